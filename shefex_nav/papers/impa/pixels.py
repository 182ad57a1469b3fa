"""IMPA tables 3 to 5 with each pixel as heavy as printed or all alike, and with five spots.

As in `centroids` two contiguous frames are made, and the clusters of the second one that the fusion kept are
held against the stars; but only those that the identification names with these very centroids. The paper
gives the spot's mean width alone, three pixels, and no shape. With the spot of the joint set the extents of
the streaks count both ends, as the box around a cluster does and equation (7) does not.
"""

import numpy as np

from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.impa import experiments, field, flight, moments, trackers
from shefex_nav.papers.impa.centroids import each_case, nearest, recognised, truth
from shefex_nav.papers.impa.kept import READINGS, RUN
from shefex_nav.papers.impa.methods import chain
from shefex_nav.papers.impa.methods import clusters as cluster
from shefex_nav.papers.impa.methods.clusters import WEIGHTS, weighted
from shefex_nav.papers.impa.moments import TABLES
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.picture import legend_below, tidy

WIDE_PX = 3.5  # of the even spot [E]
SPOTS = {  # name -> as `flight.frame` has it; a Gaussian's standard deviation [E]
    "spot of 0.5 px": {"sigma_px": 0.5},
    "spot of 0.6 px": {"sigma_px": 0.6},
    f"spot even over {WIDE_PX:g} px": {"psf": field.box(WIDE_PX)},
    f"spot of {field.PSF_SIGMA_PX:g} px": {"sigma_px": field.PSF_SIGMA_PX},  # that of `centroids`
    f"spot of {flight.JOINT.sigma_px:g} px, extents of both ends": {"sigma_px": flight.JOINT.sigma_px},
}
BOTH_ENDS_PX = (0.0, 0.0, 0.0, 0.0, 1.0)  # by which the extents are longer with each of SPOTS
COLUMNS = ("sample", "rate_deg_s", "table", "spot", "weights", "apart", "x", "y")


def errors_of(times, first, second, stars, longer_px=0.0):
    """Errors of the recognised clusters in the second of two frames, that are those of a star.

    Parameters
    ----------
    times : RowTimes
    first, second : Clusters, with the centroids of one reading
    stars : centroids.Truth
    longer_px : as of `chain.compensated`

    Returns
    -------
    star : (m,) row of Truth
    errors : (2, m, 2) px, compensated and not
    """
    settings, shape = trackers.DETECT.run_length, (field.CAMERA.height_px, field.CAMERA.width_px)
    rows, shift_px = chain.fused(settings, first, second, shape)
    moved = chain.compensated(settings, times, second, rows, shift_px, longer_px=longer_px)
    star = nearest(moved.xy_px, stars.xy_px)
    mine = (star >= 0) & recognised(times, second.energy_dn[rows], moved)
    places = np.array((moved.xy_px[mine], second.xy_px[rows[mine]]))
    return star[mine], places - stars.xy_px[star[mine]]


def rows_of(shutter, case, seed):
    """Rows of COLUMNS from `table` on, of one case and shutter: (m, 6)."""
    stars, times, rows = truth(shutter, case, 1), field.times(shutter), []
    tables = TABLES[:1] if shutter == field.SHUTTERS[0] else TABLES[1:]
    for s, (how, one) in enumerate(zip(SPOTS.values(), seed.spawn(len(SPOTS)), strict=True)):
        frames = flight.pictures(shutter, case, np.random.default_rng(one), **how)
        found = [cluster.find(trackers.DETECT, trackers.MODEL, image) for image in frames]
        for w, weights in enumerate(WEIGHTS):
            both = (weighted(weights, one) for one in found)
            star, errors = errors_of(times, *both, stars, BOTH_ENDS_PX[s])
            for table, of_table in zip(tables, errors, strict=False):
                for apart, error in zip(stars.apart[star], of_table, strict=True):
                    rows.append((TABLES.index(table), s, w, apart, *error))
    return np.array(rows, dtype=float).reshape(-1, len(COLUMNS) - 2)


def measure(samples, seed, first):
    """Samples first ... : {'rows': (m, len(COLUMNS))}."""
    rows = []
    for number, case, shutter, noise in each_case(samples, seed, first):
        found = rows_of(shutter, case, noise)
        head = np.tile([number, round(np.degrees(case.rate))], (len(found), 1))
        rows.append(np.hstack([head, found]))
    return {"rows": np.concatenate(rows)}


# --- tables and figure ---

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
        kept=(*experiments.KEPT, "impa.pixels", "impa.centroids"),
        brief=10,
    )
}
