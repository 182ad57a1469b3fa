"""The NESC check-cases: find them, fly them, compare.

In: a folder. Out: `Flown` per case, and the whole as a table for people and as plain numbers for JSON.
"""

from typing import NamedTuple

from rich.text import Text

from shefex_nav.report import columns
from shefex_nav.verify import compare, data, daveml, flight
from shefex_nav.verify.vehicles import CASES, MODELS, NOTES

F16 = ("11", "12", "13", "14", "15", "16")
GROUPS = {  # of the table: axes that belong together
    "latitude, longitude": ("latitude", "longitude"),
    "yaw, pitch, roll": ("yaw", "pitch", "roll"),
    "body rates": ("roll_rate", "pitch_rate", "yaw_rate"),
    "velocity n, e, d": ("velocity_north", "velocity_east", "velocity_down"),
}


class Flown(NamedTuple):
    """A case that was flown."""

    number: str
    title: str
    comparisons: dict  # quantity -> compare.Comparison

    @property
    def failed(self):
        """Quantities that are not good."""
        return [name for name, c in self.comparisons.items() if not c.ok]


def choose(files, wanted=()):
    """(cases to fly, cases in the folder that are not flown), numbers; wanted: empty for all there are."""
    there = sorted(files.trajectories)
    if not wanted:
        chosen = [case for case in there if case in CASES]
        if not chosen:
            raise data.NescDataError(
                f"{files.folder}: holds the cases {', '.join(there)}; those flown are {', '.join(CASES)}"
            )
        return chosen, [case for case in there if case not in CASES]
    for case in wanted:
        if case not in CASES:
            raise data.NescDataError(f"case {case} is not flown; those flown are {', '.join(CASES)}")
        if case not in files.trajectories:
            raise data.NescDataError(f"{files.folder}: no trajectory of case {case} in it or below it")
    return sorted(set(wanted)), []


def why_not(case):
    """Why a case that is there is not flown, for people."""
    if case.startswith("Orbit"):
        return "orbital, not among the atmospheric cases"
    return "F-16" if case[:2] in F16 else "not known here"


def run(files, number):
    """`Flown` of one case."""
    case = CASES[number]
    models = [daveml.read(data.model_path(files, name)) for name in MODELS[case.body]]
    simulators = {name: data.read_series(path) for name, path in files.trajectories[number].items()}
    comparisons = compare.compare(number, flight.fly(case, models), simulators)
    if not comparisons:
        raise data.NescDataError(
            f"{files.folder}: the trajectories of case {number} have no column that is known"
        )
    return Flown(number, case.title, comparisons)


def as_numbers(flown, not_flown):
    """All results as one object for JSON."""
    cases = {
        one.number: {name: _numbers(comparison) for name, comparison in one.comparisons.items()}
        for one in flown
    }
    return {
        "ok": not any(one.failed for one in flown),
        "cases": cases,
        "not_flown": list(not_flown),
        "notes": {one.number: list(NOTES[one.number]) for one in flown if one.number in NOTES},
    }


def _numbers(comparison):
    tolerance = comparison.tolerance
    return {
        "max_difference": max(comparison.against.values()),
        "unit": comparison.quantity.unit,
        "against": comparison.against,
        "spread": comparison.spread,
        "tolerance": {"value": tolerance.value, "relative": tolerance.relative, "at_s": list(tolerance.at_s)},
        "ok": comparison.ok,
    }


def table(flown):
    """rich Table of the cases flown; of axes that belong together, the worst is shown."""
    simulators = sorted({name for one in flown for c in one.comparisons.values() for name in c.against})
    numbers = (f">{name}" for name in (*simulators, "among them", "allowed"))
    heads = ("case", "quantity", "unit", *numbers, "")
    found = columns.table("Largest difference from each simulator", heads, no_wrap=True)
    found.columns[0].no_wrap = False
    for one in flown:
        for k, (name, comparison) in enumerate(_lines(one.comparisons)):
            differences = (_number(comparison.against.get(s)) for s in simulators)
            verdict = Text("good", style="green") if comparison.ok else Text("FAILS", style="bold red")
            found.add_row(
                f"{one.number} {one.title}" if k == 0 else "",
                name,
                comparison.quantity.unit,
                *differences,
                _number(comparison.spread),
                _allowed(comparison.tolerance),
                verdict,
            )
        found.add_section()
    return found


def _lines(comparisons):
    """(title, Comparison) per line: single quantities, and the worst one of each group."""
    grouped = {name: title for title, names in GROUPS.items() for name in names}
    done = set()
    for name, comparison in comparisons.items():
        title = grouped.get(name)
        if title is None:
            yield name.replace("_", " "), comparison
        elif title not in done:
            done.add(title)
            members = [comparisons[n] for n in GROUPS[title] if n in comparisons]
            yield title, max(members, key=lambda c: (not c.ok, max(c.against.values()) / c.tolerance.value))


def _number(value):
    return "-" if value is None else f"{value:.2g}"


def _allowed(tolerance):
    text = f"{100.0 * tolerance.value:g} %" if tolerance.relative else f"{tolerance.value:.2g}"
    return f"{text} at {len(tolerance.at_s)} times" if tolerance.at_s else text
