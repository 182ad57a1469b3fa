"""What the receiver's channels say about the errors: pseudoranges and range rates, one row a satellite.

z = H dx + noise, noise ~ N(0, R), dx in the order of a `state.Layout`, as in `measurements`. The satellites
come with the ranges, already at transmission and in the axes e of reception; with the antenna at r_a::

    pseudorange = |r_s - r_a| + clock bias + range bias of the satellite
    range rate  = u . (v_s - v_a)/(1 + u . v_s/c) + clock drift,     u = (r_s - r_a)/|r_s - r_a|

with velocities against axes that do not turn (Groves, 2nd ed., sections 8.5 and 14.3.2). One satellite says
something about the line of sight as far as the clock is known, and two about their difference whatever it is.

Errors that last. Clock and orbit of a satellite, what the models of ionosphere and troposphere leave, and
multipath wander over minutes. The block `range_bias` has a state for each satellite and one for what all of
them share, first-order Gauss-Markov with one sigma and one correlation time for all causes together; then
innovations are as white and as large as their covariance says. A receiver says how large these errors are
(`GpsRanges.sigma_lasting`, `sigma_shared`), and each state counts for as much more or less in the range: a
ray that leads down from orbit crosses the ionosphere twice. Without the block the same covariance is added to
R: each innovation is then as large as R says, but not independent of the one before. So ranges that have
passed the gate count with more of it (`counted`), as position fixes do.
"""

import numpy as np

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry import wgs84
from shefex_nav.onboard.navigation.blocks import SATELLITES

FEWEST_TO_AGREE = 4  # satellites by which two sets of ranges are compared
LONGEST_PAIR_S = 3.0  # [E] sets further apart than this are not compared
EARTH_RATE = np.array([[0.0, -wgs84.OMEGA, 0.0], [wgs84.OMEGA, 0.0, 0.0], [0.0, 0.0, 0.0]])  # cross product


def pseudoranges(layout, state, ranges, a, sigma_bias=0.0):
    """Pseudoranges of n satellites.

    Parameters
    ----------
    layout : Layout with the block `clock`
    state : NavState at the instant of the ranges
    ranges : GpsRanges
    a : measurements.Antenna at that instant
    sigma_bias : m, of the states `range_bias`, and of errors that last of which the receiver says nothing

    Returns
    -------
    z : (n,) m;  H : (n, layout.n);  R : (n, n) m^2
    """
    rho, u, _ = lines_of_sight(ranges, a.r_e)
    H = -u @ a.J_r
    H[:, layout.places["clock"].start] = 1.0
    z = ranges.pseudorange - rho - state.clock[0]
    own, shared = _lasting(ranges, sigma_bias)
    R = np.diag(ranges.sigma_range**2)
    place, has_state = layout.places["range_bias"], ranges.prn <= SATELLITES
    if place is not None:
        rows, slots = np.flatnonzero(has_state), ranges.prn[has_state] - 1
        z[rows] -= own[rows] * state.range_bias[slots]
        z -= shared * state.range_bias[SATELLITES]
        H[rows, place.start + slots] = own[rows]
        H[:, place.start + SATELLITES] = shared
        R = R + np.diag(np.where(has_state, 0.0, own * sigma_bias) ** 2)
    elif sigma_bias:
        R = R + _covariance(own, shared, sigma_bias)
    return z, H, R


def counted(ranges, R, sigma_bias, factor):
    """Noise with which ranges count whose errors that last have no state. R (n, n) m^2 as of `pseudoranges`

    factor : `measurements.lasting_factor` of errors that last altogether
    """
    return R + (factor - 1.0) * _covariance(*_lasting(ranges, sigma_bias), sigma_bias)


def _covariance(own, shared, sigma_bias):
    """(n, n) m^2 of errors that last. own, shared : as `_lasting`"""
    return sigma_bias**2 * (np.diag(own**2) + np.outer(shared, shared))


def _lasting(ranges, sigma_bias):
    """Factors of the states `range_bias`, sigma_bias [m] each, in the ranges: own, shared. -> (n,), (n,)"""
    n = len(ranges.prn)
    if sigma_bias > 0.0 and len(ranges.sigma_lasting) == len(ranges.sigma_shared) == n:
        return ranges.sigma_lasting / sigma_bias, ranges.sigma_shared / sigma_bias
    return np.ones(n), np.zeros(n)


def range_rates(layout, state, ranges, a):
    """Range rates of n satellites; parameters as of `pseudoranges`.

    Returns
    -------
    z : (n,) m/s;  H : (n, layout.n);  R : (n, n) m^2/s^2, diagonal
    """
    rho, u, v_s = lines_of_sight(ranges, a.r_e)
    v = v_s - (a.v_e + EARTH_RATE @ a.r_e)
    stretch = 1.0 + np.sum(u * v_s, axis=1) / SPEED_OF_LIGHT
    rate = np.sum(u * v, axis=1) / stretch
    # u moves with the antenna by -(1 - u u^T)/rho; w: what the rate is the product of u with, and its change
    w = v - rate[:, None] * v_s / SPEED_OF_LIGHT
    across = w - np.sum(w * u, axis=1)[:, None] * u
    H = -(across / rho[:, None]) @ a.J_r - u @ (a.J_v + EARTH_RATE @ a.J_r)
    H /= stretch[:, None]
    H[:, layout.places["clock"].start + 1] = 1.0
    return ranges.range_rate - rate - state.clock[1], H, np.diag(ranges.sigma_range_rate**2)


def lines_of_sight(ranges, r_ea_e):
    """Distances (n,), unit vectors to the satellites, their velocities in axes that do not turn (n, 3)."""
    d = ranges.r_es_e - r_ea_e
    rho = np.sqrt(np.sum(d * d, axis=1))
    return rho, d / rho[:, None], ranges.v_es_e + ranges.r_es_e @ EARTH_RATE.T


def offset(ranges, z, R, r_ea_e):
    """What the position is off by, by the innovations of pseudoranges, whatever the clock: least squares.

    z, R : (n,), (n, n) of the ranges;  r_ea_e : (3,) of the antenna
    -> (3,) m, Earth-fixed axes, and its covariance (3, 3) by R; NaN where they do not say it
    """
    _, u, _ = lines_of_sight(ranges, r_ea_e)
    variance = np.diag(R)
    good = np.isfinite(z) & np.isfinite(variance) & np.isfinite(u).all(axis=1)
    A = np.column_stack([-u[good], np.ones(np.count_nonzero(good))]) / np.sqrt(variance[good])[:, None]
    if len(A) < FEWEST_TO_AGREE or np.linalg.matrix_rank(A) < FEWEST_TO_AGREE:
        return np.full(3, np.nan), np.full((3, 3), np.nan)
    covariance = np.linalg.inv(A.T @ A)
    found = covariance @ (A.T @ (z[good] / np.sqrt(variance[good])))
    return found[:3], covariance[:3, :3]


def ranges_agree(earlier, later, slack):
    """Whether pseudoranges changed between two GpsRanges as their range rates say (trapezoidal rule).

    slack : m per second between them, for the accelerations in between.
    It takes four satellites that both have. Ranges that did not change at all are one set repeated, and
    prove nothing.
    """
    dt_s = later.t_valid_s - earlier.t_valid_s
    common, i, j = np.intersect1d(earlier.prn, later.prn, return_indices=True)
    if not 0.0 < dt_s <= LONGEST_PAIR_S or len(common) < FEWEST_TO_AGREE:
        return False
    change = later.pseudorange[j] - earlier.pseudorange[i]
    if np.any(change == 0.0):
        return False
    gap = change - 0.5 * dt_s * (earlier.range_rate[i] + later.range_rate[j])
    variance = earlier.sigma_range[i] ** 2 + later.sigma_range[j] ** 2 + (slack * dt_s) ** 2
    return bool(np.all(gap**2 <= 9.0 * variance))
