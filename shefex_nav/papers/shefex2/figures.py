"""Figures like those of the SHEFEX paper. Each `draw_*(figure, results, rows)` fills a matplotlib Figure."""

import numpy as np

from shefex_nav.papers.picture import COLOURS, tidy
from shefex_nav.papers.shefex2 import attitude, stars
from shefex_nav.report import intervals

STYLES = ("o-", "s-", "^-", "D-", "v-")


def draw_catalogue(figure, _results, _rows):
    """The sky of the catalogues (figures 4 and 5): three maps, right ascension against declination."""
    figure.set_size_inches(9.0, 10.5)
    built = stars.build_catalogues()
    shown = ("asymmetric", "uniform", "combined")
    for axis, name in zip(figure.subplots(3, 1, sharex=True), shown, strict=True):
        sky = built[name]
        ra_deg = np.degrees(np.arctan2(sky.u_i[:, 1], sky.u_i[:, 0])) % 360.0
        dec_deg = np.degrees(np.arcsin(sky.u_i[:, 2]))
        size = 2.0 + 2.2 * np.clip(6.0 - sky.vmag, 0.0, 6.0) ** 1.3
        axis.scatter(ra_deg, dec_deg, s=size, color=COLOURS[0], alpha=0.65, lw=0)
        south = (dec_deg < 0.0).mean()
        title = f"{name}: {len(dec_deg)} stars, {south:.0%} south, faintest V {sky.vmag.max():.2f}"
        axis.set_title(title, loc="left", fontsize=10)
        axis.set_ylabel("declination [deg]")
        axis.set_xlim(360.0, 0.0)
        axis.set_ylim(-90.0, 90.0)
        axis.set_xticks(range(0, 361, 60))
        axis.set_yticks(range(-90, 91, 30))
        tidy(axis)
    axis.set_xlabel("right ascension [deg]")


def draw_cos_error(figure, results, _rows):
    """Time (figure 7) and success (figure 8) against cosError."""
    verdict, seconds = (np.concatenate(column) for column in zip(*results, strict=True))
    figure.set_size_inches(11.0, 4.8)
    left, right = figure.subplots(1, 2)
    for e, error_px in enumerate(stars.CENTROID_ERRORS_PX):
        style = {"ms": 4, "lw": 1.2, "color": COLOURS[e], "label": f"{error_px:g} px"}
        left.plot(stars.COS_ERRORS, 1e3 * seconds[:, e].mean(axis=0), STYLES[e], **style)
        success = 100.0 * (verdict[:, e] == stars.RIGHT).mean(axis=0)
        right.plot(stars.COS_ERRORS, success, STYLES[e], **style)
    left.set_yscale("log")
    left.set_ylabel("mean time [ms]")
    right.set_ylabel("success [%]")
    right.set_ylim(0.0, 102.0)
    for axis in (left, right):
        axis.set_xscale("log")
        axis.set_xlabel("cosError")
        axis.axvline(stars.COS_ERRORS[stars.CHOSEN], color="0.5", lw=0.9, ls=":")
        axis.legend(title="centroid error", frameon=False, fontsize=9)
        tidy(axis)
    left.set_title("as figure 7", loc="left", fontsize=10)
    right.set_title("as figure 8; dotted: the cosError chosen there", loc="left", fontsize=10)


def draw_spikes(figure, results, _rows):
    """Wrong identifications against the number of spikes (figure 9)."""
    wrong = np.concatenate(results) == stars.WRONG_ONE
    figure.set_size_inches(7.5, 5.0)
    axis = figure.subplots()
    for c, cos_error in enumerate(stars.SPIKE_COS_ERRORS):
        k = wrong[:, :, c].sum(axis=0)
        ends = 100.0 * np.array([intervals.proportion(int(count), len(wrong)) for count in k])
        axis.fill_between(stars.SPIKES, ends[:, 0], ends[:, 1], color=COLOURS[c], alpha=0.12, lw=0)
        rate = 100.0 * k / len(wrong)
        axis.plot(stars.SPIKES, rate, STYLES[c], ms=4, lw=1.2, color=COLOURS[c], label=f"{cos_error:g}")
    axis.set(xlabel="spikes in the field", ylabel="wrong identifications [%]")
    axis.set_title("as figure 9; bands: 95 % confidence", loc="left", fontsize=10)
    axis.set_xlim(0, stars.SPIKES[-1])
    axis.set_ylim(bottom=0.0)
    axis.legend(title="cosError", frameon=False, fontsize=9)
    tidy(axis)


def draw_attitude(figure, results, _rows):
    """Errors about the three axes against the centroid error (figure 10)."""
    errors, known = np.moveaxis(np.concatenate([errors for errors, _ in results]), 1, 0)
    figure.set_size_inches(8.0, 5.4)
    axis = figure.subplots()
    for k, name in enumerate(attitude.AXES):
        style = {"color": COLOURS[k], "ms": 4, "lw": 1.2}
        label = f"{name}: 97.5th percentile" + (" (3 sigma dashed)" if k == 2 else "")
        curve = attitude.percentiles(errors[:, :, k])
        axis.plot(attitude.ERRORS_PX, curve, STYLES[k], label=label, **style)
        axis.plot(attitude.ERRORS_PX, attitude.three_sigma(errors[:, :, k]), "--", color=COLOURS[k], lw=1.0)
    axis.set_ylim(0.0, 1.3 * np.nanmax(curve))  # of yaw: a single wild attitude does not set the scale
    curve = attitude.percentiles(known[:, :, 2])
    axis.plot(attitude.ERRORS_PX, curve, color="0.6", lw=1.2, label="yaw, all stars known")
    axis.axhline(attitude.LIMIT_DEG, color="0.3", lw=0.9, ls=":")
    axis.axvline(attitude.CROSSING_PX, color="0.3", lw=0.9, ls=":")
    axis.set(xlabel="centroid error per axis [px]", ylabel="attitude error [deg]")
    axis.set_title(
        "as figure 10; dotted: the requirement, and where the paper passes it", loc="left", fontsize=10
    )
    axis.set_xlim(0.0, attitude.ERRORS_PX[-1])
    axis.legend(frameon=False, fontsize=9)
    tidy(axis)


def draw_calibration(figure, results, _rows):
    """Focal length against the number of frames, and the residuals with the nominal and the found camera."""
    frames = [frame for chunk in results for frame in chunk]
    figure.set_size_inches(11.0, 4.8)
    left, right = figure.subplots(1, 2)
    estimates = []
    fewer = [n for n in (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000) if n < len(frames)]
    for n in (*fewer, len(frames)):
        try:
            result = attitude.calibrated(frames[:n])
        except ValueError:  # too few stars in so few frames: there is no estimate to draw
            continue
        f_mm = result.camera.focal_length_px * attitude.PIXEL_MM
        estimates.append((n, f_mm, 1.96 * result.sigma["focal_length_px"] * attitude.PIXEL_MM))
    left.axhspan(
        attitude.TRUE_MM - attitude.ACCURACY_MM, attitude.TRUE_MM + attitude.ACCURACY_MM, color="0.92"
    )
    left.axhline(attitude.TRUE_MM, color="0.3", lw=0.9, ls=":")
    if estimates:
        n, f_mm, half = np.array(estimates).T
        left.errorbar(n, f_mm, half, fmt="o", color=COLOURS[0], ms=4, capsize=3)
        _residuals(right, [frame for frame in frames if frame is not None][:200])
    left.set_xscale("log")
    left.set(xlabel="frames", ylabel="focal length [mm]")
    left.set_title("estimate, 95 %; grey: true value ± 0.01 mm", loc="left", fontsize=10)
    tidy(left)
    tidy(right)


def _residuals(axis, frames):
    """Outward residuals against the distance from the middle, before and after the calibration."""
    found = attitude.calibrated(frames)
    cameras = {
        "nominal camera": (attitude.CAMERA, np.zeros(5)),
        "calibrated camera": (found.camera, found.distortion),
    }
    for colour, (name, (camera, distortion)) in zip(COLOURS[1::-1], cameras.items(), strict=True):
        radius, outward = attitude.radial_residuals(frames, camera, distortion)
        axis.plot(radius, outward, ".", ms=2.5, color=colour, alpha=0.6, label=name)
    axis.set(xlabel="distance from the middle [px]", ylabel="residual outwards [px]")
    axis.set_ylim(-2.0, 2.0)
    axis.legend(frameon=False, fontsize=9, markerscale=3)


def draw_scan(figure, results, rows):
    """Distribution of the times of both scans."""
    sequential, maximum, _, _ = 1e3 * np.concatenate(results)[:, 0].T  # of the fewer objects
    figure.set_size_inches(7.0, 4.5)
    axis = figure.subplots()
    bins = np.geomspace(0.5 * sequential.min(), 2.0 * maximum.max(), 60)
    axis.hist(sequential, bins, color=COLOURS[0], label="sequential scan")
    axis.hist(maximum, bins, color=COLOURS[1], label="maximum search")
    axis.set_xscale("log")
    axis.set(xlabel="time of a frame [ms]", ylabel="frames")
    ratios = [row for row in rows if row.published is not None]
    words = ", ".join(f"{row.measured:.1f} with {row.condition.split(', ')[0]}" for row in ratios)
    axis.set_title(f"ratio {words}; published {ratios[0].published:.1f}", loc="left", fontsize=10)
    axis.legend(frameon=False)
    tidy(axis)


def draw_end_to_end(figure, _results, rows):
    """Success with its interval beside the published one."""
    rows = [row for row in rows if row.quantity == "success"]
    figure.set_size_inches(9.0, 4.6)
    axis = figure.subplots()
    for k, row in enumerate(rows):
        low, high = row.ci95 or (row.measured, row.measured)
        axis.plot([100.0 * low, 100.0 * high], [k, k], color=COLOURS[0], lw=2.0)
        axis.plot(100.0 * row.measured, k, "o", color=COLOURS[0])
        if row.published is not None:
            axis.plot(100.0 * row.published, k, "|", ms=18, mew=2.0, color=COLOURS[1])
    axis.set_yticks(range(len(rows)), [row.condition for row in rows], fontsize=9)
    axis.invert_yaxis()
    axis.set_xlabel("success [%]; point and line: simulated here, 95 %; bar: published as 'more than'")
    tidy(axis)
