"""The study as one HTML page: requirements, pictures, all cells, what could not be noticed."""

import numpy as np

from shefex_nav.files import put
from shefex_nav.report import html
from shefex_nav.report.figures import style
from shefex_nav.report.html import element
from shefex_nav.report.trust import TIME_TO_ALERT_S
from shefex_nav.verify.robustness import cells, design, require, show

CAPTIONS = {
    "misleading": "Seconds in which a solution that may be used was beyond its protection level, all flights "
    "of a pair of levels together. White: none; grey: not flown.",
    "ratio": "Largest error over its protection level while it may be used. Red, above 1: it is broken.",
    "nees": "NEES of 9 degrees of freedom at the end of the flights in which nothing happens: each cell its "
    "mean, and the middle 90 % of its flights. Grey: 5 to 15.",
    "alarms": "Seconds from when a fault could be noticed and the error was beyond its level to 'do not use' "
    "with the right reason. Right of 1 s: too late.",
}


def write(path, head, records):
    """Write the page in one piece."""
    put(path, page(head, records))


def page(head, records):
    """The page: str."""
    judged = require.judge(records)
    summary = f"{require.counted(len(records), 'flight')}; {require.in_short(judged)}"
    drawn = draw(records)
    sections = [
        ("requirements", "Requirements", [element("p", summary), _requirements(judged)]),
        ("pictures", "Pictures", [style.picture(one, name, CAPTIONS[name]) for name, one in drawn]),
        ("levels", "Levels", [_level(records, name) for name in design.FACTORS]),
        ("worst", "Worst cells", [_cells(show.worst(records))]),
        ("undetectable", "Misled before, or without, being detectable", [_undetectable(records)]),
        ("cells", "All cells", [_cells(cells.table(records))]),
    ]
    title = "Robustness: " + ", ".join(head["scenarios"])
    return html.page(
        title,
        header=[element("h1", title)],
        sections=sections,
        footer=", ".join(f"{name} {value}" for name, value in head.items() if name != "scenarios"),
    )


def _requirements(judged):
    rows = []
    for one in judged:
        verdict = show.verdict(one)
        rows.append(
            (one.name, one.words, one.found, element("strong", verdict) if one.good is False else verdict)
        )
    return html.table("", ("requirement", "required", "found", "verdict"), rows)


def _level(records, name):
    rows = [(level, *show.row(cells.of_cell(found))) for level, found in show.by(records, name)]
    return html.table(f"by {name}", (name, *show.HEADS), rows, range(1, 1 + len(show.HEADS)))


def _cells(found):
    names = ("cell", *design.FACTORS)
    rows = [(*(levels[name] for name in names), *show.row(figures)) for levels, figures in found]
    return html.table("", (*names, *show.HEADS), rows, range(len(names), len(names) + len(show.HEADS)))


def _undetectable(records):
    rows = require.undetectable(records)
    if not rows:
        return element("p", "Nothing.")
    return html.table("", list(rows[0]), [tuple(one.values()) for one in rows], (6, 7))


def draw(records):
    """Yields (name, Figure)."""
    flown = [record for record in records if "failed" not in record]
    if not flown:
        return
    if len({(record["happens"], record["told"]) for record in flown}) > 1:  # else a map is one colour
        yield "misleading", _map(flown, "misleading_s", "s", "Reds")
        yield "ratio", _map(flown, "largest_ratio", "error over level", "RdBu_r")
    yield "nees", _nees(flown)
    yield "alarms", _alarms(flown)


def _values(flown, key, names):
    """Largest ratio, or sum of seconds, of pairs of levels: dict. A ratio that is no number is infinite."""
    is_ratio = key == "largest_ratio"
    return {
        pair: (max if is_ratio else sum)(
            np.inf if is_ratio and one[key] is None and one["usable_s"] else (one[key] or 0.0)
            for record in found
            for one in record["quantities"].values()
        )
        for pair, found in cells.grouped(flown, *names).items()
    }


@style.styled
def _map(flown, key, label, colours):
    """What happens over what is told wrongly, and rockets with grades over phases."""
    from matplotlib.colors import LogNorm, Normalize

    figure = style.constrained(style.WIDTH, 6.6)
    left, right = figure.subplots(1, 2, width_ratios=(2.2, 1.0))
    flown = [record | {"unit": f"{record['rocket']}, {record['grade']}"} for record in flown]
    for axes, names in ((left, ("happens", "told")), (right, ("unit", "phase"))):
        values = _values(flown, key, names)
        rows, columns = (_ordered({pair[k] for pair in values}) for k in (0, 1))
        grid = np.full((len(rows), len(columns)), np.nan)
        for (one, other), value in values.items():
            grid[rows.index(one), columns.index(other)] = value
        most = np.max(grid[np.isfinite(grid)], initial=0.0)
        norm, ticks = Normalize(0.0, max(most, TIME_TO_ALERT_S)), None  # what is shorter misleads nobody
        if key == "largest_ratio":  # 1 is the middle
            top = max(most, 2.0)  # of an error without a level, too
            norm, grid, ticks = LogNorm(1.0 / top, top), np.clip(grid, 1e-6, top), [1.0 / top, 1.0, top]
        axes.set_facecolor("#dddddd")
        mesh = axes.imshow(grid, cmap=colours, norm=norm, aspect="auto")
        axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right", fontsize=7.5)
        axes.set_yticks(range(len(rows)), rows, fontsize=7.5)
        axes.grid(False)
        bar = figure.colorbar(mesh, ax=axes, label=label, shrink=0.7, ticks=ticks, format="%.3g")
        bar.minorticks_off()
    return figure


def _ordered(levels):
    """Levels in the order of the design; rockets with grades in that of their names. set of str -> list"""
    order = [level for known in design.FACTORS.values() for level in known]
    return sorted(levels, key=lambda level: (order.index(level) if level in order else len(order), level))


@style.styled
def _nees(flown):
    figure = style.constrained(style.WIDTH, 4.2)
    axes = figure.subplots()
    axes.axhspan(*require.NEES, color="#e4e4e4")
    found = cells.grouped(flown, "told", "cell")
    names, colours = _ordered({key[0] for key in found}), (style.BLUE, style.RED)
    order = sorted(found, key=lambda key: (names.index(key[0]), key[1]))
    for k, key in enumerate(order):
        spread = cells.of_cell(found[key])["nees_healthy_end"]
        if spread["mean"] is None:
            continue
        colour = colours[names.index(key[0]) % 2]
        axes.plot([k, k], [spread["p5"], spread["p95"]], color=colour, linewidth=0.8)
        axes.plot([k], [spread["mean"]], ".", color=colour, markersize=4)
    middles = [np.mean([k for k, key in enumerate(order) if key[0] == name]) for name in names]
    axes.set_xticks(middles, names, rotation=60, ha="right", fontsize=8)
    axes.set(yscale="log", ylabel="NEES", title="NEES at the end, nothing happens")
    return figure


@style.styled
def _alarms(flown):
    figure = style.constrained(style.WIDTH, 3.6)
    axes, found = figure.subplots(), {}
    for record in flown:
        for alarm in record["fault"]["alarm"].values() if record["fault"] else ():
            if alarm["after_s"] is not None:
                found.setdefault(record["happens"], []).append(max(alarm["after_s"], 0.02))
    for k, (_, seconds) in enumerate(sorted(found.items())):
        axes.plot(seconds, np.full(len(seconds), k), "|", color=style.BLUE, markersize=9)
    axes.axvline(1.0, color=style.RED, linestyle="--")
    axes.set_yticks(range(len(found)), sorted(found), fontsize=8)
    axes.set(xscale="log", xlabel="s", title="Time to alarm")
    return figure
