"""The reconstructed SHEFEX-2 flight: what is publicly known of it, and the consistency of the truth.

Flown by cold gas where nothing else is said, with a perfect attitude reference, and as prescribed.
"""

from dataclasses import replace

import numpy as np
import pytest
from shefex2 import COLD_GAS, DEG, EARTH, PARAMS, PRESCRIBED, PROGRAMME, S44, SITE, flown, prescribed

from shefex_nav.compiled import kernel
from shefex_nav.environment.gravity import gravity_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Phase
from shefex_nav.world.flight import devices
from shefex_nav.world.flight.fly import fly
from shefex_nav.world.flight.vehicle import combine

SUN_I = np.array(
    [np.cos(23.4 * DEG) * np.cos(91.7 * DEG), np.cos(23.4 * DEG) * np.sin(91.7 * DEG), np.sin(23.4 * DEG)]
)
TASKS = dict(PROGRAMME)
BOTH = pytest.mark.parametrize("how", [flown, prescribed])


def sample(t_s):
    return round((t_s - PARAMS.t_start_s) * PARAMS.sample_rate_hz)


def speeds(trajectory, step):
    relative = trajectory.v_i[::step] - np.cross(frames.omega_ie_i(EARTH), trajectory.r_i[::step])
    return np.linalg.norm(relative, axis=1)


def level(trajectory, t_s, direction_b):
    """Azimuth and elevation of a body direction (3,) in the local level frame below the vehicle, rad."""
    k = int(np.searchsorted(trajectory.t_s, t_s - 1e-6))
    C_ei = frames.dcm_ie(EARTH, trajectory.t_s[k]).T
    latitude, longitude, _ = wgs84.geodetic_from_ecef(C_ei @ trajectory.r_i[k])
    u_n = (
        wgs84.dcm_en(latitude, longitude).T @ C_ei @ rotation.dcm_from_quat(trajectory.q_ib[k]) @ direction_b
    )
    return np.arctan2(u_n[1], u_n[0]) % (2.0 * np.pi), np.arcsin(-u_n[2])


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


@BOTH
def test_public_figures_of_the_flight(how):
    flight, events = how()
    trajectory = flight.trajectory
    assert events["apogee"].altitude_m == pytest.approx(177e3, abs=0.5e3)
    r_e, _ = frames.ecef_from_inertial(EARTH, trajectory.t_s[-1], trajectory.r_i[-1], trajectory.v_i[-1])
    latitude, longitude, height = wgs84.geodetic_from_ecef(r_e)
    assert 0.0 <= height < 1.0
    assert distance(SITE.latitude, SITE.longitude, latitude, longitude) == pytest.approx(800e3, abs=3e3)
    assert np.degrees(latitude) == pytest.approx(76.4, abs=0.1)  # west of Spitsbergen
    entry = trajectory.mach[sample(events["entry"].t_s)]
    assert 10.0 < entry < 11.0
    assert 55.0 < events["altitude_20km"].t_s - events["entry"].t_s < 60.0
    assert speeds(trajectory, 40).max() == pytest.approx(3056.0, abs=5.0)


def test_events_are_in_order():
    tasks = [f"{name}_{end}" for name in TASKS for end in ("start", "end")]
    names = [
        "lift_off", "rail_exit", "burn_out_1", "separation_1", *tasks[:4], "ignition_2", "burn_out_2",
        "yo_yo_release", "yo_yo_off", *tasks[4:], "spin_motors", "apogee", "entry", "altitude_60km",
        "altitude_20km", "max_dynamic_pressure", "impact",
    ]  # fmt: skip
    flight, events = flown()
    assert set(events) == set(names) and len(flight.events) == len(names)
    assert np.all(np.diff([event.t_s for event in flight.events]) >= 0.0)
    trajectory = flight.trajectory
    assert trajectory.t_s[-1] <= events["impact"].t_s < trajectory.t_s[-1] + 1.0 / PARAMS.sample_rate_hz
    assert events["impact"].altitude_m < 1.0
    # the yo-yo does nothing where the attitude happens as told, the spin motors come after that
    assert set(prescribed()[1]) == set(names) - {"yo_yo_release", "yo_yo_off"}


@BOTH
def test_phases_and_burning_stages(how):
    flight, _ = how()
    t = flight.trajectory
    expected = [
        (-5.0, Phase.PAD, 0), (0.0, Phase.BOOST, 1), (30.0, Phase.BOOST, 1), (56.0, Phase.COAST, 0),
        (65.0, Phase.MANOEUVRE, 0), (144.9, Phase.MANOEUVRE, 0), (147.0, Phase.COAST, 0),
        (149.2, Phase.BOOST, 2), (217.1, Phase.BOOST, 2), (217.3, Phase.COAST, 0),
        (230.0, Phase.MANOEUVRE, 0),
        (250.0, Phase.POINTING, 0), (371.9, Phase.POINTING, 0), (372.0, Phase.MANOEUVRE, 0),
        (384.0, Phase.DESCENT, 0), (480.0, Phase.DESCENT, 0),
    ]  # fmt: skip
    for t_s, phase, burning in expected:
        assert (t.phase[sample(t_s)], t.burning[sample(t_s)]) == (phase, burning), t_s
    thrusting = t.thrust_n > 0.0
    assert np.array_equal(thrusting, (t.burning > 0) & thrusting)
    assert thrusting[t.burning > 0].mean() > 0.99  # all but the first and the last instant


def test_at_rest_on_the_pad():
    trajectory = flown()[0].trajectory
    last = sample(0.0)
    C_eb = None
    for k in (0, 1234, last - 1):
        r_e, v_e = frames.ecef_from_inertial(EARTH, trajectory.t_s[k], trajectory.r_i[k], trajectory.v_i[k])
        assert np.allclose(
            r_e, wgs84.ecef_from_geodetic(SITE.latitude, SITE.longitude, SITE.height), atol=1e-8
        )
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
    assert np.all(trajectory.mass_kg[:last] == 6721.5) and np.all(trajectory.angle_of_attack[:last] == 0.0)
    nose_l = wgs84.dcm_el(SITE.latitude, SITE.longitude).T @ C_eb[:, 0]
    assert np.arcsin(nose_l[2]) == pytest.approx(SITE.elevation, abs=1e-9)
    assert np.arctan2(nose_l[0], nose_l[1]) % (2.0 * np.pi) == pytest.approx(SITE.azimuth, abs=1e-9)


@BOTH
def test_nothing_jumps_at_staging(how):
    flight, _ = how()
    trajectory, dt = flight.trajectory, 1.0 / PARAMS.sample_rate_hz
    moments = [
        e.t_s for e in flight.events if e.name.startswith("separation") or e.name[-4:] in ("tart", "_end")
    ]
    moments += [219.0, 384.0, 386.0]  # devices
    for t_s in moments:
        k = sample(t_s)
        around = slice(k - 2, k + 4)
        step = np.diff(trajectory.r_i[around], axis=0) - trajectory.v_i[around][:-1] * dt
        assert np.abs(step).max() < 20.0 * dt**2  # m: what 4 g do in a sample
        assert np.abs(np.diff(trajectory.v_i[around], axis=0)).max() < 40.0 * dt
        # rad/s: gas across 0.04 rad/s^2, about the roll axis the spin motors 3.2 and the yo-yo up to 10
        assert np.abs(np.diff(trajectory.omega_ib_b[around, 1:], axis=0)).max() < 0.2 * dt
        assert np.abs(np.diff(trajectory.omega_ib_b[around, 0])).max() < 10.0 * dt
        turned = rotation.rotvec_between(trajectory.q_ib[k - 2 : k + 3], trajectory.q_ib[k - 1 : k + 4])
        assert np.abs(turned - trajectory.dtheta_b[k - 1 : k + 4]).max() < 1e-7


@kernel
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


@BOTH
def test_increments_navigate_to_the_impact(how):
    trajectory = how()[0].trajectory
    start = trajectory.r_i[0], trajectory.v_i[0], trajectory.q_ib[0]
    r, v, q = strapdown(trajectory.t_s, trajectory.dtheta_b, trajectory.dv_b, *start, PARAMS.gravity, EARTH)
    assert np.linalg.norm(r - trajectory.r_i[-1]) < 0.1
    assert np.linalg.norm(v - trajectory.v_i[-1]) < 2e-3
    assert np.linalg.norm(rotation.rotvec_between(q, trajectory.q_ib[-1])) < 1e-5


def test_specific_force_of_the_coast_is_that_of_the_spin():
    trajectory = prescribed()[0].trajectory
    k = sample(148.0)  # constant spin, no thrust, no air to speak of
    omega = trajectory.omega_ib_b[k]
    # the centre of mass is on the roll axis; only the part of the lever arm across it matters
    lever = np.array([0.0, -PARAMS.imu_b[1], -PARAMS.imu_b[2]])
    assert np.allclose(trajectory.f_b[k], -np.cross(omega, np.cross(omega, lever)), atol=1e-4)
    # while the camera points nothing but the gradient of gravitation and a trace of air is felt
    assert np.abs(trajectory.f_b[sample(300.0)]).max() < 1e-4
    # a valve of the cold gas opens: a couple, felt as angular acceleration times lever arm
    flight, _ = flown()
    trajectory, history = flight.trajectory, flight.control
    fired = np.flatnonzero((history.torque_b[:, 1] != 0.0) & (history.t_s > 260.0) & (history.t_s < 371.0))
    assert len(fired) > 0
    dry = combine([PARAMS.payload, S44.dry])
    lever[0] = -dry.station - PARAMS.imu_b[0]
    for tick in fired:
        k = sample(history.t_s[tick]) + 3
        torque = history.torque_b[tick] / np.array([dry.inertia_roll, dry.inertia_pitch, dry.inertia_pitch])
        assert np.allclose(trajectory.f_b[k], -np.cross(torque, lever), atol=1e-4)


@BOTH
def test_spin_and_angle_of_attack(how):
    flight, events = how()
    trajectory = flight.trajectory
    spin = trajectory.omega_ib_b[sample(events["burn_out_1"].t_s + 1.0), 0] / (2.0 * np.pi)
    assert spin == pytest.approx(1.5, abs=0.05)
    for t_s, limit in ((5.0, 2.0), (20.0, 0.2), (50.0, 0.2), (400.0, 3.0), (430.0, 3.0), (455.0, 1.0)):
        k = sample(t_s)
        air = trajectory.v_i[k] - np.cross(frames.omega_ie_i(EARTH), trajectory.r_i[k])
        cosine = rotation.dcm_from_quat(trajectory.q_ib[k])[:, 0] @ air / np.linalg.norm(air)
        assert np.degrees(np.arccos(cosine)) < limit
        if t_s > 10.0:  # it counts for the centre of mass, this is the IMU; little of a difference at speed
            assert trajectory.angle_of_attack[k] == pytest.approx(np.arccos(cosine), abs=0.02 * DEG)


def test_yo_yo_and_spin_motors_change_the_spin_as_they_should():
    flight, events = flown()
    spin = flight.trajectory.omega_ib_b[:, 0]
    before, after = spin[sample(218.9)], spin[sample(221.0)]
    row = devices.yo_yo_row(PARAMS.yo_yo, before, 68.0)
    k, l2 = row[3] * PARAMS.yo_yo.radius**2, PARAMS.yo_yo.cord_length**2
    assert after == pytest.approx(before * (k - l2) / (k + l2), abs=1e-5)
    assert 0.0 < after < 5.0 * DEG  # the cold gas does the rest
    assert events["yo_yo_off"].t_s - 219.0 == pytest.approx(5.82 / (0.505 * before), rel=1e-5)
    gained = spin[sample(386.1)] - spin[sample(383.99)]
    assert gained == pytest.approx(213.6 * 2.0 / 68.0, rel=1e-4)  # about 1 Hz


def test_cold_gas_holds_what_was_wanted():
    flight, _ = flown()
    history = flight.control
    used = {}
    for name, transverse, roll in (
        ("precession", 0.4, None), ("despin", 0.4, None), ("slew", 1.5, 1.5), ("pointing", 0.5, 0.5),
        ("entry_slew", 1.0, 1.0),
    ):  # fmt: skip
        task = TASKS[name]
        during = (history.t_s > task.start - 1e-6) & (history.t_s < task.end - 1e-6)
        error = history.pointing_error[during]
        assert np.hypot(error[:, 1], error[:, 2]).max() < transverse * DEG, name
        if roll is None:
            assert np.isnan(error[:, 0]).all()  # the spin is left alone
        else:
            assert np.abs(error[:, 0]).max() < roll * DEG, name
        used[name] = np.ptp(history.propellant_kg[during])
    damping = history.t_s < 70.0 - 1e-6
    assert np.isnan(history.pointing_error[damping]).all()
    # the angular momentum of the spinning stack is turned by 64 degrees: 1670 N m s times 1.12 rad
    least = 177.5 * 9.41 * 1.12 / (2.0 * 68.0 * 9.80665)
    assert least < used["precession"] < 1.4 * least
    assert used["pointing"] < 0.05
    assert history.propellant_kg[-1] < 3.5
    assert np.all(np.diff(history.propellant_kg) >= 0.0)
    assert len(history.t_s) == round(sum(task.end - task.start for task in TASKS.values()) / COLD_GAS.period)
    # the camera works below 2 deg/s; valves rest nearly all of the time
    pointing = slice(sample(252.0), sample(372.0))
    assert np.linalg.norm(flight.trajectory.omega_ib_b[pointing], axis=1).max() < 0.3 * DEG
    still = (history.t_s > 252.0) & (history.t_s < 372.0)
    assert (history.torque_b[still] != 0.0).any(axis=1).mean() < 0.01


def test_pointing_error_is_that_of_the_trajectory():
    flight, _ = flown()
    history, trajectory = flight.control, flight.trajectory
    during = np.flatnonzero((history.t_s > 251.0) & (history.t_s < 371.0))
    first, last = during[0], during[-1]
    q_0, q_1 = (trajectory.q_ib[sample(history.t_s[j])] for j in (first, last))
    # the wanted attitude stands still: wanted = truth * exp(-error) is the same at both ends
    wanted = [
        rotation.quat_multiply(q, rotation.quat_from_rotvec(-history.pointing_error[j]))
        for q, j in ((q_0, first), (q_1, last))
    ]
    assert np.linalg.norm(rotation.rotvec_between(*wanted)) < 1e-6
    assert np.linalg.norm(rotation.rotvec_between(q_0, q_1)) > 0.01 * DEG


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


WINDOW = np.arange(250.0, 372.1, 2.0)


@pytest.mark.parametrize("turn_deg", [None, 0.0, 90.0, 180.0, 270.0])
def test_star_camera_sees_free_sky(turn_deg):
    # exclusion: 90 deg to the Sun, 45 deg to the limb; 10 deg in hand, with the boresight 5 deg off as well
    slew = TASKS["slew"]
    if turn_deg is not None:
        up, side = 5.0 * DEG * np.cos(turn_deg * DEG), 5.0 * DEG * np.sin(turn_deg * DEG)
        slew = replace(
            slew, elevation=slew.elevation + up, azimuth=slew.azimuth + side / np.cos(slew.elevation)
        )
    programme = tuple((TASKS | {"slew": slew}).items())
    flight = fly(PRESCRIBED._replace(programme=programme, sample_rate_hz=100.0), EARTH)
    sun, limb = boresight_angles(flight.trajectory, WINDOW)
    assert sun > 100.0
    assert limb > 55.0


@BOTH
def test_boresight_points_where_it_was_told(how):
    within = 1e-5 if how is prescribed else 0.5 * DEG
    azimuth, elevation = level(how()[0].trajectory, 250.0, PARAMS.C_bc[:, 2])
    assert elevation == pytest.approx(TASKS["slew"].elevation, abs=within)
    assert azimuth == pytest.approx(TASKS["slew"].azimuth, abs=within / np.cos(elevation))


@BOTH
def test_second_stage_burns_in_the_attitude_it_was_told(how):
    within = 1e-4 if how is prescribed else 0.4 * DEG
    azimuth, elevation = level(how()[0].trajectory, 149.2, np.array([1.0, 0.0, 0.0]))
    assert elevation == pytest.approx(TASKS["precession"].elevation, abs=within)
    assert azimuth == pytest.approx(TASKS["precession"].azimuth, abs=within / np.cos(elevation))


@pytest.mark.parametrize("seed", [2, 3])
def test_errors_of_the_attitude_reference_are_flown(seed):
    params = PARAMS._replace(sample_rate_hz=100.0)
    flight = fly(params, EARTH, np.random.default_rng(seed))
    history, events = flight.control, {event.name: event for event in flight.events}
    during = (history.t_s > 255.0) & (history.t_s < 371.0)
    error = np.linalg.norm(history.pointing_error[during].mean(axis=0))
    assert 0.6 * DEG < error < 8.0 * DEG  # 0.2 deg of misalignment, 20 ppm of 280 revolutions
    sun, limb = boresight_angles(flight.trajectory, WINDOW)
    assert sun > 100.0 and limb > 52.0
    assert events["apogee"].altitude_m == pytest.approx(177e3, abs=3e3)
    again = fly(params, EARTH, np.random.default_rng(seed))
    assert np.array_equal(flight.trajectory.q_ib, again.trajectory.q_ib)


@BOTH
def test_flight_repeats_to_the_last_bit(how):
    flight, _ = how()
    again = fly(PARAMS if how is flown else PRESCRIBED, EARTH)
    for first, second in zip(flight.trajectory, again.trajectory, strict=True):
        assert np.array_equal(first, second)
    assert flight.events == again.events


def test_columns_are_ready_for_kernels():
    trajectory = flown()[0].trajectory
    n = len(trajectory.t_s)
    for name, column in zip(trajectory._fields, trajectory, strict=True):
        assert len(column) == n and column.flags.c_contiguous, name
    assert trajectory.phase.dtype == np.int8 and trajectory.burning.dtype == np.int8
