"""What the functions of an instrument of a user's own give is looked at before it reaches the filter."""

import re
import sys
from types import SimpleNamespace
from typing import Annotated, NamedTuple

import numpy as np
import pytest

from shefex_nav import plugin_checks
from shefex_nav.errors import CodeError
from shefex_nav.instruments.instrument import Column, Instrument, Measured, Plot, Sampled, Use
from shefex_nav.onboard.navigation.aid import Aid, Linearised

HERE = SimpleNamespace(rows=lambda m: np.zeros((m, 15)))
READING = SimpleNamespace(t_valid_s=7.0)


class Height(NamedTuple):
    t_valid_s: float
    t_available_s: float
    height: Annotated[float, Column("m", "height")]


def instrument(measured=None, aid=None, seen=None):
    """A checked instrument whose functions give these."""
    given = Aid("mine", Height, lambda here, reading: seen) if aid is None else aid[0]
    one = Instrument(
        "mine", Sampled, Height, lambda *_: measured, aid=lambda *_: given, use=Use, equation=None
    )
    return plugin_checks.checked(one)


def expected(**changes):
    """What the filter gets of two numbers whose noise is alike, with changes."""
    seen = Linearised(np.zeros(2), np.zeros((2, 15)), 4.0 * np.eye(2))._replace(**changes)
    return instrument(seen=seen).aid(None, None, None).expect(HERE, READING)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"R": [[4.0, 12.0], [12.0, 4.0]]}, "R must be a covariance, got [[4.0, 12.0], [12.0, 4.0]]"),
        ({"R": [[4.0, 3.6], [-3.6, 4.0]]}, "R must be a covariance"),
        ({"R": [[4.0, np.nan], [np.nan, 4.0]]}, "R must be numbers, shape (2, 2), got some that are not"),
        ({"lasting": ((-3.6 * np.eye(2), 10.0),)}, "what lasts must be a covariance"),
        ({"lasting": ((np.eye(2), 0.0),)}, "what lasts must do so for more than 0 s"),
        ({"lasting": ((np.eye(2), np.nan),)}, "what lasts must do so for more than 0 s"),
    ],
)
def test_noise_that_there_cannot_be_is_refused(changes, words):
    with pytest.raises(CodeError, match=re.escape(f"'mine': expect, T+7.00 s: {words}")):
        expected(**changes)


@pytest.mark.parametrize(
    "R", [np.diag([1e10, -1e-3]), np.array([[1e10, 0.0, 0.0], [0.0, 1e-6, 2e-6], [0.0, 2e-6, 1e-6]])]
)
def test_noise_in_several_units_is_looked_at_in_each(R):
    """Beside a variance of (100 km)^2 one of -1e-3 was taken for rounding."""
    m = len(R)
    with pytest.raises(CodeError, match="what lasts must be a covariance"):
        expected(z=np.zeros(m), H=np.zeros((m, 15)), R=np.eye(m), lasting=((R, 10.0),))


def test_rounding_is_no_variance_below_zero():
    """Of unit vectors near an axis, along which there is no noise."""
    for angle in (0.0, 1e-9, 1e-8, 3e-8, 1e-5, 0.7):
        u = np.array([np.cos(angle), np.sin(angle), 0.0])
        u /= np.linalg.norm(u)
        lasts = 1e-8 * (np.eye(3) - np.outer(u, u)) - np.diag([2e-24 * (angle > 0.0), 0.0, 0.0])
        expected(z=np.zeros(3), H=np.zeros((3, 15)), R=np.eye(3), lasting=((lasts, 10.0),))


def test_noise_may_lack_a_direction_and_errors_may_last_for_ever():
    """A unit vector has no noise along itself."""
    seen = expected(R=[[4.0, 4.0], [4.0, 4.0]], lasting=((np.zeros((2, 2)), np.inf),))
    np.testing.assert_array_equal(seen.R, 4.0 * np.ones((2, 2)))


@pytest.mark.parametrize(
    ("measured", "words"),
    [
        (None, "measure: expected Measured(readings, errors, sensed), got None"),
        ([Height(1.0, 1.0, 5.0)], "measure: expected Measured(readings, errors, sensed), got [Height("),
        (Measured(None), "measure: readings must be a list, got None"),
        (
            Measured([Height(1.0, 1.0, 5.0), Height(2.0, 1.5, 5.0)]),
            "measure: the reading of T+2.000 s is there at T+1.500 s, before it is measured",
        ),
    ],
)
def test_readings_that_there_cannot_be_are_refused(measured, words):
    with pytest.raises(CodeError, match=re.escape(f"instrument 'mine': {words}")):
        instrument(measured=measured).measure(None, None, None)


def test_an_answer_of_another_type_is_told():
    with pytest.raises(CodeError, match=re.escape("'mine': aid: expected Aid(name, record,")):
        instrument(aid=[None]).aid(None, None, None)
    with pytest.raises(CodeError, match=re.escape("'mine': expect, T+7.00 s: expected Linearised(z, H,")):
        instrument(seen=None).aid(None, None, None).expect(HERE, READING)


def test_code_that_ends_the_program_has_failed():
    """`run` and `campaign` would end with exit code 0 and print nothing."""
    with pytest.raises(CodeError, match=r"'mine': measure .*SystemExit: 0"):
        plugin_checks.checked(instrument()._replace(measure=lambda *_: sys.exit(0))).measure(None, None, None)


@pytest.mark.parametrize("chance", [0.0, 3.0, -1e-4, 0.2, np.nan])
def test_a_gate_that_is_none_is_refused(chance):
    """Of 0 no reading was ever rejected, of 3 (sigma?) each was, without a word."""
    one = instrument(aid=(Aid("mine", Height, None, gate_probability=chance),))
    with pytest.raises(CodeError, match=r"'mine': gate_probability.* must be above 0 and 0.1 at most, got"):
        one.aid(None, None, None)


def test_a_gate_of_its_own_stays():
    one = instrument(aid=(Aid("mine", Height, None, gate_probability=1e-9),))
    assert one.aid(None, None, None).gate_probability == 1e-9


@pytest.mark.parametrize(
    ("field", "answer", "words"),
    [
        ("holds", None, "holds must give bool, got None"),  # no reading was used, without a word
        ("unfit", True, "unfit must give str, got True"),
    ],
)
def test_a_judgement_of_another_kind_is_told(field, answer, words):
    one = instrument(aid=(Aid("mine", Height, None, **{field: lambda *_: answer}),))
    with pytest.raises(CodeError, match=f"'mine': {words}"):
        getattr(one.aid(None, None, None), field)(READING)


@pytest.mark.parametrize("values", [None, np.zeros(2), np.zeros((3, 2)), ["a", "b", "c"]])
def test_a_plot_of_something_else_is_told(values):
    """Of another length it was drawn all the same, or the report ended in a traceback."""
    plot = Plot("height", "Height", "km", lambda read: values)
    one = plugin_checks.checked(instrument()._replace(plots=(plot,)))
    with pytest.raises(CodeError, match=r"'mine': plot 'height' must give \(3,\) or \(3, 3\) numbers, got"):
        one.plots[0].values(Height(np.zeros(3), np.zeros(3), np.zeros(3)))


def test_a_plot_is_handed_on():
    plot = Plot("height", "Height", "km", lambda read: 1e-3 * read.height)
    (checked,) = plugin_checks.checked(instrument()._replace(plots=(plot,))).plots
    assert checked.values(Height(np.zeros(2), np.zeros(2), np.array([1e3, np.nan])))[0] == 1.0
