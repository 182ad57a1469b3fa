"""An attitude that was found by the sensors is off as their biases make it: derivatives by brute force, and a
filter that learns nothing of the level from fixes of a vehicle at rest."""

import numpy as np
import pytest
import replay_files
import turntable
from turntable import Turntable

from shefex_nav.environment import ephemeris
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.hypotheses import split
from shefex_nav.onboard.navigation.state import ATT, BA
from shefex_nav.records import row
from shefex_nav.replay import align, dataset, external, load, params

EARTH = ephemeris.earth_rotation(replay_files.EPOCH, 0.0, 0.0, 0.0)
LEVEL = Turntable(rate=0.0)
ON_RAIL = Turntable(roll=np.radians(35.0), pitch=np.radians(80.0), heading=np.radians(130.0), rate=0.0)
GIVEN = "{method: static, duration: 4 s, heading: 130 deg, azimuth: 1 deg, disturbance: 1e-6 deg"
METHODS = {  # table, alignment, bias of the gyros, sigmas of angles that are told
    "north": (LEVEL, "{method: static, duration: 4 s, disturbance: 1e-6 deg}", "0.2 deg/h", {}),
    "heading": (LEVEL, f"{GIVEN}}}", "1 deg/h", {"heading": "azimuth"}),
    "steep": (ON_RAIL, f"{GIVEN}}}", "1 deg/h", {"heading": "azimuth"}),
    "at rest": (LEVEL, f"{GIVEN}, gyro_bias: at_rest}}", "1 deg/s", {"heading": "azimuth"}),
    "rail": (
        ON_RAIL,
        "{method: rail, duration: 4 s, elevation: 80 deg, elevation_error: 0.2 deg, azimuth: 130 deg, "
        "azimuth_error: 2 deg, disturbance: 1e-6 deg}",
        "1 deg/s",
        {"azimuth": "azimuth_error", "elevation": "elevation_error"},
    ),
}
QUIET = [
    "imu.gyro.random_walk=0 deg/sqrt(h)",
    "imu.accelerometer.random_walk=0 m/s/sqrt(h)",
    "imu.accelerometer.bias=2 mgee",
]


def loaded(folder, table, alignment, gyro, more=QUIET, length_s=5.0):
    """ReplayScenario and Dataset of ideal sensors at rest, 20 Hz."""
    path = replay_files.turntable_folder(folder, table, turntable.increments, 20.0, length_s)
    text = path.read_text(encoding="utf-8").replace(replay_files.REFERENCE, alignment)
    path.write_text(text, encoding="utf-8")
    scenario, files = load.load(path, [f"imu.gyro.bias={gyro}", *more])
    return scenario, dataset.read(scenario, files)


def errors(scenario, data, table, biases):
    """Errors of attitude, gyro bias and accelerometer bias of an alignment by sensors with biases, (9,).

    biases : (6,) rad/s and m/s^2
    """
    step_s = np.diff(data.imu.t_s, prepend=data.imu.t_s[0])[:, None]
    wrong = data.imu._replace(
        dtheta_b=data.imu.dtheta_b + biases[:3] * step_s, dv_b=data.imu.dv_b + biases[3:] * step_s
    )
    found = align.align(scenario, data._replace(imu=wrong), EARTH)
    C_ib = frames.dcm_ie(EARTH, found.t_valid_s) @ wgs84.dcm_en(turntable.LATITUDE, turntable.LONGITUDE)
    q_true = rotation.quat_from_dcm(C_ib @ table.C_nb(0.0))
    gyro = biases[:3] - (found.gyro_bias if len(found.gyro_bias) else 0.0)
    return np.concatenate([rotation.rotvec_between(found.q_ib, q_true), gyro, biases[3:]])


@pytest.mark.parametrize("method", METHODS)
def test_the_covariance_is_that_of_all_that_is_off(method, tmp_path):
    """Sum over the biases and the angles that are told of their variances times the squares of derivatives,
    by differences. The bias of gyros that were found at rest alone may be told to be more."""
    table, alignment, bias, told = METHODS[method]
    scenario, data = loaded(tmp_path, table, alignment, bias)
    P = align.align(scenario, data, EARTH).P_with_biases
    sheet, start = scenario.imu, errors(scenario, data, table, np.zeros(6))
    sigmas, parts = np.repeat([sheet.gyro.bias, sheet.accelerometer.bias], 3), []
    for k, sigma in enumerate(sigmas):
        biases = np.zeros(6)
        biases[k] = 1e-3 * sigma
        parts.append((errors(scenario, data, table, biases) - start) / 1e-3)
    for angle, sigma in told.items():
        one = getattr(scenario.alignment, sigma)
        moved = scenario.alignment.model_copy(update={angle: getattr(scenario.alignment, angle) + 1e-3 * one})
        there = scenario.model_copy(update={"alignment": moved})
        parts.append((errors(there, data, table, np.zeros(6)) - start) / 1e-3)
    expected = sum(np.outer(part, part) for part in parts)
    size = np.sqrt(np.diag(P))
    off = (P - expected) / np.outer(size, size)
    off[3:6, 3:6] = 0.0  # what gyros at rest say is taken for alike in all axes
    assert np.abs(off).max() < 5e-3
    assert np.linalg.eigvalsh((P - expected) / np.outer(size, size))[0] > -5e-3


def test_fixes_at_rest_say_nothing_of_the_level(tmp_path):
    """A tilt b/g and the bias b cancel each other, whatever they are: a minute says nothing new."""
    scenario, data = loaded(tmp_path, LEVEL, f"{GIVEN}}}", "1 deg/h", length_s=64.0)
    found = align.align(scenario, data, EARTH)
    nav = fusion.start(params.nav_params(scenario, 0.05), found, EARTH)
    before = nav.history.P.copy()
    blocks = external.imu_blocks(data.imu, 4, found.t_valid_s)
    waiting = [fix for fix in data.fixes if fix.t_valid_s > found.t_valid_s][::-1]
    for k in range(len(blocks.t_valid_s)):
        fusion.advance(nav, row(blocks, k))
        while waiting and waiting[-1].t_available_s <= blocks.t_valid_s[k] + 1e-6:
            fusion.take(nav, [waiting.pop()])
    assert not waiting
    C_nb = LEVEL.C_nb(0.0)
    for block in (ATT, BA):
        sigmas = [np.sqrt(np.diag(C_nb @ P[block, block] @ C_nb.T)[:2]) for P in (before, nav.history.P)]
        np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=0.02)


def test_a_part_of_an_unknown_heading_keeps_what_the_biases_are_given_the_attitude(tmp_path):
    alignment = "{method: static, duration: 4 s, heading: unknown, gyro_bias: at_rest}"
    scenario, data = loaded(tmp_path, LEVEL, alignment, "1 deg/s")
    whole = align.align(scenario, data, EARTH)
    slope = np.linalg.solve(whole.P_theta_b, whole.P_with_biases[:3, 3:])
    for part in split(whole):
        P, P_theta_b = part.alignment.P_with_biases, part.alignment.P_theta_b
        np.testing.assert_allclose(P[:3, :3], P_theta_b, atol=1e-12)
        size = np.sqrt(np.diag(P))
        assert np.linalg.eigvalsh(P / np.outer(size, size))[0] > -1e-9
        C = rotation.dcm_from_quat(
            rotation.quat_multiply(rotation.quat_conjugate(whole.q_ib), part.alignment.q_ib)
        )
        there = C @ np.linalg.solve(P_theta_b, P[:3, 3:]) @ np.kron(np.eye(2), C.T)
        np.testing.assert_allclose(there, slope, atol=1e-6 * np.abs(slope).max())
