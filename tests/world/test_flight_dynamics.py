"""Equations of motion: against a slow reference and against analytic solutions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shefex2 import EARTH, PARAMS, STACK

from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.gravity import J2_WGS84, from_normalised, gravity_e, load_egm96
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.world.flight import attitude_program as attitude
from shefex_nav.world.flight import dynamics, fly, surroundings, vehicle

NO_GRAVITY = from_normalised(0.0, 6.4e6, np.ones((1, 1)), np.zeros((1, 1)))
POINT_MASS = load_egm96(0)
RAIL = surroundings.Rail(np.zeros(3), np.array([1.0, 0.0, 0.0]), 1e9)
IDLE = attitude.hold(0.0, 1.0, 0.0)
FAR = np.array([8.0e6, 0.0, 0.0])  # m, above the atmosphere
BODY = vehicle.Part(500.0, 3.0, 60.0, 900.0)
IMU = np.array([-2.0, 0.1, -0.05])


def inert(imu=IMU):
    return vehicle.configure([BODY], None, 0.0, imu, STACK)


def state(r_i, v_i, omega_b, q_ib=(1.0, 0.0, 0.0, 0.0)):
    return np.concatenate([r_i, v_i, q_ib, omega_b, np.zeros(6)])


def propagate(x, t_end, dt, configuration, gravity=NO_GRAVITY, mode=dynamics.FREE, law=IDLE, earth=EARTH):
    """Integrate a copy of x from 0; state at the end and the rows of all samples before it."""
    rows = np.zeros((round(t_end / dt) + 1, dynamics.ROW))
    world, x = surroundings.World(gravity, earth, RAIL), x.copy()
    dynamics.integrate(x, 0.0, t_end, 0, 0.0, dt, mode, law, configuration, world, rows)
    return x, rows[:-1]


def slow_derivative(t_s, x, mode, c, gravity, earth):
    """The same equations with whole vectors; returns rates of v, omega and f_b."""
    C_ib, C_ie = rotation.dcm_from_quat(x[6:10]), frames.dcm_ie(earth, t_s)
    omega, omega_e = x[10:13], frames.omega_ie_i(earth)
    r_e = C_ie.T @ x[0:3]
    g_i = C_ie @ gravity_e(gravity, r_e)
    density, pressure, _, sound = us76(wgs84.geodetic_from_ecef(r_e)[2])
    vacuum, left = vehicle.thrust(c, t_s)
    inner2 = c.grain_outer2 - (c.grain_outer2 - c.grain_inner2) * left / c.grain_mass
    grain = vehicle.Part(
        left,
        c.grain_station,
        left * (c.grain_outer2 + inner2) / 2.0,
        left * (c.grain_outer2 + inner2) / 4.0 + left * c.grain_length**2 / 12.0,
    )
    body = vehicle.combine([vehicle.Part(c.rigid_mass, c.rigid_station, c.rigid_roll, c.rigid_pitch), grain])
    inertia = np.diag([body.inertia_roll, body.inertia_pitch, body.inertia_pitch])
    cg = np.array([-body.station_m, 0.0, 0.0])
    lever = cg - c.imu
    relative = omega - C_ib.T @ omega_e
    air = C_ib.T @ (x[3:6] - np.cross(omega_e, x[0:3])) + np.cross(relative, lever)
    speed = np.linalg.norm(air)
    ca, cn, x_cp, cmq, clp, clc = (np.interp(speed / sound, c.aero[:, 0], c.aero[:, j]) for j in range(1, 7))
    qs = 0.5 * density * speed**2 * c.area
    cosine, across = air[0] / speed, np.array([0.0, air[1], air[2]]) / speed
    force = -qs * cn * across - np.array([qs * ca * cosine * abs(cosine), 0.0, 0.0])
    moment = np.cross(np.array([-x_cp, 0.0, 0.0]) - cg, force)
    moment += qs * c.diameter**2 / (2.0 * speed) * np.array([clp, cmq, cmq]) * relative
    moment[0] += qs * c.diameter * clc * c.fin_cant
    flow = vacuum / c.exhaust_speed
    exit_b, grain_b = np.array([-c.exit_station, 0.0, 0.0]) - cg, np.array([-c.grain_station, 0.0, 0.0]) - cg
    if vacuum > 0.0:
        force[0] += max(0.0, vacuum - c.exit_area * pressure)
        force += -2.0 * flow * np.cross(omega, exit_b - grain_b)
        shell = np.diag([0.0, 1.0, 1.0]) * (inner2 / 2.0 + c.grain_length**2 / 12.0)
        turn = np.diag([0.0, 1.0, 1.0]) @ omega
        moment -= flow * (exit_b @ exit_b - grain_b @ grain_b) * turn - flow * shell @ turn
    if mode == dynamics.ON_RAIL:
        u_i = C_ib[:, 0]
        centripetal = np.cross(omega_e, np.cross(omega_e, x[0:3]))
        v_rel = x[3:6] - np.cross(omega_e, x[0:3])
        along = force[0] / body.mass_kg + u_i @ (g_i - centripetal)
        a_i = u_i * along + 2.0 * np.cross(omega_e, u_i * (u_i @ v_rel)) + centripetal
        return a_i, np.zeros(3), C_ib.T @ (a_i - g_i)
    alpha = np.linalg.solve(inertia, moment - np.cross(omega, inertia @ omega))
    g_cg = C_ie @ gravity_e(gravity, C_ie.T @ (x[0:3] + C_ib @ lever))
    a_cg = C_ib @ force / body.mass_kg + g_cg
    a_i = a_cg - C_ib @ (np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever)))
    return a_i, alpha, C_ib.T @ (a_i - g_i)


@pytest.mark.parametrize("mode", [dynamics.FREE, dynamics.ON_RAIL])
@pytest.mark.parametrize("t_s", [0.1, 5.0, 30.0, 54.0, 80.0])
def test_derivative_against_whole_vectors(mode, t_s):
    rng = np.random.default_rng(int(10 * t_s))
    stage = PARAMS.stage_1
    c = vehicle.configure([PARAMS.payload, stage.dry], stage, 0.0, IMU, STACK)
    # an Earth with all of its angles, so that no rotation can be mistaken for another
    C_iq, C_re = (Rotation.from_rotvec(rng.normal(size=3) * s).as_matrix() for s in (1e-3, 1e-6))
    earth = EarthRotation(np.ascontiguousarray(C_iq), np.ascontiguousarray(C_re), 1.234, wgs84.OMEGA)
    gravity = load_egm96(4)
    world = surroundings.World(gravity, earth, RAIL)
    for height in (100.0, 12e3, 60e3):
        r_e = wgs84.ecef_from_geodetic(rng.uniform(-1.5, 1.5), rng.uniform(-3, 3), height)
        r_i, v_i = frames.inertial_from_ecef(earth, t_s, r_e, rng.normal(size=3) * 500.0)
        q = rng.normal(size=4)
        q /= np.linalg.norm(q)
        x = state(r_i, v_i, rng.normal(size=3), q)
        if mode == dynamics.ON_RAIL:
            along = rotation.quat_rotate(q, np.array([1.0, 0.0, 0.0]))
            x[3:6] = np.cross(frames.omega_ie_i(earth), r_i) + 20.0 * along
        rate, aux = np.empty(dynamics.STATE), np.empty(dynamics.AUX)
        fine = surroundings.fine_gravity_i(world, t_s, *r_i, np.empty(3))
        dynamics.derivative(t_s, x, mode, IDLE, c, world, fine, np.empty((4, 3)), rate, aux)
        a_i, alpha, f_b = slow_derivative(t_s, x, mode, c, gravity, earth)
        # the gradient of gravitation is that of a point mass in the kernel
        assert np.allclose(rate[3:6], a_i, rtol=1e-12, atol=2e-7)
        assert np.allclose(rate[10:13], alpha, rtol=1e-11, atol=1e-11)
        assert np.allclose(rate[16:19], f_b, rtol=1e-12, atol=2e-7)
        assert np.allclose(aux[:3], rate[16:19], rtol=0, atol=0)
        q_rate = rotation.quat_multiply(q, np.concatenate([[0.0], x[10:13]])) / 2.0
        assert np.allclose(rate[6:10], q_rate, atol=1e-15)


def test_symmetric_top():
    # torque-free: the transverse rate turns in the body at (I_x/I_t - 1) p, angular momentum stays
    omega = np.array([2.0 * np.pi * 1.5, 0.4, 0.0])
    t_end = 60.0
    x, rows = propagate(state(FAR, np.zeros(3), omega), t_end, 2.5e-3, inert())
    turn = (BODY.inertia_roll / BODY.inertia_pitch - 1.0) * omega[0] * t_end
    assert np.allclose(x[10:13], [omega[0], 0.4 * np.cos(turn), 0.4 * np.sin(turn)], atol=1e-6)
    inertia = np.array([BODY.inertia_roll, BODY.inertia_pitch, BODY.inertia_pitch])
    momentum = np.array([rotation.quat_rotate(row[6:10], inertia * row[10:13]) for row in rows[::400]])
    assert np.abs(momentum - momentum[0]).max() < 1e-6 * np.linalg.norm(momentum[0])
    energy = (inertia * rows[:, 10:13] ** 2).sum(axis=1)
    assert np.ptp(energy) < 2e-9 * energy[0]
    # analytic attitude: nutation about the momentum, then spin about the body axis
    h_hat = momentum[0] / np.linalg.norm(momentum[0])
    precession = np.linalg.norm(momentum[0]) / BODY.inertia_pitch * t_end
    own = (1.0 - BODY.inertia_roll / BODY.inertia_pitch) * omega[0] * t_end
    expected = Rotation.from_rotvec(h_hat * precession) * Rotation.from_rotvec([own, 0.0, 0.0])
    error = (expected.inv() * Rotation.from_quat(rotation.xyzw(x[6:10]))).magnitude()
    assert error < 2e-6


def test_centre_of_mass_keeps_to_its_line_while_the_imu_swings_round_it():
    omega = np.array([3.0, 0.5, -0.2])
    velocity = np.array([10.0, -20.0, 5.0])
    lever = np.array([-BODY.station_m, 0.0, 0.0]) - IMU
    x0 = state(FAR, velocity, omega)
    x, _ = propagate(x0, 20.0, 2.5e-3, inert())
    cg_0, cg_1 = (s[0:3] + rotation.quat_rotate(s[6:10], lever) for s in (x0, x))
    v_0 = velocity + np.cross(omega, lever)
    assert np.allclose(cg_1, cg_0 + 20.0 * v_0, atol=2e-7)
    assert np.linalg.norm(x[0:3] - FAR - 20.0 * velocity) > 1.0  # the IMU does not


def test_order_of_the_integration():
    omega = np.array([9.0, 0.5, 0.0])
    x0 = state(FAR, np.zeros(3), omega)
    exact, _ = propagate(x0, 2.0, 1e-3, inert())
    steps = np.array([0.04, 0.02, 0.01])
    errors = [np.linalg.norm(propagate(x0, 2.0, h, inert())[0][:13] - exact[:13]) for h in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 3.8 < order < 5.2


def test_rocket_equation():
    stage = PARAMS.stage_2
    configuration = vehicle.configure([BODY, stage.dry], stage, 1.0, IMU, STACK)
    x, rows = propagate(state(FAR, np.zeros(3), np.zeros(3)), 70.0, 2.5e-3, configuration)
    dry = BODY.mass_kg + stage.dry.mass_kg
    gain = stage.isp_vacuum_s * 9.80665 * np.log((dry + stage.propellant_mass_kg) / dry)
    assert x[3] == pytest.approx(gain, rel=1e-9)
    assert np.allclose(x[4:6], 0.0, atol=1e-9)
    assert rows[-1, dynamics.STATE + 3] == pytest.approx(dry, rel=1e-12)
    flow = np.trapezoid([vehicle.thrust(configuration, t)[0] for t in np.arange(0.0, 70.0, 0.01)], dx=0.01)
    assert flow / configuration.exhaust_speed == pytest.approx(stage.propellant_mass_kg, rel=1e-6)


def test_energy_and_angular_momentum_in_a_point_mass_field():
    # the centre of mass in the IMU: pure orbit
    configuration = inert(imu=np.array([-BODY.station_m, 0.0, 0.0]))
    x0 = state(np.array([7.5e6, 1e5, 0.0]), np.array([200.0, 7000.0, 1500.0]), np.array([9.0, 0.1, 0.0]))
    x, _ = propagate(x0, 300.0, 2.5e-3, configuration, gravity=POINT_MASS)

    def invariants(s):
        r, v = s[0:3], s[3:6]
        return np.append(np.cross(r, v), v @ v / 2.0 - POINT_MASS.gm / np.linalg.norm(r))

    assert np.allclose(invariants(x), invariants(x0), rtol=1e-11)
    assert np.allclose(x[16:19], 0.0, atol=1e-12)  # in free fall an accelerometer reads nothing


def test_sphere_dropped_from_30000_feet():
    # NASA/TM-2015-218675, check case 1: no drag, J2, from rest over the equator; altitude after 30 s
    foot = 0.3048  # m
    zonal = np.zeros((3, 3))
    zonal[0, 0], zonal[2, 0] = 1.0, -J2_WGS84 / np.sqrt(5.0)
    gravity = from_normalised(wgs84.GM, wgs84.A, zonal, np.zeros((3, 3)))
    earth = EarthRotation(np.eye(3), np.eye(3), 0.0, wgs84.OMEGA)
    smooth = STACK._replace(area_m2=0.0)
    at_cg = vehicle.configure([BODY], None, 0.0, np.array([-BODY.station_m, 0.0, 0.0]), smooth)
    start = wgs84.ecef_from_geodetic(0.0, 0.0, 30000.0 * foot)
    r_i, v_i = frames.inertial_from_ecef(earth, 0.0, start, np.zeros(3))
    x, _ = propagate(state(r_i, v_i, np.zeros(3)), 30.0, 0.01, at_cg, gravity=gravity, earth=earth)
    fallen, _ = surroundings.free_fall(surroundings.World(gravity, earth, RAIL), 0.0, r_i, v_i, 30.0)
    for r in (x[0:3], fallen):
        _, longitude, height = wgs84.geodetic_from_ecef(frames.dcm_ie(earth, 30.0).T @ r)
        assert height / foot == pytest.approx(15598.90435228, abs=1e-6)
        assert np.degrees(longitude) == pytest.approx(5.74552213e-5, abs=1e-12)


def test_increments_are_the_integrals():
    omega = np.array([9.0, 0.5, 0.0])
    x0 = state(FAR, np.zeros(3), omega)
    _, coarse = propagate(x0, 1.0, 2.5e-3, inert())
    _, fine = propagate(x0, 1.0, 1.25e-4, inert())
    for columns in (slice(13, 16), slice(16, 19)):
        summed = fine[1:-19, columns].reshape(-1, 20, 3).sum(axis=1)
        assert np.allclose(coarse[1 : len(summed) + 1, columns], summed, atol=1e-10)


def test_aerodynamics_points_the_nose_into_the_wind():
    configuration = vehicle.configure([PARAMS.payload], None, 0.0, IMU, STACK)
    world = surroundings.World(POINT_MASS, EarthRotation(np.eye(3), np.eye(3), 0.0, 0.0), RAIL)
    r_i = np.array([6378137.0 + 5e3, 0.0, 0.0])
    for v_i, moment_axis, sign in (
        ([500.0, 0.0, 20.0], 1, -1.0),  # air from below: nose down, towards +z, is a negative pitch
        ([500.0, 20.0, 0.0], 2, 1.0),
    ):
        rate, aux = np.empty(dynamics.STATE), np.empty(dynamics.AUX)
        x = state(r_i, np.array(v_i), np.zeros(3))
        work, fine = np.empty((4, 3)), (0.0, 0.0, 0.0)
        dynamics.derivative(0.0, x, dynamics.FREE, IDLE, configuration, world, fine, work, rate, aux)
        assert sign * rate[10 + moment_axis] > 0.0
        assert rate[10] > 0.0  # canted fins spin it up
        x[10] = 500.0  # rad/s: damped
        dynamics.derivative(0.0, x, dynamics.FREE, IDLE, configuration, world, fine, work, rate, aux)
        assert rate[10] < 0.0


def test_mass_properties_of_a_stage():
    stage = PARAMS.stage_1
    configuration = vehicle.configure([BODY, stage.dry], stage, 0.0, IMU, STACK)
    for left in (0.0, 1000.0, stage.propellant_mass_kg):
        expected = vehicle.combine([BODY, stage.dry, vehicle.grain(stage, left)])
        got = vehicle.mass_properties(configuration, left)
        assert np.allclose(got[:4], expected, rtol=1e-13)
    # slope of the grain's own pitch inertia, for the jet damping
    own = [vehicle.grain(stage, 1000.0 + d).inertia_pitch for d in (-1.0, 1.0)]
    assert vehicle.mass_properties(configuration, 1000.0)[4] == pytest.approx(
        (own[1] - own[0]) / 2.0, rel=1e-6
    )


def test_jet_damping_takes_the_momentum_that_the_gas_carries_away():
    # transverse spin in vacuum: d(I omega)/dt = -flow x_e^2 omega, distances from the centre of mass
    stage = PARAMS.stage_2
    configuration = vehicle.configure([BODY, stage.dry], stage, 0.0, IMU, STACK)
    x0 = state(FAR, np.zeros(3), np.array([0.0, 0.05, 0.0]))
    _, rows = propagate(x0, 30.0, 2.5e-3, configuration)
    t = np.arange(len(rows)) * 2.5e-3
    inertia, loss = np.empty(len(t)), np.empty(len(t))
    for j, t_s in enumerate(t):
        force, left = vehicle.thrust(configuration, t_s)
        _, station, _, inertia[j], _ = vehicle.mass_properties(configuration, left)
        flow = force / configuration.exhaust_speed
        loss[j] = flow * (configuration.exit_station - station) ** 2 * rows[j, 11]
    momentum = inertia * rows[:, 11]
    lost = np.concatenate([[0.0], np.cumsum((loss[1:] + loss[:-1]) / 2.0) * 2.5e-3])
    assert np.allclose(momentum, momentum[0] - lost, rtol=1e-6)
    assert lost[-1] > 0.05 * momentum[0]


def test_impossible_stage_is_refused():
    with pytest.raises(ValueError, match="tail-off"):
        vehicle.thrust_history(PARAMS.stage_1._replace(tail_off_s=60.0), 0.0)


def test_unordered_table_is_refused():
    with pytest.raises(ValueError, match="Mach"):
        vehicle.configure([BODY], None, 0.0, IMU, STACK._replace(mach=STACK.mach[::-1]))


def test_all_sections_use_one_compiled_kernel():
    # one signature: a second one would double the compile time
    fly.fly(PARAMS._replace(sample_rate_hz=50.0, t_start_s=-1.0), EARTH)
    assert len(dynamics.integrate.signatures) == 1
