"""Figures of the star tracker in a run: its errors, its window, what frames gave and why others did not.

Definitions: see `metrics`.
"""

import math
from collections import Counter
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry.rotation import (
    quat_conjugate,
    quat_from_dcm,
    quat_from_rotvec,
    quat_multiply,
    rotvec_between,
)
from shefex_nav.records import Reason
from shefex_nav.report.sizes import largest, rms

WRONG_ANGLE = math.radians(0.5)
WINDOW_RATE = math.radians(2.0)  # rad/s
RATES_DEG_S = 0.0, 0.25, 0.75, 1.25, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, math.inf  # bounds of by_rate
_ARCSEC = math.degrees(1.0) * 3600.0


class StarErrors(NamedTuple):
    """The M fixes given as good, against the true attitude of the camera."""

    number: np.ndarray  # (M,) of the frame
    t_s: np.ndarray  # (M,) middle of the exposure
    rotation_c: np.ndarray  # (M, 3) rad
    sigma_c: np.ndarray  # (M, 3) rad, as the star tracker reports it


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


def summarise(data, known):
    """What `metrics.summarise` has of the star tracker. known : Configured of the run"""
    window, n_missing = window_frames(data)
    no_fix = _no_fix(data, window) + Counter({"no_frame": n_missing})
    outside = {frame.number for frame in data.frame_truths} - window
    errors = star_errors(data)
    angle = np.linalg.norm(errors.rotation_c, axis=1)
    in_window = np.isin(errors.number, list(window))
    chosen = errors.rotation_c[in_window]
    return {
        "frames": len(data.frame_truths),
        "in_window": len(window) + n_missing,
        "outside": _outside(data, window, known),
        "solved": int(in_window.sum()),
        "fixes": len(angle),  # of the whole flight
        "wrong": int((angle > WRONG_ANGLE).sum()),
        "no_fix": dict(sorted(no_fix.items())),  # in the window
        "no_fix_outside": dict(sorted(_no_fix(data, outside).items())),
        "full_table_share": _full_table(data, known.scenario),
        "objects_without_fix": _median(
            len(fix.detections.flux_dn) for fix in _refused(data, window, Reason.TOO_FEW_STARS)
        ),
        "saturated_dn": {
            "median": _median(fix.background_dn for fix in _refused(data, window, Reason.SATURATED)),
            "limit": _brightest_mean(known.scenario),
        },
        "error_arcsec": {
            "cross_axis_rms": rms(chosen[:, :2].ravel()) * _ARCSEC,
            "boresight_rms": rms(chosen[:, 2]) * _ARCSEC,
            "max": largest(angle[in_window]) * _ARCSEC,
            "mean": (np.mean(chosen, axis=0) * _ARCSEC).tolist() if len(chosen) else None,  # x, y, z
            # without the run's mean, which is of the principal point and not in the covariance
            "normalised_rms": rms((_without_mean(chosen, chosen) / errors.sigma_c[in_window]).ravel()),
        },
        "mounting_error_deg": mounting_error_deg(data),
        "by_rate": by_rate(data, errors),
        "chain_ms": _chain_ms(data.compute_times.chain_s),
    }


def _without_mean(errors, of):
    """Errors (K, 3) without the mean of some (n, 3), so much larger as the mean of n takes of their squares.

    NaN where that is all of one.
    """
    n = len(of)
    return (errors - np.mean(of, axis=0)) * math.sqrt(n / (n - 1)) if n > 1 else np.full(errors.shape, np.nan)


def _no_fix(data, numbers):
    """Why frames of these numbers gave no fix: Counter of reasons."""
    reasons = {fix.number: fix.reason for fix in data.star_fixes}
    found = (reasons.get(number) for number in numbers)
    return Counter(
        "no_result" if reason is None else Reason(reason).name.lower()
        for reason in found
        if reason != Reason.NONE
    )


def _refused(data, window, reason):
    """Fixes of frames in the window that gave none for a reason."""
    return (fix for fix in data.star_fixes if fix.number in window and fix.reason == reason)


def _median(values):
    values = list(values)
    return float(np.median(values)) if values else None


def _brightest_mean(scenario):
    """Mean grey value above which a frame counts as saturated; None without a Scenario."""
    return None if scenario is None else float(scenario.star_tracker.exposure.brightest_mean)


def _full_table(data, scenario):
    """Share of the frames with objects in which there is room for no more; None without a Scenario."""
    counts = np.array([len(fix.detections.flux_dn) for fix in data.star_fixes])
    if scenario is None or not counts.any():
        return None
    return float(np.mean(counts[counts > 0] >= scenario.star_tracker.detection.most_objects))


def _outside(data, window, limits):
    """Frames out of the window: {sun, sun_and_earth_limb, earth_limb, excluded, rate: count}, each once."""
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
                of_limb = frame.limb_angle < limits.limb_exclusion_rad
                of_sun = "sun_and_earth_limb" if of_limb else "sun"
                near_sun = frame.sun_angle < sun_limit and not frame.sun_hidden
                reasons[of_sun if near_sun else "earth_limb"] += 1
    return dict(sorted(reasons.items()))


def by_rate(data, errors):
    """Frames and fixes by the true rate: list of dicts, slowest first, of the intervals that have frames.

    RunData, its StarErrors -> from_deg_s, to_deg_s (None: no limit), frames, solved, wrong, and of the fixes
    that are not wrong cross_axis_rms_arcsec (per axis), boresight_rms_arcsec; and without the mean error of
    the run cross_axis_scatter_arcsec (per axis), boresight_scatter_arcsec and nees, the mean squared
    normalised error of three degrees of freedom; these are None of a single fix, which is its own mean.
    """
    frames = [frame for frame in data.frame_truths if frame.exclusion_met]
    number = np.array([frame.number for frame in frames], dtype=int)
    rate_deg_s = np.degrees([frame.rate for frame in frames])
    wrong = np.linalg.norm(errors.rotation_c, axis=1) > WRONG_ANGLE
    good = np.isin(errors.number, number) & ~wrong
    without_mean = _without_mean(errors.rotation_c, errors.rotation_c[good])
    covariances = {fix.number: fix.P_c for fix in data.star_fixes}
    result = []
    for low, high in pairwise(RATES_DEG_S):
        inside = number[(rate_deg_s >= low) & (rate_deg_s < high)]
        fixed = np.isin(errors.number, inside)
        if not len(inside):
            continue
        rotation = errors.rotation_c[fixed & ~wrong]
        P_c = [covariances[k] for k in errors.number[fixed & ~wrong].tolist()]
        scatter = without_mean[fixed & ~wrong]
        weighed = np.linalg.solve(np.reshape(P_c, (-1, 3, 3)), scatter[:, :, None])[:, :, 0]
        squares = [e @ w for e, w in zip(scatter, weighed, strict=True)]
        result.append(
            {
                "from_deg_s": low,
                "to_deg_s": high if math.isfinite(high) else None,
                "frames": len(inside),
                "solved": int(fixed.sum()),
                "wrong": int((fixed & wrong).sum()),
                "cross_axis_rms_arcsec": rms(rotation[:, :2].ravel()) * _ARCSEC,
                "boresight_rms_arcsec": rms(rotation[:, 2]) * _ARCSEC,
                "cross_axis_scatter_arcsec": rms(scatter[:, :2].ravel()) * _ARCSEC,
                "boresight_scatter_arcsec": rms(scatter[:, 2]) * _ARCSEC,
                "nees": float(np.mean(squares)) if squares else None,
            }
        )
    return result


def _chain_ms(chain_s):
    median, p99 = np.percentile(chain_s * 1e3, [50, 99]).tolist() if len(chain_s) else (None, None)
    return {"median": median, "p99": p99}


# ----------------------------------------------------------------------------------------------------------
# How far the star camera of a run is turned from its nominal mounting.
#
# An attitude of the camera has no part of this error; one of the body, made of it, has all that the filter
# does not find. The true attitudes of camera and body say it: q_bc = q_bi q_ic.


def mounting_error_deg(data):
    """Rotation from the nominal to the true mounting, [x, y, z] deg in camera axes; None if it is not known.

    RunData. A frame between two samples of truth takes the nearest one, rotated on at its rate; the median is
    over the frames that are as near to theirs as any.
    """
    truth, frames = data.truth, data.frame_truths
    if not frames or not len(truth.t_s):
        return None
    t_s = np.array([frame.t_valid_s for frame in frames])
    nearest = np.searchsorted(0.5 * (truth.t_s[1:] + truth.t_s[:-1]), t_s)
    gap_s = t_s - truth.t_s[nearest]
    chosen = np.flatnonzero(np.abs(gap_s) <= np.abs(gap_s).min() + SAME_S).tolist()
    nominal_q_bc, q_bc = quat_from_dcm(data.mission.C_bc), []
    for k in chosen:
        since = quat_from_rotvec(truth.omega_ib_b[nearest[k]] * gap_s[k])
        q_ib = quat_multiply(truth.q_ib[nearest[k]], since)
        q_bc.append(quat_multiply(quat_conjugate(q_ib), frames[k].q_ic))
    errors = rotvec_between(nominal_q_bc[None], q_bc)
    return np.degrees(np.median(errors, axis=0)).tolist()
