"""Readings of an instrument of a user's own that a log cannot keep as they are: told before the flight."""

import re
from enum import IntEnum
from typing import Annotated, NamedTuple

import numpy as np
import pytest

from shefex_nav import plugin_checks, plugin_readings
from shefex_nav.errors import CodeError
from shefex_nav.instruments.instrument import Column, Instrument, Measured, Sampled, Use


class State(IntEnum):
    OFF = 0
    ON = 3


class Odd(NamedTuple):
    t_valid_s: float
    t_available_s: float
    height: Annotated[float, Column("m", "height")] = 1.0
    count: Annotated[int, Column("", "of the logger")] = 7
    good: Annotated[bool, Column("", "whether it is good")] = True
    word: Annotated[str, Column("", "what it says")] = ""
    state: Annotated[int, Column("", "what it does", kind=State)] = State.ON
    pair: Annotated[np.ndarray, Column("m", "two", (2,))] = np.zeros(2)
    many: Annotated[np.ndarray, Column("m", "any number", (-1, 2))] = np.zeros((0, 2))


def measured(*readings):
    """What the program takes over of these readings."""
    given = Measured(list(readings))
    one = Instrument("mine", Sampled, Odd, lambda *_: given, use=Use)
    return plugin_checks.checked(one).measure(None, None, None).readings


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("height", None, "must be numbers, got None"),
        ("height", "21.5", "must be numbers, got '21.5'"),
        ("height", np.ones(1), "must be numbers, got array([1.])"),
        ("count", 1.5, "must be whole numbers up to 2147483647; a float has 53 bits, got 1.5"),
        ("count", np.nan, "must be whole numbers"),
        ("count", 2**31, "must be whole numbers"),
        (
            "count",
            2**53 + 1,
            "must be whole numbers up to 2147483647; a float has 53",
        ),
        ("count", -(2**70), "must be whole numbers"),
        ("good", 2, "must be True or False, got 2"),
        ("good", None, "must be True or False, got None"),
        ("word", None, "must be text, got None"),
        ("word", "\ud800", "must be text"),
        ("state", 1, "must be of State, got 1"),
        ("pair", np.zeros(3), "must be numbers, shape (2,), got array([0., 0., 0.])"),
        ("pair", [1.0, [2.0]], "must be numbers, shape (2,), got [1.0, [2.0]]"),
        ("many", np.zeros((4, 3)), "must be numbers, shape (-1, 2)"),
    ],
)
def test_what_a_log_would_change_or_cannot_write_is_told(field, value, words):
    """1.5 of a count stood in the log as 1, 2 of a flag as true; others ended the run with a traceback."""
    first, second = Odd(1.0, 1.0), Odd(2.0, 2.0)._replace(**{field: value})
    with pytest.raises(CodeError, match=re.escape(f"'mine': measure, T+2.000 s: {field} {words}")):
        measured(first, second)


def test_what_a_log_keeps_is_let_through():
    readings = [
        Odd(1.0, 1.0, np.nan, 2**31 - 1, False, 'a\n"b", ü', State.OFF, [1.0, np.nan], np.ones((3, 2))),
        Odd(2.0, 2.5, np.float32(3.0), np.float64(3.0), np.bool_(True), "", 3, np.ones(2, int)),
        Odd(3.0, 3.0, np.inf, np.int64(-5)),
    ]
    assert measured(*readings) == readings
    assert measured() == []


def test_a_time_that_is_no_number_is_told():
    with pytest.raises(CodeError, match=r"times of its readings must be numbers, got \('1', 1.0\)"):
        measured(Odd("1", 1.0))


def test_a_reading_with_a_fault_is_looked_at_too():
    one = Instrument(
        "mine",
        Sampled,
        Odd,
        None,
        aid=None,
        use=Use,
        equation=None,
        limited=lambda _, r: r._replace(good="no"),
    )
    with pytest.raises(CodeError, match=r"'mine': limited, T\+1.000 s: good must be True or False, got 'no'"):
        plugin_checks.checked(one).limited(None, Odd(1.0, 1.0))


def record(**units):
    """A type of readings with numbers of these units."""
    hints = [(name, Annotated[float, Column(unit, "")]) for name, unit in units.items()]
    return NamedTuple("Own", [("t_valid_s", float), ("t_available_s", float), *hints])


@pytest.mark.parametrize("unit", ["°C", "%", "m s-1", "uT*s"])
def test_a_unit_that_makes_no_name_of_a_column_is_told(unit):
    """It ended in `Couldn't build proto file into descriptor pool`."""
    words = plugin_readings.problem(record(temp=unit))
    assert "field temp of its record: its column is 'temp_" in words and "digits, / and ^" in words


@pytest.mark.parametrize(
    "fields",
    [
        {"speeds": "m/s", "speeds_m": "s"},
        {"timestamp": "ns"},
        {"t": "s"},  # of the instrument's own clock; the tables had two columns t_s
    ],
)
def test_two_columns_of_one_name_are_told(fields):
    assert "there is one of that name already" in plugin_readings.problem(record(**fields))
