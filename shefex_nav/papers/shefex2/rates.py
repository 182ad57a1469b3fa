"""SHEFEX section 4: the chain on frames of a turning camera, exposure under automatic control; and ours.

Each attitude is flown at every rate, about an axis across the boresight, with frames at 10 Hz. Each chain
sets the exposure of its next frame by its own flags, from 50 ms down to 35 in steps of 2; the frame after
SETTLING ones is judged. The published chains are those of `shefex-end-to-end` on the ground, as the sentence
that they are held against is of pictures of the night sky: a sequential scan of single pixels as printed, or
of sums of 3x3 as our tracker reads it; weighted centroids, the pyramid as published, the uniform catalogue.
Ours flies in space, and knows the rate to 0.02 deg/s (1 sigma) on each axis. What each part of the printed
chain does: `shefex-readings`.
"""

import numpy as np

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply
from shefex_nav.geometry.shutter import row_times
from shefex_nav.onboard.startracker import objects, streaks, tracker
from shefex_nav.onboard.startracker.objects import detect
from shefex_nav.papers import rows as row
from shefex_nav.papers.experiment import Experiment
from shefex_nav.papers.picture import COLOURS, legend_below, points, tidy
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.shefex2 import chain, end_to_end
from shefex_nav.papers.shefex2.end_to_end import CHAINS, GROUND, PAPERS
from shefex_nav.papers.shefex2.field import CAMERA
from shefex_nav.papers.shefex2.frames import DETECT, MODEL, SPACE
from shefex_nav.papers.shefex2.published import SHEFEX
from shefex_nav.papers.stills import electrons, on_detector, random_attitude, still
from shefex_nav.papers.verdict import POINTS
from shefex_nav.records import Reason

RATES = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)  # deg/s
WAYS = (*PAPERS, "ours")
SETTLING = 8  # the whole range of exposures in steps of 2 ms
NOMINAL_S = 0.05  # exposure of SPACE
RATE_ERROR = np.radians(0.02)
LEAST_STARS = 4
CONTROL = STAR_TRACKER.exposure
OWN = tracker.TrackerParams(STAR_TRACKER, MODEL, np.zeros(3))
# [E] what 'most' (up to 2 deg/s) and 'rarely' (above 4) are; read as half and half, thresholds of 4 to 8
# sigma would all do, so the threshold that is chosen follows from these
MOST, RARELY, OWN_GOAL = 0.75, 0.15, 0.9


def camera_at(exposure_s, place=SPACE):
    """The camera at a place with another exposure."""
    scale = exposure_s / NOMINAL_S
    return place._replace(
        background_electrons=scale * place.background_electrons,
        zero_magnitude_electrons=scale * place.zero_magnitude_electrons,
        times=row_times(exposure_s, 0.0, CAMERA.height_px),
    )


def found_by(way, image, motion):
    """Detections and mean grey value of a frame."""
    if way in PAPERS:
        found, seen = detect(CHAINS[way, "ground"].detection, MODEL, image)
    else:
        found, seen = streaks.detect_streaks(DETECT, MODEL, image, motion)
    return found, seen.mean_dn


def solved_by(way, found, motion):
    """q_ic of the objects of a frame, or None."""
    if way in PAPERS:
        return chain.attitude(CHAINS[way, "ground"], found)
    ready = tracker.Tracker(OWN, end_to_end.default_pairs())
    rate = objects.rate_of(CAMERA, motion, found)
    _, reason, (q_ic, _, _) = tracker.attitude(ready, found, tracker.NO_CONTEXT, rate)
    return q_ic if reason == Reason.NONE else None


def fly(way, sky, q_ic, omega_c, known_omega_c, rng):
    """Verdict (1 solved, 0 not, -1 wrong) of the frame after settling, and its exposure [s]."""
    u_i, magnitudes = sky
    exposure_s = CONTROL.start
    for number in range(SETTLING + 1):
        camera = camera_at(exposure_s, GROUND if way in PAPERS else SPACE)
        q_now = quat_multiply(q_ic, quat_from_rotvec(omega_c * (number - SETTLING) * end_to_end.FRAME_S))
        near = u_i @ dcm_from_quat(q_now)[:, 2] > 0.97
        light = electrons(camera, magnitudes[near])
        image, _ = still(camera, u_i[near], light, q_now, rng, omega_c=omega_c)
        motion = streaks.Motion(known_omega_c, RATE_ERROR**2 * np.eye(3), camera.times)
        found, mean_dn = found_by(way, image, motion)
        if number < SETTLING:
            flags = tracker.flags(CONTROL, mean_dn, found)
            exposure_s = tracker.next_exposure(CONTROL, exposure_s, *flags)
    return end_to_end.verdict(solved_by(way, found, motion), q_ic), exposure_s


def stars_in_view(q_ic):
    """Catalogue stars on the detector: int."""
    xy_px = pixels(CAMERA, end_to_end.default_pairs().stars.u_i @ dcm_from_quat(q_ic))
    return int(on_detector(CAMERA, xy_px, 5.0).sum())


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
    """Success of the chains against the rate, wrong attitudes, and the exposures that they settled at."""
    verdicts, exposures, stars = (
        np.concatenate([result[name] for result in results]) for name in ("verdicts", "exposures", "stars")
    )
    out, groups = [], ((f"{LEAST_STARS} catalogue stars in view", stars >= LEAST_STARS), (ALL, stars >= 0))
    for w, way in enumerate(WAYS):
        for r, rate in enumerate(RATES):
            for words, which in groups:
                if which.any():
                    out.append(_success_row(way, rate, words, verdicts[which, w, r] == 1))
        is_wrong, at = verdicts[:, w] == -1, exposures[:, w]
        wrong = row.share_together(f"{way}: share of wrong attitudes", "all rates", is_wrong)
        out.append(wrong if way in PAPERS else row.goal_none(GOAL_WRONG, "all rates", is_wrong))
        longest = int((at >= CONTROL.longest - 1e-9).sum())
        condition = f"all rates, limits 35 and 50 ms; {longest} of {at.size} at the longest"
        out.append(row.median(f"{way}: exposure, median [ms]", condition, 1e3 * at))
    printed = {one.condition: one for one in out if one.quantity.startswith(f"{PAPERS[0]}: success")}
    return [_explained(one, printed) if one.quantity.startswith(PAPERS[1]) else one for one in out]


ALL = "all frames"
GOAL_WRONG = "ours: wrong attitudes; goal: none"
RUN, WORDS = "shefex-rates/as printed", "with single pixels over a threshold as printed"


def _explained(one, printed):
    """A row of the scan as we read it, explained by the printed one where that does what the text says."""
    other = printed.get(one.condition)
    return one if other is None else row.explained(one, other, RUN, WORDS)


def said_of(rate):
    """What section 4 says of a rate [deg/s]: (words, criterion of `verdict.judgement`), or None."""
    limits = SHEFEX["identification"]
    if rate <= limits["identified_up_to_deg_s"]:
        return "most", {"least": MOST, "resolves": POINTS}
    if rate <= limits["rarely_above_deg_s"]:
        return None
    return "rarely", {"least": 0.0, "most": RARELY, "resolves": POINTS}


def _success_row(way, rate, words, solved):
    """Success of one chain at one rate; the threshold of the printed one was chosen for what is said."""
    quantity, k, n = f"{way}: success", int(solved.sum()), len(solved)
    condition, said = f"{rate:g} deg/s, {words}", said_of(rate)
    given = k / n, row.intervals.proportion(k, n), n
    if way in PAPERS and words != ALL and said is not None:
        made = row.statement(f"{quantity}; published: {said[0]}", condition, None, *given, **said[1])
        return row.calibrated(made) if way == PAPERS[0] else made
    if way == "ours" and words == ALL and rate == RATES[-1]:
        criterion = {"least": OWN_GOAL, "resolves": POINTS}
        return row.goal(f"{quantity}; goal: at least 90 %", condition, None, *given, **criterion)
    return row.share(quantity, condition, k, n)


def shade(axis):
    """Where the success of the paper's chain is to lie, by its sentence: as `said_of`."""
    limits, of_100 = SHEFEX["identification"], 100.0
    slow, fast = limits["identified_up_to_deg_s"], limits["rarely_above_deg_s"]
    look = {"color": "0.92", "lw": 0.0, "zorder": 0}
    axis.fill_between((RATES[0], slow), of_100 * MOST, of_100, **look)
    axis.fill_between((fast, RATES[-1]), 0.0, of_100 * RARELY, **look)


def draw(figure, results, rows):
    """Success against the rate."""
    figure.set_size_inches(8.0, 6.0)
    axis = figure.subplots()
    for way, colour in zip(WAYS, (COLOURS[1], COLOURS[4], COLOURS[0]), strict=True):
        for words, style in (("in view", "o-"), ("all frames", "o:")):
            mine = [one for one in rows if one.quantity.startswith(f"{way}: success")]
            mine = [one for one in mine if one.condition.endswith(words)]
            at = [float(one.condition.split()[0]) for one in mine]
            label = f"simulated {way}, {'four stars in view' if words == 'in view' else words}"
            points(axis, at, mine, style, 100.0, color=colour, ms=4, lw=1.2, capsize=2, label=label)
    shade(axis)
    axis.text(0.05, 100.0 * MOST + 1.0, f"published: most, read as {MOST:.0%}", fontsize=9, color="0.4")
    words = f"published: rarely, read as {RARELY:.0%}"
    axis.text(RATES[-1], 1.5, words, fontsize=9, color="0.4", ha="right")
    axis.set_ylim(0.0, 103.0)
    axis.set(xlabel="rate [deg/s]", ylabel="frames with a right attitude [%]")
    tidy(axis)
    legend_below(figure, axis, 2)


EXPERIMENTS = {
    "shefex-rates": Experiment(
        samples=500,
        unit="attitudes, each at six rates",
        chunk=10,
        measure=measure,
        conclude=conclude,
        draw=draw,
    ),
}
