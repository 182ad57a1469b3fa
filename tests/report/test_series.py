"""Scales that a few values do not flatten."""

import numpy as np
import pytest

from shefex_nav.report.figures import series, style


def test_one_large_value_is_cut_off_and_counted():
    values = np.full(1000, 20.0)
    values[500] = 4045.0
    found = series.cut(values)
    assert found.count == 1 and found.largest == 4045.0
    assert 20.0 < found.top < 40.0


@pytest.mark.parametrize(
    "values",
    [
        [],
        [np.nan, np.inf],
        [0.0, 0.0, 0.0],
        np.linspace(0.0, 100.0, 500),
        [*[20.0] * 99, 59.0],  # not three times the others
        [*[20.0] * 90, *[4045.0] * 10],  # not a few: a tenth of the time
    ],
)
def test_what_is_no_exception_is_shown(values):
    assert series.cut(values) is None


def test_values_that_are_not_finite_do_not_count():
    found = series.cut([*[20.0] * 99, np.nan, 500.0, np.inf])
    assert (found.count, found.largest) == (1, 500.0)


def test_what_stays_the_same_is_drawn_flat():
    _, axes = style.single(3.0, "height")
    axes.plot([0.0, 1.0], [100.0, 100.0 + 1e-9])
    style.no_narrower(axes, 0.2)
    assert axes.get_ylim() == pytest.approx((99.9, 100.1))
    axes.plot([0.0, 1.0], [100.0, 180.0])
    axes.relim()
    axes.autoscale(axis="y")
    wide = axes.get_ylim()
    style.no_narrower(axes, 0.2)
    assert axes.get_ylim() == wide


def test_a_scale_about_zero_ends_by_the_time_in_which_values_are_known():
    """3 sigma of 0.06 deg with stars, with one of 40 deg at their begin, then 250 deg under the parachute."""
    known = np.full(100, 0.06)
    known[0] = 40.0
    found = series.cut_about(known, np.concatenate([known, -np.linspace(0.1, 250.0, 500)]))
    assert found.top == pytest.approx(3.0 * 0.06) and found.largest == 250.0 and found.count == 501 - 1


def test_a_scale_about_zero_that_shows_all_is_not_cut():
    known = np.full(100, 0.06)
    assert series.cut_about(known, np.linspace(-0.2, 0.2, 50)) is None
    assert series.cut_about([], known) is None and series.cut_about(known, [np.nan]) is None
