"""Scenarios in a program of one's own: compared, printed, changed where their text says so too."""

import math

import pytest

from shefex_nav import runs
from shefex_nav.scenario.load import Scenario, ScenarioError

NAME, WALK = "night_sky", "imu.gyro.random_walk"


def test_scenarios_with_the_same_values_are_equal():
    one = Scenario.load(NAME)
    assert one == Scenario.load(NAME) == Scenario.load(NAME, {WALK: "0.03 deg/sqrt(h)"})
    assert one != Scenario.load(NAME, {WALK: "0.04 deg/sqrt(h)"}) and one != NAME
    assert len({one, Scenario.load(NAME)}) == 1


def test_a_scenario_prints_as_a_line():
    assert repr(Scenario.load(NAME)).startswith("<Scenario night_sky, from ")
    assert str(Scenario.load(NAME)).endswith("night_sky.yaml>")


def test_a_copy_whose_text_would_not_follow_is_refused():
    one = Scenario.load(NAME)
    with pytest.raises(TypeError, match=r"Scenario\.load\(path, \{'imu\.gyro\.random_walk'"):
        one.model_copy(update={"imu": one.imu})
    with pytest.raises(TypeError, match="is changed where it is loaded"):
        one.copy(update={"imu": one.imu})
    assert one.model_copy() == one and one.model_copy().source == one.source


def test_a_number_that_a_program_has_computed_is_in_si():
    walk = 3.0 * Scenario.load(NAME).imu.gyro.random_walk
    assert walk == pytest.approx(3.0 * math.radians(0.03) / 60.0)
    with pytest.raises(ScenarioError, match=rf"for example '{walk} rad/sqrt\(s\)'"):
        Scenario.load(NAME, {WALK: walk})
    changed = Scenario.load(NAME, {WALK: f"{walk} rad/sqrt(s)"})
    assert changed.imu.gyro.random_walk == pytest.approx(walk, rel=1e-12)
    with pytest.raises(ScenarioError, match=r"for example '0\.09 deg/sqrt\(h\)'"):  # somebody has typed it
        Scenario.load(NAME, {WALK: 0.09})


def test_one_override_may_be_a_text():
    assert Scenario.load(NAME, "gps.rate=2 Hz").gps.rate == 2.0


def test_a_log_has_its_scenario(tmp_path):
    flown = Scenario.load(NAME, {WALK: "0.09 deg/sqrt(h)"})
    log = tmp_path / "run.mcap"
    assert runs.fly(flown, 1, until_s=1.0, log=log).scenario is not None
    read = runs.open_run(log)
    assert read.scenario == flown and read.star_fixes is read.data.star_fixes
    with pytest.raises(ScenarioError, match="is a log, expected a scenario file"):
        Scenario.load(log)
