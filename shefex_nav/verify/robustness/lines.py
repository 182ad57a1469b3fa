"""The lines of `flights.jsonl`, read back: each is the record of a flight, or told with its number.

A flight is written with its line end before it counts. A last line without one, of a process that was killed,
is none and its flight is flown again; any other line that cannot be what `flight.fly` gives was spoilt.
"""

import json
import math
from functools import cache
from typing import NamedTuple

from shefex_nav.errors import UserError
from shefex_nav.verify.robustness import design, random_faults
from shefex_nav.verify.robustness.factors import RIGHT, TOLD

MOST = 1e300  # of a number that may be anything
LATEST_S = 1e7
AGAIN = "take the line away, and --resume flies the flight again"


class LineError(UserError):
    """A line that is no record of a flight; the message says which and why."""


class Number(NamedTuple):
    """A finite number within bounds."""

    least: float
    most: float

    def fault(self, value):
        """Words about a value that is none; '' if it is one."""
        if type(value) in (int, float) and abs(value) < math.inf and self.least <= value <= self.most:
            return ""
        return f"got {_shown(value)}, expected a number from {self.least:g} to {self.most:g}"


class Whole(NamedTuple):
    """A whole number within bounds."""

    least: int
    most: int

    def fault(self, value):
        """As of Number."""
        if type(value) is int and self.least <= value <= self.most:
            return ""
        return f"got {_shown(value)}, expected a whole number from {self.least} to {self.most}"


class Or(NamedTuple):
    """None, or a shape."""

    shape: object


ANY = "any name"  # of the key of an object whose keys are names
SECONDS, SPAN, COUNT = Number(-LATEST_S, LATEST_S), Number(0.0, LATEST_S), Whole(0, 10**9)
MAYBE = Or(Number(0.0, math.inf))
FIGURES = {
    "quantities": {
        ANY: {
            "usable_s": SPAN, "misleading_s": SPAN, "misleading_times": COUNT,
            "misleading_from_s": Or(SECONDS), "largest_ratio": MAYBE,
        }
    },
    "alarms": [str], "sigma_deg": MAYBE, "nees_end": MAYBE, "nees_usable": MAYBE, "end_s": SECONDS,
}  # fmt: skip
DETECTABLE = {
    "what": str,
    "start_s": SECONDS,
    "t_s": Or(SECONDS),
    "by": Or(str),
    "sum": Or(Number(-MOST, MOST)),
}
ALARM = {"beyond_s": SPAN, "late_s": SPAN, "undetected_s": SPAN, "wrong_words": COUNT, "after_s": Or(SECONDS)}
FAULT = {
    "start_s": SECONDS, "end_s": SECONDS, "settings": [str], "detectable": [DETECTABLE],
    "alarm": {ANY: ALARM}, "usable_again_s": Or(SECONDS),
}  # fmt: skip
HEAD = {"cell": COUNT, "flight": COUNT, "seed": Whole(0, 2**32 - 1)} | dict.fromkeys(design.FACTORS, str)
FAILED = HEAD | {"failed": str, "cpu_s": SPAN}
FLOWN = HEAD | FIGURES | {
    "told_kind": str, "noise_told": Number(0.0, MOST), "risk": Number(0.0, 1.0), "twin": Or(FIGURES),
    "fault": Or(FAULT), "cpu_s": SPAN,
}  # fmt: skip
KINDS = {str: "a text", list: "a list", dict: "an object"}


def read(path, seed_of):
    """(record of each whole line of a file, number of bytes of these lines).

    seed_of : function of cell and flight, the seed that a flight of this study has
    """
    content = path.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    found, places = [], {}
    for number, line in enumerate(whole.split(b"\n")[:-1], 1):
        record = _record(f"{path}:{number}", line, seed_of)
        first = places.setdefault((record["rocket"], record["cell"], record["flight"]), number)
        if first != number:
            words = f"flight {record['flight']} of cell {record['cell']} stands in line {first} already"
            raise LineError(f"{path}:{number}: {words}; keep one of them")
        found.append(record)
    return found, len(whole)


def _record(place, line, seed_of):
    """Record of a line, bytes."""
    try:
        record = json.loads(line.decode(), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise LineError(f"{place}: is no record of a flight ({error}); {AGAIN}") from None
    shape = FAILED if isinstance(record, dict) and "failed" in record else FLOWN
    if fault := _fault(record, shape):
        raise LineError(f"{place}: {fault}; {AGAIN}")
    if fault := _other_cell(record):
        raise LineError(f"{place}: {fault}; {AGAIN}")
    wanted = seed_of(record["cell"], record["flight"])
    if record["seed"] != wanted:
        words = f"seed: got {record['seed']}, expected {wanted} of this cell and flight"
        raise LineError(f"{place}: {words}; {AGAIN}")
    return record


def _other_cell(record):
    """Words about a level that the cell of a record does not have; '' if it has all of them."""
    if record["happens"] == random_faults.NAME:
        wanted = {"grade": design.OWN, "told": RIGHT, "phase": design.ANY}
    elif record["cell"] < len(cells := _cells()):
        wanted = {name: getattr(cells[record["cell"]], name) for name in design.FACTORS if name != "rocket"}
    else:
        return f"cell: got {record['cell']}, expected one of {len(cells)}, counted from 0"
    if "failed" not in record:
        told = TOLD[wanted["told"]]
        wanted |= {"told_kind": told.kind, "noise_told": told.residuals}
    wrong = [name for name, level in wanted.items() if record[name] != level]
    if not wrong:
        return ""
    return f"{wrong[0]}: got {_shown(record[wrong[0]])}, expected {_shown(wanted[wrong[0]])} of this cell"


@cache
def _cells():
    return design.cells()


def _no_number(text):
    raise ValueError(f"{text} is no number")


def _fault(value, shape, name=""):
    """Words about what first differs from a shape, with its field; '' if nothing does."""
    if isinstance(shape, Or):
        return "" if value is None else _fault(value, shape.shape, name)
    if isinstance(shape, Number | Whole):
        fault = shape.fault(value)
        return fault and f"{name}: {fault}"
    kind = shape if isinstance(shape, type) else type(shape)
    if type(value) is not kind:
        return f"{name or 'the line'}: got {_shown(value)}, expected {KINDS[kind]}"
    if kind is list:
        return _first((one, shape[0], f"{name}.{k}") for k, one in enumerate(value))
    if kind is not dict:
        return ""
    if ANY in shape:
        return _first((one, shape[ANY], f"{name}.{key}") for key, one in value.items())
    inner = {key: f"{name}.{key}".lstrip(".") for key in shape}
    if missing := [inner[key] for key in shape if key not in value]:
        return f"{missing[0]}: is missing"
    if other := [key for key in value if key not in shape]:
        return f"{name + '.' if name else ''}{other[0][:40]}: is no field of a record"
    return _first((value[key], shape[key], inner[key]) for key in shape)


def _first(given):
    """The first fault of (value, shape, name); '' if there is none."""
    return next((fault for one in given if (fault := _fault(*one))), "")


def _shown(value):
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
