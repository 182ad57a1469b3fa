"""Alignment of external data: standing still, and from a reference."""

import numpy as np
import pytest
import replay_files
import turntable
from scipy import stats
from turntable import Turntable

from shefex_nav.environment import ephemeris
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.replay import align, dataset, load
from shefex_nav.scenario.data_table import DataError

STILL = Turntable(rate=0.0)
STATIC = "{method: static, duration: 4 s}"
EARTH = ephemeris.earth_rotation(replay_files.EPOCH, 0.0, 0.0, 0.0)


def aligned(folder, table=STILL, overrides=(), alignment=STATIC):
    """Alignment and Dataset of five seconds of ideal sensors at 20 Hz."""
    path = replay_files.turntable_folder(folder, table, turntable.increments, 20.0, 5.0)
    text = path.read_text(encoding="utf-8").replace(replay_files.REFERENCE, alignment)
    path.write_text(text, encoding="utf-8")
    scenario, files = load.load(path, overrides)
    data = dataset.read(scenario, files)
    return align.align(scenario, data, EARTH), data


def angles_of(alignment):
    """Roll, pitch, heading of an Alignment [rad], and C_nb."""
    r_e, v_e = frames.ecef_from_inertial(EARTH, alignment.t_valid_s, alignment.r_i, alignment.v_i)
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    C_ni = (frames.dcm_ie(EARTH, alignment.t_valid_s) @ wgs84.dcm_en(latitude, longitude)).T
    C_nb = C_ni @ rotation.dcm_from_quat(alignment.q_ib)
    return np.array(euler.euler_from_dcm(C_nb)), C_nb, r_e, v_e


def test_level_and_north_of_ideal_sensors(tmp_path):
    """The plumb line is not quite the normal of the ellipsoid under J2 alone: 1e-5 rad."""
    alignment, _ = aligned(tmp_path)
    angles, _, r_e, v_e = angles_of(alignment)
    expected = np.array([STILL.roll, STILL.pitch, STILL.heading])
    np.testing.assert_allclose(angles, expected, atol=3e-5)
    np.testing.assert_allclose(r_e, turntable.place_e(), atol=1e-6)
    np.testing.assert_allclose(v_e, 0.0, atol=1e-9)
    assert alignment.t_valid_s == pytest.approx(4.0)


def test_sigmas_are_what_the_biases_make(tmp_path):
    """b/g of the level; b/(Omega cos(latitude)) of the heading, and the level's times tan(latitude)."""
    alignment, _ = aligned(tmp_path, overrides=["imu.gyro.bias=0.2 deg/h", "imu.accelerometer.bias=20 mgee"])
    _, C_nb, _, _ = angles_of(alignment)
    level, east, azimuth = np.sqrt(np.diag(C_nb @ alignment.P_theta_b @ C_nb.T))
    assert level == pytest.approx(2e-2, rel=0.01) and east == pytest.approx(level)
    of_gyros = 0.2 / 15.041 / np.cos(turntable.LATITUDE)
    assert azimuth == pytest.approx(np.hypot(of_gyros, 2e-2 * np.tan(turntable.LATITUDE)), rel=0.02)


@pytest.mark.parametrize(("gyro", "accelerometer"), [("0.001 deg/h", "1 mgee"), ("0.2 deg/h", "1 mgee")])
def test_errors_of_drawn_biases_are_as_the_covariance_says(tmp_path, gyro, accelerometer):
    """400 alignments with biases drawn, seed 3: squared normalised errors, 3 degrees of freedom each, and
    those of the heading alone; bounds of 99.8 %. The heading leans on the level where the gyros are good."""
    biases = [f"imu.gyro.bias={gyro}", f"imu.accelerometer.bias={accelerometer}"]
    quiet = ["imu.gyro.random_walk=0 deg/sqrt(h)", "imu.accelerometer.random_walk=0 m/s/sqrt(h)"]
    path = replay_files.turntable_folder(tmp_path, STILL, turntable.increments, 20.0, 5.0)
    text = path.read_text(encoding="utf-8").replace(replay_files.REFERENCE, STATIC)
    path.write_text(text, encoding="utf-8")
    scenario, files = load.load(path, [*biases, *quiet])
    data, rng = dataset.read(scenario, files), np.random.default_rng(3)
    step_s = np.diff(data.imu.t_s, prepend=data.imu.t_s[0])[:, None]

    def attitude(gyro_bias, accel_bias):
        wrong = data.imu._replace(
            dtheta_b=data.imu.dtheta_b + gyro_bias * step_s, dv_b=data.imu.dv_b + accel_bias * step_s
        )
        alignment = align.align(scenario, data._replace(imu=wrong), EARTH)
        _, C_nb, _, _ = angles_of(alignment)
        return C_nb, alignment.P_theta_b

    true, _ = attitude(np.zeros(3), np.zeros(3))
    nees, heading = [], []
    for _ in range(400):
        C_nb, P_b = attitude(
            scenario.imu.gyro.bias * rng.standard_normal(3),
            scenario.imu.accelerometer.bias * rng.standard_normal(3),
        )
        error, P_n = rotation.rotvec_from_quat(rotation.quat_from_dcm(C_nb @ true.T)), C_nb @ P_b @ C_nb.T
        nees.append(error @ np.linalg.solve(P_n, error))
        heading.append(error[2] ** 2 / P_n[2, 2])
    for values, dof in ((nees, 3), (heading, 1)):
        low, high = stats.chi2.ppf([0.001, 0.999], 400 * dof) / 400
        assert low < np.mean(values) < high


def test_a_heading_that_is_given_is_taken(tmp_path):
    given = "{method: static, duration: 4 s, heading: 200 deg, azimuth: 3 deg}"
    alignment, _ = aligned(tmp_path, overrides=["imu.gyro.bias=100 deg/h"], alignment=given)
    angles, C_nb, _, _ = angles_of(alignment)
    assert np.degrees(angles[2]) % 360.0 == pytest.approx(200.0)
    sigma = np.sqrt(np.diag(C_nb @ alignment.P_theta_b @ C_nb.T))
    assert np.degrees(sigma[2]) == pytest.approx(3.0)


def test_the_antenna_is_not_the_imu(tmp_path):
    alignment, _ = aligned(tmp_path, overrides=["gnss.lever_arm=[2 m, 0 m, -1 m]"])
    _, C_nb, r_e, _ = angles_of(alignment)
    C_en = wgs84.dcm_en(turntable.LATITUDE, turntable.LONGITUDE)
    np.testing.assert_allclose(turntable.place_e() - r_e, C_en @ C_nb @ [2.0, 0.0, -1.0], atol=1e-4)


REFUSED = {
    "poor gyros": (STILL, ["imu.gyro.bias=30 deg/h"], "find north to 171 deg only"),
    "turning": (Turntable(rate=0.1), [], r"the mean rate is 5\.7\d* deg/s"),
    "upside down": (STILL, ["data.axes=[x, -y, -z]"], "the specific force points down"),
    "wrong unit": (STILL, ["data.imu.accelerometer_unit=gee"], "the mean specific force is 96.18 m/s2"),
    "too long": (STILL, ["alignment.duration=20 s"], "the data end 5 s after mission.start"),
    "no fix": (
        STILL,
        ["gnss.first=4.2 s"],
        "needs a GNSS fix from 0 s to 4 s after the first IMU sample; there is none, its ",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_aligned_is_refused(kind, tmp_path):
    table, overrides, words = REFUSED[kind]
    with pytest.raises(DataError, match=words):
        aligned(tmp_path, table, overrides)


def test_from_the_reference_between_its_rows(tmp_path):
    """Attitude and place of a moving turntable at 0.13 s, which is no row of the truth (20 Hz)."""
    table = Turntable()
    reference = "{method: reference, level: 1 deg, azimuth: 2 deg, position: 5 m, velocity: 0.1 m/s}"
    path = replay_files.turntable_folder(tmp_path, table, turntable.increments, 100.0, 2.0)
    text = path.read_text(encoding="utf-8").replace(replay_files.REFERENCE, reference)
    path.write_text(text, encoding="utf-8")
    scenario, files = load.load(path, ["mission.start=0.13 s"])
    alignment = align.align(scenario, dataset.read(scenario, files), EARTH)
    angles, C_nb, r_e, _ = angles_of(alignment)
    assert alignment.t_valid_s == pytest.approx(0.13)
    np.testing.assert_allclose(angles, table.angles(np.array([0.13]))[0], atol=1e-9)
    np.testing.assert_allclose(r_e, turntable.place_e(), atol=1e-6)
    sigma = np.sqrt(np.diag(C_nb @ alignment.P_theta_b @ C_nb.T))
    np.testing.assert_allclose(np.degrees(sigma), [1.0, 1.0, 2.0], rtol=1e-6)
    assert (alignment.sigma_r, alignment.sigma_v) == (5.0, 0.1)


def test_a_reference_that_begins_too_late_is_named(tmp_path):
    path = replay_files.turntable_folder(tmp_path, STILL, turntable.increments, 20.0, 5.0)
    lines = (tmp_path / "truth.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "truth.csv").write_text("\n".join(lines[:1] + lines[40:]) + "\n", encoding="utf-8")
    scenario, files = load.load(path)
    with pytest.raises(DataError, match=r"truth\.csv: covers 1\.95 s to 5 s, not the start .* at 0 s; set"):
        align.align(scenario, dataset.read(scenario, files), EARTH)
