"""Figures of the star tracker: what came of the frames, errors of the fixes, settings, computing time."""

import numpy as np

from shefex_nav.records import Reason
from shefex_nav.report import star_metrics
from shefex_nav.report.configured import configured
from shefex_nav.report.figures import style

_ARCSEC = np.degrees(1.0) * 3600.0
_AXES = (("x", "across the boresight, x"), ("y", "across the boresight, y"), ("z", "about the boresight, z"))


@style.styled
def status(data):
    """Result of every frame, its stars and conditions. RunData -> Figure; None without fixes."""
    fixes = data.star_fixes
    if not fixes:
        return None
    t_s = np.array([fix.t_valid_s for fix in fixes])
    has_truth = bool(data.frame_truths)
    words = "Star tracker: what came of each frame, and why"
    figure, rows = style.panels(data, 4 if has_truth else 2, words, spans_s=[style.around(t_s)])
    _reasons(rows[0, 0], fixes, t_s)
    found = np.array([len(fix.hip) for fix in fixes], dtype=float)
    known = np.array([np.count_nonzero(fix.hip) for fix in fixes], dtype=float)
    style.curve(rows[1, 0], t_s, found, color=style.ORANGE, lw=0.9, label="detected")
    style.curve(rows[1, 0], t_s, known, color=style.BLUE, lw=0.9, label="identified")
    rows[1, 0].set_ylabel("objects in\na frame")
    rows[1, 0].set_ylim(bottom=0.0)
    style.legend_above(rows[1, 0])
    if has_truth:
        _conditions(rows[2:, 0], data)
    return figure


def _reasons(axes, fixes, t_s):
    """A lane for each result that occurred; a run of like results is a bar."""
    reasons = np.array([int(fix.reason) for fix in fixes])
    present = sorted(set(reasons.tolist()))
    step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.1
    for lane, reason in enumerate(present):
        colour = style.GREEN if reason == Reason.NONE else style.RED
        runs = style.spans(t_s, reasons == reason)
        least = 0.6 * step_s
        axes.broken_barh([(a, max(b, least)) for a, b in runs], (lane - 0.36, 0.72), color=colour, lw=0.4)
    counts = [int((reasons == reason).sum()) for reason in present]
    names = ["fix" if r == Reason.NONE else _short(Reason(r)) for r in present]
    axes.set_yticks(
        range(len(present)), [f"{n}\n({c})" for n, c in zip(names, counts, strict=True)], fontsize=9
    )
    axes.set_ylim(len(present) - 0.4, -0.6)
    axes.grid(False, axis="y")


def _short(reason):
    return reason.name.lower().replace("_", " ").replace("exclusion", "excl.")


def _conditions(rows, data):
    """True rate, and angles to Sun and limb with their exclusion."""
    frames = data.frame_truths
    t_s = np.array([frame.t_valid_s for frame in frames])
    rate_deg_s = np.degrees([frame.rate for frame in frames])
    style.curve(rows[0], t_s, rate_deg_s, color=style.BLUE)
    rows[0].axhline(np.degrees(star_metrics.WINDOW_RATE), color=style.BLACK, lw=1.0, ls="--")
    rows[0].annotate(
        "window of the star tracker", (0.5, np.degrees(star_metrics.WINDOW_RATE)), (0, 3),
        xycoords=rows[0].get_yaxis_transform(), textcoords="offset points", ha="center", fontsize=9,
    )  # fmt: skip
    style.log_scale(rows[0], bottom=1e-2, top=max(10.0, 2.0 * float(rate_deg_s.max())))
    rows[0].set_ylabel("largest rate\n[deg/s]")
    limits = configured(data)
    for name, field, limit, colour, dashes in (
        ("to the Sun", "sun_angle", limits.sun_exclusion_rad, style.ORANGE, "-"),
        ("above the limb", "limb_angle", limits.limb_exclusion_rad, style.BLUE, "-."),
    ):
        angle_deg = np.degrees([getattr(frame, field) for frame in frames])
        style.curve(rows[1], t_s, angle_deg, color=colour, ls=dashes, label=name)
        if limit is not None:
            rows[1].axhline(np.degrees(limit), color=colour, lw=1.0, ls=":", label="least " + name)
    rows[1].set_ylabel("boresight\n[deg]")
    style.legend_above(rows[1])


@style.styled
def star_errors(data):
    """Error of the fixes about each camera axis with 3 sigma. RunData -> Figure; None without fixes."""
    errors = star_metrics.star_errors(data)
    if not len(errors.t_s):
        return None
    wrong = np.linalg.norm(errors.rotation_c, axis=1) > star_metrics.WRONG_ANGLE
    good = ~wrong
    mean = errors.rotation_c[good].mean(axis=0) if good.any() else np.zeros(3)
    words = "Star tracker: error of every fix about the axes of the camera"
    figure, rows = style.panels(data, 3, words, spans_s=[style.around(errors.t_s)])
    for k, (axis, name) in enumerate(_AXES):
        axes = rows[k, 0]
        arcsec, sigma = errors.rotation_c[:, k] * _ARCSEC, errors.sigma_c[:, k] * _ARCSEC
        label = f"±3 σ about the mean, {mean[k] * _ARCSEC:+.1f}″"
        style.band(axes, errors.t_s, sigma, centre=mean[k] * _ARCSEC, label=label)
        style.dots(axes, errors.t_s[good], arcsec[good], color=style.AXES[axis], label=f"error {name}")
        if good.any():
            edges = mean[k] * _ARCSEC + 3.0 * np.array([[-1.0], [1.0]]) * sigma[good]
            style.limits(axes, [arcsec[good], edges])
        for t_s in errors.t_s[wrong]:
            axes.axvline(t_s, color=style.RED, lw=1.5)
        axes.set_ylabel(f"{axis} [arcsec]")
        style.legend_above(axes, markerscale=3)
    if wrong.any():
        rows[0, 0].set_title(f"{int(wrong.sum())} wrong fixes, marked by lines", color=style.RED, fontsize=10)
    return figure


@style.styled
def camera(data):
    """Exposure, gain, background and residuals of the frames. RunData -> Figure; None without fixes."""
    fixes = data.star_fixes
    if not fixes:
        return None
    t_s = np.array([fix.t_valid_s for fix in fixes])
    shown = data.frames
    has_frames = len(shown.t_valid_s) > 0
    words = "Star camera: settings asked for by the star tracker, background, and fit"
    figure, rows = style.panels(data, 3 + has_frames, words, height=1.4, spans_s=[style.around(t_s)])
    exposure_ms = 1e3 * np.array([fix.exposure_s for fix in fixes])
    style.curve(rows[0, 0], t_s, exposure_ms, color=style.BLUE, drawstyle="steps-post")
    rows[0, 0].set_ylabel("exposure\n[ms]")
    style.limits(rows[0, 0], [exposure_ms], least=1.0)
    style.cut_off(rows[0, 0], exposure_ms, "ms")
    if has_frames:
        style.curve(rows[1, 0], shown.t_valid_s, shown.gain_db, color=style.BLUE, drawstyle="steps-post")
        rows[1, 0].set_ylabel("gain\n[dB]")
        style.limits(rows[1, 0], [shown.gain_db], least=1.0)
    background = np.array([fix.background_dn for fix in fixes])
    style.curve(rows[-2, 0], t_s, background, color=style.BLUE)
    rows[-2, 0].set_ylabel("mean grey\nvalue [DN]")
    style.cut_off(rows[-2, 0], background, "DN")
    residual = np.array([fix.residual_px for fix in fixes])
    style.dots(rows[-1, 0], t_s, residual, color=style.BLUE)
    rows[-1, 0].set_ylabel("residual of\nstars [px rms]")
    rows[-1, 0].set_ylim(bottom=0.0)
    return figure


@style.styled
def timing(data):
    """Time of the star tracker's chain. RunData -> Figure; None without frames.

    A program that waits while the machine does something else has that time in it. On two cores with five
    other programs 20 % of the frames took 5 or 9 ms in place of 0.7: 99 % of these had been interrupted, 2 %
    of the others, and the processor had worked on them for 1.0 ms.
    """
    times = data.compute_times
    chosen = np.isfinite(times.chain_s) & (times.chain_s > 0.0)
    if not chosen.any():
        return None
    t_s, chain_ms = times.t_s[chosen], 1e3 * times.chain_s[chosen]
    figure = style.figure(4.1)
    style.title(figure, "Time that the star tracker's chain took for a frame")
    spec = style.grid(figure, [2.6], columns=2, left=0.9, between=0.8, below=0.3)
    over_time, share = figure.add_subplot(spec[0, 0]), figure.add_subplot(spec[0, 1])
    style.dots(over_time, t_s, chain_ms, color=style.BLUE)
    style.log_scale(over_time)
    over_time.set_xlabel(style.time_label(data))
    over_time.set_ylabel("time [ms]")
    ordered = np.sort(chain_ms)
    percent = 100.0 * np.arange(1, len(ordered) + 1) / len(ordered)
    shown = style.envelope(ordered)
    share.plot(ordered[shown], percent[shown], color=style.BLUE, drawstyle="steps-post")
    median, p99 = np.percentile(chain_ms, [50, 99])
    for value, name, dashes in ((median, "median", "--"), (p99, "99 %", ":")):
        share.axvline(value, color=style.BLACK, lw=1.0, ls=dashes, label=f"{name}: {value:.2f} ms")
    share.set_xlim(0.0, 1.3 * float(np.percentile(chain_ms, 99.5)))
    share.set_ylim(0.0, 100.5)
    share.set_xlabel("time [ms]")
    share.set_ylabel("frames done [%]")
    style.legend_above(share)
    words = "Wall-clock times: work of other programs is in them, loading of compiled code in the first ones"
    figure.text(0.01, 0.01, words, ha="left", va="bottom", fontsize=9, color=style.GREY)
    return figure
