"""Figures of one run: the object that `run --json` and `report --json` print.

Every figure is computed from the records of the run and its truth; one that does not apply is None.

Definitions
-----------
- Errors are truth minus estimate; position and velocity errors are norms in inertial axes, attitude errors
  rotation vectors in body axes (navigation) or camera axes (star tracker; z is the boresight).
- A star fix is wrong if it is given as good and more than 0.5 deg off, in the window or out of it.
- The window is where the true rate is at most 2 deg/s and the true exclusion angles are met. A tick of the
  camera without a frame counts in it if both neighbours do.
- `by_rate` counts the frames whose exclusion angles are met, in the window or too fast for it, by the true
  rate; its NEES is that of the fixes with their own covariance, less the run's mean error, which is mounting
  and principal point.
- `cross_axis_rms` is per axis, over x and y; `max` is of the whole rotation angle.
- `outside` counts the frames out of the window: too near to the Sun, else to the Earth's limb, else too fast.
- The star phase is from the first frame in the window to the last, whatever software flies.
- `solution_share` is the part of the ticks of truth at which there is a solution; the errors are over these.
- NEES: position, velocity and attitude at whole seconds since the start of the run, from the first star fix
  that the filter accepts to entry, or to the end of a run without one. Software that tells of no gates begins
  where its solution is star aided, or where it never is, at the first star fix of the log. Where no
  covariance is of a whole second, the first in each second counts.
- Entry is the first descent through 100 km. Speed is relative to the Earth, range along the ellipsoid from
  the start to the impact; without an impact there is none. Without truth the flight is that of the solution
  (`of`). The greatest height is an apogee only if the data go on beyond it; `climbs_at_km` if they do not.
- `simulated_s` is the time from the first sample of truth, at `simulated_from_s`, to the last.
- `warnings` are of the scenario against the flight (`programme`); None where no scenario can be read.
- Attitude control: the pointing error is the true attitude against the wanted one, the whole angle, or that
  of the roll axis alone while the spin is left alone; in the phases POINTING.
"""

import math
from collections import Counter
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.onboard.navigation.quantity import ATTITUDE, fix_of
from shefex_nav.records import Reason
from shefex_nav.report import flight, local_level, programme, trust, while_pointing
from shefex_nav.report.configured import configured
from shefex_nav.report.instrument_use import instrument_use
from shefex_nav.report.nees import nees
from shefex_nav.report.pairing import pointing_error, same_times
from shefex_nav.report.track import earth_fixed

WRONG_ANGLE = math.radians(0.5)
WINDOW_RATE = math.radians(2.0)  # rad/s
RATES_DEG_S = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, math.inf)  # bounds of by_rate
ENTRY_HEIGHT = 100e3  # m
NEES_DOF = 9  # position, velocity, attitude
_ARCSEC = math.degrees(1.0) * 3600.0


class NavErrors(NamedTuple):
    """Truth minus estimate over the N ticks that have both."""

    t_s: np.ndarray  # (N,)
    position_i: np.ndarray  # (N, 3) m
    velocity_i: np.ndarray  # (N, 3) m/s
    attitude_b: np.ndarray  # (N, 3) rad


class StarErrors(NamedTuple):
    """The M fixes given as good, against the true attitude of the camera."""

    number: np.ndarray  # (M,) of the frame
    t_s: np.ndarray  # (M,) middle of the exposure
    rotation_c: np.ndarray  # (M, 3) rad
    sigma_c: np.ndarray  # (M, 3) rad, as the star tracker reports it


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


def star_errors(data):
    """StarErrors of a RunData."""
    true_q_ic = {truth.number: truth.q_ic for truth in data.frame_truths}
    good = [fix for fix in data.star_fixes if fix.reason == Reason.NONE and fix.number in true_q_ic]
    if not good:
        return StarErrors(np.zeros(0, int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    estimates = np.array([fix.q_ic for fix in good])
    return StarErrors(
        np.array([fix.number for fix in good]),
        np.array([fix.t_valid_s for fix in good]),
        rotvec_between(estimates, np.array([true_q_ic[fix.number] for fix in good])),
        np.sqrt(np.array([np.diag(fix.P_c) for fix in good])),
    )


def summarise(data, *, log=None, from_s=None, scenario=None):
    """The summary object of a RunData: plain dict of numbers, texts and None, ready for JSON.

    `log` is the path that the object names. A replay of external data, or whoever names a mission time
    `from_s`, gets the errors in local level axes from then on as well (`local_level`). `scenario` is that of
    the run, where it is at hand; otherwise the one in the log is read.
    """
    truth = data.truth
    track = earth_fixed(data.mission.earth, truth)
    entry = entry_index(truth.t_s, track.height)
    t_s = truth.t_s if len(truth.t_s) else data.nav.t_s
    simulated_s = float(t_s[-1] - t_s[0]) if len(t_s) else None
    wall_s = data.summary.wall_s if data.summary else None
    result = {
        "scenario": data.mission.scenario,
        "seed": data.mission.seed,
        "version": data.mission.version,
        "software": {
            section: f"{name}, sha256 {hash_[:12]}" if hash_ else name
            for section, name, hash_ in data.mission.software
        },
        "log": None if log is None else str(log),
        "ended_early": data.ended_early,
        "failure": data.failure or None,
        "until_s": data.until_s,
        "simulated_s": simulated_s,
        "simulated_from_s": float(t_s[0]) if len(t_s) else None,
        "wall_s": wall_s,
        "setup_s": data.summary.setup_s if data.summary else None,
        "real_time_factor": simulated_s / wall_s if simulated_s and wall_s else None,
        "flight": flight.of_truth(data, track, entry) if len(truth.t_s) else flight.of_solution(data),
        "attitude_control": _attitude_control(data),
        "star_tracker": _star_tracker(data),
        "navigation": _navigation(data, track.height, entry),
        "warnings": _warnings(data, scenario),
    }
    if from_s is not None or local_level.is_replay(data):
        result["navigation"] |= local_level.summarise(data, from_s)
    return _without_nan(result)


def _warnings(data, scenario):
    """What the scenario gets wrong of the flight: list of field and text."""
    scenario = configured(data).scenario if scenario is None else scenario
    if scenario is None:
        return None
    found = programme.warnings(scenario, programme.of_data(data))
    return [{"field": ".".join(one.field), "text": one.text} for one in found]


def entry_index(t_s, height):
    """Index of the first sample at or below 100 km after having been above it, or None."""
    above = np.flatnonzero(height > ENTRY_HEIGHT)
    if not len(above):
        return None
    below = np.flatnonzero(height[above[0] :] <= ENTRY_HEIGHT)
    return int(above[0] + below[0]) if len(below) else None


def _attitude_control(data):
    """Gas used and pointing error; None without attitude control."""
    control = data.control
    if not len(control.t_s):
        return None
    error_deg = np.degrees(pointing_error(control, data.truth))
    return {
        "propellant_kg": float(control.propellant_kg[-1]),
        "pointing_error_deg": {"rms": _rms(error_deg), "max": _max(error_deg)},
    }


def window_frames(data):
    """Numbers of the frames in the star tracker's window, and how many ticks in it had no frame."""
    inside = [frame.exclusion_met and frame.rate <= WINDOW_RATE for frame in data.frame_truths]
    numbers = {frame.number for frame, is_in in zip(data.frame_truths, inside, strict=True) if is_in}
    t_s = np.array([frame.t_valid_s for frame in data.frame_truths])
    if len(t_s) < 3:
        return numbers, 0
    steps = np.diff(t_s)
    missing = np.maximum(np.round(steps / np.median(steps)).astype(int) - 1, 0)
    both = np.array(inside[1:]) & np.array(inside[:-1])
    return numbers, int(missing[both].sum())


def _star_tracker(data):
    window, n_missing = window_frames(data)
    reasons = {fix.number: fix.reason for fix in data.star_fixes}
    no_fix = Counter({"no_frame": n_missing} if n_missing else {})
    for number in window:
        reason = reasons.get(number)
        if reason is None:
            no_fix["no_result"] += 1
        elif reason != Reason.NONE:
            no_fix[Reason(reason).name.lower()] += 1
    errors = star_errors(data)
    angle = np.linalg.norm(errors.rotation_c, axis=1)
    in_window = np.isin(errors.number, list(window))
    chosen = errors.rotation_c[in_window]
    return {
        "frames": len(data.frame_truths),
        "in_window": len(window) + n_missing,
        "outside": _outside(data, window),
        "solved": int(in_window.sum()),
        "fixes": len(angle),  # of the whole flight
        "wrong": int((angle > WRONG_ANGLE).sum()),
        "no_fix": dict(sorted(no_fix.items())),
        "error_arcsec": {
            "cross_axis_rms": _rms(chosen[:, :2].ravel()) * _ARCSEC,
            "boresight_rms": _rms(chosen[:, 2]) * _ARCSEC,
            "max": _max(angle[in_window]) * _ARCSEC,
            "mean": (np.mean(chosen, axis=0) * _ARCSEC).tolist() if len(chosen) else None,  # x, y, z
            # without the run's mean, which is mounting and principal point and not in the covariance
            "normalised_rms": _rms(((chosen - np.mean(chosen, axis=0)) / errors.sigma_c[in_window]).ravel())
            if len(chosen)
            else None,
        },
        "by_rate": by_rate(data, errors),
        "chain_ms": _chain_ms(data.compute_times.chain_s),
    }


def _outside(data, window):
    """Frames out of the window by the first reason that holds: {sun, earth_limb, excluded, rate: count}."""
    limits = configured(data)
    reasons = Counter()
    for frame in data.frame_truths:
        if frame.number in window:
            continue
        if frame.exclusion_met:
            reasons["rate"] += 1
        else:
            sun_limit = limits.sun_exclusion_rad
            if sun_limit is None:
                reasons["excluded"] += 1
            else:
                reasons["sun" if frame.sun_angle < sun_limit else "earth_limb"] += 1
    return dict(sorted(reasons.items()))


def by_rate(data, errors):
    """Frames and fixes by the true rate: list of dicts, slowest first, of the intervals that have frames.

    RunData, its StarErrors -> from_deg_s, to_deg_s (None: no limit), frames, solved, wrong, and of the fixes
    that are not wrong cross_axis_rms_arcsec, boresight_rms_arcsec and nees, the mean squared normalised
    error of three degrees of freedom, without the mean error of the run.
    """
    frames = [frame for frame in data.frame_truths if frame.exclusion_met]
    number = np.array([frame.number for frame in frames], dtype=int)
    rate_deg_s = np.degrees([frame.rate for frame in frames])
    wrong = np.linalg.norm(errors.rotation_c, axis=1) > WRONG_ANGLE
    good = np.isin(errors.number, number) & ~wrong
    mean = np.mean(errors.rotation_c[good], axis=0) if good.any() else np.zeros(3)
    covariances = {fix.number: fix.P_c for fix in data.star_fixes}
    result = []
    for low, high in pairwise(RATES_DEG_S):
        inside = number[(rate_deg_s >= low) & (rate_deg_s < high)]
        fixed = np.isin(errors.number, inside)
        if not len(inside):
            continue
        rotation = errors.rotation_c[fixed & ~wrong]
        P_c = [covariances[k] for k in errors.number[fixed & ~wrong].tolist()]
        squares = [e @ np.linalg.solve(P, e) for e, P in zip(rotation - mean, P_c, strict=True)]
        result.append(
            {
                "from_deg_s": low,
                "to_deg_s": high if math.isfinite(high) else None,
                "frames": len(inside),
                "solved": int(fixed.sum()),
                "wrong": int((fixed & wrong).sum()),
                "cross_axis_rms_arcsec": _rms(rotation[:, :2].ravel()) * _ARCSEC,
                "boresight_rms_arcsec": _rms(rotation[:, 2]) * _ARCSEC,
                "nees": float(np.mean(squares)) if squares else None,
            }
        )
    return result


def _chain_ms(chain_s):
    median, p99 = np.percentile(chain_s * 1e3, [50, 99]).tolist() if len(chain_s) else (None, None)
    return {"median": median, "p99": p99}


def _navigation(data, height, entry):
    errors = navigation_errors(data)
    position, velocity, attitude = (
        np.linalg.norm(error, axis=1) for error in (errors.position_i, errors.velocity_i, errors.attitude_b)
    )
    attitude_deg = np.degrees(attitude)
    ticks = len(data.truth.t_s)
    return {
        "solution_share": len(errors.t_s) / ticks if ticks else None,
        "position_error_m": {"rms": _rms(position), "max": _max(position)},
        "velocity_error_m_s": {"rms": _rms(velocity), "max": _max(velocity)},
        "attitude_error_deg": {"rms": _rms(attitude_deg), "max": _max(attitude_deg)},
        "star_phase": _star_phase(data, errors.t_s, position, velocity, attitude_deg),
        "while_pointing": while_pointing.errors(data.truth, errors),
        "at_entry": None if entry is None else _at_entry(data, errors, data.truth.t_s[entry], height[entry]),
        "nees": _nees_summary(data, errors, math.inf if entry is None else data.truth.t_s[entry]),
        "instruments": instrument_use(data.gates),
        "integrity": trust.trust(data, None if entry is None else float(data.truth.t_s[entry])),
    }


def _star_phase(data, t_s, position, velocity, attitude_deg):
    """Errors of the star phase; None without one. t_s (N,) s of sizes (N,) m, m/s, deg"""
    numbers, _ = window_frames(data)
    times = [frame.t_valid_s for frame in data.frame_truths if frame.number in numbers]
    inside = (
        (t_s >= min(times) - SAME_S) & (t_s <= max(times) + SAME_S) if times else np.zeros(len(t_s), bool)
    )
    if not inside.any():
        return None
    return {
        "from_s": float(min(times)),
        "to_s": float(max(times)),
        "position_rms_m": _rms(position[inside]),
        "velocity_rms_m_s": _rms(velocity[inside]),
        "attitude_rms_deg": _rms(attitude_deg[inside]),
    }


def _at_entry(data, errors, t_s, height):
    k = np.flatnonzero(np.abs(errors.t_s - t_s) <= SAME_S)
    if not len(k):
        return None
    k = k[0]
    times, squares, sigma = normalised_errors(data, errors)
    before = np.flatnonzero(times <= t_s + SAME_S)
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


def normalised_errors(data, errors):
    """(t_s, NEES, sigma) at the epochs of the logged covariance: (K,), (K,), (K, 9)."""
    i, j = same_times(errors.t_s, data.covariance.t_s)
    x = np.hstack([errors.position_i[i], errors.velocity_i[i], errors.attitude_b[i]])
    P = data.covariance.P[j]
    return errors.t_s[i], nees(x, P), np.sqrt(np.einsum("kii->ki", P))


def _nees_summary(data, errors, end_s):
    nothing = {"mean": None, "dof": NEES_DOF, "samples": 0}
    since = _star_aided_from(data)
    if since is None:
        return nothing
    t_s, squares, _ = normalised_errors(data, errors)
    inside = (t_s >= since) & (t_s <= end_s) & np.isfinite(squares)
    chosen = squares[_seconds(t_s - data.mission.start_s) & inside]
    if not len(chosen):
        return nothing
    return {"mean": float(chosen.mean()), "dof": NEES_DOF, "samples": len(chosen)}


def _seconds(since_s):
    """Which times (K,) since the start are at whole seconds; where none is, the first in each second."""
    whole = np.abs(since_s - np.round(since_s)) <= SAME_S
    if whole.any():
        return whole
    return np.diff(np.floor(since_s), prepend=-np.inf) > 0.0


def _star_aided_from(data):
    """Mission time from which a solution knows the stars; None if it never does."""
    accepted = [gate.t_s for gate in data.gates if fix_of(gate.sensor) is ATTITUDE and gate.accepted]
    if data.gates:
        return accepted[0] if accepted else None
    aided = data.nav.t_s[np.asarray(data.nav.star_aided, dtype=bool)]
    fixes = [fix.t_available_s for fix in data.star_fixes if fix.reason == Reason.NONE]
    return float(aided[0]) if len(aided) else min(fixes, default=None)


def _rms(values):
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def _max(values):
    return float(np.abs(values).max()) if len(values) else math.nan


def _without_nan(value):
    """The same with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
