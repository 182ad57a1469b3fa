"""Rows and figure of the centroid errors; see `impa_centroids`."""

import numpy as np

from shefex_nav.papers import rows as row
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.impa import kept, moments
from shefex_nav.papers.impa.moments import MARGIN
from shefex_nav.papers.impa.published import CENTROID_MEAN_PX, IMPA
from shefex_nav.papers.picture import legend_below, tidy

PUBLISHED = (
    "global_shutter",
    "rolling_compensated",  # with c_z
    "rolling_implicit",  # with c~_z, as equation (22) is printed
    "rolling_uncompensated",
)
BOX, JOINT = "box", "joint spot"  # the same with another spot: even over r_psf pixels, that of the joint set
OWN = ("ours_global", "ours_rolling")


def with_spot(kind, spot):
    """Name of a kind of PUBLISHED with another spot."""
    return f"{kind}, {spot}"


KINDS = (
    *PUBLISHED,
    *(with_spot(kind, BOX) for kind in PUBLISHED),
    *OWN,
    *(with_spot(kind, JOINT) for kind in PUBLISHED),
)
COLUMNS = (
    "rate_deg_s", "kind", "is_star", "x", "y", "electrons",  # of all
    "seen", "snr", "inside", "along", "across", "least_along", "least_across", "nes", "recognised",
    "apart", "sample",
)  # fmt: skip
VARIANT = "rolling_implicit"  # of equation (22): beside the other one, not counted a second time
TABLE = {VARIANT: "rolling_compensated"}  # whose published column a kind is held against
RATES = tuple(IMPA["protocol"]["rates_deg_s"])
OWN_GOAL_PX = 0.2  # at 5 deg/s with a rolling shutter, stars that the published threshold detects
SNR = 15.0
BOUND_GOAL = 1.3
LEAST = 20  # values that make a standard deviation

EXTENTS = (
    "the extent of a streak's pixels is taken for the star's way, as published: it is longer by the spot and "
    "shorter by the faint ends, so the error depends on the stars' brightness and on the width of the spot, "
    "which the paper does not give"
)
WHY = {"rolling_compensated": EXTENTS, "rolling_implicit": EXTENTS}
SMALL_PX, ALMOST_ALL, LARGEST_PX = 2.0, 0.95, 20.0  # of figure 13; 'almost all' is ours [E]
READINGS = {  # of what is a star's cluster; the paper does not say which one is compared with which star
    "stars apart": "those of stars with no other streak within 5 px",
    "recognised": "those that the identification names",  # which is how the paper's chain knows the star
    "recognised and apart": "those that the identification names, no other streak within 5 px",
    "within 2 px": "those within 2 px of a star",  # below which its figure 13 has almost all
}
CHOSEN = "recognised and apart"
ALONE = "of clusters of recognised stars with no other streak within 5 px alone"
EXPLAINS = {  # in this order; words of the run
    "stars apart": f"of clusters {READINGS['stars apart']} alone",
    f"{CHOSEN}, {BOX}": f"with a spot that is even over r_psf pixels, as (26) counts, and {ALONE}",
    f"{CHOSEN}, {JOINT}": f"with the spot of the joint set, 0.7 px, and {ALONE}",
}
SHOWN = (*EXPLAINS, "within 2 px")  # in the sentence of a row that none of them explains
THINGS = {"stars apart": 1, f"{CHOSEN}, {BOX}": 2, f"{CHOSEN}, {JOINT}": 2} | kept.THINGS  # otherwise
WORDS = {  # of a reading that explains a row: how many things are otherwise in it, and which
    reading: f"{THINGS[reading]} thing{'s' * (THINGS[reading] > 1)} otherwise: {words}"
    for reading, words in (EXPLAINS | {reading: kept.words(reading) for reading in kept.READINGS}).items()
}
RUNS = {reading: f"{'impa-centroids' if reading in EXPLAINS else kept.RUN}/{reading}" for reading in WORDS}


def column(rows, name):
    """A column of the results by its name."""
    return rows[:, COLUMNS.index(name)]


def chosen(rows, kind, rate):
    """Rows of a kind and rate that belong to a star."""
    at = (column(rows, "kind") == KINDS.index(kind)) & (column(rows, "rate_deg_s") == rate)
    return rows[at & (column(rows, "is_star") == 1.0)]


def conclude(results, others=kept.others):
    """Tables 3 to 5, and ours.

    others : as `kept.others`, what the kept run gives beside a published figure
    """
    rows = np.concatenate([result["rows"] for result in results])
    out = []
    for kind in PUBLISHED:
        both = [one for rate in RATES for one in _published_rows(kind, rate, rows, others)]
        found = _explained(both)
        if both:
            found.append(_reached_row(kind, both))
        out += found if kind != VARIANT else [row.variant(one) for one in found]
    out += _shape_rows(rows)
    for kind in OWN:
        for rate in RATES:
            out += _own_rows(kind, rate, chosen(rows, kind, rate))
    return out or [_info(f"clusters; a row needs {LEAST}", "all kinds and rates", len(rows))]


def _published_rows(kind, rate, rows, kept_of):
    """Mean, standard deviation, skewness and kurtosis of one kind and rate; and what belongs to no star.

    list of (Row, {reading of SHOWN or WORDS: Row with it}); kept_of: as `kept.others`
    """
    mine = chosen(rows, kind, rate)
    if len(mine) < LEAST or len(np.unique(column(mine, "sample"))) < 2:
        return []
    spots = {"": mine} | {f", {spot}": chosen(rows, with_spot(kind, spot), rate) for spot in (BOX, JOINT)}
    r, table = RATES.index(rate), TABLE.get(kind, kind)
    words = f"{kind.replace('_', ' ')}, {rate:g} deg/s"
    condition, out = f"{words}, {len(mine)} clusters", []
    for axis, name in enumerate(("horizontal", "vertical")):
        values = mine[:, COLUMNS.index("x") + axis], column(mine, "sample")
        found = _moment_rows(name, condition, values, table, r, WHY.get(kind, ""))
        others = {
            reading: _moment_rows(name, condition, values, table, r, "")
            for reading, values in selections(kind, spots, axis).items()
        }
        for k, (one, moment) in enumerate(zip(found, moments.MOMENTS, strict=True)):
            here = {key: found_by[k] for key, found_by in others.items()}
            out.append((one, here | kept_of(table, moment, name, rate)))
    for reading, which in readings(kind, mine).items():
        what, sample = f"clusters, {READINGS[reading]}", column(mine, "sample")
        out.append((_info(what, condition, which.mean(), _of_samples(which, sample)), {}))
    at = (column(rows, "kind") == KINDS.index(kind)) & (column(rows, "rate_deg_s") == rate)
    lost, sample = column(rows[at], "is_star") != 1.0, column(rows[at], "sample")
    out.append((_info("clusters at no star", condition, lost.mean(), _of_samples(lost, sample)), {}))
    return out


def _of_samples(which, sample):
    """Interval of a share of clusters; those of one sample belong together. (n,) bool, (n,)"""
    _, place = np.unique(sample, return_inverse=True)
    return row.together(np.bincount(place, which), np.bincount(place))


def _explained(both):
    """Rows of one kind at all rates, with what one reading explains: that of WORDS which explains most.

    both : as of `_published_rows`

    The reading is chosen afterwards, by the rows that it explains; of some that explain as many it is the
    first of WORDS. It is used for all rows: those that it does not reach are open. `_reached_row` says how
    far the others come.

    'within 2 px' leaves out clusters by the error that is judged: it shows, and explains nothing. The others
    do not look at the error.
    """

    found = _by(_chosen_reading(both), both)
    return [_with_readings(one, of) for one, (_, of) in zip(found, both, strict=True)]


def _by(reading, both):
    """The rows, explained by one reading where it reaches them."""
    run, words = RUNS[reading], WORDS[reading]
    return [row.explained(one, of[reading], run, words) if reading in of else one for one, of in both]


def _chosen_reading(both):
    """That of WORDS which explains most rows, the first of those that explain as many: str."""
    return max(WORDS, key=lambda name: sum(one.verdict == row.Verdict.EXPLAINED for one in _by(name, both)))


def _reached_row(kind, both):
    """How many of the published figures the chosen reading reproduces, and the others."""
    n_rows = sum(one.published is not None for one, _ in both)
    reached = {
        reading: sum(of[reading].verdict == row.Verdict.REPRODUCED for _, of in both if reading in of)
        for reading in WORDS
    }
    used, counts = _chosen_reading(both), list(reached.values())
    condition = (
        f"{kind.replace('_', ' ')}, of {n_rows}: {used}, chosen afterwards of {len(counts)} readings; the "
        f"best has {max(counts)}, the median {np.median(counts):g}"
    )
    return _info("published figures that the chosen reading reproduces", condition, reached[used])


def _with_readings(one, others):
    """A row that is open, with what each reading gives, those of SHOWN and the kept ones; else as it is."""
    if one.verdict == row.Verdict.OPEN and others:
        given = "; ".join(f"{reading} {other.measured:.3g}" for reading, other in others.items())
        one = one._replace(
            why=f"published {one.published:.3g}, here {one.measured:.3g}; of clusters: {given}"
        )
    return one


def selections(kind, spots, axis):
    """Errors along an axis and their samples, (n,) each, of each of SHOWN that has enough of them: dict."""
    out = {}
    for suffix, one in spots.items():
        x, sample = one[:, COLUMNS.index("x") + axis], column(one, "sample")
        for reading, which in readings(kind, one).items():
            if f"{reading}{suffix}" in SHOWN:
                out[f"{reading}{suffix}"] = x[which], sample[which]
    return out


def readings(kind, mine):
    """Which clusters each reading of the paper's statistics leaves: dict of (n,) bool, none with too few.

    Without compensation the errors themselves say nothing of which star a cluster is.
    """
    known = column(mine, "recognised") == 1.0
    of = {"stars apart": column(mine, "apart") == 1.0, "recognised": known}
    of["recognised and apart"] = of["stars apart"] & known
    if kind != "rolling_uncompensated":
        x = COLUMNS.index("x")
        of["within 2 px"] = np.hypot(*mine[:, x : x + 2].T) < SMALL_PX
    sample = column(mine, "sample")
    return {name: which for name, which in of.items() if len(np.unique(sample[which])) >= LEAST}


def _moment_rows(name, condition, values, table, r, why):
    """Standard deviation, mean, skewness and kurtosis beside the published ones.

    values : errors [px] and their sample, (n,) each
    """
    found = moments.figures_of("", table, RATES[r], name, *values)
    return [moments.judged(one, condition, why) for one in found]


def _shape_rows(rows):
    """What the text says of figure 13: almost all below 2 px compensated, close to 20 px at most without."""
    out, condition = [], f"{RATES[-1]:g} deg/s, horizontal and vertical"
    moved, raw = (chosen(rows, kind, RATES[-1]) for kind in ("rolling_compensated", "rolling_uncompensated"))
    x = COLUMNS.index("x")
    if len(moved) >= LEAST:
        below, sample = np.abs(moved[:, x : x + 2]) < SMALL_PX, column(moved, "sample")
        given = f"errors below {SMALL_PX:g} px, compensated; published: almost all", condition, None
        ends = _of_samples(below.ravel(), np.repeat(sample, 2))
        measured = float(below.mean()), ends, len(np.unique(sample))
        out.append(row.statement(*given, *measured, EXTENTS, least=ALMOST_ALL, resolves=1.0 - ALMOST_ALL))
    if len(raw) >= LEAST:
        largest = float(np.abs(raw[:, x : x + 2]).max())
        out.append(Row("largest error, not compensated [px]", condition, LARGEST_PX, largest))
    return out


def _info(quantity, condition, value, interval=None):
    """A row without a verdict."""
    return Row(quantity, condition, None, float(value), interval)


def _own_rows(kind, rate, mine):
    """Ours: both axes for stars as bright as the published threshold detects; the bound for the fainter."""
    out, words = [], f"{kind.replace('_', ' ')}, {rate:g} deg/s"
    seen = column(mine, "seen") == 1.0
    if seen.sum() >= LEAST:
        condition = f"{words}, {int(seen.sum())} stars that the published threshold detects"
        table = "global_shutter" if kind == "ours_global" else "rolling_compensated"
        for axis, name in enumerate(("horizontal", "vertical")):
            errors, sample = mine[seen][:, COLUMNS.index("x") + axis], column(mine[seen], "sample")
            goal = IMPA["centroid_error_std_px"][table][name][RATES.index(rate)]
            square = (errors - errors.mean()) ** 2
            std, interval = errors.std(ddof=1), moments.rms_interval(square, sample)
            strict = kind == "ours_rolling" and rate == RATES[-1]
            most = OWN_GOAL_PX if strict else goal
            given, n = (condition, goal, float(std), interval), len(np.unique(sample))
            if strict:
                quantity = f"ours: std, {name} [px]; goal: under 0.2"
                out.append(row.goal(quantity, *given, n, most=most, resolves=MARGIN * most))
            else:
                how = {"resolves": MARGIN * goal, "rounding": 0.0005, "better": "less"}
                out.append(row.figure(f"ours: std, {name} [px]", *given, n, **how))
    whole = column(mine, "inside") == 1.0
    faint = ~seen & whole & (column(mine, "snr") > SNR)
    groups = (("fainter, SNR over 15", faint, True), ("brighter", seen & whole, False))
    for what, group, has_goal in groups:
        out += _bound_rows(mine[group], f"{words}, {int(group.sum())} stars, {what}", has_goal)
    return out


def _bound_rows(mine, condition, has_goal):
    """Ratio of the errors to the bound along and across, and the normalised squared error."""
    if len(mine) < LEAST:
        return []
    out, sample = [], column(mine, "sample")
    for name in ("along", "across"):
        square = column(mine, name) ** 2 / column(mine, "least_" + name)
        ratio, interval = float(np.sqrt(square.mean())), moments.rms_interval(square, sample)
        quantity = f"ours: error {name} the streak over the Cramer-Rao bound"
        if has_goal:
            given, criterion = (
                (None, ratio, interval, len(np.unique(sample))),
                {"resolves": BOUND_GOAL - 1.0},
            )
            out.append(row.goal(f"{quantity}; goal 1.3", condition, *given, most=BOUND_GOAL, **criterion))
        else:
            out.append(_info(quantity, condition, ratio, interval))
    nes = column(mine, "nes") / 2.0
    out.append(
        _info("ours: normalised squared error per axis (1: as the covariance says)", condition, nes.mean(),
              moments.mean_square_interval(nes, sample))
    )  # fmt: skip
    return out


SHAPES = {
    "global_shutter": 2.0,
    "rolling_compensated": 2.5,
    "rolling_uncompensated": 20.0,
}  # px, of figure 13
SHOWN_PX = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # on the axis
STYLES = {
    "global_shutter": ("#1f5fa8", "o-", "IMPA's chain here, global"),
    "rolling_compensated": ("#d1622b", "o-", "... rolling, compensated"),
    "rolling_uncompensated": ("0.45", "o-", "... rolling, not compensated"),
    "ours_global": ("#1f5fa8", "s:", "ours, global"),
    "ours_rolling": ("#d1622b", "s:", "ours, rolling"),
}


def draw(figure, results, _rows):
    """Figure 14: spread against rate, measured and published; beside it figure 13, errors at 5 deg/s."""
    rows = np.concatenate([result["rows"] for result in results])
    figure.set_size_inches(16.0, 6.5)
    left, right = figure.subfigures(1, 2, width_ratios=(1.2, 1.0))
    _spread(left, rows)
    _distributions(right, rows)


def _distributions(figure, rows):
    """Figure 13: errors at the highest rate; on top mean and standard deviation, measured and published."""
    axes = figure.subplots(len(SHAPES), 2, sharex="row")
    for line, (kind, reach) in zip(axes, SHAPES.items(), strict=True):
        mine = chosen(rows, kind, RATES[-1])
        for k, (axis, name) in enumerate(zip(line, ("horizontal", "vertical"), strict=True)):
            errors = mine[:, COLUMNS.index("x") + k]
            if (np.abs(errors) <= reach).any():  # else there is no density
                how = {"density": True, "color": STYLES[kind][0], "alpha": 0.5}
                axis.hist(errors, bins=60, range=(-reach, reach), **how)
            axis.margins(y=0.3)
            means = CENTROID_MEAN_PX[kind][name][-1], errors.mean() if len(errors) else np.nan
            sigmas = IMPA["centroid_error_std_px"][kind][name][-1], errors.std() if len(errors) else np.nan
            top = axis.get_ylim()[1]
            both = zip(("published", "simulated here"), ("k", STYLES[kind][0]), means, sigmas, strict=True)
            for n, (label, colour, mean, sigma) in enumerate(both):
                look = {"fmt": "o", "ms": 3, "capsize": 3, "color": colour, "label": label}
                axis.errorbar([mean], [top * (0.97 - 0.1 * n)], xerr=[[sigma], [sigma]], **look)
            axis.set_xlim(-reach, reach)
            axis.set_yticks([])
            words = f"{kind.replace('_', ' ')}, {name}, {RATES[-1]:g} deg/s"
            axis.set_title(words, loc="left", fontsize=9)
            tidy(axis)
    for axis in axes[-1]:
        axis.set_xlabel("error of the centroid [px]", fontsize=9)
    legend_below(figure, axes[-1, 0], 2)


def _spread(figure, rows):
    """Spread against rate, horizontal and vertical."""
    axes = figure.subplots(1, 2, sharey=True)
    for axis, (k, name) in zip(axes, enumerate(("horizontal", "vertical")), strict=True):
        for kind, (colour, style, label) in STYLES.items():
            values = []
            for rate in RATES:
                mine = chosen(rows, kind, rate)
                if kind.startswith("ours"):
                    mine = mine[column(mine, "seen") == 1.0]
                errors = mine[:, COLUMNS.index("x") + k]
                values.append(errors.std() if len(errors) > 1 else np.nan)
            axis.plot(RATES, values, style, color=colour, ms=4, lw=1.3, label=label)
            if kind in IMPA["centroid_error_std_px"]:
                published = IMPA["centroid_error_std_px"][kind][name]
                label = "published" if kind == "global_shutter" else None
                axis.plot(RATES, published, "x--", color=colour, ms=6, lw=0.8, label=label)
        axis.set_yscale("log")
        axis.set_yticks(SHOWN_PX, labels=[f"{value:g}" for value in SHOWN_PX])
        axis.set_xticks(RATES)
        axis.set_xlabel("rate [deg/s]")
        axis.set_title(f"{name} (of stars over its threshold)", loc="left", fontsize=10)
        tidy(axis)
    axes[0].set_ylabel("standard deviation of the centroid error [px]")
    legend_below(figure, axes[0], 3)
