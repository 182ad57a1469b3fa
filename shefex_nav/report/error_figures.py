"""Figures of the navigation errors of a run: of all of it and of parts of it, at entry, against their sigmas.

The definitions are those of `metrics`. An error is far beyond its sigma by the root of the normalised squared
error per degree of freedom of its block (position, velocity, attitude): 1 on average where the covariance is
right. The stars are known with the second star fix, because an attitude begins with two that agree; errors
before are of the start alone. That depends on the star tracker alone, so that two filters of one flight are
compared over the same time. While the vehicle points, most payloads are used.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.onboard.navigation.quantity import ATTITUDE, fix_of
from shefex_nav.records import QUANTITIES, Phase
from shefex_nav.report import sensor_use, star_metrics
from shefex_nav.report.navigation_errors import NEES_DOF, beside_covariance, nees, normalised_errors
from shefex_nav.report.pairing import phase_at, stretches
from shefex_nav.report.sizes import largest, rms

FAR = 5.0  # times the sigmas; by chance one epoch in 10^15
LASTING_S = 1.0  # an error that is over sooner is not told
GAP_S = 10.0  # between two errors that are told as one
BLOCKS = {name: slice(3 * k, 3 * k + 3) for k, name in enumerate(QUANTITIES)}
LATEST_S = 1.0  # how long before entry the covariance may be that is told of it
NO_STARS = "no star fix was used"


def sizes(errors, rows=slice(None)):
    """Sizes of some rows of NavErrors: (N,) m, m/s, deg."""
    position, velocity, attitude = (np.linalg.norm(error[rows], axis=1) for error in errors[1:])
    return position, velocity, np.degrees(attitude)


def of_sizes(size):
    """{"rms", "max"} of (N,) sizes."""
    return {"rms": rms(size), "max": largest(size)}


def star_phase(data, errors):
    """Errors of the star phase; None without one. RunData, NavErrors"""
    numbers, _ = star_metrics.window_frames(data)
    times = [frame.t_valid_s for frame in data.frame_truths if frame.number in numbers]
    if not times:
        return None
    inside = (errors.t_s >= min(times) - SAME_S) & (errors.t_s <= max(times) + SAME_S)
    if not inside.any():
        return None
    position, velocity, attitude_deg = sizes(errors, inside)
    return {
        "from_s": float(min(times)),
        "to_s": float(max(times)),
        "position_rms_m": rms(position),
        "velocity_rms_m_s": rms(velocity),
        "attitude_rms_deg": rms(attitude_deg),
    }


def star_aided(data, errors):
    """Errors from the second star fix to the end; None if there are no two. RunData, NavErrors

    -> from_s; position_m, velocity_m_s, attitude_deg: rms and max of the whole error
    """
    given = sorted(fix.t_available_s for fix in sensor_use.good_fixes(data))
    if len(given) < 2 or not (rows := errors.t_s >= given[1] - SAME_S).any():
        return None
    names = ("position_m", "velocity_m_s", "attitude_deg")
    found = zip(names, map(of_sizes, sizes(errors, rows)), strict=True)
    return {"from_s": float(given[1])} | dict(found)


def while_pointing(truth, errors):
    """Errors while the vehicle points; None where it never does, or has no solution then.

    truth : of a RunData;  errors : NavErrors
    -> solution_share, of its ticks; from_s, to_s; position_m and velocity_m_s of the whole error;
    attitude_deg, its `max` about one axis; each with rms, max, and max_at_s, when that was
    """
    rows = phase_at(truth, errors.t_s) == Phase.POINTING
    if not rows.any():
        return None
    t_s, (position, velocity, attitude_deg) = errors.t_s[rows], sizes(errors, rows)
    about_axis = np.degrees(np.abs(errors.attitude_b[rows])).max(axis=1)
    return {
        "solution_share": float(rows.sum() / (truth.phase == Phase.POINTING).sum()),
        "from_s": float(t_s[0]),
        "to_s": float(t_s[-1]),
        "position_m": _with_time(t_s, position, position),
        "velocity_m_s": _with_time(t_s, velocity, velocity),
        "attitude_deg": _with_time(t_s, attitude_deg, about_axis),
    }


def _with_time(t_s, size, judged):
    """rms of sizes (N,) at t_s (N,), the largest of `judged` (N,) and its time."""
    k = int(np.argmax(judged))
    return {"rms": rms(size), "max": float(judged[k]), "max_at_s": float(t_s[k])}


def at_entry(data, errors, t_s, height):
    """Errors and sigmas at the entry, at t_s and a height [m]; None without a solution then."""
    k = np.flatnonzero(np.abs(errors.t_s - t_s) <= SAME_S)
    if not len(k):
        return None
    k = k[0]
    times, squares, sigma = normalised_errors(data, errors)
    before = np.flatnonzero((times <= t_s + SAME_S) & (times >= t_s - LATEST_S - SAME_S))
    known = before[-1] if len(before) else None
    return {
        "t_s": float(t_s),
        "altitude_km": float(height) / 1e3,
        "position_error_m": float(np.linalg.norm(errors.position_i[k])),
        "velocity_error_m_s": float(np.linalg.norm(errors.velocity_i[k])),
        "attitude_error_deg": np.degrees(errors.attitude_b[k]).tolist(),
        "position_sigma_m": None if known is None else float(np.linalg.norm(sigma[known, :3])),
        "velocity_sigma_m_s": None if known is None else float(np.linalg.norm(sigma[known, 3:6])),
        "attitude_sigma_deg": None if known is None else np.degrees(sigma[known, 6:]).tolist(),
        "nees": None if known is None else float(squares[known]),
    }


def nees_summary(data, errors, end_s):
    """Mean NEES from when the stars are known until end_s, or why there is none. RunData, NavErrors, s"""
    nothing = {"mean": None, "dof": NEES_DOF, "samples": 0, "why": None, "times_sigma": None}
    t_s, squares, _ = normalised_errors(data, errors)
    known, since, why = np.isfinite(squares), stars_known_from(data), None
    if since is None and known.any():
        why, since = NO_STARS, -math.inf
        if not sensor_use.is_own(data):
            begins = "from the first of which it counts"
            return nothing | ({"why": f"none: {why}, {begins}"} if sensor_use.good_fixes(data) else {})
    if since is None:
        return nothing
    chosen = whole_seconds(t_s - data.mission.start_s) & (t_s >= since) & (t_s <= end_s) & known
    if not chosen.any():
        return nothing
    return {
        "mean": float(squares[chosen].mean()),
        "dof": NEES_DOF,
        "samples": int(chosen.sum()),
        "why": why and f"from the start of the run, because {why}",
        "times_sigma": {name: rms(ratio[chosen]) for name, ratio in ratios(data, errors)[1].items()},
    }


def stars_known_from(data):
    """Mission time from which a solution knows the stars; None if it never does, as far as it says.

    Of a solution that did not fly, which cannot say it, that of the first star fix.
    """
    accepted = [gate.t_s for gate in data.gates if fix_of(gate.sensor) is ATTITUDE and gate.accepted]
    if data.gates:
        return accepted[0] if accepted else None
    aided = data.nav.t_s[np.asarray(data.nav.star_aided, dtype=bool)]
    if not len(aided) and not sensor_use.flew(data):
        return min((fix.t_available_s for fix in sensor_use.good_fixes(data)), default=None)
    return float(aided[0]) if len(aided) else None


def whole_seconds(since_s):
    """Which times (K,) since the start are at whole seconds; where none is, the first in each second."""
    whole = np.abs(since_s - np.round(since_s)) <= SAME_S
    if whole.any():
        return whole
    return np.diff(np.floor(since_s), prepend=-np.inf) > 0.0


class Beyond(NamedTuple):
    """A stretch of time in which a quantity's errors are far beyond its sigmas."""

    quantity: str
    from_s: float
    until_s: float | None  # None: to the end of the covariances
    times: float  # at most


def ratios(data, errors):
    """Root of NEES per degree of freedom at the epochs of the covariance: t_s (K,), {quantity: (K,)}.

    data : RunData;  errors : NavErrors
    """
    t_s, x, P = beside_covariance(data, errors)
    found = {name: np.sqrt(nees(x[:, at], P[:, at, at]) / 3.0) for name, at in BLOCKS.items()}
    return t_s, found


def beyond_sigma(data, errors):
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


def _closed(t_s, flags):
    """The same flags, with short gaps between flagged times filled. (K,), (K,) bool"""
    flags, found = flags.copy(), np.flatnonzero(flags)
    for a, b in zip(found[:-1].tolist(), found[1:].tolist(), strict=True):
        if b > a + 1 and t_s[b] - t_s[a] < GAP_S:
            flags[a:b] = True
    return flags
