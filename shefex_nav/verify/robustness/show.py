"""The study in a terminal: requirements, totals of each level, worst cells, what could not be noticed."""

from shefex_nav.report import columns
from shefex_nav.verify.robustness import cells, design, require

WORST = 20  # cells that are shown


def as_numbers(head, records):
    """Plain dict for JSON."""
    judged = require.judge(records)
    return {
        **head,
        "flown": len(records),
        "cpu_s": round(sum(record["cpu_s"] for record in records), 1),
        "ok": all(one.good is not False for one in judged),
        "requirements": [one._asdict() for one in judged],
        "totals": cells.of_cell(records),
        "levels": {
            name: {level: cells.of_cell(several) for level, several in by(records, name)}
            for name in design.FACTORS
        },
        "cells": [levels | figures for levels, figures in cells.table(records)],
        "flights": [_flight(record) for record in records],
        "undetectable": require.undetectable(records),
    }


def _flight(record):
    """Of one flight: from when each of its faults could be noticed."""
    fault = record.get("fault")
    names = "rocket", "cell", "flight", "seed"
    return {name: record[name] for name in names} | {"detectable": fault["detectable"] if fault else None}


def by(records, name):
    """Flights of each level of a factor, in the order of the design: list of (level, records)."""
    found, order = cells.grouped(records, name), design.FACTORS[name]
    levels = sorted(found, key=lambda one: order.index(one[0]) if one[0] in order else len(order))
    return [(level[0], found[level]) for level in levels]


def worst(records, most=WORST):
    """Cells, the worst first: list of (levels, figures)."""
    found = cells.table(records)
    return sorted(found, key=lambda one: cells.badness(one[1]), reverse=True)[:most]


HEADS = (
    "flights", "misleads, s", "largest error/level", "late", "wrong words", "alarm after, s",
    "NEES end", "sd", "false alarms", "others blamed", "usable again, s",
)  # fmt: skip


def row(figures):
    """Texts of `HEADS`."""
    sums = figures["quantities"].values()
    after = [one["alarm_s"]["most"] for one in sums if one["alarm_s"]["most"] is not None]
    nees, again = figures["nees_end"], figures["usable_again_s"]
    never = figures["never_usable_again"]
    return (
        str(figures["flights"]) + (f" ({figures['failed']} failed)" if figures["failed"] else ""),
        _number(sum(one["misleading_s"] for one in sums), 1),
        _number(max((one["largest_ratio"] for one in sums), default=None), 2),
        str(sum(one["late_flights"] for one in sums)),
        str(sum(one["wrong_words_flights"] for one in sums)),
        _number(max(after, default=None), 1),
        _number(nees["mean"], 1),
        _number(nees["sd"], 1),
        str(figures["false_alarms"]),
        str(figures["others_blamed"]),
        _number(again, 1) + (f", {never} never" if never else ""),
    )


def _number(value, digits):
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if abs(value) < 1e4 else f"{value:.2g}"


def verdict(one):
    """Judged -> 'met', 'not met' or 'not flown'."""
    return {True: "met", False: "NOT MET", None: "not flown"}[one.good]


def tables(records):
    """rich Tables, in the order in which they are printed."""
    yield _requirements(records)
    for name in design.FACTORS:
        rows = [(level, row(cells.of_cell(found))) for level, found in by(records, name)]
        if len(rows) > 1:
            yield _table(f"by {name}", (name,), [((level,), numbers) for level, numbers in rows])
    names = ("cell", *design.FACTORS)
    rows = [(tuple(str(levels[name]) for name in names), row(figures)) for levels, figures in worst(records)]
    yield _table(f"worst cells, {len(rows)} of {len(cells.table(records))}", names, rows)
    if found := require.undetectable(records)[:WORST]:
        yield _undetectable(found)


def _table(title, names, rows):
    heads = (*names, *(f">{name}" for name in HEADS))
    table = columns.table(title, heads, ((*levels, *numbers) for levels, numbers in rows))
    for column in table.columns[: len(names)]:
        column.no_wrap = True
    return table


def _requirements(records):
    judged = require.judge(records)
    rows = ((f"{one.name}: {verdict(one)}", one.words, one.found) for one in judged)
    return columns.table(require.in_short(judged), ("", "required", "found"), rows, show_lines=True)


def _undetectable(rows):
    heads = [f">{name}" if name in ("flights", "seconds") else name for name in rows[0]]
    texts = (map(str, one.values()) for one in rows)
    return columns.table("misled before, or without, being detectable", heads, texts)
