"""Fixes whose times are in another unit than those of the IMU: nobody would use them."""

import pytest
from test_plausible import folder_of

from shefex_nav.replay import dataset, load, plausible
from shefex_nav.scenario.data_table import DataError


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Scenario and Dataset."""
    scenario, files = load.load(folder_of(tmp_path_factory.mktemp("rocket")), ())
    return scenario, dataset.read(scenario, files)


def timed(data, of_time, every=1):
    """Dataset whose fixes are at other times."""
    return data._replace(
        fixes=[fix._replace(t_valid_s=float(of_time(fix.t_valid_s))) for fix in data.fixes[::every]]
    )


def test_the_right_times_pass(given):
    assert plausible.meeting(*given) == []


@pytest.mark.parametrize(("name", "factor"), [("ms", 1e3), ("us", 1e6), ("min", 1.0 / 60.0)])
def test_another_unit_is_named(given, name, factor):
    scenario, data = given
    later = timed(data, lambda t_s: factor * (t_s + 1000.0))
    moved = later._replace(imu=data.imu._replace(t_s=data.imu.t_s + 1000.0))
    with pytest.raises(
        DataError, match=rf"data\.gnss\.time_unit: 0 of \d+ valid fixes .* they fit as {name}"
    ):
        plausible.meeting(scenario, moved)


def test_what_no_unit_explains_is_warned_of(given):
    scenario, data = given
    ((field, words),) = plausible.meeting(scenario, timed(data, lambda t_s: t_s - 5000.0))
    assert field == "data.gnss" and "The others are not used" in words


def test_an_imu_that_ran_for_a_part_of_the_time_alone(given):
    """Two fixes within are enough: a long record of the receiver may go with it."""
    scenario, data = given
    t_s = [fix.t_valid_s for fix in data.fixes if fix.valid]
    some = (data.imu.t_s >= t_s[3]) & (data.imu.t_s <= t_s[4])
    short = data._replace(imu=data.imu._replace(t_s=data.imu.t_s[some]))
    assert plausible.meeting(scenario, short) == []
