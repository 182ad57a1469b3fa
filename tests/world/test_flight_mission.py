"""The reconstructed SHEFEX-2 flight: what is publicly known of it, and the consistency of the truth."""

import numpy as np
import pytest
from numba import njit
from shefex2 import DEG, EARTH, PARAMS, PROGRAM, SITE, flown

from shefex_nav.environment.gravity import gravity_e, load_egm96
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Phase
from shefex_nav.world.flight.fly import FlightError, fly
from shefex_nav.world.flight.vehicle import combine

SUN_I = np.array(
    [np.cos(23.4 * DEG) * np.cos(91.7 * DEG), np.cos(23.4 * DEG) * np.sin(91.7 * DEG), np.sin(23.4 * DEG)]
)


def sample(t_s):
    return round((t_s - PARAMS.t_start_s) * PARAMS.sample_rate_hz)


def speeds(trajectory, step):
    relative = trajectory.v_i[::step] - np.cross(frames.omega_ie_i(EARTH), trajectory.r_i[::step])
    return np.linalg.norm(relative, axis=1)


def distance(lat_1, lon_1, lat_2, lon_2):
    """Length of the geodesic on WGS 84 by Vincenty's inverse formula, m."""
    u_1, u_2 = (np.arctan((1.0 - wgs84.F) * np.tan(lat)) for lat in (lat_1, lat_2))
    lam = lon_2 - lon_1
    for _ in range(20):
        across = np.cos(u_2) * np.sin(lam)
        along = np.cos(u_1) * np.sin(u_2) - np.sin(u_1) * np.cos(u_2) * np.cos(lam)
        sin_s = np.hypot(across, along)
        cos_s = np.sin(u_1) * np.sin(u_2) + np.cos(u_1) * np.cos(u_2) * np.cos(lam)
        s = np.arctan2(sin_s, cos_s)
        sin_a = np.cos(u_1) * np.cos(u_2) * np.sin(lam) / sin_s
        cos2_a = 1.0 - sin_a**2
        c2m = cos_s - 2.0 * np.sin(u_1) * np.sin(u_2) / cos2_a
        c = wgs84.F / 16.0 * cos2_a * (4.0 + wgs84.F * (4.0 - 3.0 * cos2_a))
        inner = c2m + c * cos_s * (2.0 * c2m**2 - 1.0)
        lam = lon_2 - lon_1 + (1.0 - c) * wgs84.F * sin_a * (s + c * sin_s * inner)
    k = cos2_a * wgs84.EP2
    a = 1.0 + k / 16384.0 * (4096.0 + k * (-768.0 + k * (320.0 - 175.0 * k)))
    b = k / 1024.0 * (256.0 + k * (-128.0 + k * (74.0 - 47.0 * k)))
    tail = b / 6.0 * c2m * (4.0 * sin_s**2 - 3.0) * (4.0 * c2m**2 - 3.0)
    ds = b * sin_s * (c2m + b / 4.0 * (cos_s * (2.0 * c2m**2 - 1.0) - tail))
    return wgs84.B * a * (s - ds)


def test_public_figures_of_the_flight():
    trajectory, events = flown()
    assert events["apogee"].altitude_m == pytest.approx(177e3, abs=0.5e3)
    r_e, _ = frames.ecef_from_inertial(EARTH, trajectory.t_s[-1], trajectory.r_i[-1], trajectory.v_i[-1])
    latitude, longitude, height = wgs84.geodetic_from_ecef(r_e)
    assert 0.0 <= height < 1.0
    assert distance(SITE.latitude, SITE.longitude, latitude, longitude) == pytest.approx(800e3, abs=2e3)
    assert np.degrees(latitude) == pytest.approx(76.4, abs=0.1)  # west of Spitsbergen
    entry = trajectory.mach[sample(events["entry"].t_s)]
    assert 10.0 < entry < 11.0
    assert 52.0 < events["altitude_20km"].t_s - events["entry"].t_s < 62.0
    assert speeds(trajectory, 40).max() == pytest.approx(3056.0, abs=5.0)


def test_events_and_phases_are_in_order():
    trajectory, events = flown()
    names = [
        "lift_off", "rail_exit", "burn_out_1", "separation", "ignition_2", "burn_out_2", "despin_complete",
        "pointing_start", "apogee", "pointing_end", "spin_up_start", "spin_up_complete", "entry",
        "altitude_60km", "altitude_20km", "max_dynamic_pressure", "impact",
    ]  # fmt: skip
    assert list(events) == names
    assert np.all(np.diff([events[name].t_s for name in names]) > 0.0)
    assert np.all(np.diff(trajectory.phase) >= 0)
    assert set(trajectory.phase) == {int(phase) for phase in Phase}
    assert events["impact"].altitude_m < 1.0
    assert trajectory.t_s[-1] <= events["impact"].t_s < trajectory.t_s[-1] + 1.0 / PARAMS.sample_rate_hz


def test_at_rest_on_the_pad():
    trajectory, _ = flown()
    last = sample(0.0)
    C_eb = None
    for k in (0, 1234, last - 1):
        r_e, v_e = frames.ecef_from_inertial(EARTH, trajectory.t_s[k], trajectory.r_i[k], trajectory.v_i[k])
        assert np.allclose(r_e, wgs84.ecef_from_geodetic(*SITE[:3]), atol=1e-8)
        assert np.linalg.norm(v_e) < 1e-9
        C_eb = frames.dcm_ie(EARTH, trajectory.t_s[k]).T @ rotation.dcm_from_quat(trajectory.q_ib[k])
        # reaction to gravity: upwards, as long as WGS 84 normal gravity but for the anomaly of the place
        up_n = wgs84.dcm_en(SITE.latitude, SITE.longitude).T @ C_eb @ trajectory.f_b[k]
        assert np.linalg.norm(up_n) == pytest.approx(9.825676743958033, abs=1e-3)
        assert up_n[2] < 0.0 and np.linalg.norm(up_n[:2]) < 1e-3
        assert np.allclose(C_eb @ trajectory.omega_ib_b[k], [0.0, 0.0, EARTH.rate], atol=1e-15)
    dt = 1.0 / PARAMS.sample_rate_hz
    assert np.allclose(trajectory.dtheta_b[1 : last + 1], trajectory.omega_ib_b[0] * dt, atol=1e-18)
    assert np.allclose(trajectory.dv_b[1 : last + 1], trajectory.f_b[0] * dt, atol=1e-13)
    assert np.all(trajectory.dtheta_b[0] == 0.0)
    nose_l = wgs84.dcm_el(SITE.latitude, SITE.longitude).T @ C_eb[:, 0]
    assert np.arcsin(nose_l[2]) == pytest.approx(SITE.elevation, abs=1e-9)
    assert np.arctan2(nose_l[0], nose_l[1]) % (2.0 * np.pi) == pytest.approx(SITE.azimuth, abs=1e-9)


def test_nothing_jumps_at_staging():
    trajectory, _ = flown()
    dt = 1.0 / PARAMS.sample_rate_hz
    p = PROGRAM
    for t_s in (p.separation_s, p.precession_start_s, p.precession_end_s, p.despin_start_s, p.despin_end_s,
                p.pointing_start_s, p.pointing_end_s, p.entry_slew_end_s, p.spin_up_end_s):  # fmt: skip
        k = sample(t_s)
        around = slice(k - 2, k + 4)
        step = np.diff(trajectory.r_i[around], axis=0) - trajectory.v_i[around][:-1] * dt
        assert np.abs(step).max() < 20.0 * dt**2  # m: what 4 g do in a sample
        assert np.abs(np.diff(trajectory.v_i[around], axis=0)).max() < 40.0 * dt
        assert np.abs(np.diff(trajectory.omega_ib_b[around], axis=0)).max() < 0.2 * dt  # rad/s
        turned = rotation.rotvec_between(trajectory.q_ib[k - 2 : k + 3], trajectory.q_ib[k - 1 : k + 4])
        assert np.abs(turned - trajectory.dtheta_b[k - 1 : k + 4]).max() < 1e-9


@njit
def strapdown(t_s, dtheta_b, dv_b, r, v, q, gravity, earth):
    """Navigate on the increments alone, rate and specific force quadratic over three samples."""
    for k in range(1, len(t_s)):
        h = t_s[k] - t_s[k - 1]
        a, b = dtheta_b[k], dv_b[k]
        a1, b1 = dtheta_b[max(k - 1, 1)], dv_b[max(k - 1, 1)]
        a2, b2 = dtheta_b[max(k - 2, 1)], dv_b[max(k - 2, 1)]
        turn = a + 121.0 / 720.0 * rotation.cross(a1, a) - 31.0 / 720.0 * rotation.cross(a2, a)
        turn += rotation.cross(a2, a1) / 720.0
        gain = b + 0.5 * rotation.cross(a, b) + rotation.cross(a, rotation.cross(a, b)) / 6.0
        gain += 121.0 / 720.0 * (rotation.cross(a1, b) - rotation.cross(a, b1))
        gain -= 31.0 / 720.0 * (rotation.cross(a2, b) - rotation.cross(a, b2))
        gain += (rotation.cross(a2, b1) - rotation.cross(a1, b2)) / 720.0
        way = h * (3.0 / 8.0 * b + b1 / 6.0 - b2 / 24.0 + rotation.cross(a, b) / 6.0)
        C = frames.dcm_ie(earth, t_s[k - 1])
        g_0 = C @ gravity_e(gravity, C.T @ r)
        r_next = r + v * h + rotation.quat_rotate(q, way)
        C = frames.dcm_ie(earth, t_s[k])
        g_1 = C @ gravity_e(gravity, C.T @ (r_next + 0.5 * h * h * g_0))
        r = r_next + (2.0 * g_0 + g_1) / 6.0 * h * h
        v = v + rotation.quat_rotate(q, gain) + 0.5 * h * (g_0 + g_1)
        q = rotation.quat_normalise(rotation.quat_multiply(q, rotation.quat_from_rotvec(turn)))
    return r, v, q


def test_increments_navigate_to_the_impact():
    trajectory, _ = flown()
    start = trajectory.r_i[0], trajectory.v_i[0], trajectory.q_ib[0]
    gravity = load_egm96(PARAMS.gravity_degree)
    r, v, q = strapdown(trajectory.t_s, trajectory.dtheta_b, trajectory.dv_b, *start, gravity, EARTH)
    assert np.linalg.norm(r - trajectory.r_i[-1]) < 0.1
    assert np.linalg.norm(v - trajectory.v_i[-1]) < 2e-3
    assert np.linalg.norm(rotation.rotvec_between(q, trajectory.q_ib[-1])) < 1e-6


def test_specific_force_of_the_coast_is_that_of_the_spin():
    trajectory, _ = flown()
    k = sample(148.0)  # constant spin, no thrust, no air to speak of
    omega = trajectory.omega_ib_b[k]
    # the centre of mass is on the roll axis; only the part of the lever arm across it matters
    lever = np.array([0.0, -PARAMS.imu_b[1], -PARAMS.imu_b[2]])
    assert np.allclose(trajectory.f_b[k], -np.cross(omega, np.cross(omega, lever)), atol=1e-4)
    # while pointing: the small angular acceleration times the lever arm, and drag at 171 km
    k = sample(300.0)
    alpha = (trajectory.omega_ib_b[k + 1] - trajectory.omega_ib_b[k - 1]) * PARAMS.sample_rate_hz / 2.0
    dry = combine([PARAMS.payload, PARAMS.stage_2.dry])
    lever[0] = -dry.station_m - PARAMS.imu_b[0]
    assert np.allclose(trajectory.f_b[k], -np.cross(alpha, lever), atol=1e-4)


def test_spin_and_angle_of_attack():
    trajectory, events = flown()
    spin = trajectory.omega_ib_b[sample(events["burn_out_1"].t_s + 1.0), 0] / (2.0 * np.pi)
    assert spin == pytest.approx(1.5, abs=0.05)
    for t_s, limit in ((5.0, 2.0), (20.0, 0.2), (50.0, 0.2), (400.0, 3.0), (430.0, 3.0), (455.0, 1.0)):
        k = sample(t_s)
        air = trajectory.v_i[k] - np.cross(frames.omega_ie_i(EARTH), trajectory.r_i[k])
        cosine = rotation.dcm_from_quat(trajectory.q_ib[k])[:, 0] @ air / np.linalg.norm(air)
        assert np.degrees(np.arccos(cosine)) < limit


def boresight_angles(trajectory, seconds):
    """Smallest angles of the boresight to the Sun and above the Earth's limb, degrees."""
    sun, limb = [], []
    for t_s in seconds:
        k = int(np.searchsorted(trajectory.t_s, t_s - 1e-6))
        boresight_i = rotation.dcm_from_quat(trajectory.q_ib[k]) @ PARAMS.C_bc[:, 2]
        C_ei = frames.dcm_ie(EARTH, trajectory.t_s[k]).T
        sun.append(np.arccos(boresight_i @ SUN_I))
        limb.append(wgs84.limb_angle(C_ei @ trajectory.r_i[k], C_ei @ boresight_i))
    return np.degrees(min(sun)), np.degrees(min(limb))


@pytest.mark.parametrize("turn_deg", [None, 0.0, 90.0, 180.0, 270.0])
def test_star_camera_sees_free_sky(turn_deg):
    # exclusion: 90 deg to the Sun, 45 deg to the limb; 10 deg in hand, with the boresight 5 deg off as well
    program = PROGRAM
    if turn_deg is not None:
        up, side = 5.0 * DEG * np.cos(turn_deg * DEG), 5.0 * DEG * np.sin(turn_deg * DEG)
        program = program._replace(
            boresight_elevation=program.boresight_elevation + up,
            boresight_azimuth=program.boresight_azimuth + side / np.cos(program.boresight_elevation),
        )
    trajectory, _ = fly(PARAMS._replace(program=program, sample_rate_hz=100.0), EARTH)
    window = np.arange(PROGRAM.pointing_start_s, PROGRAM.pointing_end_s + 0.1, 2.0)
    sun, limb = boresight_angles(trajectory, window)
    assert sun > 100.0
    assert limb > 55.0


def test_boresight_points_where_it_was_told():
    trajectory, _ = flown()
    k = sample(PROGRAM.pointing_start_s)
    C_ei = frames.dcm_ie(EARTH, trajectory.t_s[k]).T
    latitude, longitude, _ = wgs84.geodetic_from_ecef(C_ei @ trajectory.r_i[k])
    u_n = (
        wgs84.dcm_en(latitude, longitude).T
        @ C_ei
        @ rotation.dcm_from_quat(trajectory.q_ib[k])
        @ PARAMS.C_bc[:, 2]
    )
    assert np.arctan2(u_n[1], u_n[0]) == pytest.approx(PROGRAM.boresight_azimuth, abs=1e-5)
    assert np.arcsin(-u_n[2]) == pytest.approx(PROGRAM.boresight_elevation, abs=1e-5)


def test_second_stage_burns_in_the_attitude_it_was_told():
    trajectory, _ = flown()
    k = sample(PROGRAM.ignition_2_s)
    C_ei = frames.dcm_ie(EARTH, trajectory.t_s[k]).T
    latitude, longitude, _ = wgs84.geodetic_from_ecef(C_ei @ trajectory.r_i[k])
    x_n = wgs84.dcm_en(latitude, longitude).T @ C_ei @ rotation.dcm_from_quat(trajectory.q_ib[k])[:, 0]
    assert np.arcsin(-x_n[2]) == pytest.approx(PROGRAM.burn_elevation, abs=1e-4)
    assert np.arctan2(x_n[1], x_n[0]) % (2.0 * np.pi) == pytest.approx(PROGRAM.burn_azimuth, abs=1e-4)


def test_flight_repeats_to_the_last_bit():
    trajectory, _ = flown()
    again, _ = fly(PARAMS, EARTH)
    for first, second in zip(trajectory, again, strict=True):
        assert np.array_equal(first, second)


def test_mistakes_are_refused():
    late = PROGRAM._replace(ignition_2_s=PROGRAM.precession_start_s)
    with pytest.raises(ValueError, match="ignition_2_s"):
        fly(PARAMS._replace(program=late), EARTH)
    with pytest.raises(ValueError, match="residual_ramp_s"):
        fly(PARAMS._replace(program=PROGRAM._replace(residual_ramp_s=100.0)), EARTH)
    with pytest.raises(FlightError, match="in the air"):
        fly(PARAMS._replace(time_limit_s=420.0, sample_rate_hz=100.0), EARTH)
    heavy = PARAMS._replace(payload=PARAMS.payload._replace(mass_kg=30e3), sample_rate_hz=100.0)
    with pytest.raises(FlightError, match="on the rail"):
        fly(heavy, EARTH)
