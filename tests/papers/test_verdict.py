"""Verdicts: what a sample may say, and what it leaves open."""

from math import inf, nan

import pytest

from shefex_nav.papers.experiment import Row
from shefex_nav.papers.verdict import NO_FIGURE, POINTS, TOO_FEW, is_open, judgement
from shefex_nav.report import intervals


def share(k, n, least):
    return judgement(k / n, intervals.proportion(k, n), "because", least=least, resolves=POINTS)


@pytest.mark.parametrize("k, n, least", [(0, 1, 0.3), (1, 1, 0.95), (0, 3, 0.3), (11, 12, 0.9), (5, 12, 0.3)])
def test_a_small_sample_leaves_open_what_its_interval_holds(k, n, least):
    """One failure is no proof of a small share, nor one success of a large one."""
    assert share(k, n, least) == (None, TOO_FEW)


@pytest.mark.parametrize(
    "k, n, least, agrees",
    [
        (78, 520, 0.1571, False),  # the intervals of these reach across the criterion, but not far
        (468, 520, 0.8769, True),
        (200, 200, 0.995, True),
        (0, 40, 0.3, False),  # and these not at all
        (60, 60, 0.9, True),
        (3, 12, 0.8, False),
        (0, 1, -0.02, True),  # no share is below it
    ],
)
def test_a_sample_that_can_tell_does(k, n, least, agrees):
    assert share(k, n, least) == (agrees, "" if agrees else "because")


def test_a_range_is_left_open_on_both_sides():
    def of(measured, ci95):
        return judgement(measured, ci95, "because", least=0.75, most=1.25, resolves=0.25)[0]

    assert of(1.0, (0.9, 1.1)) is True and of(1.0, (0.7, 1.3)) is None
    assert of(1.2, (1.0, 1.4)) is True and of(1.3, (1.1, 1.5)) is False  # as narrow as the tolerance
    assert of(0.2, (0.0, 0.7)) is False and of(9.0, (2.0, 20.0)) is False  # wide, but all on one side
    assert of(1.0, (0.0, inf)) is None and of(1.0, (nan, nan)) is None and of(1.0, None) is None


def test_a_criterion_that_must_be_refuted():
    def of(ci95):
        return judgement(1.3, ci95, "because", most=1.1, resolves=0.3, refuted=True)[0]

    assert of((1.2, 1.4)) is False and of((1.05, 1.55)) is True and of((0.9, 1.9)) is None


def test_no_figure_is_no_verdict():
    assert judgement(nan, None, "because", most=1.0, resolves=1.0) == (None, NO_FIGURE)


def test_open_rows_are_known_from_those_without_a_criterion():
    assert is_open(Row("q", "c", 1.0, 0.0, None, None, TOO_FEW))
    assert not is_open(Row("q", "c", None, 0.0, None, None, ""))
    assert not is_open(Row("q", "c", 1.0, 0.0, None, False, "because"))
