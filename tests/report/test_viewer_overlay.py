"""Runs that are drawn over each other: by which names, and curves that swing as their edges."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.report.viewer import navigation, recording


def run(seed, software=()):
    return SimpleNamespace(mission=SimpleNamespace(scenario="made_up", seed=seed, software=software))


EKF = (("navigation", "ekf.py:Ekf", "272f"),)


@pytest.mark.parametrize(
    ("runs", "found"),
    [
        ([run(1), run(2)], ["made_up-1", "made_up-2"]),
        ([run(1), run(1, EKF)], ["built-in", "ekf.py-Ekf"]),
        ([run(1), run(1)], ["first", "with-gate"]),
        ([run(1), run(1, EKF), run(1, EKF)], ["first", "with-gate", "third"]),
    ],
)
def test_runs_are_named_by_what_tells_them_apart(runs, found):
    logs = ["a/first.mcap", "a/with gate.mcap", "b/third.mcap"][: len(runs)]
    assert recording.names(runs, logs) == found


def test_files_of_one_name_are_numbered():
    found = recording.names([run(1), run(1)], ["a/run.mcap", "b/run.mcap"])
    assert found == ["made_up-1-1", "made_up-1-2"] == recording.names([run(1), run(1)])


def test_what_swings_is_outlined_and_nothing_else():
    """A ramp, then a swing of 1.5 Hz at ten points a second, whose amplitude is 2."""
    t_s = np.arange(400) / 10.0
    values = np.where(t_s < 20.0, 0.1 * t_s, 2.0 * np.sin(2.0 * np.pi * 1.5 * t_s + 0.3))
    line, middle_s, (least, most) = navigation.outline(t_s, values)
    assert np.array_equal(line[t_s < 20.0], values[t_s < 20.0]) and np.isnan(line[t_s >= 20.0]).all()
    assert np.isnan(least[middle_s < 20.0]).all()
    late = middle_s > 20.0
    assert np.all(least[late] < -1.6) and np.all(most[late] > 1.6)
    assert least[late].min() == values[200:].min() and most[late].max() == values[200:].max()


@pytest.mark.parametrize("n", [0, 1, 9, 10, 11])
def test_short_curves_stay_whole(n):
    t_s = np.arange(n) / 10.0
    line, middle_s, edges = navigation.outline(t_s, 3.0 * t_s)
    assert np.array_equal(line, 3.0 * t_s) and edges.shape == (2, len(middle_s)) and np.isnan(edges).all()


def test_a_flight_from_elsewhere_is_said_to_be_out_of_the_scene():
    """The chord of ten degrees of the equator is 1112 km."""
    here, there = (
        SimpleNamespace(launch_latitude=0.0, launch_longitude=np.radians(deg), launch_height=0.0)
        for deg in (0.0, 10.0)
    )
    assert recording._elsewhere(there, here, 800e3) == " (starts 1112 km away, out of the scene)"
    assert recording._elsewhere(there, here, 2000e3) == ""
