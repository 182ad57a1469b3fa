"""Records of one instant, found in two sorted arrays of times; samples that follow each other; some rows."""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.records import Phase

APART_S = 1.0  # [E] of the ends of two series of one flight


def same_times(t_a, t_b):
    """Indices into two sorted arrays of the times they have in common."""
    if not len(t_a) or not len(t_b):
        return np.zeros(0, int), np.zeros(0, int)
    k = np.searchsorted(t_b, t_a - SAME_S).clip(0, len(t_b) - 1)
    both = np.abs(t_b[k] - t_a) <= SAME_S
    return np.flatnonzero(both), k[both]


def stretches(flags):
    """Runs of flagged samples: list of (first, end), the end behind the last one. (n,) bool"""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, dtype=np.int8), [0]]))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def at_rows(record, rows):
    """A record of arrays with some of its rows; what it does not have, None, stays so."""
    return record._make(None if one is None else np.ascontiguousarray(one[rows]) for one in record)


def is_partly_true(data):
    """Whether the truth of a RunData is of a part of its solution alone: an end is more than APART_S away."""
    true_s, t_s = data.truth.t_s, data.nav.t_s
    if not len(true_s) or not len(t_s):
        return False
    return bool(true_s[0] - t_s[0] > APART_S or t_s[-1] - true_s[-1] > APART_S)


def whole_time(data):
    """Mission time of the first and the last sample of truth or solution, (s, s); None without any."""
    both = [t_s for t_s in (data.truth.t_s, data.nav.t_s) if len(t_s)]
    return (min(float(t[0]) for t in both), max(float(t[-1]) for t in both)) if both else None


def phase_at(truth, t_s):
    """Phase of the last sample of truth not later than each time, -1 before the first.

    Truth of arrays or Trajectory, (M,) s -> (M,)
    """
    k = np.searchsorted(truth.t_s, t_s + SAME_S) - 1
    return np.where(k >= 0, truth.phase[k.clip(0)], -1) if len(truth.t_s) else np.full(len(t_s), -1)


def pointing_error(control, truth):
    """Angle between true and wanted attitude, or roll axes, in the phases POINTING, where one is wanted.

    ControlSample of arrays or ControlHistory, Truth of arrays or Trajectory -> (K,) rad, K <= M
    """
    error = control.pointing_error
    wanted = np.isfinite(error).any(axis=1) & (phase_at(truth, control.t_s) == Phase.POINTING)
    return np.sqrt(np.nansum(error[wanted] ** 2, axis=1))
