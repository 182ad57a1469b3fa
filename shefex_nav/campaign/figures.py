"""Pictures of a campaign. matplotlib is imported when a picture is drawn, not before.

Each `draw_*` returns a matplotlib Figure, or None where there is nothing to draw.
"""

import numpy as np

from shefex_nav.campaign import convergence, over_time, sensitivity, statistics
from shefex_nav.report.figures import style
from shefex_nav.report.figures.style import BAND, BLUE, GREY, RED

FAINT = "0.87"
MOST_BARS = 8
MOST_DOTS = 10_000  # of the first runs
MOST_PANELS = 9
FEW_RUNS = 40  # of fewer, each is drawn
FIRST_SHOWN = 10  # number of runs from which estimates are worth looking at


@style.styled
def draw_errors(series):
    """Errors of every axis over time: percentiles over the runs, and 3 sigma as the filter reports it."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure = style.constrained(14.0, 9.0)
    axes, has_decades = figure.subplots(3, 3, sharex=True), False
    for q, (name, unit, factor) in enumerate(style.QUANTITIES):
        block = over_time.BLOCKS.index(name)
        for k, axis in enumerate(axes[:, q]):
            errors = factor * series.errors[:, :, block, k]
            limit = factor * over_time.SIGMAS * series.sigmas[:, :, block, k]
            t_s, (low, middle, high) = _percentiles(series.t_s, errors, (2.5, 50.0, 97.5))
            axis.fill_between(t_s, low, high, color=BAND, lw=0)
            if len(errors) <= FEW_RUNS:  # faint, as the runs of a spinning vehicle cover each other
                axis.plot(series.t_s, errors.T, color=GREY, lw=0.3, alpha=0.25)
            axis.plot(t_s, middle, color=BLUE, lw=1.0)
            t_s, (sigma,) = _percentiles(series.t_s, limit, (50.0,))
            for sign in (-1.0, 1.0):
                axis.plot(t_s, sign * sigma, color=RED, lw=1.0)
            if len(t_s):
                has_decades |= _both_ways(axis, sigma, np.maximum(-low, high))
            axis.set_ylabel(f"{over_time.AXES[k]} [{unit}]")
        axes[0, q].set_title(f"{name}, {'body' if name == 'attitude' else 'inertial'} axes", loc="left")
        axes[2, q].set_xlabel("time from lift-off [s]")
    handles = [
        Patch(color=BAND, label="95 % of the runs"),
        Line2D([], [], color=BLUE, label="median"),
        Line2D([], [], color=RED, label="3 sigma of the filter, median"),
    ]
    if len(series.runs) <= FEW_RUNS:
        handles.append(Line2D([], [], color=GREY, lw=0.5, label="each run"))
    if has_decades:
        words = "scale: linear between the dotted lines, decades beyond"
        handles.append(Line2D([], [], color=GREY, lw=0.8, ls=":", label=words))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    style.heading(figure, f"Errors of {len(series.runs)} runs")
    return figure


def _both_ways(axis, sigma, size):
    """y axis from a linear part about zero, where errors are small, to decades where they are large.

    sigma : (T,) limits drawn;  size : (T,) of the errors drawn. Returns whether it has decades; their ends
    next to zero are then dotted.
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    small = max(float(np.percentile(sigma, 20.0)), 1e-12)
    top = 1.3 * max(float(np.max(sigma)), float(np.max(size)), 1.01 * small)
    axis.set_ylim(-top, top)
    if top < 6.0 * small:
        return False
    axis.set_yscale("symlog", linthresh=small, linscale=1.0)
    decades = 10.0 ** np.arange(np.ceil(np.log10(small)), np.floor(np.log10(top)) + 1.0)
    axis.yaxis.set_major_locator(FixedLocator([*-decades[::-1], 0.0, *decades]))
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.yaxis.set_minor_locator(NullLocator())
    for end in (-small, small):
        axis.axhline(end, color=GREY, lw=0.8, ls=":")
    return True


def _percentiles(t_s, values, percents):
    """(t_s, percentiles) of the epochs that have values: (T',), (P, T')."""
    known = np.isfinite(values).any(axis=0)
    if not known.any():
        return t_s[:0], np.empty((len(percents), 0))
    return t_s[known], np.nanpercentile(values[:, known], percents, axis=0)


@style.styled
def draw_nees(series):
    """Mean normalised squares over the runs, of errors and of innovations, with 95 % bounds.

    As long as half of the runs have the epoch: a mean over the few that fly longest is one of others.
    """
    found, innovations = over_time.anees(series), over_time.anis(series)
    panels = []
    for b, name in enumerate(over_time.BLOCKS):
        words = "" if name in over_time.CORRELATED else ", without the correlations of its axes"
        panels.append((f"NEES, {style.TITLES.get(name, name)}{words}", found.mean[:, b], found))
    panels += [(f"NIS, {name.replace('_', ' ')}", one.mean, one) for name, one in innovations.items()]
    many = 2 * (series.phase >= 0).sum(axis=0) >= len(series.runs)
    panels = [panel for panel in panels if (np.isfinite(panel[1]) & many).any()]
    if not panels:
        return None
    figure = style.constrained(11.0, 1.0 + 1.8 * len(panels))
    axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    for axis, (title, mean, one) in zip(axes, panels, strict=True):
        known = np.isfinite(mean) & many
        bounds = (np.where(many, end, np.nan) for end in (one.low, one.high))
        axis.fill_between(series.t_s, *bounds, color=FAINT, lw=0, step="mid")
        axis.plot(series.t_s[known], mean[known], color=BLUE, lw=1.0)
        axis.axhline(1.0, color=GREY, lw=0.8)
        top = np.nanmax([1.2 * np.percentile(mean[known], 99.0), 1.1 * np.nanmedian(one.high), 1.5])
        axis.set_ylim(0.0, top)
        axis.set_ylabel("per deg. of freedom")
        axis.set_title(title, loc="left", fontsize=10)
    axes[-1].set_xlabel("time from lift-off [s]")
    words = f"mean of {len(series.runs)} runs, while half of them fly"
    style.heading(figure, f"Normalised squares, {words}; grey: 95 % if the filter is right")
    return figure


@style.styled
def draw_containment(series):
    """Share of the runs inside 3 sigma over time, axis by axis."""
    found = over_time.contained(series)
    known = [b for b in range(len(over_time.BLOCKS)) if np.isfinite(found.share[:, b]).any()]
    if not known:
        return None
    figure = style.constrained(11.0, 1.0 + 1.8 * len(known))
    for b, axis in zip(known, np.atleast_1d(figure.subplots(len(known), 1, sharex=True)), strict=True):
        name = over_time.BLOCKS[b]
        axis.fill_between(series.t_s, found.low, found.high, color=FAINT, lw=0, step="mid")
        for k, name_of_axis in enumerate(over_time.AXES):
            look = {"color": style.AXES[name_of_axis], "ls": style.DASHES[name_of_axis]}
            axis.plot(series.t_s, found.share[:, b, k], lw=1.0, label=name_of_axis, **look)
        axis.axhline(over_time.INSIDE, color=GREY, lw=0.8)
        low = min(np.nanmin(found.share[:, b]), np.nanmin(found.low))
        axis.set_ylim(max(0.0, low - 0.25 * (1.0 - low) - 0.005), 1.005)
        axis.set_title(style.TITLES.get(name, name), loc="left", fontsize=10)
        axis.set_ylabel("share")
        if b == known[0]:
            axis.legend(ncols=3, frameon=False, fontsize=9, loc="lower left")
    axis.set_xlabel("time from lift-off [s]")
    style.heading(
        figure, f"Runs inside 3 sigma, of {len(series.runs)}; grey: 99 % if the covariance is right"
    )
    return figure


@style.styled
def draw_ellipses(campaign):
    """Where the flights are at apogee, at entry and at impact."""
    found = statistics.ellipses(campaign)
    if not found:
        return None
    figure = style.constrained(6.5 * len(found), 6.5)
    for axis, one in zip(np.atleast_1d(figure.subplots(1, len(found))), found, strict=True):
        north, east = one.offsets_km[:MOST_DOTS, 0], one.offsets_km[:MOST_DOTS, 1]
        axis.plot(east, north, ".", color=BLUE, ms=7, alpha=0.5, mew=0)
        along = np.radians(one.azimuth_deg)
        angle = np.linspace(0.0, 2.0 * np.pi, 200)
        long, short = one.semi_axes_km[0] * np.cos(angle), one.semi_axes_km[1] * np.sin(angle)
        axis.plot(
            long * np.sin(along) + short * np.cos(along), long * np.cos(along) - short * np.sin(along),
            color=RED, lw=1.5,
        )  # fmt: skip
        axis.plot(0.0, 0.0, "+", color=GREY, ms=10)
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_xlabel("east [km]")
        axis.set_ylabel("north [km]")
        axis.set_title(
            f"{one.what}: {one.samples} runs, {one.inside} inside\n{one.semi_axes_km[0]:.3g} by "
            f"{one.semi_axes_km[1]:.3g} km about {one.latitude_deg:.3f} N, {one.longitude_deg:.3f} E",
            loc="left", fontsize=10,
        )  # fmt: skip
    style.heading(figure, "Dispersion of the flights, 95 % ellipse")
    return figure


@style.styled
def draw_convergence(campaign):
    """Success rates and percentiles of errors against the number of runs, with 95 % intervals."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    panels, judged = [], campaign.judgements
    for k, name in enumerate(judged.names):
        of = judged.judgeable[:, k]
        if of.any():
            course = convergence.success_course(judged.passed[of, k])
            panels.append((f"{name.replace('_', ' ')}: share of runs", course))
    for one in statistics.ERRORS:
        size = np.abs(np.array([campaign.numbers(column) for column in one[1]])).max(axis=0)
        values = size[np.isfinite(size) & campaign.succeeded]
        if len(values) > 1 and ("worst axis" in one[0] or one[0].startswith("position at")):
            panels.append((f"{one[0]}: 95 % [{one[2]}]", convergence.percentile_course(values, 95.0)))
    if not panels:
        return None
    figure, axes = style.small_multiples(len(panels), 3, 13.0, 2.8, 0.6)
    for axis, (title, course) in zip(axes, panels, strict=True):
        axis.fill_between(course.n, course.low, course.high, color=BLUE, alpha=0.2, lw=0)
        axis.plot(course.n, course.value, color=BLUE, lw=1.3)
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.xaxis.set_minor_locator(NullLocator())
        first = FIRST_SHOWN if course.n[-1] > 2 * FIRST_SHOWN else 1
        axis.set_xlim(first, max(course.n[-1], 2))
        shown = np.concatenate([part[course.n >= first] for part in course[1:]])
        low, high = np.nanmin(shown), np.nanmax(shown)
        axis.set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low) + 1e-9)
        axis.set_title(title, loc="left", fontsize=10)
        axis.set_xlabel("runs")
    style.heading(figure, "Estimates against the number of runs, with 95 % intervals")
    return figure


@style.styled
def draw_sensitivity(campaign):
    """Standardised coefficients of the regressions, with 95 % intervals; the best explained results first."""
    found = sensitivity.outcomes(campaign)
    panels = sorted(sensitivity.regressions(found, sensitivity.drawn(campaign)), key=lambda one: -one.r2)[
        :MOST_PANELS
    ]
    if not panels:
        return None
    columns = min(len(panels), 3)
    figure, axes = style.small_multiples(len(panels), columns, 5.5 * columns, 2.9, 0.6)
    for axis, one in zip(axes, panels, strict=True):
        effects = one.effects[:MOST_BARS][::-1]
        values = np.array([effect.value for effect in effects])
        ends = np.array([(effect.low, effect.high) for effect in effects])
        clear = (ends[:, 0] > 0.0) | (ends[:, 1] < 0.0)
        place = np.arange(len(effects))
        axis.barh(place, values, color=[BLUE if sure else "0.8" for sure in clear], height=0.65)
        axis.hlines(place, ends[:, 0], ends[:, 1], color="0.2", lw=1.0)
        axis.set_yticks(place, [_short(effect.feature) for effect in effects], fontsize=8)
        axis.axvline(0.0, color=GREY, lw=0.8)
        axis.set_title(
            f"{one.outcome}: R² {one.r2:.2f} ({one.r2_low:.2f} to {one.r2_high:.2f})", loc="left", fontsize=10
        )
    words = "each with its 95 % interval; grey: zero is within"
    style.heading(figure, f"What explains the results: sigmas per sigma of a draw, {words}")
    return figure


def _short(name):
    """A path that fits beside a bar: its last parts."""
    parts = name.strip("|").split(".")
    text = ".".join(parts[-2:]) if len(parts) > 2 else name.strip("|")
    return f"|{text}|" if name.startswith("|") else text


OF_SERIES = {"errors": draw_errors, "nees": draw_nees, "containment": draw_containment}
OF_RESULTS = {"ellipses": draw_ellipses, "convergence": draw_convergence, "sensitivity": draw_sensitivity}
NAMES = (*OF_SERIES, *OF_RESULTS)
NO_SERIES = "no run that flew to its end has a series over time (campaign.series)"
MISSING = {  # why there is nothing to draw, of each
    **dict.fromkeys(OF_SERIES, NO_SERIES),
    "nees": f"{NO_SERIES}, or the software gives neither covariances nor gate results",
    "containment": f"{NO_SERIES}, or the software gives no covariances",
    "ellipses": f"fewer than {statistics.FEWEST} runs reached apogee, entry or impact, or all at one place",
    "convergence": "there is neither a requirement nor an error that two runs have",
    "sensitivity": "there are too few runs for the number of dispersions, or their results are all alike",
}


def plots(campaign):
    """NAMES as functions: Plots. `sensitivity` is told only of a campaign that has dispersions."""
    from shefex_nav.report.figures import Plots

    def draw(name):
        return draw_one(name, campaign)

    if campaign.draws:
        return Plots(NAMES, draw, MISSING)
    names = [name for name in NAMES if name != "sensitivity"]
    return Plots(names, draw, MISSING | {"sensitivity": "the scenario has no dispersions"})


def draw_one(name, campaign):
    """Figure of one of NAMES, or None where there is nothing to draw."""
    if name in OF_RESULTS:
        return OF_RESULTS[name](campaign)
    series = over_time.read(campaign)
    return None if series is None else OF_SERIES[name](series)


def draw(campaign, series):
    """All pictures that there is something for: list of (name, Figure). series : over_time.Series or None"""
    pictures = {} if series is None else {name: make(series) for name, make in OF_SERIES.items()}
    pictures |= {name: make(campaign) for name, make in OF_RESULTS.items()}
    return [(name, figure) for name, figure in pictures.items() if figure is not None]


def save_all(campaign, series, folder):
    """Write all pictures as PNG into a folder that is there. -> list of Path"""
    written = []
    for name, figure in draw(campaign, series):
        style.save(figure, folder / f"{name}.png", dpi=100)
        written.append(folder / f"{name}.png")
    return written
