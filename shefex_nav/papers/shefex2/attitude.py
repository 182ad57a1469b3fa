"""SHEFEX sections 3.4.1 and 4: attitude error against centroid error, and the calibration of the camera."""

from dataclasses import replace
from functools import cache

import numpy as np

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.distortion import undistort
from shefex_nav.geometry.pinhole import pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, rotvec_between
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.papers import rows
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.shefex2.field import (
    CAMERA,
    MAX_CENTROIDS,
    MERGE,
    MIN_STARS,
    YEAR,
    directions,
    draw_field,
    flown,
    flown_pairs,
    match,
)
from shefex_nav.papers.shefex2.methods.calibrate import calibrate
from shefex_nav.papers.shefex2.published import SHEFEX
from shefex_nav.papers.stills import on_detector, random_attitude
from shefex_nav.papers.verdict import Verdict
from shefex_nav.report import intervals
from shefex_nav.solve.camera import Camera
from shefex_nav.solve.centroids import solve_centroids

# --- shefex-attitude ---

AXES = ("roll", "pitch", "yaw")  # about x, y and the boresight z, as the paper calls them
WAYS = ("identified", "known")  # stars as the pyramid finds them, stars as they are
ERRORS_PX = np.round(np.arange(0.05, 1.0001, 0.05), 2)
LIMIT_DEG = SHEFEX["requirements"]["attitude_error_deg"]
CROSSING_PX = SHEFEX["identification"]["centroid_error_at_0p1deg_yaw_px"]
NEAR_PX = 0.05  # what the figure of the paper can be read to
AT = int(np.flatnonzero(np.isclose(ERRORS_PX, CROSSING_PX))[0])
RATIO_RESOLVES = 5.0  # of the ratio of the errors, which is 10 to 100 as published
PERCENTILE = 97.5
RESAMPLES = 500
BOOTSTRAP_SEED = 1


def measure_attitude(samples, seed):
    """Errors about the three axes [deg] and the number of stars used.

    The same attitudes and the same noise, scaled, serve all centroid errors.

    Returns
    -------
    errors : (samples, ways, centroid errors, 3); NaN where there is no attitude
    used : (samples, ways, centroid errors)
    """
    rng = np.random.default_rng(seed)
    errors = np.full((samples, len(WAYS), len(ERRORS_PX), 3), np.nan)
    used = np.zeros(errors.shape[:3], dtype=np.int64)
    pairs, stars = flown_pairs(), flown()
    for k in range(samples):
        field = draw_field(rng)
        truth = np.where(np.arange(len(field.star)) < MAX_CENTROIDS, field.star, -1)
        for e, error_px in enumerate(ERRORS_PX):
            u_c = directions(field, error_px)
            found = match(pairs, u_c, SHEFEX["identification"]["cos_error"])
            for w, star in enumerate((found, truth)):
                known = star >= 0
                used[k, w, e] = known.sum()
                if used[k, w, e] >= MIN_STARS:
                    q_ic = esoq2(u_c[known], stars.u_i[star[known]], np.ones(known.sum()))
                    errors[k, w, e] = np.degrees(rotvec_between(q_ic, field.q_ic))
    return errors, used


def percentiles(errors):
    """97.5th percentile of the absolute error at each centroid error. (n, e) deg, may hold NaN -> (e,)."""
    return np.array([_of_finite(column, lambda x: np.percentile(x, PERCENTILE)) for column in errors.T])


def three_sigma(errors):
    """Three times the root of the mean square. (n, e) deg, may hold NaN -> (e,)."""
    return np.array([_of_finite(column, lambda x: 3.0 * np.sqrt(np.mean(x**2))) for column in errors.T])


def _of_finite(column, statistic):
    column = np.abs(column[np.isfinite(column)])
    return statistic(column) if len(column) else np.nan


def crossing(curve):
    """Centroid error [px] at which a curve first passes the limit; NaN if it does not."""
    above = np.flatnonzero(curve > LIMIT_DEG)
    if len(above) == 0 or above[0] == 0:
        return np.nan
    k = above[0]
    part = (LIMIT_DEG - curve[k - 1]) / (curve[k] - curve[k - 1])
    return float(ERRORS_PX[k - 1] + part * (ERRORS_PX[k] - ERRORS_PX[k - 1]))


def conclude_attitude(results):
    """Where the error about the boresight passes the requirement, and what the text says about figure 10."""
    errors, used = (np.concatenate(column) for column in zip(*results, strict=True))
    identified = errors[:, 0]
    curves = np.array([percentiles(identified[:, :, axis]) for axis in range(3)])
    rising = int((np.diff(curves, axis=1) > 0.0).all(axis=1).sum())
    critical = int((curves[:2, AT] > LIMIT_DEG).sum())
    where = f"centroid error {CROSSING_PX} px"
    n = len(identified)
    fewer = _why_fewer(identified, errors[:, 1], used)
    given = (
        _crossing_row(identified, percentiles, "97.5th percentile, stars as identified", fewer),
        _crossing_row(errors[:, 1], percentiles, "97.5th percentile, all stars known"),
    )
    strict = (
        _crossing_row(identified, three_sigma, "3 sigma, stars as identified"),
        _crossing_row(errors[:, 1], three_sigma, "3 sigma, all stars known"),
    )
    run, words = "shefex-attitude/97.5th percentile", "which statistic is drawn is not said; as a percentile"
    least, pitch = intervals.values_needed(PERCENTILE), f"{curves[0, AT]:.3f} and {curves[1, AT]:.3f} deg"
    return [
        *given,
        *(rows.explained(row, other, run, words) for row, other in zip(strict, given, strict=True)),
        rows.trend("axes whose error rises steadily", "figure 10", 3, rising, n, "a curve falls", least),
        rows.trend("of roll and pitch, above 0.1 deg", where, 0, critical, n, pitch, least),
        _ratio_row(identified[:, AT]),
        *(_percentile_row(identified[:, AT, axis], axis, fewer) for axis in range(3)),
        *(_identified_row(identified, e) for e in (AT, len(ERRORS_PX) - 1)),
    ]


def _why_fewer(identified, known, used):
    """What the identification has to do with the error."""
    there = np.isfinite(identified[:, AT, 2])
    if not there.any():
        return ""
    n_named, n_all = used[there, 0, AT].mean(), used[there, 1, AT].mean()
    all_known = crossing(percentiles(known[:, :, 2]))
    return (
        f"at {CROSSING_PX} px and cosError 5.5e-5 the pyramid names {n_named:.1f} of {n_all:.1f} stars of a "
        "field, and fewer stars hold the rotation about the boresight less; with all of them the crossing "
        f"is at {all_known:.2f} px"
    )


def _crossing_row(errors, what, condition, why=""):
    """Where the error about the boresight passes 0.1 deg. (n, centroid errors, 3) deg."""
    yaw = errors[:, :, 2]
    measured = crossing(what(yaw))
    interval = None
    if _enough(yaw) and np.isfinite(measured):
        rng = np.random.default_rng(BOOTSTRAP_SEED)
        interval = intervals.bootstrap(lambda x: crossing(what(x)), [yaw], rng, resamples=RESAMPLES)
    quantity = "centroid error where yaw passes 0.1 deg [px]"
    how = {"rounding": NEAR_PX, "resolves": 2.0 * NEAR_PX, "why": why}
    return rows.figure(quantity, condition, CROSSING_PX, measured, interval, len(yaw), **how)


def _enough(values):
    """Whether so many values have the percentile: below, the largest one takes its place."""
    return len(values) >= intervals.values_needed(PERCENTILE)


def _percentile_row(values, axis, why):
    """97.5th percentile at the published crossing, where that of the yaw error is the limit. (n,) deg."""
    values = np.abs(values[np.isfinite(values)])
    measured = float(np.percentile(values, PERCENTILE)) if len(values) else np.nan
    interval = intervals.percentile(values, PERCENTILE) if _enough(values) else None
    quantity = f"97.5th percentile of the {AXES[axis]} error [deg]"
    condition = f"centroid error {CROSSING_PX} px"
    if AXES[axis] != "yaw":
        return Row(quantity, condition, None, measured, interval)
    margin = LIMIT_DEG * NEAR_PX / CROSSING_PX
    how = {"rounding": margin, "resolves": 2.0 * margin, "why": why}
    return rows.figure(quantity, condition, LIMIT_DEG, measured, interval, len(values), **how)


def _identified_row(errors, e):
    """Share of the attitudes that the pyramid identified."""
    condition = f"cosError 5.5e-5, centroid error {ERRORS_PX[e]:g} px"
    return rows.share("identified", condition, np.isfinite(errors[:, e, 0]).sum(), len(errors))


def _ratio_row(errors):
    """RMS about the boresight over that about the other axes. (n, 3) deg."""
    errors = errors[np.isfinite(errors[:, 0])]

    def ratio(e):
        return float(np.sqrt(np.mean(e[:, 2] ** 2) / np.mean(e[:, :2] ** 2)))

    quantity, condition = "yaw error over roll and pitch error (RMS)", "one or two orders of magnitude"
    measured, interval = np.nan, None
    if len(errors) > 1:
        rng, measured = np.random.default_rng(BOOTSTRAP_SEED), ratio(errors)
        interval = intervals.bootstrap(ratio, [errors], rng, resamples=RESAMPLES)
    criterion = {"least": 10.0, "most": 100.0, "resolves": RATIO_RESOLVES, "refuted": True}
    return rows.statement(quantity, condition, None, measured, interval, len(errors), **criterion)


# --- shefex-calibration ---

PIXEL_MM = SHEFEX["camera"]["pixel_um"] * 1e-3
TRUE_MM = SHEFEX["camera"]["calibrated_focal_length_mm"]
ACCURACY_MM = 0.01  # the digits that the paper gives
TRUE_CAMERA = CAMERA._replace(
    focal_length_px=TRUE_MM / PIXEL_MM, cx_px=CAMERA.cx_px + 3.2, cy_px=CAMERA.cy_px - 2.1
)  # [E] offsets: the paper calibrates them and does not say what they were
TRUE_CAMERA_MM = TRUE_CAMERA.focal_length_px * PIXEL_MM
TRUE_K1 = -0.03  # [E] a weak barrel, a third of a pixel in the corner
NOISE_PX, NOISE_MAG = 0.15, 0.1
MAX_MAGNITUDE = 5.5
BLOCK = 50  # frames of one calibration when its scatter is looked at


@cache
def _sky():
    """The stars that the camera sees and the identification knows: OnboardCatalogue."""
    settings = replace(STAR_TRACKER.catalogue, faintest=MAX_MAGNITUDE, merge_radius=MERGE)
    return catalogue.build(settings, load_catalogue(8.0), YEAR)


def measure_calibration(samples, seed):
    """Frames of the true camera identified with the nominal one: list of (xy_px, u_i, n_wrong) or None."""
    rng = np.random.default_rng(seed)
    nominal = Camera(CAMERA.width_px, CAMERA.height_px, CAMERA.focal_length_px)
    stars = _sky()
    row_of = {int(hip): row for row, hip in enumerate(stars.hip)}
    frames = []
    for _ in range(samples):
        rows, xy_px = _photograph(rng, stars)
        flux = 10.0 ** (-0.4 * (stars.vmag[rows] + rng.normal(0.0, NOISE_MAG, len(rows))))
        solution = solve_centroids(
            xy_px, flux, camera=nominal, epoch=YEAR, max_magnitude=MAX_MAGNITUDE, centroid_sigma_px=NOISE_PX
        )
        named = solution.hip > 0
        if solution.status != "ok":
            frames.append(None)
            continue
        found = np.array([row_of[int(hip)] for hip in solution.hip[named]])
        frames.append((xy_px[named], stars.u_i[found], int((found != rows[named]).sum())))
    return frames


def _photograph(rng, stars):
    """Rows and noisy centroids of the stars that the true camera sees."""
    q_ic = random_attitude(rng)
    ideal = pixels(TRUE_CAMERA, np.ascontiguousarray(stars.u_i @ dcm_from_quat(q_ic)))
    centre = np.array([TRUE_CAMERA.cx_px, TRUE_CAMERA.cy_px])
    off = ideal - centre
    r2 = (off**2).sum(axis=1, keepdims=True) / TRUE_CAMERA.focal_length_px**2
    seen = centre + off * (1.0 + TRUE_K1 * r2)
    near = np.nan_to_num(r2[:, 0], nan=1.0) < 0.1  # far outside the distortion means nothing
    rows = np.flatnonzero(on_detector(CAMERA, seen) & near)
    return rows, seen[rows] + rng.normal(0.0, NOISE_PX, (len(rows), 2))


def calibrated(frames):
    """Calibration of frames as `measure_calibration` returns them, without those that were not identified."""
    return calibrate([(xy_px, u_i, NOISE_PX) for xy_px, u_i, _ in filter(None, frames)], CAMERA)


def radial_residuals(frames, camera, distortion):
    """Distance from the principal point, residual away from it; attitudes fitted: (n,), (n,) px."""
    centre = np.array([camera.cx_px, camera.cy_px])
    radius, outward = [], []
    for xy_px, u_i, _ in frames:
        ideal = undistort(camera, distortion, xy_px)
        q_ic = esoq2(unit_vectors(camera, ideal), u_i, np.ones(len(xy_px)))
        off = pixels(camera, np.ascontiguousarray(u_i @ dcm_from_quat(q_ic))) - centre
        r = np.hypot(*off.T)
        radius.append(r)
        outward.append(((ideal - centre - off) * off).sum(axis=1) / r)
    return np.concatenate(radius), np.concatenate(outward)


def conclude_calibration(results):
    """What the calibration finds of the true camera."""
    frames = [frame for chunk in results for frame in chunk]
    named = [frame for frame in frames if frame is not None]
    n_wrong = sum(frame[2] for frame in named)
    condition = "with the nominal focal length, 25.00 mm"
    table = [
        rows.share("frames identified", condition, len(named), len(frames)),
        Row("stars named wrongly [stars]", f"in {len(named)} frames", None, n_wrong),
    ]
    condition = f"{len(named)} frames; nominal 25.00, true {TRUE_MM} mm"
    try:
        result = calibrated(frames)
    except ValueError as error:
        missed = (Verdict.TOO_FEW, None, str(error))
        return [*table, Row("focal length found [mm]", condition, None, np.nan, None, *missed)]
    f_mm, sigma = result.camera.focal_length_px * PIXEL_MM, result.sigma
    half = 1.96 * sigma["focal_length_px"] * PIXEL_MM
    table.append(rows.given("focal length of the camera [mm]", "simulated", TRUE_MM, TRUE_CAMERA_MM))
    found = "focal length found [mm]; goal: the true one within 0.01 mm", condition, None, f_mm
    criterion = {"least": TRUE_MM - ACCURACY_MM, "most": TRUE_MM + ACCURACY_MM, "resolves": ACCURACY_MM}
    table.append(rows.goal(*found, (f_mm - half, f_mm + half), len(named), **criterion))
    found = (result.camera.cx_px, result.camera.cy_px, result.distortion[0])
    true = (TRUE_CAMERA.cx_px, TRUE_CAMERA.cy_px, TRUE_K1)
    for name, value, truth in zip(("cx_px", "cy_px", "k1"), found, true, strict=True):
        ends = (value - 1.96 * sigma[name], value + 1.96 * sigma[name])
        table.append(Row(name, f"true value {truth:g}", None, float(value), ends))
    chi = float(np.sqrt(result.chi2 / result.dof))
    table.append(Row("residuals over their expectation (RMS)", "all frames", None, chi))
    return table + _scatter_rows(frames)


def _scatter_rows(frames):
    """Error of the focal length from blocks of frames."""
    blocks = [frames[k : k + BLOCK] for k in range(0, len(frames) - BLOCK + 1, BLOCK)]
    if len(blocks) < 2:
        return []
    errors = np.array([calibrated(block).camera.focal_length_px * PIXEL_MM - TRUE_MM for block in blocks])
    rms, condition = float(np.sqrt(np.mean(errors**2))), f"{len(blocks)} calibrations of {BLOCK} frames each"
    return [Row("error of the focal length, RMS [mm]", condition, None, rms, intervals.rms(errors))]
