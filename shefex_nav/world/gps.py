"""GPS receiver: fixes of the antenna's position and velocity at a steady rate, one of them on every whole
second, or why there is none, and what its channels measure.

A satellite is tracked if its signal clears the Earth, arrives outside the blind cones of the antenna and is
not lost in the spin (`gps_receiver`: nor limited, nor to be acquired again). Range errors of the tracked
satellites go through the least-squares solution with a receiver clock, linear about the truth, so that their
scatter has the covariance which the receiver reports::

    R_r_e = A (range_noise^2 I + Sigma) A^T,   A = (H^T H)^-1 H^T,   H = [-u_e^T, 1],   likewise R_v_e

(Groves, Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, 2nd ed., section 9.4.3).
Sigma is the covariance of the errors that last (`gps_errors`), those that all satellites share included: in
the layer of the ionosphere they go into the receiver's clock, above it into the height as well. Unless errors
that last are asked for, ionosphere, troposphere and orbits are in range_noise, which is white in time. The
pseudoranges and range rates (`gps_receiver`) have the very same errors.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.environment import gnss
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.geometry.elementary import arccos
from shefex_nav.records import GpsFix, GpsRanges
from shefex_nav.world import gps_errors, gps_receiver
from shefex_nav.world.absent import GPS_LASTING, GPS_NOISE

MIN_SATELLITES = 4  # position and receiver clock


class Antenna(NamedTuple):
    """True state of the antenna at the m epochs of the fixes."""

    t_s: np.ndarray  # (m,)
    r_ea_e: np.ndarray  # (m, 3) m
    v_ea_e: np.ndarray  # (m, 3) m/s, relative to the Earth
    nose_e: np.ndarray  # (m, 3) direction of body x
    roll_rate: np.ndarray  # (m,) rad/s


class Sky(NamedTuple):
    """Where antenna and satellites are at the fixes: the same in all runs of one flight."""

    lever_arm: tuple  # (3,) m, and
    rate: float  # Hz, of the receiver that it is for
    antenna: Antenna
    prn: np.ndarray  # (n,) int
    u_e: np.ndarray  # (m, n, 3) lines of sight
    geometry: tuple | None  # of gps_receiver.geometry; None: no ranges are wanted


class GpsData(NamedTuple):
    """What the receiver gives, one of each at a time, and where its antenna was, which it does not know."""

    fixes: list[GpsFix]
    ranges: list[GpsRanges]
    antenna: Antenna


def measure(settings, trajectory, events, earth, constellation, gps_start_s, rng, rng_errors):
    """Fixes and ranges along a trajectory: `received` of its `sky`. -> GpsData"""
    seen = sky(settings, trajectory, earth, constellation)
    return received(settings, seen, events, gps_start_s, rng, rng_errors)


def sky(settings, trajectory, earth, constellation, with_ranges=True):
    """Where antenna and satellites are along a trajectory.

    Parameters
    ----------
    settings : gps_settings.Gps
    trajectory : Trajectory
    earth : EarthRotation
    constellation : environment.gnss.Constellation
    with_ranges : False where nobody is going to look at the ranges

    Returns
    -------
    Sky
    """
    antenna = antenna_states(trajectory, earth, settings.antenna.lever_arm, settings.rate)
    u_e = gnss.lines_of_sight_e(antenna.r_ea_e, gnss.positions_e(constellation, antenna.t_s))
    geometry = None
    if with_ranges:
        geometry = gps_receiver.geometry(constellation, antenna.t_s, antenna.r_ea_e, antenna.v_ea_e)
    arm = tuple(settings.antenna.lever_arm)
    return Sky(arm, settings.rate, antenna, gnss.numbers(constellation), u_e, geometry)


def received(settings, seen, events, gps_start_s, rng, rng_errors, absent=()):
    """Fixes and ranges of a flight.

    Parameters
    ----------
    settings : gps_settings.Gps
    seen : `sky` of the flight
    events : sequence of Event; those named by `settings.outages` interrupt the solution
    gps_start_s : s, GPS time of mission time zero
    rng : Generator of noise, spin and outages; as many numbers are drawn whatever is visible, so each
        satellite keeps its errors
    rng_errors : Generator of errors that last, clock and reacquisition
    absent : of `absent.NAMES`, errors that are in the covariances and do not happen

    Returns
    -------
    GpsData; without ranges if `seen` has no geometry of them
    """
    if (seen.lever_arm, seen.rate) != (tuple(settings.antenna.lever_arm), settings.rate):
        raise ValueError("the sky is that of another antenna, or of fixes at another rate")
    antenna, prn, u_e = seen.antenna, seen.prn, seen.u_e
    t_s = antenna.t_s
    white = rng.standard_normal((2, *u_e.shape[:2])) * (GPS_NOISE not in absent)
    fortune = rng.random(u_e.shape[:2])
    reasons = outage_reasons(settings.outages, events, t_s, rng.random(len(settings.outages)))
    fractions = rng_errors.random(u_e.shape[:2])
    clock = gps_errors.clock(settings.clock, t_s, rng_errors)

    spinning = np.abs(antenna.roll_rate) > settings.spin.threshold
    lit = np.array([not reason for reason in reasons])[:, None]
    present = visible(settings, antenna, u_e)
    if settings.reacquisition is not None:
        present = gps_receiver.reacquired(present & lit, t_s, settings.reacquisition, fractions)
    tracked = present & ~(spinning[:, None] & (fortune < settings.spin.loss))
    tracked = gps_receiver.limited(tracked, t_s, settings.only, prn, u_e)
    silent = gps_receiver.silenced(settings, antenna.r_ea_e, antenna.v_ea_e)
    reasons = [reason or why for reason, why in zip(reasons, silent, strict=True)]
    told = lit & np.array([not why for why in silent])[:, None]

    factor = np.where(spinning, settings.spin.noise_factor, 1.0)
    sigmas = np.stack([settings.range_noise * factor, settings.range_rate_noise * factor])
    lasting = _lasting(settings.errors, gps_start_s, antenna, u_e, rng_errors, absent)
    fixes = _fixes(settings, antenna, u_e, tracked, white, sigmas, lasting, reasons)
    errors = sigmas[..., None] * white + (0.0 if lasting is None else lasting.error)
    ranges = []
    if seen.geometry is not None:
        reception = gps_receiver.Reception(t_s, prn, tracked & told, reasons)
        given = seen.geometry, clock, errors, sigmas, reception, settings.latency
        ranges = gps_receiver.ranges(*given, lasting and lasting.sigmas)
    return GpsData(fixes, ranges, antenna)


def _lasting(errors, gps_start_s, antenna, u_e, rng, absent):
    """Errors of the ranges that last; None of a receiver without any."""
    if not errors:
        return None
    lasting = gps_errors.range_errors(errors, gps_start_s, antenna.t_s, antenna.r_ea_e, u_e, rng)
    return lasting._replace(error=lasting.error * (GPS_LASTING not in absent))


def stamped(messages, offset_s):
    """Messages of a receiver whose clock gives instants that are later by offset_s than they are. -> list"""
    if not offset_s:
        return messages
    return [message._replace(t_valid_s=message.t_valid_s + offset_s) for message in messages]


def _fixes(settings, antenna, u_e, tracked, white, sigmas, lasting, reasons):
    """GpsFix of every epoch: errors and covariance by least squares. -> list"""
    pdop, cofactor, per_sigma = solve(u_e, tracked, white)
    error, R = sigmas[..., None] * per_sigma, sigmas[..., None, None] ** 2 * cofactor
    if lasting is not None:
        error = error + solve(u_e, tracked, lasting.error)[2]
        R = R + spread(u_e, tracked, lasting.variance, lasting.shared)
    r_ea_e, v_ea_e = antenna.r_ea_e + error[0], antenna.v_ea_e + error[1]
    return [
        _sent(settings, GpsFix(t, t + settings.latency, True, r, v, R_r, R_v, int(n), float(dop), reason))
        for t, r, v, R_r, R_v, n, dop, reason in zip(
            antenna.t_s.tolist(), r_ea_e, v_ea_e, R[0], R[1], tracked.sum(axis=1), pdop, reasons, strict=True
        )
    ]


def antenna_states(trajectory, earth, l_ba_b, rate=1.0):
    """True states of the antenna when fixes are due, `rate` times a second from whole seconds on.

    r_ea_e = r_eb_e + C_eb l_ba_b,   v_ea_e = v_eb_e + C_eb (omega_eb_b x l_ba_b)

    Returns
    -------
    Antenna
    """
    t_s = trajectory.t_s
    first, last = np.ceil(rate * (t_s[0] - SAME_S)), np.floor(rate * (t_s[-1] + SAME_S))
    seconds = np.arange(first, last + 1.0) / rate
    samples = np.searchsorted(t_s, seconds - SAME_S)
    if np.any(np.abs(t_s[samples] - seconds) > SAME_S):
        raise ValueError(
            f"GPS fixes are due {rate:g} times a second, but no sample of truth is (start {t_s[0]} s)"
        )
    r_ea_e, v_ea_e, nose_e = (np.empty((len(seconds), 3)) for _ in range(3))
    l_ba_b = np.asarray(l_ba_b, dtype=float)
    for n, k in enumerate(samples):
        C_ib = rotation.dcm_from_quat(trajectory.q_ib[k])
        r_ea_i = trajectory.r_i[k] + C_ib @ l_ba_b
        v_ea_i = trajectory.v_i[k] + C_ib @ rotation.cross(trajectory.omega_ib_b[k], l_ba_b)
        r_ea_e[n], v_ea_e[n] = frames.ecef_from_inertial(earth, seconds[n], r_ea_i, v_ea_i)
        nose_e[n] = frames.dcm_ie(earth, seconds[n]).T @ C_ib[:, 0]
    return Antenna(seconds, r_ea_e, v_ea_e, nose_e, trajectory.omega_ib_b[samples, 0])


def visible(settings, antenna, u_e):
    """Whether a satellite's signal passes the Earth and meets the antenna. (m, n, 3) -> (m, n) bool."""
    clears_earth = (gnss.elevation(antenna.r_ea_e, u_e) >= settings.elevation_mask) | (
        gnss.lowest_height(antenna.r_ea_e, u_e) >= settings.lowest_ray_height
    )
    to_nose = arccos(np.clip(np.einsum("mnk,mk->mn", u_e, antenna.nose_e), -1.0, 1.0))
    nose, tail = settings.antenna.blind_nose, np.pi - settings.antenna.blind_tail
    return clears_earth & (to_nose >= nose) & (to_nose <= tail)


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
    H, information, unsolvable = _normal_equations(u_e, tracked)
    inverse = np.linalg.inv(information)
    inverse[unsolvable] = np.nan
    cofactor = inverse[:, :3, :3]
    per_sigma = np.einsum("mij,mnj,amn->ami", inverse, H, errors, optimize=["einsum_path", (1, 2), (0, 1)])
    return np.sqrt(np.trace(cofactor, axis1=1, axis2=2)), cofactor, per_sigma[..., :3]


def _normal_equations(u_e, tracked):
    """H (m, n, 4), H^T H (m, 4, 4), the unit matrix without a solution, and where there is none (m,)."""
    H = np.concatenate([-u_e, np.ones_like(u_e[..., :1])], axis=-1) * tracked[..., None]
    information = np.einsum("mni,mnj->mij", H, H)
    unsolvable = tracked.sum(axis=1) < MIN_SATELLITES
    information[unsolvable] = np.eye(4)
    return H, information, unsolvable


def spread(u_e, tracked, variances, shared):
    """Covariance of the least-squares position for ranges with variances of their own.

    u_e : (m, n, 3); tracked : (m, n) bool; variances : (a, m, n)
    shared : (k, a, m, n), what k errors that all satellites share do to each, one sigma; in the variances
    -> (a, m, 3, 3), NaN without a solution
    """
    H, information, unsolvable = _normal_equations(u_e, tracked)
    A = np.linalg.solve(information, np.swapaxes(H, 1, 2))[:, :3]
    A[unsolvable] = np.nan
    moved = np.einsum("min,kamn->kami", A, shared)
    own = np.einsum("min,amn,mjn->amij", A, variances - (shared**2).sum(axis=0), A)
    return own + np.einsum("kami,kamj->amij", moved, moved)


def as_kind(fixes, kind):
    """GpsFix as a receiver tells them: 'full', by 'position' alone, by latitude and longitude ('horizontal').

    list of GpsFix -> list
    """
    if kind == "full":
        return fixes
    nothing = {"v_ea_e": np.full(3, np.nan), "R_v_e": np.full((3, 3), np.nan)}
    fixes = [fix._replace(**nothing) for fix in fixes]
    return fixes if kind == "position" else [_horizontal(fix) for fix in fixes]


def _horizontal(fix):
    """A GpsFix of position without its height: on the ellipsoid, without a variance along the vertical."""
    if not fix.valid:
        return fix._replace(horizontal=True)
    latitude, longitude, _ = wgs84.geodetic_from_ecef(fix.r_ea_e)
    level = wgs84.dcm_en(latitude, longitude)[:, :2]
    R_r_e = level @ (level.T @ fix.R_r_e @ level) @ level.T
    foot = wgs84.ecef_from_geodetic(latitude, longitude, 0.0)
    return fix._replace(r_ea_e=foot, R_r_e=R_r_e, horizontal=True)


def outage_reasons(outages, events, t_s, fractions):
    """Why the receiver has no solution at each epoch, as far as events of the flight are the cause.

    fractions: (number of outages,) in [0, 1), where the duration lies between its limits.
    -> list of str, empty where there is no outage
    """
    reasons = [""] * len(t_s)
    for outage, fraction in zip(outages, fractions, strict=True):
        duration_s = outage.shortest + fraction * (outage.longest - outage.shortest)
        for event in events:
            if event.name == outage.event:
                for k in np.flatnonzero((t_s >= event.t_s) & (t_s < event.t_s + duration_s)):
                    reasons[k] = f"signals lost at {event.name}"
    return reasons


def _sent(settings, fix):
    """A GpsFix as the receiver gives it: without a solution if there is a reason against it."""
    reason = fix.reason
    if reason:
        fix = fix._replace(n_satellites=0, pdop=np.nan)
    elif fix.n_satellites < MIN_SATELLITES:
        reason = f"{fix.n_satellites} satellites tracked"
    elif fix.pdop > settings.max_pdop:
        reason = f"pdop {fix.pdop:.0f}"
    return gps_receiver.unsolved(fix, reason) if reason else fix
