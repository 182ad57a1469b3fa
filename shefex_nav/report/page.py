"""The report of one run to hand over: one HTML page with everything in it.

No network, no scripts: figures are SVG texts inside the page, letters in them are outlines. Summary first,
then sections in the order of the route from the flight to the solution, the scenario and the versions last.
"""

from collections import Counter
from hashlib import file_digest
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__, event_words
from shefex_nav.files import opened, put
from shefex_nav.records import QUANTITIES, Reason, protected
from shefex_nav.report import (
    error_figures,
    figures,
    html,
    likely_mistakes,
    local_level,
    metrics,
    page_summary,
    sensor_use,
    star_metrics,
    table,
    table_rows,
    trust,
)
from shefex_nav.report.configured import configured
from shefex_nav.report.figures import style
from shefex_nav.report.html import element
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.report.pairing import stretches

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
    sections = [("summary", "Summary", page_summary.summary(run, incidents(data)))]
    drawn = _figures(data)
    for section, heading in _HEADINGS:
        parts = [*page_summary.tables(run, section), *drawn.get(section, [])]
        if parts:
            sections.append((section.replace(" ", "-"), heading, parts))
    sections.append(("numbers", "All numbers of the run", [_numbers(run.summary)]))
    sections.append(("scenario", "Scenario and versions", page_summary.origin(run)))
    title = local_level.title(data)
    return html.page(
        f"{title}: report of a run",
        header=[element("h1", title), page_summary.lead(run), *([_at_a_glance(glance)] if glance else [])],
        sections=sections,
        footer=f"Report of {run.log}, made by shefex_nav {__version__}.",
    )


def _at_a_glance(figure):
    caption = "A frame with its identified stars named; the dashed line is its instant."
    return style.picture(figure, "glance", caption)


def _digest(log):
    with opened(log) as file:
        return file_digest(file, "sha256").hexdigest()


def _figures(data):
    """{section: its figures as HTML}."""
    out = {}
    for entry in figures.catalogue():
        figure = figures.draw(entry.name, data)
        if figure is None:
            continue
        alt = f"{figure.texts[0].get_text()}. {entry.caption}" if figure.texts else entry.caption
        out.setdefault(entry.section, []).append(style.picture(figure, entry.name, entry.caption, alt))
    return out


def _numbers(summary):
    """The table of `report`, without the events, which have one of their own."""
    events = {event_words.in_words(event["name"]) for event in summary["flight"]["events"]}
    rows = []
    for section, lines in table.rows(summary):
        lines = [(name, value) for name, value in lines if section != "flight" or name not in events]
        rows += [(section if k == 0 else "", name, str(value)) for k, (name, value) in enumerate(lines)]
    return html.table("", ("", "", "value"), rows)


# ----------------------------------------------------------------------------------------------------------
# What went wrong in a run, and when: one list out of all the places of a log that say so.


_TOGETHER_S = (
    2.5  # refusals of one sensor, or doubts about one quantity, that are not farther apart are one incident
)


class Incident(NamedTuple):
    """Something out of order."""

    from_s: float
    until_s: float | None  # None: it lasted to the end of the log
    what: str


def incidents(data):
    """Incidents of a RunData by time: list of Incident, empty where all went well."""
    found = [*_noticed(data), *_refused(data), *_resets(data), *_doubts(data), *_imu(data), *_stars(data)]
    found += _errors(data)
    if data.ended_early:
        why = data.failure.partition("\n")[0] or "the run was cut off"
        found.append(Incident(data.reached_s, None, f"the log ends here: {why}"))
    return sorted(found, key=lambda incident: (incident.from_s, incident.what))


def _errors(data):
    """Errors far beyond their sigmas, and what those of a user's own software look like."""
    errors = navigation_errors(data)
    for one in error_figures.beyond_sigma(data, errors):
        yield Incident(one.from_s, one.until_s, table_rows.beyond_words(one))
    if sensor_use.is_own(data):
        for one in likely_mistakes.found(data, errors, configured(data).scenario):
            yield Incident(one.from_s, one.until_s, f"errors fit {one.what}")


def _noticed(data):
    for entry in trust.noticed(data.health):
        name = entry["source"].replace("_", " ")
        yield Incident(entry["from_s"], entry["until_s"], f"{name} out of use: {entry['reason']}")


def _refused(data):
    """Refused measurements, those of a sensor in a row together."""
    by_sensor = {}
    for gate in data.gates:
        if not gate.accepted and gate.dof > 0:
            by_sensor.setdefault(gate.sensor, []).append(gate)
    for sensor, gates in by_sensor.items():
        times = np.array([gate.t_valid_s for gate in gates])
        for group in np.split(np.arange(len(gates)), np.flatnonzero(np.diff(times) > _TOGETHER_S) + 1):
            notes = Counter(gates[k].note for k in group)
            why = "; ".join(note for note, _ in notes.most_common(2) if note)
            plural = "s" if len(group) > 1 else ""
            what = f"{len(group)} measurement{plural} of {sensor.replace('_', ' ')} refused"
            yield Incident(float(times[group[0]]), float(times[group[-1]]), f"{what}: {why}" if why else what)


def _resets(data):
    """Measurements that were used in an unusual way."""
    for gate in data.gates:
        if gate.accepted and gate.note:
            yield Incident(gate.t_s, gate.t_s, f"{gate.sensor.replace('_', ' ')}: {gate.note}")


def _doubts(data):
    nav = data.nav
    if not len(nav.t_s):
        return
    limits = trust.limits_of(configured(data))
    for quantity in QUANTITIES:
        said = protected(nav, quantity)
        limit, by_default = limits[quantity].values()
        for doubt in trust.DOUBTS:
            text = trust.doubt_words(doubt, quantity, limit, by_default)
            for start, end in _joined(_runs(nav.t_s, said.do_not_use & (said.doubt == doubt))):
                yield Incident(start, end, f"{quantity} not to be used: {text}")


def _joined(spans):
    """Spans of time, those that follow soon as one: a level grows and shrinks from fix to fix."""
    whole = []
    for start, end in spans:
        if whole and start - whole[-1][1] < _TOGETHER_S:
            start = whole.pop()[0]
        whole.append((start, end))
    return whole


def _imu(data):
    imu = data.imu
    for flags, text in ((imu.saturated, "IMU at the end of its range"), (~imu.valid, "IMU silent")):
        for start, end in _runs(imu.t_valid_s, flags):
            yield Incident(start, end, text)


def _runs(t_s, flags):
    """(first, last or None at the end of the samples) of every run of flagged samples."""
    for a, b in stretches(flags):
        yield float(t_s[a]), None if b == len(t_s) else float(t_s[b])


def _stars(data):
    """Frames of the window without an attitude, in runs of one reason, and wrong attitudes."""
    window, _ = star_metrics.window_frames(data)
    errors = star_metrics.star_errors(data)
    wrong = errors.t_s[np.linalg.norm(errors.rotation_c, axis=1) > star_metrics.WRONG_ANGLE]
    for t_s in wrong.tolist():
        yield Incident(t_s, t_s, "wrong star fix, given as good")
    for (bad, _), fixes in groupby(data.star_fixes, lambda fix: (_is_bad(fix, window), fix.reason)):
        if bad:
            yield _without(list(fixes))


def _is_bad(fix, window):
    return fix.number in window and fix.reason != Reason.NONE


def _without(fixes):
    n, reason = len(fixes), Reason(fixes[0].reason).name.lower().replace("_", " ")
    what = f"{n} frame{'s' if n > 1 else ''} in the window without a star fix: {reason}"
    return Incident(fixes[0].t_valid_s, fixes[-1].t_valid_s, what)
