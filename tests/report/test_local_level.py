"""Errors north, east, down and of roll, pitch, heading: known errors are put in and must come out."""

import numpy as np
import pytest

from shefex_nav.environment import ephemeris
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.topics import Mission
from shefex_nav.records import Event, GateResult, NavCovariance, NavSolution, Phase, TruthSample
from shefex_nav.report import local_level, metrics

EARTH = ephemeris.earth_rotation("2020-06-01T12:00:00", 0.0, 0.0, 0.0)
N = 400
PLACE = (np.radians(47.0), np.radians(8.0), 400.0)
MISSION = Mission(
    "known", "", 0, "0", "2020-06-01T12:00:00", 0.0, EARTH, *PLACE, pinhole(1, 1, 1.0), np.eye(3)
)
ANGLES = np.radians([20.0, -35.0, 170.0])
SIGMA_R, SIGMA_V, SIGMA_B = np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]), 0.004


def run(dr_n, dv_n, dtheta_b, *, start_s=0.0):
    """RunData of a drive to the north-west with these errors, truth minus estimate, (N, 3) each."""
    kept = RunDataBuilder(MISSION._replace(start_s=start_s))
    kept.add(Event(start_s, local_level.REPLAY_START, 0.0, "known errors"))
    C_en, q_nb = wgs84.dcm_en(*PLACE[:2]), rotation.quat_from_dcm(euler.dcm_from_euler(*ANGLES))
    r_e = wgs84.ecef_from_geodetic(*PLACE)
    for k in range(N):
        t_s = start_s + 0.1 * (k + 1)
        C_ie = frames.dcm_ie(EARTH, t_s)
        q_ib = rotation.quat_multiply(rotation.quat_from_dcm(C_ie @ C_en), q_nb)
        v_e = C_en @ [20.0, -20.0, 0.0]
        true = frames.inertial_from_ecef(EARTH, t_s, r_e, v_e)
        estimate = frames.inertial_from_ecef(EARTH, t_s, r_e - C_en @ dr_n[k], v_e - C_en @ dv_n[k])
        q_estimate = rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(-dtheta_b[k]))
        nothing = np.zeros(3)
        kept.add(TruthSample(t_s, Phase.COAST, *true, q_ib, nothing, nothing, 0.0))
        kept.add(solution(t_s, *estimate, q_estimate))
        C_in = C_ie @ C_en
        P = np.zeros((9, 9))
        P[:3, :3] = C_in * SIGMA_R**2 @ C_in.T
        P[3:6, 3:6] = C_in * SIGMA_V**2 @ C_in.T
        P[6:, 6:] = SIGMA_B**2 * np.eye(3)
        kept.add(NavCovariance(t_s, P, nothing, nothing, nothing, nothing, np.zeros(12)))
    return kept


def solution(t_s, r_i, v_i, q_ib):
    """NavSolution of which nothing else matters."""
    values = {name: 0.0 for name in NavSolution._fields} | {
        name: np.zeros(3) for name in ("omega_ib_b", "r_e", "v_e", "sigma_r_e", "sigma_v_e")
    }
    values |= {name: np.zeros(3) for name in ("sigma_theta_b", "sigma_omega_b")}
    defaults = NavSolution._field_defaults
    return NavSolution(**(values | defaults | {"t_s": t_s, "r_i": r_i, "v_i": v_i, "q_ib": q_ib}))


def constant(value):
    return np.tile(value, (N, 1))


def test_constant_errors_come_out_axis_by_axis():
    dr_n, dv_n, dtheta_b = (
        np.array([3.0, -2.0, 6.0]),
        np.array([0.1, 0.4, -0.6]),
        np.array([1e-3, -2e-3, 5e-4]),
    )
    data = run(constant(dr_n), constant(dv_n), constant(dtheta_b)).build()
    found = metrics.summarise(data)["navigation"]
    np.testing.assert_allclose(found["position_rms_ned_m"], np.abs(dr_n), atol=1e-6)
    np.testing.assert_allclose(found["velocity_rms_ned_m_s"], np.abs(dv_n), atol=1e-6)
    C_nb = euler.dcm_from_euler(*ANGLES)
    before = np.array(euler.euler_from_dcm(C_nb @ rotation.dcm_from_rotvec(-dtheta_b)))
    np.testing.assert_allclose(found["attitude_rms_rpy_deg"], np.degrees(np.abs(ANGLES - before)), atol=1e-6)
    over = found["error_over_sigma"]
    np.testing.assert_allclose(over["position_ned"], np.abs(dr_n) / SIGMA_R, rtol=1e-5)
    np.testing.assert_allclose(over["velocity_ned"], np.abs(dv_n) / SIGMA_V, rtol=1e-2)  # omega x dr


def test_random_errors_are_as_large_as_their_sigmas():
    """4000 epochs of errors drawn from the covariance: rms over sigma is 1 within four of its own sigmas."""
    rng = np.random.default_rng(11)
    draws = [rng.standard_normal((N, 3)) for _ in range(3)]
    data = run(draws[0] * SIGMA_R, draws[1] * SIGMA_V, draws[2] * SIGMA_B).build()
    over = local_level.summarise(data)["error_over_sigma"]
    for values in over.values():
        np.testing.assert_allclose(values, 1.0, atol=4.0 / np.sqrt(2.0 * N))


def test_statistics_may_begin_later():
    dr_n = constant(np.array([1.0, 1.0, 1.0]))
    dr_n[:100] = 1000.0
    data = run(dr_n, 0.0 * dr_n, 0.0 * dr_n, start_s=5.0).build()
    late = metrics.summarise(data, from_s=5.0 + 10.05)["navigation"]
    np.testing.assert_allclose(late["position_rms_ned_m"], 1.0, atol=1e-6)
    assert late["statistics_from_s"] == pytest.approx(15.05)
    assert metrics.summarise(data)["navigation"]["position_rms_ned_m"][0] > 400.0


def test_heading_beyond_half_a_turn_is_no_error():
    """Headings of 179.9 deg and -179.9 deg are 0.2 deg apart."""
    turn = np.zeros((N, 3))
    data = run(turn, turn, constant(np.array([0.0, 0.0, np.radians(20.0)]))).build()
    assert local_level.summarise(data)["attitude_rms_rpy_deg"][2] < 40.0


def test_nis_knows_where_it_should_lie():
    """Values of the chi-square distribution lie inside the interval, those of twice the noise do not."""
    rng = np.random.default_rng(3)
    kept = run(*[np.zeros((N, 3))] * 3)
    for k in range(300):
        for sensor, scale in (("gps_position", 1.0), ("gps_velocity", 2.0)):
            nis = float(scale * rng.chisquare(3))
            kept.add(GateResult(0.1 * k, 0.1 * k, sensor, 3, nis, 21.0, True, "", np.zeros(3)))
    nis = local_level.summarise(kept.build())["nis"]
    for sensor, inside in (("gps_position", True), ("gps_velocity", False)):
        low, high = nis[sensor]["interval"]
        assert (low < nis[sensor]["mean"] < high) == inside
        assert nis[sensor]["samples"] == 300 and nis[sensor]["dof"] == 3
    assert low == pytest.approx(3.0 - 2.576 * np.sqrt(6.0 / 300.0), abs=0.03)


def test_a_flight_is_no_replay():
    """Only logs with the event of a replay get these figures unasked."""
    data = run(*[np.zeros((N, 3))] * 3).build()._replace(events=[])
    assert "position_rms_ned_m" not in metrics.summarise(data)["navigation"]
    assert "position_rms_ned_m" in metrics.summarise(data, from_s=0.0)["navigation"]
