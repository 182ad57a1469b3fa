"""Which of the satellites in view a receiver tracks: reacquisition after a loss, and limits; where it is
silent by order of its maker.

A solution that freezes, and other faults: `world.faults`.
"""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry import wgs84

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


def _during(t_s, span):
    """(m,) bool: epochs from start on and before end."""
    return (t_s >= span.start - SAME_S) & (t_s < span.end - SAME_S)
