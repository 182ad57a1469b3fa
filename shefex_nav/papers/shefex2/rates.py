"""SHEFEX section 4: the chain on frames of a turning camera, exposure under automatic control; and ours.

Each attitude is flown at every rate, about an axis across the boresight, with frames at 10 Hz. Each chain
sets the exposure of its next frame by its own flags, from 50 ms down to 35 in steps of 2; the frame after
SETTLING ones is judged. The published chain is that of `shefex-end-to-end`: sequential scan, weighted
centroids, the pyramid as published. Ours knows the rate to 0.02 deg/s (1 sigma) on each axis.
"""

from dataclasses import replace

import numpy as np

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply
from shefex_nav.geometry.shutter import row_times
from shefex_nav.onboard.startracker import exposure, objects, streaks, tracker
from shefex_nav.onboard.startracker.detect import detect
from shefex_nav.papers.experiment import Experiment
from shefex_nav.papers.picture import tidy
from shefex_nav.papers.rows import judged_share, median, share
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.shefex2 import end_to_end
from shefex_nav.papers.shefex2.field import CAMERA
from shefex_nav.papers.shefex2.frames import DETECT, MODEL, SPACE
from shefex_nav.papers.shefex2.published import SHEFEX
from shefex_nav.papers.stills import electrons, random_attitude, still
from shefex_nav.papers.verdict import POINTS
from shefex_nav.records import Reason

RATES = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)  # deg/s
WAYS = ("as published", "ours")
SETTLING = 8  # the whole range of exposures in steps of 2 ms
NOMINAL_S = 0.05  # exposure of SPACE
RATE_ERROR = np.radians(0.02)
LEAST_STARS = 4
CONTROL = STAR_TRACKER.exposure
OWN = tracker.TrackerParams(STAR_TRACKER, MODEL, np.zeros(3))
MOSTLY, OWN_GOAL = 0.5, 0.9
GOOD_S = tuple(1e-3 * ms for ms in SHEFEX["exposure_control"]["good_range_ms"])


def camera_at(exposure_s):
    """The camera of the mission with another exposure."""
    scale = exposure_s / NOMINAL_S
    return SPACE._replace(
        background_electrons=scale * SPACE.background_electrons,
        zero_magnitude_electrons=scale * SPACE.zero_magnitude_electrons,
        times=row_times(exposure_s, 0.0, CAMERA.height_px),
    )


def found_by(way, image, motion):
    """Detections and mean grey value of a frame."""
    if way == "as published":
        found, seen = detect(replace(DETECT, centroid="weighted"), MODEL, image)
    else:
        found, seen = streaks.detect_streaks(DETECT, MODEL, image, motion)
    return found, seen.mean_dn


def solved_by(way, image, found, motion):
    """q_ic of a frame, or None."""
    if way == "as published":
        return end_to_end.solve_frame(image, way)
    ready = tracker.Tracker(OWN, end_to_end.default_pairs())
    rate = objects.rate_of(CAMERA, motion, found)
    _, reason, (q_ic, _, _) = tracker.attitude(ready, found, tracker.NO_CONTEXT, rate)
    return q_ic if reason == Reason.NONE else None


def fly(way, sky, q_ic, omega_c, known_omega_c, rng):
    """Verdict (1 solved, 0 not, -1 wrong) of the frame after settling, and its exposure [s]."""
    u_i, magnitudes = sky
    exposure_s = CONTROL.start
    for number in range(SETTLING + 1):
        camera = camera_at(exposure_s)
        q_now = quat_multiply(q_ic, quat_from_rotvec(omega_c * (number - SETTLING) * end_to_end.FRAME_S))
        near = u_i @ dcm_from_quat(q_now)[:, 2] > 0.97
        light = electrons(camera, magnitudes[near])
        image, _ = still(camera, u_i[near], light, q_now, rng, omega_c=omega_c)
        motion = streaks.Motion(known_omega_c, RATE_ERROR**2 * np.eye(3), camera.times)
        found, mean_dn = found_by(way, image, motion)
        if number < SETTLING:
            flags = exposure.flags(CONTROL, mean_dn, found)
            exposure_s = exposure.next_exposure(CONTROL, exposure_s, *flags)
    return end_to_end.verdict(solved_by(way, image, found, motion), q_ic), exposure_s


def stars_in_view(q_ic):
    """Catalogue stars on the detector: int."""
    xy_px = pixels(CAMERA, end_to_end.default_pairs().stars.u_i @ dcm_from_quat(q_ic))
    size = np.array([CAMERA.width_px, CAMERA.height_px])
    with np.errstate(invalid="ignore"):  # NaN behind the camera
        return int(((xy_px > 5.0) & (xy_px < size - 6.0)).all(axis=1).sum())


def measure(samples, seed):
    """Verdicts and exposures (samples, ways, rates), and catalogue stars in view (samples,)."""
    rng = np.random.default_rng(seed)
    shape = (samples, len(WAYS), len(RATES))
    verdicts, exposures = np.zeros(shape, dtype=np.int64), np.zeros(shape)
    stars = np.zeros(samples, dtype=np.int64)
    for k in range(samples):
        q_ic, sky = random_attitude(rng), end_to_end.sky_of(rng)
        angle = rng.uniform(0.0, 2.0 * np.pi)
        stars[k] = stars_in_view(q_ic)
        for r, rate in enumerate(RATES):
            omega_c = np.radians(rate) * np.array([np.cos(angle), np.sin(angle), 0.0])
            known = omega_c + RATE_ERROR * rng.standard_normal(3)
            for w, way in enumerate(WAYS):
                verdicts[k, w, r], exposures[k, w, r] = fly(way, sky, q_ic, omega_c, known, rng)
    return {"verdicts": verdicts, "exposures": exposures, "stars": stars}


def conclude(results):
    """Success of both chains against the rate, wrong attitudes, and the exposures that they settled at."""
    verdicts, exposures, stars = (
        np.concatenate([result[name] for result in results]) for name in ("verdicts", "exposures", "stars")
    )
    enough, rows = stars >= LEAST_STARS, []
    for w, way in enumerate(WAYS):
        for r, rate in enumerate(RATES):
            for words, which in (
                (f"{LEAST_STARS} catalogue stars in view", enough),
                ("all frames", stars >= 0),
            ):
                if which.any():
                    judged = (which is enough) == (way == "as published")  # ours: all that were taken
                    rows.append(_success_row(way, rate, words, verdicts[which, w, r] == 1, judged))
        n_wrong, n = int((verdicts[:, w] == -1).sum()), verdicts[:, w].size
        row = share(f"{way}: share of wrong attitudes", "all rates", n_wrong, n)
        if way == "ours":
            row = row._replace(agrees=n_wrong == 0, why=WHY_OWN if n_wrong else "")
        rows.append(row)
        at = exposures[:, w]
        inside = int(((at >= GOOD_S[0] - 1e-9) & (at <= GOOD_S[1] + 1e-9)).sum())
        condition = f"all rates; {inside} of {at.size} in the published range of 35 to 50 ms"
        rows.append(median(f"{way}: exposure, median [ms]", condition, 1e3 * at))
    return rows


def _success_row(way, rate, words, solved, judged):
    """Success of one chain at one rate; most is more than a half, rarely is less."""
    quantity, least, most = f"{way}: success", None, 1.0
    limits = SHEFEX["identification"]
    if way == "as published" and judged and rate <= limits["identified_up_to_deg_s"]:
        least, quantity = np.nextafter(MOSTLY, 1.0), quantity + "; published: most"
    elif way == "as published" and judged and rate > limits["rarely_above_deg_s"]:
        least, most, quantity = 0.0, np.nextafter(MOSTLY, 0.0), quantity + "; published: rarely"
    elif way == "ours" and judged and rate == RATES[-1]:
        least, quantity = OWN_GOAL, quantity + "; agrees if at least 90 %"
    condition, k, n = f"{rate:g} deg/s, {words}", int(solved.sum()), len(solved)
    if least is None:
        return share(quantity, condition, k, n)
    why, criterion = WHY_OWN if way == "ours" else WHY_PUBLISHED, {"least": least, "most": most}
    return judged_share(quantity, condition, None, k, n, why, **criterion, resolves=POINTS)


WHY_PUBLISHED = (
    "success at a rate hangs on the threshold of the detection, which the paper does not give; this one "
    "seeks objects in sums of 3x3 pixels, 5.5 sigma above their noise"
)
WHY_OWN = "not explained"


def draw(figure, results, rows):
    """Success against the rate."""
    figure.set_size_inches(8.0, 5.0)
    axis = figure.subplots()
    for way, colour in zip(WAYS, ("#d1622b", "#1f5fa8"), strict=True):
        for words, style in (("in view", "o-"), ("all frames", "o:")):
            mine = [row for row in rows if row.quantity.startswith(f"{way}: success")]
            mine = [row for row in mine if row.condition.endswith(words)]
            values = 100.0 * np.array([row.measured for row in mine])
            reach = np.abs(100.0 * np.array([row.ci95 for row in mine]).reshape(-1, 2) - values[:, None]).T
            at = [float(row.condition.split()[0]) for row in mine]
            label = f"{way}, {'four stars in view' if words == 'in view' else words}"
            axis.errorbar(at, values, reach, fmt=style, color=colour, ms=4, lw=1.2, capsize=2, label=label)
    axis.axvspan(0.0, 2.0, color="0.95", zorder=0)
    axis.text(0.05, 3.0, "published: most", fontsize=9, color="0.4")
    axis.axvspan(4.0, 5.0, color="0.95", zorder=0)
    axis.text(4.05, 3.0, "published: rarely", fontsize=9, color="0.4")
    axis.set_ylim(0.0, 103.0)
    axis.set_xlabel("rate [deg/s]")
    axis.set_ylabel("frames with a right attitude [%]")
    tidy(axis)
    axis.legend(frameon=False, fontsize=9)


EXPERIMENTS = {
    "shefex-rates": Experiment(
        title="Success against the rate, exposure under automatic control (SHEFEX section 4)",
        samples=500,
        unit="attitudes, each at six rates",
        chunk=10,
        measure=measure,
        conclude=conclude,
        draw=draw,
    ),
}
