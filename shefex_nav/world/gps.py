"""GPS receiver: a fix of the antenna's position and velocity on every whole second, or why there is none.

A satellite is tracked if its signal clears the Earth, arrives outside the blind cones of the antenna and is
not lost in the spin. Range errors of the tracked satellites, white in time, go through the least-squares
solution with a receiver clock, so that their scatter has the covariance which the receiver reports::

    R_r_e = sigma_range^2 [(H^T H)^-1]_rr,   R_v_e = sigma_range_rate^2 [(H^T H)^-1]_rr,   H = [-u_e^T, 1]

(Groves, Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, 2nd ed., section 9.4.3).
Ionosphere, troposphere and orbit errors are in sigma_range; errors correlated in time are not modelled.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gnss
from shefex_nav.geometry import frames, rotation
from shefex_nav.records import GpsFix

MIN_SATELLITES = 4  # position and receiver clock


class Outage(NamedTuple):
    """No solution from an event on, for a time drawn between two limits."""

    event: str  # name of the Event; if it does not happen there is no outage
    shortest_s: float
    longest_s: float


class GpsParams(NamedTuple):
    """Receiver, antenna and how the flight disturbs them."""

    l_ba_b: np.ndarray  # (3,) m, IMU to antenna
    latency_s: float  # from the instant measured to the fix in the on-board computer
    sigma_range: float  # m, range to one satellite, all causes
    sigma_range_rate: float  # m/s
    elevation_mask: float  # rad; a signal below it must pass above lowest_height
    lowest_height: float  # m above the ellipsoid, of the path of such a signal
    blind_nose: float  # rad, half angle of the cone about the nose in which the antenna receives nothing
    blind_tail: float  # rad, the same about the tail
    max_pdop: float  # no solution above it
    spin_threshold: float  # rad/s, roll rate from which reception suffers
    spin_loss: float  # probability, per fix and satellite, that it is not tracked in the spin
    spin_noise_factor: float  # on both sigmas in the spin
    outages: tuple[Outage, ...]


class Antenna(NamedTuple):
    """True state of the antenna at the m epochs of the fixes."""

    t_s: np.ndarray  # (m,)
    r_ea_e: np.ndarray  # (m, 3) m
    v_ea_e: np.ndarray  # (m, 3) m/s, relative to the Earth
    nose_e: np.ndarray  # (m, 3) direction of body x
    roll_rate: np.ndarray  # (m,) rad/s


def measure(params, trajectory, events, earth, constellation, rng):
    """Fixes on every whole second of a trajectory.

    Parameters
    ----------
    params : GpsParams
    trajectory : Trajectory
    events : sequence of Event; those named by `params.outages` interrupt the solution
    earth : EarthRotation
    constellation : environment.gnss.Constellation
    rng : Generator; as many numbers are drawn whatever is visible, so each satellite keeps its errors

    Returns
    -------
    list of GpsFix, one a second, valid or not
    """
    antenna = antenna_states(trajectory, earth, params.l_ba_b)
    satellites_e = gnss.positions_e(constellation, antenna.t_s)
    u_e = gnss.lines_of_sight_e(antenna.r_ea_e, satellites_e)
    errors = rng.standard_normal((2, *u_e.shape[:2]))
    fortune = rng.random(u_e.shape[:2])
    reasons = outage_reasons(params.outages, events, antenna.t_s, rng.random(len(params.outages)))

    spinning = np.abs(antenna.roll_rate) > params.spin_threshold
    tracked = visible(params, antenna, u_e) & ~(spinning[:, None] & (fortune < params.spin_loss))
    pdop, cofactor, per_sigma = solve(u_e, tracked, errors)
    factor = np.where(spinning, params.spin_noise_factor, 1.0)
    sigma_r, sigma_v = params.sigma_range * factor, params.sigma_range_rate * factor
    return [
        _fix(
            params,
            float(antenna.t_s[k]),
            antenna.r_ea_e[k] + sigma_r[k] * per_sigma[0, k],
            antenna.v_ea_e[k] + sigma_v[k] * per_sigma[1, k],
            sigma_r[k] ** 2 * cofactor[k],
            sigma_v[k] ** 2 * cofactor[k],
            int(tracked[k].sum()),
            float(pdop[k]),
            reasons[k],
        )
        for k in range(len(antenna.t_s))
    ]


def antenna_states(trajectory, earth, l_ba_b):
    """True states of the antenna on whole seconds.

    r_ea_e = r_eb_e + C_eb l_ba_b,   v_ea_e = v_eb_e + C_eb (omega_eb_b x l_ba_b)

    Returns
    -------
    Antenna
    """
    t_s = trajectory.t_s
    seconds = np.arange(np.ceil(t_s[0] - 1e-6), np.floor(t_s[-1] + 1e-6) + 1.0)
    samples = np.searchsorted(t_s, seconds - 1e-6)
    if np.any(np.abs(t_s[samples] - seconds) > 1e-6):
        raise ValueError(f"GPS fixes are due on whole seconds, but no sample of truth is (start {t_s[0]} s)")
    r_ea_e, v_ea_e, nose_e = (np.empty((len(seconds), 3)) for _ in range(3))
    l_ba_b = np.asarray(l_ba_b, dtype=float)
    for n, k in enumerate(samples):
        C_ib = rotation.dcm_from_quat(trajectory.q_ib[k])
        r_ea_i = trajectory.r_i[k] + C_ib @ l_ba_b
        v_ea_i = trajectory.v_i[k] + C_ib @ rotation.cross(trajectory.omega_ib_b[k], l_ba_b)
        r_ea_e[n], v_ea_e[n] = frames.ecef_from_inertial(earth, seconds[n], r_ea_i, v_ea_i)
        nose_e[n] = frames.dcm_ie(earth, seconds[n]).T @ C_ib[:, 0]
    return Antenna(seconds, r_ea_e, v_ea_e, nose_e, trajectory.omega_ib_b[samples, 0])


def visible(params, antenna, u_e):
    """Whether a satellite's signal passes the Earth and meets the antenna. (m, n, 3) -> (m, n) bool."""
    clears_earth = (gnss.elevation(antenna.r_ea_e, u_e) >= params.elevation_mask) | (
        gnss.lowest_height(antenna.r_ea_e, u_e) >= params.lowest_height
    )
    to_nose = np.arccos(np.clip(np.einsum("mnk,mk->mn", u_e, antenna.nose_e), -1.0, 1.0))
    return clears_earth & (to_nose >= params.blind_nose) & (to_nose <= np.pi - params.blind_tail)


def solve(u_e, tracked, errors):
    """Least-squares solution for unit range errors.

    Parameters
    ----------
    u_e : (m, n, 3) lines of sight
    tracked : (m, n) bool
    errors : (2, m, n) errors of range and of range rate in units of their sigma

    Returns
    -------
    pdop : (m,) NaN with fewer than four satellites
    cofactor : (m, 3, 3) covariance of the position for unit sigma, frame e
    per_sigma : (2, m, 3) errors of position and velocity for unit sigma, frame e
    """
    H = np.concatenate([-u_e, np.ones_like(u_e[..., :1])], axis=-1) * tracked[..., None]
    information = np.einsum("mni,mnj->mij", H, H)
    unsolvable = tracked.sum(axis=1) < MIN_SATELLITES
    information[unsolvable] = np.eye(4)
    inverse = np.linalg.inv(information)
    inverse[unsolvable] = np.nan
    cofactor = inverse[:, :3, :3]
    per_sigma = np.einsum("mij,mnj,amn->ami", inverse, H, errors, optimize=["einsum_path", (1, 2), (0, 1)])
    return np.sqrt(np.trace(cofactor, axis1=1, axis2=2)), cofactor, per_sigma[..., :3]


def outage_reasons(outages, events, t_s, fractions):
    """Why the receiver has no solution at each epoch, as far as events of the flight are the cause.

    fractions: (number of outages,) in [0, 1), where the duration lies between its limits.
    -> list of str, empty where there is no outage
    """
    reasons = [""] * len(t_s)
    for outage, fraction in zip(outages, fractions, strict=True):
        duration_s = outage.shortest_s + fraction * (outage.longest_s - outage.shortest_s)
        for event in events:
            if event.name == outage.event:
                for k in np.flatnonzero((t_s >= event.t_s) & (t_s < event.t_s + duration_s)):
                    reasons[k] = f"signals lost at {event.name}"
    return reasons


def _fix(params, t_s, r_ea_e, v_ea_e, R_r_e, R_v_e, n_satellites, pdop, reason):
    """GpsFix, without a solution if there is a reason against it."""
    if reason:
        n_satellites, pdop = 0, np.nan
    elif n_satellites < MIN_SATELLITES:
        reason = f"{n_satellites} satellites tracked"
    elif pdop > params.max_pdop:
        reason = f"pdop {pdop:.0f}"
    if reason:
        r_ea_e, v_ea_e = np.full(3, np.nan), np.full(3, np.nan)
        R_r_e, R_v_e = np.full((3, 3), np.nan), np.full((3, 3), np.nan)
    return GpsFix(
        t_valid_s=t_s,
        t_available_s=t_s + params.latency_s,
        valid=not reason,
        r_ea_e=r_ea_e,
        v_ea_e=v_ea_e,
        R_r_e=R_r_e,
        R_v_e=R_v_e,
        n_satellites=n_satellites,
        pdop=pdop,
        reason=reason,
    )
