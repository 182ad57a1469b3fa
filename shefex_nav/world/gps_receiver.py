"""Which of the satellites in view a receiver tracks: reacquisition after a loss, and limits; where it is
silent by order of its maker; and what its channels measure, of signals that take a fourteenth of a second.

The satellite is where it was at transmission, in axes that have turned with the Earth since (Sagnac)::

    rho = |R3(omega tau) r_s(t - tau) - r_a(t)|,   tau = rho/c
    drho/dt = u . (v_s - v_a)/(1 + u . v_s/c),     v_s, v_a inertial

the denominator because the satellite moves less during transmission than the receiver's clock says (Groves,
2nd ed., sections 8.5.2, 8.5.3 and 9.3). Relativity of the satellite's clock is in what it broadcasts. Epochs
are whole seconds of the mission's time, as of a receiver whose time pulse is steered; its bias of time is
in the pseudoranges alone, without the metres that the vehicle moves in it.

A solution that freezes, and other faults: `world.faults`.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.environment import gnss
from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry import wgs84
from shefex_nav.records import GpsRanges

LIGHT_TIME_PASSES = 4  # each takes the error of the range down by a factor of 1e5: satellite over light speed
LASTING = "sigma_lasting", "sigma_shared"  # fields of GpsRanges
LONG = 0.9  # of the time that the best satellite is tracked, for one that counts as tracked long


def reacquired(present, t_s, reacquisition, fractions):
    """Which signals are tracked: those that have been there for long enough since they came back.

    Parameters
    ----------
    present : (m, n) bool, signals that could be tracked
    t_s : (m,) s
    reacquisition : gps_settings.Reacquisition
    fractions : (m, n) in [0, 1), where the time lies that a signal coming back at an epoch needs

    Returns
    -------
    (m, n) bool; what is there at the first epoch is tracked at once
    """
    wait_s = reacquisition.shortest + fractions * (reacquisition.longest - reacquisition.shortest)
    tracked = np.zeros_like(present)
    ready_s, before = np.full(present.shape[1], -np.inf), present[0]
    for k, now in enumerate(present):
        back = now & ~before
        ready_s[back] = t_s[k] + wait_s[k, back]
        tracked[k] = now & (t_s[k] >= ready_s - SAME_S)
        before = now
    return tracked


def limited(tracked, t_s, limits, prn, u_e):
    """The same without the satellites that `limits`, a sequence of gps_settings.Only, leave out.

    tracked : (m, n) bool;  prn : (n,);  u_e : (m, n, 3) lines of sight -> (m, n) bool
    """
    tracked = tracked.copy()
    for limit in limits:
        during = _during(t_s, limit)
        if not during.any():  # it is over before the flight, or begins after it
            continue
        if limit.prn:
            kept = np.isin(prn, limit.prn)
        else:
            kept = apart(tracked[during].sum(axis=0), limit.satellites or 0, u_e[during].mean(axis=0))
        tracked[during] &= kept
    return tracked


def apart(seconds, count, u_e):
    """Choice of satellites that are tracked long and stand in different directions.

    The one that is tracked longest, then each time the one whose smallest angle to the chosen is largest.

    seconds : (n,) how long each is tracked;  u_e : (n, 3) mean lines of sight -> (n,) bool
    """
    chosen = np.zeros(len(seconds), dtype=bool)
    good = (seconds > 0) & (seconds >= LONG * seconds.max(initial=0))
    for _ in range(min(count, int(good.sum()))):
        if not chosen.any():
            chosen[np.argmax(seconds)] = True
            continue
        nearest = np.max(u_e @ u_e[chosen].T, axis=1)  # cosine of the smallest angle
        chosen[np.argmin(np.where(good & ~chosen, nearest, np.inf))] = True
    return chosen


def silenced(settings, r_ea_e, v_ea_e):
    """Why a receiver tells nothing at each epoch although it goes on tracking: it is beyond the speed or the
    height for which it may be sold.

    settings : gps_settings.Gps;  r_ea_e, v_ea_e : (m, 3) m, m/s -> list of str, empty where it tells
    """
    reasons = [""] * len(r_ea_e)
    if np.isfinite(settings.highest_height):
        for k, r_e in enumerate(r_ea_e):
            if wgs84.geodetic_from_ecef(r_e)[2] > settings.highest_height:
                reasons[k] = f"beyond its {1e-3 * settings.highest_height:g} km"
    if np.isfinite(settings.highest_speed):
        for k in np.flatnonzero(np.linalg.norm(v_ea_e, axis=1) > settings.highest_speed):
            reasons[k] = reasons[k] or f"beyond its {settings.highest_speed:g} m/s"
    return reasons


def unsolved(fix, reason, **more):
    """A GpsFix without a solution, and why. more : of its fields"""
    nothing, unknown = np.full(3, np.nan), np.full((3, 3), np.nan)
    return fix._replace(
        valid=False, r_ea_e=nothing, v_ea_e=nothing, R_r_e=unknown, R_v_e=unknown, reason=reason, **more
    )


def _during(t_s, span):
    """(m,) bool: epochs from start on and before end."""
    return (t_s >= span.start - SAME_S) & (t_s < span.end - SAME_S)


class Reception(NamedTuple):
    """Which of n satellites are received at m epochs."""

    t_s: np.ndarray  # (m,)
    prn: np.ndarray  # (n,) int
    tracked: np.ndarray  # (m, n) bool
    reasons: list  # (m,) str, why nothing is tracked


def geometry(constellation, t_s, r_ea_e, v_ea_e):
    """Ranges and range rates without any error, and where the signals came from.

    Parameters
    ----------
    constellation : gnss.Constellation
    t_s : (m,) s, of reception
    r_ea_e, v_ea_e : (m, 3) m, m/s, antenna, relative to the Earth

    Returns
    -------
    rho, rho_rate : (m, n) m, m/s
    r_es_e, v_es_e : (m, n, 3) m, m/s, satellites at transmission in the axes e of reception
    """
    tau = np.full((len(t_s), len(constellation.node)), 0.075)
    for _ in range(LIGHT_TIME_PASSES):
        r_e, v_e = gnss.states_e(constellation, t_s[:, None] - tau)
        r_es_e, v_es_e = _rotated_with_earth(r_e, tau), _rotated_with_earth(v_e, tau)
        tau = np.linalg.norm(r_es_e - r_ea_e[:, None, :], axis=-1) / SPEED_OF_LIGHT
    rho, rho_rate = between(r_es_e, v_es_e, r_ea_e, v_ea_e)
    return rho, rho_rate, r_es_e, v_es_e


def between(r_es_e, v_es_e, r_ea_e, v_ea_e):
    """Ranges and range rates of satellites at transmission: the formulas above.

    (..., n, 3), (..., n, 3), (..., 3), (..., 3) m, m/s, axes e of reception -> (..., n) m, (..., n) m/s
    """
    d = r_es_e - r_ea_e[..., None, :]
    rho = np.linalg.norm(d, axis=-1)
    u = d / rho[..., None]
    earth_rate = np.array([0.0, 0.0, wgs84.OMEGA])
    v_s = v_es_e + np.cross(earth_rate, r_es_e)
    v_a = (v_ea_e + np.cross(earth_rate, r_ea_e))[..., None, :]
    rho_rate = np.sum(u * (v_s - v_a), axis=-1) / (1.0 + np.sum(u * v_s, axis=-1) / SPEED_OF_LIGHT)
    return rho, rho_rate


def _rotated_with_earth(x_e, tau):
    """Components in the axes e of tau later: the Earth has turned. (m, n, 3), (m, n) s -> (m, n, 3)."""
    c, s = np.cos(wgs84.OMEGA * tau), np.sin(wgs84.OMEGA * tau)
    x, y, z = x_e[..., 0], x_e[..., 1], x_e[..., 2]
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)


def ranges(geometry, clock, errors, sigmas, reception, latency_s, lasting=None):
    """GpsRanges of every epoch.

    Parameters
    ----------
    geometry : rho, rho_rate, r_es_e, v_es_e of `geometry`
    clock : bias (m,) m, drift (m,) m/s
    errors : (2, m, n) m, m/s of range and range rate, everything but the clock
    sigmas : (2, m) m, m/s, noise of a channel as the receiver reports it
    reception : Reception
    latency_s : s
    lasting : (2, m, n) m, of `RangeErrors.sigmas`; None: there are none

    Returns
    -------
    list of GpsRanges
    """
    rho, rho_rate, r_es_e, v_es_e = geometry
    pseudorange = rho + clock[0][:, None] + errors[0]
    range_rate = rho_rate + clock[1][:, None] + errors[1]
    t_s, result = reception.t_s, []
    for k, seen in enumerate(reception.tracked):
        n = int(seen.sum())
        reason = "" if n else reception.reasons[k] or "0 satellites tracked"
        result.append(
            GpsRanges(
                t_valid_s=float(t_s[k]),
                t_available_s=float(t_s[k]) + latency_s,
                prn=reception.prn[seen],
                pseudorange=pseudorange[k, seen],
                range_rate=range_rate[k, seen],
                r_es_e=r_es_e[k, seen],
                v_es_e=v_es_e[k, seen],
                sigma_range=np.full(n, sigmas[0][k]),
                sigma_range_rate=np.full(n, sigmas[1][k]),
                reason=reason,
                **({} if lasting is None else dict(zip(LASTING, lasting[:, k, seen], strict=True))),
            )
        )
    return result
