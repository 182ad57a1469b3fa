"""Errors of the navigation solution: truth minus estimate, and over what the filter says of itself."""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.report.pairing import same_times


def nees(errors, P):
    """Normalised squared errors: (..., m), (..., m, m) -> (...)."""
    sigma = np.sqrt(np.einsum("...ii->...i", P))
    with np.errstate(divide="ignore", invalid="ignore"):  # of a sigma of zero: NaN, nothing is known
        scaled = P / (sigma[..., :, None] * sigma[..., None, :])  # correlations: no trouble with units
        normal = np.where(sigma > 0.0, errors / sigma, np.nan)
    return np.einsum("...i,...i->...", normal, np.linalg.solve(scaled, normal[..., None])[..., 0])


def chi2_bounds(dof, probability):
    """Interval that holds a chi-square variable with a probability. Degrees of freedom -> low, high, alike"""
    from scipy.special import gammaincinv  # scipy.stats would take a second to import

    tail = 0.5 * (1.0 - probability)
    return tuple(2.0 * gammaincinv(0.5 * dof, share) for share in (tail, 1.0 - tail))


NEES_DOF = 9  # position, velocity, attitude


class NavErrors(NamedTuple):
    """Truth minus estimate over the N ticks that have both."""

    t_s: np.ndarray  # (N,)
    position_i: np.ndarray  # (N, 3) m
    velocity_i: np.ndarray  # (N, 3) m/s
    attitude_b: np.ndarray  # (N, 3) rad


def navigation_errors(data):
    """NavErrors of a RunData."""
    i, j = same_times(data.truth.t_s, data.nav.t_s)
    truth, nav = data.truth, data.nav
    return NavErrors(
        truth.t_s[i],
        truth.r_i[i] - nav.r_i[j],
        truth.v_i[i] - nav.v_i[j],
        rotvec_between(nav.q_ib[j], truth.q_ib[i]),
    )


def beside_covariance(data, errors):
    """Errors at the epochs of the logged covariance: t_s (K,), x (K, 9), P (K, 9, 9). RunData, NavErrors"""
    i, j = same_times(errors.t_s, data.covariance.t_s)
    x = np.hstack([errors.position_i[i], errors.velocity_i[i], errors.attitude_b[i]])
    return errors.t_s[i], x, data.covariance.P[j]


def normalised_errors(data, errors):
    """(t_s, NEES, sigma) at the epochs of the logged covariance: (K,), (K,), (K, 9)."""
    t_s, x, P = beside_covariance(data, errors)
    return t_s, nees(x, P), np.sqrt(np.einsum("kii->ki", P))
