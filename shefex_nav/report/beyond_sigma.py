"""Errors that are far beyond the sigmas that the navigation reports: which, by how much, since when.

The measure is the root of the normalised squared error per degree of freedom of a block (position, velocity,
attitude): 1 on average where the covariance is right.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.records import QUANTITIES
from shefex_nav.report.navigation_errors import beside_covariance
from shefex_nav.report.nees import nees
from shefex_nav.report.pairing import stretches

FAR = 5.0  # times the sigmas; by chance one epoch in 10^15
LASTING_S = 1.0  # an error that is over sooner is not told
BLOCKS = {name: slice(3 * k, 3 * k + 3) for k, name in enumerate(QUANTITIES)}


class Beyond(NamedTuple):
    """A stretch of time in which a quantity's errors are far beyond its sigmas."""

    quantity: str
    from_s: float
    until_s: float | None  # None: to the end of the covariances
    times: float  # at most


def ratios(data, errors):
    """Root of NEES per degree of freedom at the epochs of the covariance: t_s (K,), {quantity: (K,)}.

    data : RunData;  errors : navigation_errors.NavErrors
    """
    t_s, x, P = beside_covariance(data, errors)
    found = {name: np.sqrt(nees(x[:, at], P[:, at, at]) / 3.0) for name, at in BLOCKS.items()}
    return t_s, found


def stretches_of(data, errors):
    """Every Beyond of a RunData: list, in the order of the quantities. Arguments as of `ratios`"""
    t_s, found = ratios(data, errors)
    out = []
    for quantity, ratio in found.items():
        for first, end in stretches(_closed(t_s, ratio > FAR)):
            if t_s[end - 1] - t_s[first] >= LASTING_S - SAME_S:
                until_s = None if end == len(t_s) else float(t_s[end])
                most = float(np.nanmax(ratio[first:end]))
                out.append(Beyond(quantity, float(t_s[first]), until_s, most))
    return out


def _closed(t_s, flags, gap_s=10.0):
    """The same flags, with short gaps between flagged times filled. (K,), (K,) bool"""
    flags, found = flags.copy(), np.flatnonzero(flags)
    for a, b in zip(found[:-1].tolist(), found[1:].tolist(), strict=True):
        if b > a + 1 and t_s[b] - t_s[a] < gap_s:
            flags[a:b] = True
    return flags
