"""Magnetometer in the filter: Jacobians of three axes and of the heading, hard iron, limits of use."""

from dataclasses import replace

import numpy as np
import pytest
from magnetic_elements import declination_sigma, field_n
from navigation_flight import MODEL, PARAMS
from unpacked import correct

from shefex_nav.environment import gravity, magnetic_field
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.instruments import magnetometer
from shefex_nav.instruments.instrument import Known, Release
from shefex_nav.instruments.magnetometer import Magnetometer, MagnetometerReading, MagnetometerUse
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.aiding import Here
from shefex_nav.onboard.navigation.state import ATT, NavState, layout, pack
from shefex_nav.records import Alignment, ImuBlock

EARTH = frames.EarthRotation(
    rotation.dcm_from_rotvec(np.array([1e-3, -2e-3, 5e-4])), np.eye(3), 2.5, 7.292115e-5
)
SITE = np.deg2rad(47.0), np.deg2rad(11.0)
HARMONICS = magnetic_field.load(2025.5)
STEP = np.concatenate([np.repeat([1.0, 1e-2, 1e-5, 1e-4, 1e-2], 3), np.full(3, 1e-8)])
SENSOR = Magnetometer(
    rate=10.0, latency=0.0, hard_iron=5e-7, soft_iron=3e-3, noise=5e-8, quantum=0.0, range=2e-4
)


def aid_of(rows, sensor=SENSOR):
    """Aid of a filter that uses the three axes, or the heading alone."""
    release = Release(rejections=5, duration=0.4)
    use = MagnetometerUse(used=True, rows=rows, model_error=0.0, memory=100.0, release=release)
    return magnetometer.aid(sensor, use, Known(2025.5, np.zeros(3)))


FIELD, HEADING = aid_of("field"), aid_of("heading")
LAYOUT = layout(("hard_iron",), FIELD.blocks)


def state_at(t_s=50.0, seed=4, site=SITE):
    rng = np.random.default_rng(seed)
    r_e, C_en = wgs84.ecef_from_geodetic(*site, 3000.0), wgs84.dcm_en(*site)
    r_i, v_i = frames.inertial_from_ecef(EARTH, t_s, r_e, C_en @ np.array([40.0, -20.0, -300.0]))
    q_ib = rotation.quat_normalise(rng.standard_normal(4))
    return NavState(t_s, r_i, v_i, q_ib, np.zeros(3), np.zeros(3), others=5e-7 * rng.standard_normal(3))


def here(state):
    return Here(LAYOUT, EARTH, state.t_s, pack(state))


def said(state, aid=FIELD, field_b=(0.0, 0.0, 0.0)):
    """z, H, and R with what lasts."""
    seen = aid.expect(here(state), MagnetometerReading(state.t_s, state.t_s, np.array(field_b)))
    return seen.z, seen.H, seen.R + sum(one for one, _ in seen.lasting)


def true_field(state):
    """What a sensor without noise reads of a state: the model's field, turned, and the hard iron."""
    C_ie = frames.dcm_ie(EARTH, state.t_s)
    b_i = C_ie @ magnetic_field.field_e(HARMONICS, C_ie.T @ state.r_i)
    return rotation.dcm_from_quat(state.q_ib).T @ b_i + state.others


def test_the_reading_of_a_known_attitude_leaves_no_innovation():
    state = state_at()
    z, _, R = said(state, field_b=true_field(state))
    assert np.abs(z).max() < 1e-15
    assert np.linalg.eigvalsh(R).min() > SENSOR.noise**2


def test_the_jacobian_is_what_perturbing_the_state_gives():
    state = state_at()
    _, H, _ = said(state)
    for k in range(LAYOUT.n):
        e = np.zeros(LAYOUT.n)
        e[k] = STEP[k]
        ahead, behind = (said(correct(LAYOUT, state, s * e))[0] for s in (1.0, -1.0))
        numeric = (behind - ahead) / (2.0 * STEP[k])
        np.testing.assert_allclose(H[:, k], numeric, rtol=1e-5, atol=4e-11, err_msg=str(k))  # of the place


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_heading_is_how_far_the_horizontal_field_is_turned(seed):
    """A vehicle turned about the vertical by a small angle reads a heading that is off by it."""
    state = state_at(seed=seed)
    C_ie = frames.dcm_ie(EARTH, state.t_s)
    latitude, longitude, _ = wgs84.geodetic_from_ecef(C_ie.T @ state.r_i)
    down_i = C_ie @ wgs84.dcm_en(latitude, longitude)[:, 2]
    down_b = rotation.dcm_from_quat(state.q_ib).T @ down_i
    turned = correct(LAYOUT, state, np.concatenate([np.zeros(6), 1e-5 * down_b, np.zeros(9)]))
    z, H, R = said(state, HEADING, true_field(turned))
    assert z.shape == (1,) and R.shape == (1, 1)
    assert abs(z[0]) == pytest.approx(1e-5, rel=1e-4)
    assert H[0, ATT] @ (1e-5 * down_b) == pytest.approx(z[0], rel=1e-4)
    declination = declination_sigma(field_n(HARMONICS, latitude, longitude, 3000.0), 2025.5)
    assert np.sqrt(R[0, 0]) > declination


def test_a_reading_is_not_used_at_the_end_of_its_range_nor_for_a_heading_near_the_pole():
    def why(aid, state, limit=False):
        return aid.unfit(here(state), MagnetometerReading(state.t_s, state.t_s, np.zeros(3), limit))

    pole = state_at(site=(np.deg2rad(86.0), np.deg2rad(139.0)))
    assert why(FIELD, state_at()) == why(HEADING, state_at()) == why(FIELD, pole) == ""
    assert why(FIELD, state_at(), limit=True) == "not used: the sensor is at an end of its range"
    assert why(HEADING, pole) == "not used: the horizontal field is too weak for a heading"


def turn_on_a_table(readings_of, seconds=12.0, azimuth_off=0.0):
    """A vehicle that turns about the vertical at 30 deg/s and hears a magnetometer.

    -> fusion.Filter, list of GateResult, true attitude at the end
    """
    r_e, C_en = wgs84.ecef_from_geodetic(*SITE, 600.0), wgs84.dcm_en(*SITE)
    r_i, v_i = frames.inertial_from_ecef(EARTH, 0.0, r_e, np.zeros(3))
    level = frames.dcm_ie(EARTH, 0.0) @ C_en
    off = rotation.dcm_from_rotvec(np.array([0.0, 0.0, azimuth_off]))
    P = np.diag([1e-3, 1e-3, np.deg2rad(5.0)]) ** 2
    begin = Alignment(0.0, r_i, v_i, rotation.quat_from_dcm(level @ off.T), 3.0, 0.01, P)
    params = PARAMS._replace(states=("hard_iron",), sigma_blocks={}, aids=(FIELD,), imu=MODEL)
    nav, results = fusion.start(params, begin, EARTH), []
    g, spin = float(np.linalg.norm(gravity.normal_gravity_e(r_e))), np.deg2rad(30.0)
    earth_n = np.array([wgs84.OMEGA * np.cos(SITE[0]), 0.0, -wgs84.OMEGA * np.sin(SITE[0])])
    waiting = readings_of(lambda t_s: _read(t_s, spin, r_e, C_en))
    for k in range(1, round(100 * seconds) + 1):
        turned = rotation.dcm_from_rotvec(np.array([0.0, 0.0, spin * 0.01 * (k - 0.5)]))
        rate = turned.T @ earth_n + [0.0, 0.0, spin]
        dtheta_b, dv_b = np.tile(rate / 400.0, (4, 1)), np.tile([0.0, 0.0, -g / 400.0], (4, 1))
        fusion.advance(nav, ImuBlock(0.01 * k, 0.01 * k, 1.0 / 400.0, dtheta_b, dv_b, False))
        due = [one for one in waiting if one.t_available_s <= 0.01 * k + 1e-6]
        waiting = [one for one in waiting if one.t_available_s > 0.01 * k + 1e-6]
        if due:
            results += fusion.fuse(nav, [("magnetometer", one) for one in due])
    at_end = level_at(seconds) @ rotation.dcm_from_rotvec(np.array([0.0, 0.0, spin * seconds]))
    return nav, results, rotation.quat_from_dcm(at_end)


def level_at(t_s):
    return frames.dcm_ie(EARTH, t_s) @ wgs84.dcm_en(*SITE)


def _read(t_s, spin, r_e, C_en):
    """Field in body axes of the table."""
    C_bn = rotation.dcm_from_rotvec(np.array([0.0, 0.0, spin * t_s])).T
    return C_bn @ C_en.T @ magnetic_field.field_e(HARMONICS, r_e)


IRON = np.array([6e-7, -4e-7, 3e-7])


def readings(late_s=0.0, seconds=12.0, jump=None):
    def made(read):
        rng = np.random.default_rng(5)
        out = []
        for k in range(1, round(10 * seconds) + 1):
            more = jump[1] if jump and 0.1 * k > jump[0] else 0.0
            field_b = read(0.1 * k) + IRON + more + 5e-8 * rng.standard_normal(3)
            out.append(MagnetometerReading(0.1 * k, 0.1 * k + late_s, field_b))
        return out

    return made


def test_turning_finds_the_hard_iron_and_the_heading():
    """Heading off by 8 deg (sigma 5 deg), hard iron of some 0.5 uT: after a turn both are known."""
    nav, results, q_ib = turn_on_a_table(readings(), azimuth_off=np.deg2rad(8.0))
    assert all(result.accepted and result.dof == 3 for result in results)
    state = nav.history[-1].state
    error = rotation.rotvec_between(state.q_ib, q_ib)
    sigma = np.sqrt(np.diag(nav.history.P))
    assert abs(np.degrees(error[2])) < 0.6
    assert np.all(np.abs(error) < 3.5 * sigma[ATT])
    place = nav.layout.places["hard_iron"]
    assert np.all(sigma[place][:2] < 0.75 * 5e-7)  # across the axis of the turn; soft iron hides the rest
    assert np.all(np.abs(state.others - IRON) < 3.5 * sigma[place])


def test_readings_that_come_late_say_what_they_would_have_said_in_time():
    in_time, _, _ = turn_on_a_table(readings(seconds=3.0), 3.5)
    late, _, _ = turn_on_a_table(readings(late_s=0.25, seconds=3.0), 3.5)
    np.testing.assert_allclose(in_time.history[-1].x, late.history[-1].x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(in_time.history[-1].P, late.history[-1].P, rtol=1e-5, atol=1e-18)


def test_a_field_that_jumps_is_a_new_hard_iron():
    """A motor case that drops: 20 uT from one reading to the next."""
    nav, results, q_ib = turn_on_a_table(readings(jump=(6.0, np.array([2e-5, 0.0, 0.0]))))
    assert [result.note for result in results if result.note.startswith("new")] == ["new hard iron"]
    assert results[-1].accepted
    assert abs(np.degrees(rotation.rotvec_between(nav.history[-1].state.q_ib, q_ib)[2])) < 1.0
    assert np.abs(nav.history[-1].state.others - IRON - [2e-5, 0.0, 0.0]).max() < 1e-6


def test_quanta_are_white_noise_of_a_twelfth_of_their_square():
    state = state_at()
    coarse = aid_of("field", replace(SENSOR, quantum=1.5e-7))
    reading = MagnetometerReading(state.t_s, state.t_s, np.zeros(3))
    R = coarse.expect(here(state), reading).R
    np.testing.assert_allclose(R, (SENSOR.noise**2 + 1.5e-7**2 / 12.0) * np.eye(3), rtol=1e-12)
