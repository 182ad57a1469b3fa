"""The lines of `flights.jsonl`, read back: each is the record of a flight, or told with its number.

A flight is written with its line end before it counts. A last line without one, of a process that was killed,
is none and its flight is flown again; any other line that cannot be what `flight.fly` gives was spoilt.
"""

import json
from functools import cache
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from shefex_nav.errors import UserError
from shefex_nav.files import content_of
from shefex_nav.verify.robustness import design, random_faults
from shefex_nav.verify.robustness.factors import RIGHT, TOLD

LATEST_S = 1e7
AGAIN = "take the line away, and --resume flies the flight again"


class LineError(UserError):
    """A line that is no record of a flight; the message says which and why."""


Seconds = Annotated[float, Field(ge=-LATEST_S, le=LATEST_S)]
Span = Annotated[float, Field(ge=0.0, le=LATEST_S)]
Positive = Annotated[float, Field(ge=0.0)]
Count = Annotated[int, Field(ge=0, le=10**9)]


class _Object(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)


class _Quantity(_Object):
    usable_s: Span
    misleading_s: Span
    misleading_times: Count
    misleading_from_s: Seconds | None
    largest_ratio: Positive | None


class _Figures(_Object):
    quantities: dict[str, _Quantity]
    alarms: list[str]
    sigma_deg: Positive | None
    nees_end: Positive | None
    nees_usable: Positive | None
    end_s: Seconds


class _Detectable(_Object):
    what: str
    start_s: Seconds
    t_s: Seconds | None
    by: str | None
    sum: float | None


class _Alarm(_Object):
    beyond_s: Span
    late_s: Span
    undetected_s: Span
    wrong_words: Count
    after_s: Seconds | None


class _Fault(_Object):
    start_s: Seconds
    end_s: Seconds
    settings: list[str]
    detectable: list[_Detectable]
    alarm: dict[str, _Alarm]
    usable_again_s: Seconds | None


class Head(_Object):
    """Which flight it is."""

    cell: Count
    flight: Count
    seed: Annotated[int, Field(ge=0, lt=2**32)]
    rocket: str
    grade: str
    told: str
    happens: str
    phase: str


class Failed(Head):
    """Line of a flight that has come to no end."""

    failed: str
    cpu_s: Span


class Flown(Head, _Figures):
    """Line of a flight."""

    told_kind: str
    noise_told: Positive
    risk: Annotated[float, Field(ge=0.0, le=1.0)]
    twin: _Figures | None
    fault: _Fault | None
    cpu_s: Span


def read(path, seed_of):
    """(record of each whole line of a file, number of bytes of these lines).

    seed_of : function of cell and flight, the seed that a flight of this study has
    """
    content = content_of(path)
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
    kind = Failed if isinstance(record, dict) and "failed" in record else Flown
    try:
        kind.model_validate(record)
    except ValidationError as error:
        raise LineError(f"{place}: {_words(error.errors()[0])}; {AGAIN}") from None
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


def _words(error):
    """Of one error of pydantic."""
    field = ".".join(map(str, error["loc"])) or "the line"
    if error["type"] == "missing":
        return f"{field}: is missing"
    if error["type"] == "extra_forbidden":
        return f"{field[:60]}: is no field of a record"
    is_object = error["type"] in ("model_type", "dict_type")
    wanted = "expected an object" if is_object else error["msg"].replace("Input should be", "expected", 1)
    return f"{field}: got {_shown(error['input'])}, {wanted}"


def _shown(value):
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
