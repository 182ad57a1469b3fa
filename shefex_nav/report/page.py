"""The report of one run to hand over: one HTML page with everything in it.

No network, no scripts: figures are SVG texts inside the page, letters in them are outlines. Summary first,
then sections in the order of the route from the flight to the solution, the scenario and the versions last.
"""

from typing import NamedTuple

from shefex_nav import event_words
from shefex_nav.files import put
from shefex_nav.report import figures, html, incidents, metrics, page_summary, table
from shefex_nav.report.configured import configured
from shefex_nav.report.figures import style
from shefex_nav.report.html import element

_HEADINGS = (  # section of figures.catalogue, heading
    ("flight", "Flight"),
    ("sensors", "Sensors"),
    ("star tracker", "Star tracker"),
    ("navigation", "Navigation errors"),
    ("consistency", "Consistency and trust"),
    ("computing time", "Computing time"),
)


class Run(NamedTuple):
    """What a page is about."""

    data: object  # RunData
    summary: dict  # metrics.summarise
    limits: object  # configured.Configured
    log: str  # name of the file
    digest: str  # sha256 of it; may be empty


def write(path, data, log=None, glance=None):
    """Make the page of a RunData and write it in one piece. Arguments as of `page`."""
    from pathlib import Path

    put(Path(path), page(data, log, glance))


def page(data, log=None, glance=None):
    """The page of a RunData: str.

    log : file that it was read from;  glance : Figure of `figures.glance`, for the head of the page
    """
    name = data.mission.scenario if log is None else log
    run = Run(
        data,
        metrics.summarise(data, log=log),
        configured(data),
        str(name),
        "" if log is None else _digest(log),
    )
    sections = [("summary", "Summary", page_summary.summary(run, incidents.incidents(data)))]
    drawn = _figures(data)
    for section, heading in _HEADINGS:
        parts = [*page_summary.tables(run, section), *drawn.get(section, [])]
        if parts:
            sections.append((section.replace(" ", "-"), heading, parts))
    sections.append(("numbers", "All numbers of the run", [_numbers(run.summary)]))
    sections.append(("scenario", "Scenario and versions", page_summary.origin(run)))
    title = f"{data.mission.scenario}, seed {data.mission.seed}"
    return html.page(
        f"{title}: report of a run",
        header=[element("h1", title), page_summary.lead(run), *([_at_a_glance(glance)] if glance else [])],
        sections=sections,
        footer=f"Report of {run.log}, made by shefex_nav {_version()}.",
    )


def _at_a_glance(figure):
    caption = "A frame with its identified stars named; the dashed line is its instant."
    return html.picture(style.svg(figure), "glance", caption, caption, figure.get_size_inches())


def _version():
    from shefex_nav import __version__

    return __version__


def _digest(log):
    from hashlib import file_digest

    with open(log, "rb") as file:
        return file_digest(file, "sha256").hexdigest()


def _figures(data):
    """{section: its figures as HTML}."""
    out = {}
    for entry in figures.catalogue():
        figure = figures.draw(entry.name, data)
        if figure is None:
            continue
        alt = f"{figure.texts[0].get_text()}. {entry.caption}" if figure.texts else entry.caption
        piece = html.picture(style.svg(figure), entry.name, alt, entry.caption, figure.get_size_inches())
        out.setdefault(entry.section, []).append(piece)
    return out


def _numbers(summary):
    """The table of `report`, without the events, which have one of their own."""
    events = {event_words.in_words(event["name"]) for event in summary["flight"]["events"]}
    rows = []
    for section, lines in table.rows(summary):
        lines = [(name, value) for name, value in lines if section != "flight" or name not in events]
        rows += [(section if k == 0 else "", name, str(value)) for k, (name, value) in enumerate(lines)]
    return html.table("", ("", "", "value"), rows)
