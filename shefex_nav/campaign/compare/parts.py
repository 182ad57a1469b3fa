"""A comparison as tables and lines: what `shefex-nav compare` prints and its page holds."""

import shlex

import numpy as np

from shefex_nav.campaign.compare import described, paired
from shefex_nav.campaign.compare.given import LOG
from shefex_nav.campaign.compare.quantities import NEARER, NEES, NEITHER
from shefex_nav.campaign.over_time import PRACTICAL
from shefex_nav.campaign.tables import Bold, Command, Part
from shefex_nav.report import innovations, sensor_use
from shefex_nav.report.navigation_errors import NEES_DOF
from shefex_nav.report.table_rows import TOO_SURE
from shefex_nav.scenario import differences

MOST_DIFFERENCES = 10  # values, that are told
LOG_NAME = "{letter}{run}.mcap"


def parts(sides, found):
    """list of campaign.parts.Part of the sides and of the Comparisons with the first of them."""
    made = [_sides(sides)]
    for one in found:
        made += [_figures(one), _shares(one)]
    made.append(_honest(sides))
    if found[0].rows:
        lines = tuple(map(Command, commands(found[0])))
        made.append(Part("The pair that differs most, by the first row", lines=lines))
    return [*made, Part("All figures of each", lines=tuple(map(Command, reports(sides))))]


def _sides(sides):
    rows = []
    for side in sides:
        failed = sum(bool(one.failed) for one in side.runs.values())
        flown = "; ".join(side.software.values()) or "built-in"
        rows.append((side.letter, side.label, flown, str(len(side.runs)), _bold(str(failed), failed)))
    heads = "", "what", "software", ">runs", ">failed"
    lines = [f"{side.letter}: {side.where}" for side in sides]
    for side in sides:
        failed = [one for one in side.runs.values() if one.failed]
        if failed:
            which = "" if failed[0].run is None else f"run {failed[0].run}"
            lines.append(f"{side.letter} failed, {which or 'the log says'}: {failed[0].failed}")
    return Part("Compared", heads, tuple(rows), tuple(lines))


def _honest(sides):
    """Table of what each side says of its own errors."""
    made, silent = [], []
    for side in sides:
        found = described.of_side(side)
        if not found and all(one.failed for one in side.runs.values()):
            silent.append(f"No run of {side.letter} flew to its end: there is nothing to judge.")
        elif not found:
            silent.append(f"{side.letter} gives no covariance: there is nothing to judge.")
        for cells, is_wrong in described.rows(found):
            made.append((side.letter, *cells[:-1], _bold(cells[-1], is_wrong)))
    heads = "", "of", "when", ">NEES per degree of freedom", ">expected", ">sigma / error", "sigmas"
    lines = [
        "NEES per degree of freedom: mean over all runs of a side, 1 where the covariance is right. 95 % of "
        "means lie within what is expected, so of many one or another lies outside by chance: wrong is said "
        "where chance does not explain the NEES among all instants and blocks of a side (5 %, corrected by "
        "Holm). Sigma / error: root mean squares over all axes. It can be 1 although the sigmas of one axis, "
        "or the correlations, are wrong: NEES shows that. Of few runs only gross faults show.",
    ]
    return Part(
        "Does the covariance of each describe its errors?", heads if made else (), tuple(made),
        (*(lines if made else ()), *silent),
    )  # fmt: skip


def reports(sides):
    """Shell commands that print all figures of each side: list."""
    return [
        shlex.join(["shefex-nav", "report", where])
        for where in dict.fromkeys(str(one.where) for one in sides)
    ]


def _figures(one):
    """Table of the figures of a Comparison."""
    a, b = one.a.letter, one.b.letter
    heads = (
        "median of the runs", "unit", f">{a}", f">{b}", f">{b} - {a}", ">95 % interval", f">{b} better in",
        "verdict",
    )  # fmt: skip
    rows = tuple(_row(row, one) for row in one.rows)
    return Part(f"{title(one)}, {_count(len(one.seeds), 'pair')}", heads, rows, _lines(one))


def title(one):
    """Heading of a Comparison."""
    return f"{one.b.letter} ({one.b.label}) against {one.a.letter} ({one.a.label})"


def _row(row, one):
    unit = row.quantity.unit
    medians = ("-" if side is None else number(side.median) for side in (row.a, row.b))
    found = row.difference
    if found is None:
        return row.quantity.name, unit, *medians, "-", "-", "-", row.why
    better = "-" if row.quantity.better == NEITHER else f"{found.better} of {found.n}"
    log = "ln: " if row.quantity.better == NEARER else ""
    return (
        row.quantity.name, unit, *medians, log + number(found.mean, sign=True), _interval(found), better,
        verdict(found, one),
    )  # fmt: skip


def number(value, *, sign=False):
    """A number for people."""
    if value == 0.0:
        return "0"
    is_count = abs(value) >= 1e3 and float(value).is_integer()
    return f"{value:{'+' if sign else ''}{'.0f' if is_count else '.3g'}}"


def _interval(found):
    if found.low is None:
        return "-"
    return f"{number(found.low, sign=True)} to {number(found.high, sign=True)}"


def verdict(found, one):
    """The verdict of a Difference or ShareDifference of a Comparison, for people."""
    if found.verdict is None:
        return f"no interval: {found.why}"
    if found.verdict == paired.NOT_JUDGED:
        return f"not judged: {found.why}"
    if found.verdict == paired.EQUAL:
        return f"equal within {100.0 * paired.NEGLIGIBLE:g} %"
    if found.verdict == paired.OPEN:
        return f"open: {found.why}"
    if found.verdict == paired.NOT_SEEN:
        return "the same in each pair" if found.low is None else "no difference seen"
    return Bold(f"{(one.a if found.verdict == paired.A_BETTER else one.b).letter} better")


def _lines(one):
    return (*(_words(one) if one.rows else ["No pair flew to its end on both sides."]), *_context(one))


def _words(one):
    """What the rows mean, and what is wrong with a side by itself."""
    a, b = one.a.letter, one.b.letter
    lines = [
        f"{a} and {b} are medians of the runs. {b} - {a} is the mean of the differences of runs of one seed, "
        "with Student's interval; the difference of the medians may be another. There is a verdict where the "
        f"interval of {paired.FEW} pairs or more does not include zero. Of twenty rows without a difference, "
        "one shows one by chance."
    ]
    if any(row.quantity is NEES for row in one.rows):
        lines.append(
            "NEES: of position, velocity and attitude together, each whole second from the first star fix "
            "that the filter used until entry, without an entry to the end; its difference is of "
            "|ln(NEES / 9)|, how far it is from what it should be. Phase by phase: the table of covariances."
        )
        lines += _too_sure(one)
    if sensors := sorted({*one.a.sensors, *one.b.sensors}):
        lines.append(
            "NIS: per degree of freedom, of all measurements of a sensor that met the gate, refused ones "
            "too; its difference is of |ln NIS|. What is used and refused has no verdict: to refuse a wrong "
            "fix is right."
        )
        lines += _wrong_nis(one, sensors)
    return lines


def _context(one):
    """How the pairs came about, and in what the scenarios differ."""
    lines = [*one.notes]
    if one.different:
        told = differences.lines(one.different, most=MOST_DIFFERENCES)
        more = len(one.different) - len(told)
        count = _count(len(one.different), "value")
        lines.append(f"The scenarios differ in {count} ({one.a.letter} -> {one.b.letter}):")
        lines += [*told, *([f"and {more} more"] if more else [])]
    return lines


def _too_sure(one):
    """A line for each side whose errors are larger than its covariances say, whatever the other does."""
    nees = [row for row in one.rows if row.quantity is NEES]
    for row in nees:
        for side, sample in ((one.a, row.a), (one.b, row.b)):
            if sample is not None and sample.median > TOO_SURE * NEES_DOF:
                words = f"NEES {number(sample.median)}: its errors are larger than its covariances say"
                yield Bold(f"{side.letter}, {words}")


def _wrong_nis(one, sensors):
    """A line for each side and sensor whose NIS, the median of the runs, is not where it should be."""
    for side in (one.a, one.b):
        runs = [side.runs[seed].get for seed in one.seeds if not side.runs[seed].failed]
        lasting = innovations.fixes_last(side.source)
        for sensor in (name for name in sensors if not (innovations.errors_last(name) or name in lasting)):
            if not (known := [found for get in runs if (found := _nis(get, sensor))]):
                continue
            value, low, high = np.median(known, axis=0)
            if not low <= value <= high and abs(value - 1.0) > PRACTICAL:
                size = "larger" if value > high else "smaller"
                found = f"NIS of {sensor_use.named(sensor)} {number(value)}, {low:.2f} to {high:.2f} expected"
                yield Bold(f"{side.letter}, {found}: its innovations are {size} than it says")


def _nis(get, sensor):
    """NIS per degree of freedom of a run, and the ends of where it should be; None where it is not known."""
    value = get(f"navigation.nis.{sensor}.per_dof")
    expected = innovations.expected_per_dof(get, sensor)
    return None if value is None or expected is None else (value, *expected)


def _shares(one):
    """Table of requirements met and failed runs."""
    a, b = one.a.letter, one.b.letter
    heads = "", f">{a}", ">95 % interval", f">{b}", ">95 % interval", f">{b} - {a}", ">interval", "verdict"
    rows = []
    for row in one.shares:
        cells = [cell for share in (row.a, row.b) for cell in _share(share)]
        if row.difference is None:
            rows.append((row.name, *cells, "-", "-", row.why))
            continue
        found = row.difference
        bounds = "-" if found.low is None else f"{_percent(found.low)} to {_percent(found.high)}"
        rows.append((row.name, *cells, _percent(found.mean), bounds, verdict(found, one)))
    lines = (
        "Intervals of Clopper and Pearson, of the difference of Bonett and Price; the verdict is McNemar's "
        "exact test of the pairs that differ.",
    )
    return Part("Requirements and failures", heads, tuple(rows), lines)


def _share(share):
    if not share.n:
        return "-", "-"
    return f"{share.k} of {share.n}", f"{100.0 * share.low:.0f} to {100.0 * share.high:.0f} %"


def _percent(value):
    return "0" if value == 0.0 else f"{100.0 * value:+.0f} %"


def _count(n, word):
    return f"{n} {word}{'' if n == 1 else 's'}"


def _bold(text, wrong):
    return Bold(text) if wrong else text


def commands(one):
    """Shell commands that lay a pair of a Comparison over each other in the viewer: `worst_seed`."""
    seed, logs, lines = worst_seed(one), [], []
    for side in (one.a, one.b):
        if side.kind == LOG:
            logs.append(str(side.where))
            continue
        run = side.runs[seed].run
        logs.append(LOG_NAME.format(letter=side.letter.lower(), run=run))
        lines.append(shlex.join(["shefex-nav", "repeat", str(side.where), str(run), "--log", logs[-1]]))
    return [*lines, shlex.join(["shefex-nav", "view", *dict.fromkeys(logs)])]


def worst_seed(one):
    """Seed of the pair whose first figure, of those that have a difference, differs most; else the first."""
    for row in one.rows:
        if row.seeds and np.abs(row.each).max() > 0.0:
            return row.seeds[int(np.argmax(np.abs(row.each)))]
    return one.seeds[0]
