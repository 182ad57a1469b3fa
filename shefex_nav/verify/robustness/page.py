"""The study as one HTML page: requirements, pictures, all cells, what could not be noticed."""

from shefex_nav.files import put
from shefex_nav.report import html
from shefex_nav.report.figures import style
from shefex_nav.report.html import element
from shefex_nav.verify.robustness import cells, design, pictures, require, show

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
    drawn = pictures.draw(records)
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
