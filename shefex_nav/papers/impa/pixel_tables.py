"""Tables and figure of `pixels`: the four moments of the centroid errors, reading by reading."""

import numpy as np

from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.impa import experiments, moments
from shefex_nav.papers.impa.kept import READINGS, RUN
from shefex_nav.papers.impa.methods.weights import WEIGHTS
from shefex_nav.papers.impa.moments import TABLES
from shefex_nav.papers.impa.pixels import COLUMNS, SPOTS, measure
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.picture import legend_below, tidy

SHOWN = ("std", "kurtosis")
OF_ALL = [reading for reading, (_, _, of) in READINGS.items() if of == "recognised"]


def column(rows, name):
    """A column of the results by its name."""
    return rows[:, COLUMNS.index(name)]


def figures(results):
    """Moments of each reading, table, rate and axis: list of moments.Figure."""
    rows, out = np.concatenate([result["rows"] for result in results]), []
    for reading, (spot, weights, of) in READINGS.items():
        which = column(rows, "spot") == list(SPOTS).index(spot)
        which &= column(rows, "weights") == WEIGHTS.index(weights)
        if of != "recognised":
            which &= column(rows, "apart") == 1.0
        mine = rows[which]
        for t, table in enumerate(TABLES):
            for rate in moments.RATES:
                here = mine[(column(mine, "table") == t) & (column(mine, "rate_deg_s") == rate)]
                sample = column(here, "sample")
                if len(np.unique(sample)) < 2:
                    continue
                for axis, errors in zip(moments.AXES, here[:, -2:].T, strict=True):
                    out += moments.figures_of(reading, table, rate, axis, errors, sample)
    return out


def conclude(results):
    """Spread and kurtosis of all recognised stars beside the published ones; they judge nothing here.

    The kept table has the other moments, and the clusters that have no neighbour, too.
    """
    every = [one for one in figures(results) if one.reading in OF_ALL]
    found = [moments.shown(one) for one in every if one.moment in SHOWN]
    n_clusters = sum(len(result["rows"]) for result in results)
    return found or [Row("clusters; a row needs two samples", "all readings", None, float(n_clusters))]


def draw(figure, results, _rows):
    """Standard deviation and kurtosis against rate with 95 %, tables below each other."""
    figure.set_size_inches(11.0, 11.0)
    found = {one[:5]: one for one in figures(results)}
    axes = figure.subplots(len(TABLES), 2, sharex=True)
    for line, table in zip(axes, TABLES, strict=True):
        for axis, moment in zip(line, SHOWN, strict=True):
            values = moments.published(table, moment)["horizontal"]
            axis.plot(moments.RATES, values, "k-", lw=2.5, label="published, horizontal")
            for k, reading in enumerate(OF_ALL):
                keys = [(reading, table, moment, "horizontal", rate) for rate in moments.RATES]
                mine = [found[key] for key in keys if key in found]
                rates = [one.rate + 0.03 * (k - 0.5 * len(OF_ALL)) for one in mine]  # beside each other
                values = [one.value for one in mine]
                above = 0.0 if moment == "kurtosis" else 1.0  # which has no upper end
                bars = [
                    [one.value - one.low for one in mine],
                    [above * (one.high - one.value) for one in mine],
                ]
                axis.errorbar(rates, values, bars, fmt="o-", ms=3, lw=1.0, label=f"simulated, {reading}")
            axis.set_title(
                f"{table.replace('_', ' ')}: {moment}{moments.UNITS.get(moment, '')}", loc="left", fontsize=9
            )
            tidy(axis)
    for axis in axes[-1]:
        axis.set_xticks(IMPA["protocol"]["rates_deg_s"])
        axis.set_xlabel("rate [deg/s]")
    legend_below(figure, axes[0, 0], 2)


EXPERIMENTS = {
    RUN: Experiment(
        samples=650,
        unit="attitudes and directions, each at five rates with both shutters",
        chunk=5,
        measure=measure,
        conclude=conclude,
        draw=draw,
        designed=True,
        kept=(*experiments.KEPT, "impa.pixels", "impa.centroids", "impa.spot"),
        brief=10,
    )
}
