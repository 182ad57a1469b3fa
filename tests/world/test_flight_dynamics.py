"""Equations of motion: against a slow reference with whole vectors, and in cases with a known answer."""

from dataclasses import astuple, replace

import numpy as np
import pytest
from flight_bench import (
    AT_CG,
    BODY,
    CALM,
    FAR,
    IDLE,
    IMU,
    RAIL,
    STANDARD,
    STILL,
    body,
    propagate,
    state,
    world,
)
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation
from shefex2 import PARAMS, S40, S44, STACK, part

from shefex_nav.environment import gravity as fields
from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.gravity import gravity_e, load
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.world.flight import aerodynamics, dynamics, fly, integrate, scene, surroundings, vehicle
from shefex_nav.world.flight.params import Air

LIFTING = STACK._replace(
    mach=np.array([0.0, 1.0, 6.0]),
    alpha=np.radians([0.0, 10.0, 40.0, 120.0, 180.0]),
    axial=np.array([[0.4, 0.4, 0.3, -0.2, -0.5], [0.8, 0.7, 0.5, -0.3, -0.9], [0.3, 0.3, 0.4, -0.4, -0.8]]),
    normal_slope=np.array([[9, 10, 12, 8, 7], [11, 12, 13, 9, 8], [5, 6, 7, 6, 5]], dtype=float),
    pressure_station_m=np.array([[9.6, 9.0, 8.0, 7.0, 6.5], [9.8, 9.1, 8.0, 7.0, 6.5], [8, 7.5, 7, 6.5, 6]]),
    drag=np.full((3, 5), 0.1),
    pitch_damping=np.array([-600.0, -700.0, -500.0]),
    roll_damping=np.array([-10.0, -11.0, -3.0]),
    roll_by_cant=np.array([6.0, 6.6, 2.0]),
)  # fmt: skip


def derivative(t_s, x, mode, configuration, around, torque=(0.0, 0.0, 0.0), law=IDLE):
    """(rate, aux) of the kernel, with all of the gravitation."""
    prepared = scene.prepare(configuration, around)
    s, tables = prepared.record[0], prepared.tables
    vehicle.choose_rows(s, tables, t_s)
    s["torque"] = torque
    fine = surroundings.fine_gravity_i(around.gravity, s, t_s, *x[0:3])
    rate, aux = np.full(dynamics.STATE, np.nan), np.empty(dynamics.AUX)
    dynamics.derivative(t_s, x, dynamics.Section(mode, law, s, tables), fine, rate, aux)
    return rate, aux


def slow_mass(c, t_s):
    """Thrust in vacuum, mass flow, mass, centre of mass, inertia tensor, slopes of the mass table."""
    inside = c.thrust[0, 0] <= t_s < c.thrust[-1, 0]
    force = np.interp(t_s, c.thrust[:, 0], c.thrust[:, 1]) if inside else 0.0
    grid = np.unique(np.concatenate([np.linspace(0.0, t_s, 20001), c.thrust[:, 0][c.thrust[:, 0] < t_s]]))
    curve = np.interp(grid, c.thrust[:, 0], c.thrust[:, 1], left=0.0, right=0.0)
    left = c.thrust[0, 2] - np.trapezoid(curve, grid) / c.exhaust_speed
    _, mass, station, i_x, i_y, i_z = (np.interp(left, c.mass[:, 0], column) for column in c.mass.T)
    j_xy, j_xz, j_yz = c.products
    inertia = np.array([[i_x, j_xy, j_xz], [j_xy, i_y, j_yz], [j_xz, j_yz, i_z]])
    k = min(max(np.searchsorted(c.mass[:, 0], left) - 1, 0), len(c.mass) - 2)
    slopes = (c.mass[k + 1] - c.mass[k]) / (c.mass[k + 1, 0] - c.mass[k, 0])
    burning = np.diff((c.mass[:, 1] * c.mass[:, 2])[k : k + 2])[0] / np.diff(c.mass[k : k + 2, 0])[0]
    return force, force / c.exhaust_speed, mass, np.array([-station, *c.offset]), inertia, slopes, burning


def slow_aerodynamics(aero, air, relative, density, sound, cg):
    """Force and moment about cg by interpolation of the parameters, not of the tables made of them."""
    speed = np.linalg.norm(air)
    mach, alpha = speed / sound, np.arctan2(np.hypot(air[1], air[2]), air[0])

    def at(grid):
        if len(aero.alpha) == 1:
            return np.interp(mach, aero.mach, grid[:, 0])
        limited = np.clip(mach, aero.mach[0], aero.mach[-1]), alpha
        return float(RegularGridInterpolator((aero.mach, aero.alpha), grid)(limited))

    qs = 0.5 * density * speed**2 * aero.area_m2
    by_angle = np.cos(alpha) * abs(np.cos(alpha)) if len(aero.alpha) == 1 else 1.0
    force = np.array([-qs * at(aero.axial) * by_angle, 0.0, 0.0]) - qs * at(aero.drag) * air / speed
    force -= qs * at(aero.normal_slope) * np.array([0.0, air[1], air[2]]) / speed
    # the moment coefficient is what is interpolated, about the mean centre of pressure
    middle = aero.pressure_station_m.mean()
    slope = at((aero.normal_slope + aero.drag) * (aero.pressure_station_m - middle))
    across = -qs * slope * np.array([0.0, air[1], air[2]]) / speed
    moment = np.cross([-middle, 0.0, 0.0] - cg, force) + np.cross([-1.0, 0.0, 0.0], across)
    rows = (aero.roll_damping, aero.pitch_damping, aero.pitch_damping)
    by_rate = np.array([np.interp(mach, aero.mach, row) for row in rows])
    moment += qs * aero.diameter_m**2 / (2.0 * speed) * by_rate * relative
    moment[0] += qs * aero.diameter_m * np.interp(mach, aero.mach, aero.roll_by_cant) * aero.fin_cant
    return force, moment, mach, alpha


def slow_derivative(t_s, x, mode, c, aero, around, torque):
    """The same equations with whole vectors; rates of v, omega and f_b, and what the air data are."""
    C_ib, C_ie = rotation.dcm_from_quat(x[6:10]), frames.dcm_ie(around.earth, t_s)
    omega, omega_e = x[10:13], frames.omega_ie_i(around.earth)
    r_e = C_ie.T @ x[0:3]
    g_i = C_ie @ gravity_e(around.gravity, r_e)
    latitude, longitude, height = wgs84.geodetic_from_ecef(r_e)
    density, pressure, _, sound = us76(height)
    density *= around.density_factor
    north, east = (np.interp(height, around.wind[:, 0], around.wind[:, k]) for k in (1, 2))
    wind_i = C_ie @ wgs84.dcm_en(latitude, longitude) @ [north, east, 0.0]
    vacuum, flow, mass, cg, inertia, slopes, burning = slow_mass(c, t_s)
    lever = cg - c.imu
    relative = omega - C_ib.T @ omega_e
    air = C_ib.T @ (x[3:6] - np.cross(omega_e, x[0:3]) - wind_i) + np.cross(relative, lever)
    force, moment, mach, alpha_t = slow_aerodynamics(aero, air, relative, density, sound, cg)
    if t_s >= c.parachute[0]:
        line = np.array([-c.parachute[3], 0.0, 0.0]) - cg
        pull = air + np.cross(relative, line)
        full = min(1.0, (t_s - c.parachute[0]) / c.parachute[1])
        pull = -0.5 * density * c.parachute[2] * full * np.linalg.norm(pull) * pull
        force, moment = force + pull, moment + np.cross(line, pull)
    push = max(0.0, vacuum - c.exit_area * pressure) if vacuum > 0.0 else 0.0
    exit_b = np.array([-c.exit_station, *c.thrust_offset]) - cg
    force = force + push * c.thrust_axis
    moment = moment + np.cross(exit_b, push * c.thrust_axis)
    way = np.array([burning - c.exit_station, 0.0, 0.0])  # of the gas
    force = force - 2.0 * flow * np.cross(omega, way)
    reach2 = (c.exit_station + cg[0]) ** 2
    moment = moment - flow * np.array([0.0, reach2 - slopes[4], reach2 - slopes[5]]) * omega
    for start, end, roll in c.spin_motors:
        moment[0] += roll * (start <= t_s < end)
    if c.yo_yo[0] <= t_s < c.yo_yo[1]:
        k, spin = c.yo_yo[3], c.yo_yo[2]
        s = spin * (t_s - c.yo_yo[0])
        moment[0] -= inertia[0, 0] * 4.0 * k * spin**2 * s / (k + s * s) ** 2
    air_data = [mass, mach, 0.5 * density * (air @ air), push, height, alpha_t]
    if mode == dynamics.ON_RAIL:
        u_i = C_ib[:, 0]
        centripetal = np.cross(omega_e, np.cross(omega_e, x[0:3]))
        v_rel = x[3:6] - np.cross(omega_e, x[0:3])
        along = force[0] / mass + u_i @ (g_i - centripetal)
        a_i = u_i * along + 2.0 * np.cross(omega_e, u_i * (u_i @ v_rel)) + centripetal
        return a_i, np.zeros(3), C_ib.T @ (a_i - g_i), air_data
    moment = moment + torque
    alpha = np.linalg.solve(inertia, moment - np.cross(omega, inertia @ omega))
    g_cg = C_ie @ gravity_e(around.gravity, C_ie.T @ (x[0:3] + C_ib @ lever))
    a_i = C_ib @ force / mass + g_cg
    a_i = a_i - C_ib @ (np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever)))
    return a_i, alpha, C_ib.T @ (a_i - g_i), air_data


def crooked(aero):
    """The first stage with everything that a vehicle can have, and nothing on the axis."""
    lit = S40._replace(
        motor=S40.motor._replace(
            nozzle=replace(S40.motor.nozzle, misalignment=(0.01, -0.02), offset=(0.03, 0.05))
        ),
        aerodynamics=aero,
    )
    return body(
        [PARAMS.payload, S40.dry], lit, aerodynamics=aero, offset=(0.02, -0.04), tilt=(0.03, 0.05),
        spin_motors=np.array([[4.0, 6.0, 500.0], [4.5, 5.5, -100.0]]),
        yo_yo=np.array([29.0, 31.0, 2.0, 40.0]), parachute=np.array([79.0, 4.0, 30.0, 1.0, 0.0]),
    )  # fmt: skip


@pytest.mark.parametrize("mode", [dynamics.FREE, dynamics.ON_RAIL, dynamics.CONTROLLED])
@pytest.mark.parametrize("aero", [STACK, LIFTING], ids=["straight", "lifting"])
@pytest.mark.parametrize("t_s", [0.1, 5.0, 30.0, 54.0, 80.0, 90.0])
def test_derivative_against_whole_vectors(mode, aero, t_s):
    rng = np.random.default_rng(int(10 * t_s))
    c = crooked(aero)
    torque = np.array([3.0, -40.0, 50.0]) if mode == dynamics.CONTROLLED else np.zeros(3)
    # an Earth with all of its angles, so that no rotation can be mistaken for another
    C_iq, C_re = (Rotation.from_rotvec(rng.normal(size=3) * s).as_matrix() for s in (1e-3, 1e-6))
    earth = EarthRotation(np.ascontiguousarray(C_iq), np.ascontiguousarray(C_re), 1.234, wgs84.OMEGA)
    wind = np.array([[0.0, 5.0, -8.0], [10e3, -30.0, 40.0], [70e3, 10.0, 60.0]])
    around = world(load("egm96", 4), earth, Air(np.zeros((0, 4)), 1.1), wind)
    for height in (100.0, 12e3, 60e3):
        r_e = wgs84.ecef_from_geodetic(rng.uniform(-1.5, 1.5), rng.uniform(-3, 3), height)
        r_i, v_i = frames.inertial_from_ecef(earth, t_s, r_e, rng.normal(size=3) * 500.0)
        q = rng.normal(size=4)
        q /= np.linalg.norm(q)
        x = state(r_i, v_i, rng.normal(size=3), q)
        if mode == dynamics.ON_RAIL:
            along = rotation.quat_rotate(q, np.array([1.0, 0.0, 0.0]))
            x[3:6] = np.cross(frames.omega_ie_i(earth), r_i) + 20.0 * along
        rate, aux = derivative(t_s, x, mode, c, around, torque)
        a_i, alpha, f_b, air_data = slow_derivative(t_s, x, mode, c, aero, around, torque)
        # the gradient of gravitation is that of a point mass in the kernel
        assert np.allclose(rate[3:6], a_i, rtol=1e-10, atol=2e-7)
        assert np.allclose(rate[10:13], alpha, rtol=1e-9, atol=1e-10)
        assert np.allclose(rate[16:19], f_b, rtol=1e-10, atol=2e-7)
        assert np.array_equal(aux[:3], rate[16:19])
        assert np.allclose(aux[3:], air_data, rtol=1e-10, atol=1e-8)
        assert np.array_equal(rate[0:3], x[3:6])
        assert np.array_equal(rate[13:16], x[10:13])


@pytest.mark.parametrize(
    ("v_i", "axis", "sign"),
    [
        ((500.0, 0.0, 20.0), 1, -1.0),  # air from below, +z: the nose goes down to it, a negative pitch
        ((500.0, 20.0, 0.0), 2, 1.0),
    ],
)
def test_aerodynamics_points_the_nose_into_the_wind(v_i, axis, sign):
    c, around = body([PARAMS.payload]), world(earth=STILL, air=STANDARD)
    low = np.array([wgs84.A + 5e3, 0.0, 0.0])
    rate, _ = derivative(0.0, state(low, v_i), dynamics.FREE, c, around)
    assert sign * rate[10 + axis] > 0.0
    assert rate[10] > 0.0  # canted fins spin it up
    rate, _ = derivative(0.0, state(low, v_i, (500.0, 0.0, 0.0)), dynamics.FREE, c, around)
    assert rate[10] < 0.0  # and damp it when it is too fast


def test_drag_alone_brakes_along_the_velocity():
    sphere = STACK._replace(
        axial=0.0 * STACK.axial, normal_slope=0.0 * STACK.axial, drag=0.0 * STACK.axial + 0.5
    )
    middle = sphere._replace(pressure_station_m=0.0 * STACK.axial + BODY.station, fin_cant=0.0)
    c = body(imu=AT_CG, aerodynamics=middle)
    v_i = np.array([300.0, -200.0, 100.0])
    low = np.array([wgs84.A + 5e3, 0.0, 0.0])
    rate, aux = derivative(0.0, state(low, v_i), dynamics.FREE, c, world(air=STANDARD))
    expected = -aux[5] * sphere.area_m2 * 0.5 / BODY.mass * v_i / np.linalg.norm(v_i)
    assert np.allclose(rate[3:6], expected, rtol=1e-12)
    assert np.allclose(rate[10:13], 0.0, atol=1e-15)


def test_a_body_at_rest_in_moving_air_goes_with_it():
    # on the equator north is z and east is y of frame e, which is i here
    r_i = np.array([wgs84.A + 1e3, 0.0, 0.0])
    for wind, axis, sign in (
        ((0.0, 12.0, 0.0), 5, 1.0),
        ((0.0, 0.0, 12.0), 4, 1.0),
        ((0.0, -12.0, 0.0), 5, -1.0),
    ):
        around = world(air=STANDARD, wind=np.array([wind]))
        rate, _ = derivative(0.0, state(r_i), dynamics.FREE, body(imu=AT_CG), around)
        assert sign * rate[axis] > 1e-3
        assert abs(rate[9 - axis]) < 1e-12
    rate, _ = derivative(0.0, state(r_i), dynamics.FREE, body(imu=AT_CG), world(air=STANDARD, wind=CALM))
    assert np.array_equal(rate[3:6], np.zeros(3))


@pytest.mark.parametrize("stage", [S40, S44])
def test_mass_properties_between_the_rows_of_the_propellant(stage):
    c = body([BODY, stage.dry], stage)
    s, tables = scene.prepare(c, world())
    q = stage.propellant
    for left in (0.3 * q.mass_kg[1], q.mass_kg[7], 0.77 * q.mass_kg[-1], q.mass_kg[-1]):
        k = max(0, np.searchsorted(q.mass_kg, left) - 1)
        s[0]["mass_row"] = k
        rows = [vehicle.combine([BODY, stage.dry, part(*(column[j] for column in q))]) for j in (k, k + 1)]
        share = (left - q.mass_kg[k]) / (q.mass_kg[k + 1] - q.mass_kg[k])
        mass, station, roll, pitch = (a + share * (b - a) for a, b in zip(*map(astuple, rows), strict=True))
        got = vehicle.mass_properties(s[0], tables, left)
        assert np.allclose(got[:5], [mass, station, roll, pitch, pitch], rtol=1e-13)
        assert got[5] == pytest.approx(q.station_m[0], abs=1e-9)  # what burns is where the grain is
        # d I/dm = (x_p - x)^2 + k^2 of the burning shell: from the parameters, over the row
        shell = (rows[1].inertia_pitch - rows[0].inertia_pitch) / (q.mass_kg[k + 1] - q.mass_kg[k])
        assert got[6] == pytest.approx(shell, rel=1e-9)
        assert got[7] == got[6]


def test_tilt_turns_the_principal_axis():
    c = body(tilt=(0.03, -0.05))
    j_xy, j_xz, j_yz = c.products
    i_x, i_y, i_z = c.mass[0, 3:]
    inertia = np.array([[i_x, j_xy, j_xz], [j_xy, i_y, j_yz], [j_xz, j_yz, i_z]])
    axis = Rotation.from_rotvec([0.0, 0.03, -0.05]).apply([1.0, 0.0, 0.0])
    assert np.allclose(inertia @ axis, BODY.inertia_roll * axis, atol=1e-10)
    assert np.allclose(
        np.linalg.eigvalsh(inertia), [BODY.inertia_roll, *[BODY.inertia_pitch] * 2], rtol=1e-12
    )


def test_thrust_is_turned_about_the_body_axes():
    c = crooked(STACK)
    assert np.allclose(
        c.thrust_axis, [1.0, -0.02, -0.01], atol=3e-4
    )  # about y: towards -z, about z: towards y
    assert np.linalg.norm(c.thrust_axis) == pytest.approx(1.0, abs=1e-15)


def test_jet_damping_takes_the_momentum_that_the_gas_carries_away():
    # transverse spin in vacuum: d(I omega)/dt = -flow x_e^2 omega, distances from the centre of mass
    c = body([BODY, S44.dry], S44._replace(t_ignition_s=0.0))
    _, rows = propagate(state(FAR, omega_b=(0.0, 0.05, 0.0)), 30.0, c, dt=2.5e-3)
    t = np.arange(len(rows)) * 2.5e-3
    force, left = (np.interp(t, c.thrust[:, 0], column) for column in c.thrust.T[1:])
    left = c.thrust[0, 2] - np.concatenate(
        [[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(t))]
    ) / (c.exhaust_speed)
    station, inertia = (np.interp(left, c.mass[:, 0], c.mass[:, k]) for k in (2, 4))
    loss = force / c.exhaust_speed * (c.exit_station - station) ** 2 * rows[:, 11]
    momentum = inertia * rows[:, 11]
    lost = np.concatenate([[0.0], np.cumsum((loss[1:] + loss[:-1]) / 2.0) * 2.5e-3])
    assert np.allclose(momentum, momentum[0] - lost, rtol=1e-6)
    assert lost[-1] > 0.05 * momentum[0]


def test_without_gas_effects_the_rate_follows_the_inertia_alone():
    c = body([BODY, S44.dry], S44._replace(t_ignition_s=0.0), gas=0.0)
    x, _ = propagate(state(FAR, omega_b=(0.0, 0.05, 0.0)), 30.0, c)
    assert x[11] == pytest.approx(0.05, rel=1e-12)  # I alpha = 0: the principle of solidification


def test_corners_of_a_configuration():
    c = crooked(STACK)
    corners = vehicle.corners(c)
    assert np.all(np.diff(corners) > 0.0)
    for t in (*c.thrust[:, 0], 4.0, 4.5, 5.5, 6.0, 29.0, 31.0, 79.0, 83.0):
        assert t in corners
    s, tables = scene.prepare(c, world())
    left = []
    for t in corners[(corners > 0.0) & (corners < c.thrust[-1, 0])]:
        vehicle.choose_rows(s[0], tables, t)
        left.append(vehicle.thrust(s[0], tables, t)[1])
    for row in c.mass[1:-1, 0]:
        assert np.abs(np.array(left) - row).min() < 1e-9  # each row of the mass table is met
    # a motor that is a single block, and one that gives no thrust
    block = c._replace(thrust=np.array([[2.0, 100.0, 50.0], [4.0, 100.0, 0.0]]), exhaust_speed=4.0)
    assert np.isclose(vehicle.corners(block), 2.0 + 2.0 * (50.0 - c.mass[0, 0]) / 50.0).any()
    spent = block._replace(thrust=block.thrust * [1.0, 0.0, 1.0])
    assert {2.0, 4.0} <= set(vehicle.corners(spent))


def test_impossible_vehicles_are_refused():
    wrong = S44._replace(motor=S44.motor._replace(exhaust_speed=1.01 * S44.motor.exhaust_speed))
    with pytest.raises(ValueError, match="impulse"):
        body([BODY], wrong)
    times = S44._replace(motor=S44.motor._replace(t_s=S44.motor.t_s[::-1]))
    with pytest.raises(ValueError, match="increase"):
        body([BODY], times)
    rows = S44._replace(propellant=S44.propellant._replace(mass_kg=S44.propellant.mass_kg[::-1]))
    with pytest.raises(ValueError, match="propellant"):
        body([BODY], rows)
    with pytest.raises(ValueError, match="Mach"):
        aerodynamics.tables(STACK._replace(mach=STACK.mach[::-1]))
    with pytest.raises(ValueError, match="angles"):
        aerodynamics.tables(LIFTING._replace(alpha=LIFTING.alpha + 0.1))


def test_the_moment_station_does_not_matter():
    # the same forces, described about another point
    c = body(aerodynamics=LIFTING, offset=(0.02, -0.04))
    shift = 1.5
    other = c.aero._replace(
        moment_station=c.aero.moment_station + shift,
        moment=c.aero.moment + (c.aero.normal + c.aero.drag) * shift / c.aero.diameter,
    )
    x = state([wgs84.A + 5e3, 0.0, 0.0], [500.0, 30.0, -80.0], [0.1, 0.2, 0.3])
    one, _ = derivative(0.0, x, dynamics.FREE, c, world(air=STANDARD))
    two, _ = derivative(0.0, x, dynamics.FREE, c._replace(aero=other), world(air=STANDARD))
    assert np.allclose(one[3:6], two[3:6], rtol=1e-12)
    assert np.allclose(one[10:13], two[10:13], rtol=1e-9)
    assert np.abs(one[11:13]).min() > 0.1


def test_tables_over_the_angle_hold_beyond_their_ends():
    c = body(aerodynamics=LIFTING._replace(alpha=np.radians([0.0, 1.0, 2.0, 3.0, 4.0])))
    r_i = [wgs84.A + 5e3, 0.0, 0.0]
    _, shallow = derivative(0.0, state(r_i, [900.0, 0.0, 900.0]), dynamics.FREE, c, world(air=STANDARD))
    assert shallow[8] == pytest.approx(np.pi / 4.0, rel=1e-9)
    _, backwards = derivative(0.0, state(r_i, [-900.0, 1.0, 0.0]), dynamics.FREE, c, world(air=STANDARD))
    assert backwards[8] == pytest.approx(np.pi - 1.0 / 900.0, abs=1e-6)
    for aux in (shallow, backwards):
        assert np.all(np.isfinite(aux))


@pytest.mark.parametrize("last_deg", [4.0, 60.0, 89.0, 90.0, 130.0, 177.0])
def test_air_at_angles_beyond_a_table_never_pushes(last_deg):
    """Power of the air on a body that does not turn: negative at any angle; tail first as nose first."""
    given = np.radians([0.0, 0.5 * last_deg, last_deg])
    axial = np.array([0.4, 0.6]) * np.maximum(np.cos(given), -1.0)[:, None]
    aero = LIFTING._replace(
        mach=np.array([0.0, 5.0]), alpha=given, axial=axial.T, normal_slope=np.full((2, 3), 3.0),
        pressure_station_m=np.full((2, 3), 3.0), drag=np.zeros((2, 3)), pitch_damping=np.zeros(2),
        roll_damping=np.zeros(2), roll_by_cant=np.zeros(2),
    )  # fmt: skip
    c, r_i = body(aerodynamics=aero, imu=AT_CG), [wgs84.A + 5e3, 0.0, 0.0]
    braked = []
    for angle in np.radians(np.arange(0.0, 180.5, 0.5)):
        v_i = 600.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
        _, aux = derivative(0.0, state(r_i, v_i), dynamics.FREE, c, world(air=STANDARD))
        braked.append(-aux[:3] @ v_i / 600.0)
    assert min(braked) > 0.0
    assert np.abs(np.diff(braked)).max() < 0.1 * max(braked), "no jump at the end of the table"
    if last_deg < 170.0:
        assert braked[-1] == pytest.approx(braked[0], rel=1e-9)


def test_all_sections_use_one_compiled_kernel():
    # one signature: a second one would double the compile time
    fly.fly(PARAMS._replace(sample_rate_hz=50.0, t_start_s=-1.0, gravity=fields.load("egm96", 4)), STILL)
    assert len(integrate._integrate.signatures) == 1


def test_rail_allows_motion_along_itself_only():
    # no rotation, no gravity: the misaligned thrust pushes with its part along the rail alone
    c, around = crooked(STACK), world(rail=RAIL)
    rate, aux = derivative(10.0, state(FAR, omega_b=(0.0, 0.0, 0.0)), dynamics.ON_RAIL, c, around)
    assert rate[3] == pytest.approx(aux[6] * c.thrust_axis[0] / aux[3], rel=1e-12)
    assert np.allclose(rate[4:6], 0.0, atol=1e-14)
    assert np.array_equal(rate[10:13], np.zeros(3))


def test_imu_is_not_the_centre_of_mass():
    omega = np.array([3.0, 0.5, -0.2])
    velocity = np.array([10.0, -20.0, 5.0])
    lever = np.array([-BODY.station, 0.02, -0.01]) - IMU
    x0 = state(FAR, velocity, omega)
    x, _ = propagate(x0, 20.0, body(offset=(0.02, -0.01)))
    cg_0, cg_1 = (s[0:3] + rotation.quat_rotate(s[6:10], lever) for s in (x0, x))
    v_0 = velocity + np.cross(omega, lever)
    assert np.allclose(cg_1, cg_0 + 20.0 * v_0, atol=2e-7)
    assert np.linalg.norm(x[0:3] - FAR - 20.0 * velocity) > 0.5  # the IMU does not
