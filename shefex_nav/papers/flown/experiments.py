"""`reproduce as-flown`: the papers' scenarios and the default chain in one table.

Frames of one flight show the same stars, so the flights are the sample: `rows.together`.
"""

import numpy as np

from shefex_nav.papers import rows
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.flown import flights
from shefex_nav.papers.flown.flights import FIGURES, FLIGHTS, WAYS
from shefex_nav.papers.picture import COLOURS, legend_below, tidy
from shefex_nav.report import intervals

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
        measure=flights.measure,
        conclude=conclude,
        draw=draw,
        timed=True,
        brief=3,
    ),
}
