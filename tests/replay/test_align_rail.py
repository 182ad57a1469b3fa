"""Alignment on a rail: it says where the nose points, gravity how it is rolled, rest the gyros' bias."""

import numpy as np
import pytest
import replay_files
import turntable
from test_replay_align import angles_of
from turntable import Turntable

from shefex_nav.environment import ephemeris
from shefex_nav.replay import align, dataset, load
from shefex_nav.scenario.data_table import DataError
from shefex_nav.scenario.load import ScenarioError

EARTH = ephemeris.earth_rotation(replay_files.EPOCH, 0.0, 0.0, 0.0)
ON_RAIL = Turntable(roll=np.radians(35.0), pitch=np.radians(80.0), heading=np.radians(130.0), rate=0.0)
RAIL = (
    "{method: rail, duration: 4 s, elevation: 80.2 deg, elevation_error: 0.5 deg, azimuth: 131 deg, "
    "azimuth_error: 2 deg, disturbance: 0.001 deg}"
)
BIASES = ["imu.accelerometer.bias=2 mgee", "imu.gyro.bias=1 deg/s"]


def aligned(folder, table=ON_RAIL, overrides=BIASES, alignment=RAIL, bias=(0.0, 0.0, 0.0)):
    """Alignment of five seconds of ideal sensors at 20 Hz, but for a bias of the gyros in deg/s."""
    path = replay_files.turntable_folder(folder, table, turntable.increments, 20.0, 5.0)
    text = path.read_text(encoding="utf-8").replace(replay_files.REFERENCE, alignment)
    path.write_text(text, encoding="utf-8")
    scenario, files = load.load(path, overrides)
    data = dataset.read(scenario, files)
    imu = data.imu
    turn = imu.dtheta_b + np.radians(bias) * np.diff(imu.t_s, prepend=imu.t_s[0])[:, None]
    return align.align(scenario, data._replace(imu=imu._replace(dtheta_b=turn)), EARTH)


def test_roll_by_gravity_and_elevation_by_both(tmp_path):
    """2 mgee are 0.115 deg of elevation: the rail's 0.5 deg weigh a nineteenth; roll: over cos 80 deg."""
    found = aligned(tmp_path)
    angles, C_nb, _, v_e = angles_of(found)
    level = np.degrees(2e-3)
    weight = level**2 / (level**2 + 0.5**2)
    assert np.degrees(angles[0]) == pytest.approx(35.0, abs=0.02)
    assert np.degrees(angles[1]) == pytest.approx(80.0 + 0.2 * weight, abs=0.002)
    assert np.degrees(angles[2]) == pytest.approx(131.0)
    np.testing.assert_allclose(v_e, 0.0, atol=1e-9)
    P_n = np.degrees(np.degrees(C_nb @ found.P_theta_b @ C_nb.T))
    nose, across = C_nb[:, 0], np.array([-np.sin(angles[2]), np.cos(angles[2]), 0.0])
    roll = level / np.cos(angles[1])
    elevation = level * 0.5 / np.hypot(level, 0.5)
    expected = 4.0 * np.diag([0.0, 0.0, 1.0]) + roll**2 * np.outer(nose, nose)
    expected += elevation**2 * np.outer(across, across)
    np.testing.assert_allclose(P_n, expected, atol=1e-3 * np.trace(expected))


def test_bias_of_the_gyros_at_rest(tmp_path):
    """Found to the rate of the Earth's part that the attitude leaves open (2 deg of 15 deg/h)."""
    found = aligned(tmp_path, bias=(0.7, -0.4, 0.2))
    off = np.degrees(found.gyro_bias) - [0.7, -0.4, 0.2]
    assert np.abs(off).max() < 3.0 * np.degrees(found.sigma_gyro_bias)
    assert np.degrees(found.sigma_gyro_bias) * 3600.0 < 10.0  # deg/h


def test_a_vertical_rail_shows_no_roll(tmp_path):
    upright = ON_RAIL._replace(pitch=np.radians(89.99))
    rail = RAIL.replace("80.2 deg", "90 deg")
    found = aligned(tmp_path, table=upright, alignment=rail)
    assert np.degrees(np.sqrt(found.P_theta_b[0, 0])) > 100.0  # about the nose
    assert np.degrees(np.sqrt(np.diag(found.P_theta_b)[1:])).max() < 1.0


def test_a_rail_that_the_accelerometers_contradict_is_refused(tmp_path):
    rail = RAIL.replace("80.2 deg", "86 deg")
    words = r"the accelerometers sense 80\.0 deg, alignment.elevation says 86\.0 deg; check elevation"
    with pytest.raises(DataError, match=words):
        aligned(tmp_path, alignment=rail)
    with pytest.raises(DataError, match="axis x of the file points up"):
        aligned(tmp_path, overrides=[*BIASES, "data.axes=[z, y, -x]"])


def test_a_unit_of_the_gyros_that_makes_rest_a_turn_is_named(tmp_path):
    """The rate of the Earth as turns a second, and columns that say none."""
    words = (
        r"rail alignment: the mean rate is 0\.02\d* deg/s; check data\.imu\.gyro_unit, imu\.gyro\.bias and al"
    )
    with pytest.raises(DataError, match=words):
        aligned(tmp_path, overrides=["imu.accelerometer.bias=2 mgee", "data.imu.gyro_unit=cycle/s"])
    with pytest.raises(
        ScenarioError, match=r"data\.imu\.gyro_unit: is missing; expected .* 'gyro_unit: deg/s'"
    ):
        aligned(tmp_path, overrides=["data.imu.gyro_unit=null"])


def test_an_attitude_of_which_two_angles_would_be_unknown_is_refused(tmp_path):
    """A single linear filter, or several along one angle, cannot start from it."""
    rail = RAIL.replace("azimuth_error: 2 deg", "azimuth_error: 150 deg").replace(
        "elevation_error: 0.5 deg", "elevation_error: 60 deg"
    )
    with pytest.raises(DataError, match="needs two of the three within 20 deg: check the errors"):
        aligned(tmp_path, alignment=rail, overrides=["imu.accelerometer.bias=600 mgee"])
