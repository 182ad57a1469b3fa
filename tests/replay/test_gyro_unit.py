"""Gyros in another unit than told: the motion shows it, or nothing is said."""

import drive
import numpy as np
import pytest
from test_clocks import lift_off

from shefex_nav.environment import ephemeris
from shefex_nav.replay import dataset, imu_units, load
from shefex_nav.scenario.data_table import DataError

EARTH = ephemeris.earth_rotation("2020-06-01T12:00:00", 0.0, 0.0, 0.0)
COURSE = "{method: course, speed: 5 m/s, sideslip: 1 deg}"


def turned(data, factor):
    return data._replace(imu=data.imu._replace(dtheta_b=factor * data.imu.dtheta_b))


def found(data, told, units=imu_units.RATES, arm=drive.LEVER):
    """Name of the unit that fits, of gyros that are told to be in another."""
    fit = imu_units.find_gyro_unit(data.imu, data.fixes, arm, {k: v / units[told] for k, v in units.items()})
    return fit and fit.name


@pytest.fixture(scope="module")
def driven():
    return drive.sensed(drive.drive(EARTH, 60.0, heading=0.3), np.random.default_rng(7))


@pytest.fixture(scope="module")
def rocket():
    """The shipped half minute, whose rocket turns by some degrees only, and its lever arm."""
    scenario, files = load.load("csv_example")
    return dataset.read(scenario, files), np.array(scenario.gnss.lever_arm)


@pytest.mark.parametrize("told", imu_units.RATES)
@pytest.mark.parametrize("meant", imu_units.RATES)
def test_every_unit_taken_for_every_other(told, meant, driven, rocket):
    """Each pair is named; those that are the same, or too near to tell from a bias, are not."""
    ratio = imu_units.RATES[told] / imu_units.RATES[meant]
    expected = meant if not 1.0 / imu_units.APART < ratio < imu_units.APART else None
    assert found(turned(driven, ratio), told) == expected
    data, arm = rocket
    assert found(turned(data, ratio), told, arm=arm) == expected


@pytest.mark.parametrize("bias_deg_s", [0.1, 1.0, 5.0, 20.0])
def test_a_bias_is_no_unit(bias_deg_s, driven):
    """It is not removed where there is no rest; turned off, the gyros would fit better."""
    imu = driven.imu
    step = np.radians(bias_deg_s) * np.diff(imu.t_s, prepend=imu.t_s[0])[:, None]
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        biased = driven._replace(imu=imu._replace(dtheta_b=imu.dtheta_b + step * axis))
        assert found(biased, "deg/s") is None and found(biased, "rad/s") is None


def test_what_does_not_turn_shows_nothing():
    imu, fixes = lift_off(np.arange(0.5, 29.0, 1.0))
    data = dataset.Dataset(imu, fixes, None)
    assert found(data, "deg/s", arm=np.zeros(3)) is None


def test_the_field_is_named():
    scenario, files = load.load("csv_example")
    data = dataset.read(scenario, files)
    imu_units.gyros(scenario, data)
    with pytest.raises(
        DataError, match=r"data\.imu\.gyro_unit: the gyros, taken as deg/s, .* as rad/s they do"
    ):
        imu_units.gyros(scenario, turned(data, np.pi / 180.0))
