"""The papers' systems in flight beside the default chain: `reproduce as-flown`.

Each flight of the papers' scenarios has three chains: the paper's, the paper's verified, the default.
All three see the same sky with the same camera from the same flight. A frame is solved if its attitude is
right within WRONG_RAD, wrong if it is further off. The camera's own errors (principal point, mounting) are in
every attitude of a flight alike, so accuracy is the scatter of a flight's attitudes about their mean error.
Frames of one flight show the same stars, so the flights are the sample: `rows.together`.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav import prepare, simulate
from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.papers import rows
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.picture import COLOURS, legend_below, tidy
from shefex_nav.records import ComputeTime, FrameTruth, Reason, StarFix
from shefex_nav.report import intervals
from shefex_nav.scenario import load, shipped

WRONG_RAD = np.radians(0.5)
WAYS = ("as published", "verified", "default")
LOWEST = 45.0  # deg, elevation of the boresight of a satellite's camera, drawn above it [E]
TRACKER = "star_tracker"
IDENTIFICATION = f"{TRACKER}.identification"
DEFAULT = (  # what makes a paper's chain the default one
    f"{TRACKER}.detection.centroid=fit",
    f"{IDENTIFICATION}.method=bayes",
    f"{IDENTIFICATION}.acceptance=verified",
    f"{IDENTIFICATION}.tracking=true",
    f"{IDENTIFICATION}.fewest_stars=4",
)


class Flight(NamedTuple):
    """A scenario of a paper, and how it is flown with each of WAYS."""

    name: str
    begin_s: float  # mission time from which frames count
    end_s: float
    sky: bool  # the camera is pointed somewhere else in each flight
    chains: tuple  # (name of the scenario, overrides) of each of WAYS


FLIGHTS = (
    Flight(
        "shefex2_as_flown", 250.0, 262.0, False,
        (
            ("shefex2_as_flown", ()),
            (
                "shefex2_as_flown",
                (f"{IDENTIFICATION}.acceptance=verified", f"{IDENTIFICATION}.cosine_error=null"),
            ),
            ("shefex2_andoya", ()),
        ),
    ),
    Flight(
        "bright_three_star", 32.0, 42.0, True,
        (
            ("bright_three_star", ()),
            (
                "bright_three_star",
                (f"{IDENTIFICATION}.acceptance=verified", f"{IDENTIFICATION}.fewest_stars=4"),
            ),
            (
                "bright_three_star",
                (*DEFAULT, f"{IDENTIFICATION}.reference_magnitude=null", f"{TRACKER}.outlier_sigma=4"),
            ),
        ),
    ),
    Flight(
        "bright_four_star", 32.0, 42.0, True,
        (
            ("bright_four_star", ()),
            ("bright_four_star", (f"{IDENTIFICATION}.acceptance=verified",)),
            ("bright_four_star", (*DEFAULT, f"{TRACKER}.outlier_sigma=4")),
        ),
    ),
    Flight(
        "impa", 33.0, 40.0, True,
        (
            ("impa", (f"{IDENTIFICATION}.acceptance=published",)),
            ("impa", ()),
            (
                "impa",
                (*DEFAULT, f"{TRACKER}.detection.scan=streaks", f"{IDENTIFICATION}.tolerance=0.018 deg"),
            ),
        ),
    ),
)  # fmt: skip
FIGURES = ("frames", "solved", "wrong", "across", "about", "seconds")  # of a flight with one chain


def drawn_sky(rng):
    """Overrides that point a satellite's camera anywhere above LOWEST: tuple of str."""
    elevation = np.degrees(np.arcsin(rng.uniform(np.sin(np.radians(LOWEST)), 1.0)))
    return (
        f"programme.slew.azimuth={rng.uniform(0.0, 360.0):.2f} deg",
        f"programme.slew.elevation={elevation:.2f} deg",
        f"programme.slew.roll={rng.uniform(-180.0, 180.0):.2f} deg",
    )


def flown(name, overrides, begin_s, end_s, seed):
    """What a flight says of a chain, as FIGURES: frames, solved, wrong, scatter [rad] and median time [s].

    A scatter is NaN with fewer than two solved frames.
    """
    scenario = load.load(shipped.files()[name], overrides)
    world = prepare.build_world(scenario, seed)
    truths, fixes, seconds = {}, [], []
    for record in simulate.route(world, scenario, seed, until_s=end_s):
        if isinstance(record, FrameTruth):
            truths[record.number] = record.q_ic
        elif isinstance(record, StarFix) and record.t_valid_s >= begin_s:
            fixes.append(record)
        elif isinstance(record, ComputeTime) and record.t_s >= begin_s:
            seconds.append(record.chain_s)
    given = [fix for fix in fixes if fix.reason == Reason.NONE]
    errors = np.array([rotvec_between(fix.q_ic, truths[fix.number]) for fix in given]).reshape(-1, 3)
    right = np.linalg.norm(errors, axis=1) < WRONG_RAD
    across, about = scatter(errors[right])
    return len(fixes), int(right.sum()), int((~right).sum()), across, about, float(np.median(seconds))


def scatter(errors):
    """Standard deviation across the boresight, per axis, and about it. (n, 3) rad -> rad, rad"""
    if len(errors) < 2:
        return np.nan, np.nan
    variance = errors.var(axis=0, ddof=1)
    return float(np.sqrt(variance[:2].mean())), float(np.sqrt(variance[2]))


def measure(samples, seed):
    """FIGURES of each chain in each flight: (samples, flights, ways, figures)."""
    out = np.empty((samples, len(FLIGHTS), len(WAYS), len(FIGURES)))
    rng = np.random.default_rng(seed)
    for k in range(samples):
        for f, flight in enumerate(FLIGHTS):
            sky = drawn_sky(rng) if flight.sky else ()
            run_seed = int(rng.integers(2**31))
            for w, (name, overrides) in enumerate(flight.chains):
                out[k, f, w] = flown(name, sky + overrides, flight.begin_s, flight.end_s, run_seed)
    return out


ARCSEC = np.pi / 180.0 / 3600.0
ACCURACY = (("across", "error across [arcsec]"), ("about", "error about [arcsec]"))  # the boresight, 1 sigma
SUCCESS, WRONG, TIME = "success", "wrong attitudes", "time a frame [ms]"
GOAL = "default: wrong attitudes; goal: none"
PANELS = (SUCCESS, WRONG, ACCURACY[0][1], ACCURACY[1][1], TIME)


def conclude(results):
    """Success, wrong attitudes, accuracy and time of each chain in each scenario."""
    table, out = np.concatenate(results), []
    for f, flight in enumerate(FLIGHTS):
        chains = [_of_chain(flight, way, table[:, f, w]) for w, way in enumerate(WAYS)]
        out += [row for rows_of_one in zip(*chains, strict=True) for row in rows_of_one]
        of = dict(zip(FIGURES, table[:, f, -1].T, strict=True))
        out += [rows.goal_none_together(GOAL, flight.name, of["wrong"], of["frames"])]
    return out


def _of_chain(flight, way, figures):
    """Rows of one chain in the flights of a scenario, (flights, figures)."""
    of, condition = dict(zip(FIGURES, figures.T, strict=True)), f"{flight.name}, {way}"
    return [
        _share(SUCCESS, condition, of["solved"], of["frames"]),
        _share(WRONG, condition, of["wrong"], of["frames"]),
        *(_accuracy(words, condition, of[name]) for name, words in ACCURACY),
        rows.median(TIME, condition, 1e3 * of["seconds"]),
    ]


def _share(quantity, condition, k, n):
    """Row of a share of frames, of each flight."""
    return Row(quantity, condition, None, float(k.sum() / n.sum()), rows.together(k, n))


def _accuracy(quantity, condition, sigma):
    """Row of the scatter within flights, root mean square over those that have one."""
    known = sigma[np.isfinite(sigma)] / ARCSEC
    if not len(known):
        return Row(quantity, condition, None, np.nan)
    return Row(quantity, condition, None, float(np.sqrt((known**2).mean())), intervals.rms(known))


def draw(figure, results, rows):
    """A panel each of success, wrong attitudes, accuracy and time; bars are the chains."""
    figure.set_size_inches(13.0, 7.5)
    axes = figure.subplots(2, 3).ravel()
    of = {(row.quantity, row.condition): row for row in rows}
    places = np.arange(len(FLIGHTS))
    for axis, quantity in zip(axes, PANELS, strict=False):
        is_share = quantity in (SUCCESS, WRONG)
        for w, way in enumerate(WAYS):
            values = np.array([of[quantity, f"{flight.name}, {way}"].measured for flight in FLIGHTS])
            values = 100.0 * values if is_share else values
            at = places + 0.27 * (w - 1)
            if quantity == WRONG:  # a bar of nothing is not seen
                axis.plot(at, values, "o", color=COLOURS[w])
                axis.set_ylim(0.0, max(1.0, axis.get_ylim()[1]))
            else:
                axis.bar(at, values, 0.26, color=COLOURS[w], label=way)
            for x, value in zip(at, values, strict=True):
                words = "" if np.isnan(value) else f"{value:.2g}" if value < 10.0 else f"{value:.0f}"
                axis.text(x, np.nan_to_num(value), words, ha="center", va="bottom", fontsize=7)
        names = [flight.name.replace("_", "\n", 1).replace("_", " ") for flight in FLIGHTS]
        axis.set_xticks(places, names, fontsize=8)
        axis.set_title(f"{quantity} [%]" if is_share else quantity, fontsize=10)
        axis.margins(y=0.1)
        tidy(axis)
    axes[-1].remove()
    legend_below(figure, axes[0], len(WAYS))


EXPERIMENTS = {
    "as-flown": Experiment(
        samples=20,
        unit="flights of each scenario, with three chains each",
        chunk=1,
        measure=measure,
        conclude=conclude,
        draw=draw,
        timed=True,
        brief=3,
    ),
}
