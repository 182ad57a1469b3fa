"""The table of an experiment, for people, and the same as numbers, for programs."""

from math import floor, isfinite, log10

from rich.console import Group
from rich.padding import Padding
from rich.text import Text

from shefex_nav import __version__
from shefex_nav.papers.verdict import DIFFERS, Verdict
from shefex_nav.report import columns

STYLES = {Verdict.REPRODUCED: "green", Verdict.BETTER: "cyan", Verdict.GOAL_MET: "green"} | dict.fromkeys(
    (*DIFFERS, Verdict.GOAL_MISSED), "bold red"
)


def as_numbers(name, experiment, outcome):
    """One experiment as an object that JSON can hold: dict. A value that is no number becomes null."""
    return {
        "version": __version__,
        "experiment": name,
        "title": experiment.title,
        "unit": experiment.unit,
        "seed": outcome.seed,
        "samples": outcome.samples,
        "rows": [_row_as_numbers(row) for row in outcome.rows],
        "wall_s": round(outcome.wall_s, 3),
    }


def _row_as_numbers(row):
    return row._asdict() | {
        "published": _finite(row.published),
        "measured": _finite(row.measured),
        "ci95": None if row.ci95 is None else [_finite(end) for end in row.ci95],
        "verdict": str(row.verdict),
        "tolerance": None if row.tolerance is None else _finite(row.tolerance),
    }


def _finite(value):
    return float(value) if value is not None and isfinite(value) else None


def experiment_table(name, experiment, outcome):
    """Table of published against measured, the reasons of disagreements below it: rich renderable."""
    title = f"{name}: {experiment.title}"
    heads = ("quantity", "condition", ">published", ">measured", ">95 % interval", ">tolerance", "class")
    table = columns.table(title, heads, title_style="bold")
    for column in table.columns[2:]:
        column.no_wrap = True
    notes = list(dict.fromkeys(row.why for row in outcome.rows if row.why))  # each reason once
    for row in outcome.rows:
        step = None if row.ci95 is None else row.ci95[1] - row.ci95[0]
        table.add_row(
            Text(row.quantity),
            Text(row.condition),
            number(row.published),
            number(row.measured, step),
            "" if row.ci95 is None else f"{number(row.ci95[0], step)} … {number(row.ci95[1], step)}",
            "" if row.tolerance is None else number(row.tolerance, row.tolerance),
            _verdict(row, notes),
        )
    unit = experiment.unit
    caption = f"{outcome.samples} {unit}, seed {outcome.seed}, {outcome.wall_s:.1f} s"
    below = [Text(f"[{k}] {why}") for k, why in enumerate(notes, 1)]
    return Group(table, *(Padding(line, (0, 0, 0, 1)) for line in (*below, Text(caption, style="dim"))), "")


def _verdict(row, notes):
    if row.verdict == Verdict.NONE:
        return Text("-")
    reference = f" [{notes.index(row.why) + 1}]" if row.why else ""
    return Text(f"{row.verdict}{reference}", style=STYLES.get(row.verdict, ""))


def counts(rows):
    """Rows of each class: dict of Verdict -> int, all classes."""
    return {verdict: sum(row.verdict == verdict for row in rows) for verdict in Verdict}


def counts_table(outcomes):
    """Rows of each class, experiment by experiment and in all. Pairs of (name, Outcome) -> rich Table."""
    made = columns.table("Rows per class", ("experiment", *(f">{verdict}" for verdict in Verdict)))
    for name, outcome in outcomes:
        made.add_row(name, *(str(n or "") for n in counts(outcome.rows).values()))
    every = counts([row for _, outcome in outcomes for row in outcome.rows])
    made.add_section()
    made.add_row("all", *(str(n) for n in every.values()))
    return made


def number(value, width=None):
    """A figure for people: str, '-' where there is none.

    With the width of its interval: to two digits of that. Without: four digits, whole numbers whole.
    """
    if value is None or not isfinite(value):
        return "-"
    if width is not None and isfinite(width) and width > 0.0:
        return f"{value:.{min(max(1 - floor(log10(width)), 0), 9)}f}"
    if abs(value) >= 1000.0 or value == int(value):
        return f"{value:.0f}"
    return f"{value:.4g}"
