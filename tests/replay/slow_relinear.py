"""The slow, obvious reference of `relinear`: dense matrices, step by step.

A filter is linear about its own estimates. Before the stars those may be off by a degree about the roll axis,
and what a smoother later takes from them is off by the square of that: 1.5e-4 of every acceleration that the
sensors sense, 40 micro gee in a vehicle that tumbles at 1.5 Hz. The first smoothing is off by hundredths of a
degree, so it is linear about that a second time: a Kalman filter about a given trajectory x with errors of
mean m and covariance P, and the adjoint back over it. A smoother that is repeated so is a Gauss-Newton method
for the most probable trajectory (Bell, SIAM J. Optim. 4 (1994) 626).

Of an interval from x to y, with f(x) what the strapdown makes of x and d = y (-) f(x)::

    m <- G (Phi m - d),   P <- G (Phi P Phi^T + Q) G^T,   G = Jr(d) for the attitude

Of a measurement of GPS or of single stars, linear about the filter's estimate x' as z = H e' + noise, with
d = x (-) x'::

    z <- z - H d,   H <- H Jr(d)^-1 for the attitude

which is right to the square of d times the arm of an antenna, parts of a millimetre a second. Attitudes of
the camera are compared anew. Whether a measurement is believed is not decided again.
"""

from typing import Any, NamedTuple

import numpy as np
import slow_smoother as smoother

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import prediction
from shefex_nav.onboard.navigation.fusion import Interval
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.measurements import star_attitude
from shefex_nav.onboard.navigation.state import (
    ATT,
    POS,
    VEL,
    X_Q,
    X_R,
    X_V,
    corrected,
    pack,
    right_jacobian,
    unpack,
)


class Way(NamedTuple):
    """An interval of the first pass."""

    t_begin_s: float
    t_end_s: float
    imu: Any  # ImuWindow of the tick
    x: np.ndarray  # packed nominal values at its end, of the trajectory to be linear about


class Seen(NamedTuple):
    """A measurement of the first pass, or what made one doubtful: then it has no rows."""

    x_then: np.ndarray  # packed nominal values that it was linear about
    z: np.ndarray  # (m,)
    H: np.ndarray  # (m, n)
    R: np.ndarray  # (m, m)
    P: Any  # (n, n) what was added to the covariance before it, or of the blocks of `cut`; None: nothing
    cut: tuple  # slices of the blocks that were forgotten with all their ties to others
    star: Any  # StarFix, where it is an attitude of the camera
    x: np.ndarray  # packed nominal values after it, of the trajectory to be linear about


class Filtered(NamedTuple):
    """Errors about the trajectory, after a step; and what the adjoint needs of the step."""

    mean: np.ndarray  # (n,)
    P: np.ndarray  # (n, n)
    Phi: Any = None  # (n, n) of an interval or a turn
    update: Any = None  # arguments of `smoother.before_update`
    cut: tuple = ()


def step_of(step, x):
    """Way or Seen of an Interval or a Correction; x : packed nominal values after it, to be linear about."""
    if type(step) is Interval:
        return Way(step.t_begin_s, step.t_end_s, step.imu, x)
    P = None if step.fate == Fate.USED else step.P_forgotten if step.cut else step.P_forgotten - step.P
    star = step.fix if step.sensor == "star_tracker" else None
    return Seen(pack(step.state), step.z, step.H, step.R, P, step.cut, star, x)


def difference(layout, x, y):
    """Error e of packed nominal values x against y: y = x (+) e. -> (n,)"""
    e = np.empty(layout.n)
    e[POS], e[VEL] = y[X_R] - x[X_R], y[X_V] - x[X_V]
    e[ATT] = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(x[X_Q]), y[X_Q]))
    e[ATT.stop :] = y[layout.nominal] - x[layout.nominal]
    return e


def turn_of(layout, d):
    """G = Jr(d) for the attitude, the identity for all others: (n, n)."""
    G = np.eye(layout.n)
    G[ATT, ATT] = right_jacobian(d[ATT])
    return G


def origin(nav, first, e):
    """Packed nominal values that are better by e than a Tick, and the errors about them as it knew them.

    fusion.Filter, history.Tick, (n,) -> (X,), Filtered
    """
    G = turn_of(nav.layout, e)
    return corrected(first.x, e, nav.layout.nominal), Filtered(-G @ e, G @ first.P @ G.T)


def follow(nav, before, x, step):
    """A step further.

    Parameters
    ----------
    nav : fusion.Filter, of which parameters and layout are used
    before : Filtered
    x : packed nominal values before it
    step : Way or Seen

    Returns
    -------
    Filtered
    """
    return (_on if type(step) is Way else _corrected)(nav, before, x, step)


def _on(nav, before, x, step):
    """Over a Way."""
    layout = nav.layout
    begin_s, end_s = (step.imu.length_s - (step.imu.t_end_s - t_s) for t_s in (step.t_begin_s, step.t_end_s))
    part = step.imu, begin_s, end_s
    Phi, Q = prediction.growth(nav.constants, layout, unpack(step.t_begin_s, x), *part)
    there, _ = prediction.advance(nav.constants, x, step.t_begin_s, before.P, *part)
    P = Phi @ before.P @ Phi.T + Q  # of what is not linear nothing is left about this trajectory
    d = difference(layout, there, step.x)
    J, mean = right_jacobian(d[ATT]), Phi @ before.mean - d
    Phi[ATT], mean[ATT], P[ATT] = J @ Phi[ATT], J @ mean[ATT], J @ P[ATT]
    P[:, ATT] = P[:, ATT] @ J.T
    return Filtered(mean, 0.5 * (P + P.T), Phi=Phi)


def _corrected(nav, before, x, step):
    """By a Seen."""
    layout, P, mean = nav.layout, before.P.copy(), before.mean.copy()
    held = difference(layout, x, step.x_then)
    for block in step.cut:  # it may be anything, around what the filter held for right
        P[block], P[:, block], mean[block] = 0.0, 0.0, held[block]
        P[block, block] = step.P[block, block]
    if step.P is not None and not step.cut:
        P += step.P
    d = difference(layout, x, step.x)
    G = turn_of(layout, d)
    mean, P = G @ (mean - d), G @ P @ G.T
    if not len(step.z):
        return Filtered(mean, P, Phi=G, cut=step.cut)
    z, H, R = _rows(nav, step)
    z -= H @ mean
    gain = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(layout.n) - gain @ H
    after = left @ P @ left.T + gain @ R @ gain.T
    return Filtered(mean + gain @ z, 0.5 * (after + after.T), Phi=G, update=(P, z, H, R), cut=step.cut)


def _rows(nav, step):
    """z, H, R of a Seen about the trajectory."""
    if step.star is not None:
        params = nav.params
        return star_attitude(nav.layout, step.x, step.star, params.C_bc, params.star_fix_floor)
    d, H = difference(nav.layout, step.x_then, step.x), step.H.copy()
    H[:, ATT] = H[:, ATT] @ np.linalg.inv(right_jacobian(d[ATT]))
    return step.z - step.H @ d, H, step.R


def back(adjoint, after):
    """Adjoint before a step, from that after it and the Filtered after it."""
    if after.update is not None:
        adjoint = smoother.before_update(adjoint, *after.update)
    adjoint = smoother.before_interval(adjoint, after.Phi)
    for block in after.cut:
        adjoint = smoother.before_forgetting(adjoint, block)
    return adjoint
