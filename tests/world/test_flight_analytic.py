"""Flights with a known answer: what is conserved in 600 s, and solutions in closed form."""

import csv
from importlib import resources

import numpy as np
import pytest
from flight_bench import AT_CG, BODY, FAR, POINT, STANDARD, TURNING, body, propagate, section, state, world
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import gammaln, lpmv
from shefex2 import S40, S44, STACK, part

from shefex_nav.environment import gravity
from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.gravity import J2_WGS84, gravity_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.world.flight import devices, surroundings
from shefex_nav.world.flight.settings import YoYo

LONG = 600.0  # s
SPIN = 2.0 * np.pi * 1.5  # rad/s
FINE = 1e-12  # tolerance
ORBIT = state([7.2e6, 1e5, 3e5], [200.0, 5000.0, 5500.0], [0.02, 0.1, -0.05])
COASTING = body(imu=AT_CG)  # the state is that of the centre of mass


def inertial_momentum(x, inertia):
    """Angular momentum about the centre of mass in frame i, of states (n, >= 13)."""
    return np.array([rotation.quat_rotate(np.ascontiguousarray(s[6:10]), inertia @ s[10:13]) for s in x])


def relative_change(values):
    """Largest change of the rows of values over the size of the first."""
    values = np.atleast_2d(np.asarray(values).T).T
    return np.abs(values - values[0]).max() / np.linalg.norm(values[0])


def test_symmetric_top_spinning_and_coning_for_600_s():
    # rates turn in the body at (I_x/I_t - 1) p, the body about its angular momentum at H/I_t
    i_x, i_t = BODY.inertia_roll, BODY.inertia_pitch
    coning = np.tan(np.radians(2.0)) * i_x / i_t * SPIN  # rad/s, for 2 deg between roll axis and momentum
    omega = np.array([SPIN, coning, 0.0])
    x, _ = propagate(state(FAR, omega_b=omega), LONG, body(), tolerance=0.1 * FINE)
    turn = (i_x / i_t - 1.0) * SPIN * LONG
    assert np.allclose(x[10:13], [SPIN, coning * np.cos(turn), coning * np.sin(turn)], atol=1e-9 * coning)
    momentum = np.array([i_x * SPIN, i_t * coning, 0.0])
    size = np.linalg.norm(momentum)
    about_momentum = Rotation.from_rotvec(momentum / size * (size / i_t * LONG))
    expected = about_momentum * Rotation.from_rotvec([(1.0 - i_x / i_t) * SPIN * LONG, 0.0, 0.0])
    error = (expected.inv() * Rotation.from_quat(rotation.xyzw(x[6:10]))).magnitude()
    assert error < 1e-9  # rad, after 900 revolutions


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.05, -0.1)], ids=["symmetric", "asymmetric"])
def test_free_rotation_keeps_energy_and_momentum(tilt):
    c = body(imu=AT_CG, tilt=tilt)
    if tilt[0] != 0.0:
        c.mass[:, 4] *= 0.8  # three different moments and all products
        c = c._replace(products=np.array([-20.0, 35.0, 50.0]))
    j_xy, j_xz, j_yz = c.products
    i_x, i_y, i_z = c.mass[0, 3:]
    inertia = np.array([[i_x, j_xy, j_xz], [j_xy, i_y, j_yz], [j_xz, j_yz, i_z]])
    x0 = state(FAR, omega_b=(2.0, 0.8, -0.5))
    x, rows = propagate(x0, LONG, c, tolerance=FINE, dt=1.0)
    states = np.vstack([rows[:, :19], x])
    energy = np.einsum("ni,ij,nj->n", states[:, 10:13], inertia, states[:, 10:13])
    assert relative_change(energy) < 1e-9
    assert relative_change(inertial_momentum(states, inertia)) < 1e-9
    change = np.ptp(states[:, 10])
    assert change > 0.1 if tilt[0] else change < 1e-9  # the asymmetric one does tumble


def test_point_mass_keeps_energy_and_angular_momentum():
    x, rows = propagate(ORBIT, LONG, COASTING, world(POINT), dt=1.0)
    r, v = np.vstack([rows[:, 0:3], x[0:3]]), np.vstack([rows[:, 3:6], x[3:6]])
    assert relative_change((v**2).sum(axis=1) / 2.0 - POINT.gm / np.linalg.norm(r, axis=1)) < 1e-9
    assert relative_change(np.cross(r, v)) < 1e-9
    assert np.allclose(x[16:19], 0.0, atol=1e-12)  # in free fall an accelerometer reads nothing


def test_oblate_earth_keeps_energy_and_polar_angular_momentum():
    x, rows = propagate(ORBIT, LONG, COASTING, world(gravity.load("j2"), TURNING), dt=1.0)
    r, v = np.vstack([rows[:, 0:3], x[0:3]]), np.vstack([rows[:, 3:6], x[3:6]])
    size = np.linalg.norm(r, axis=1)
    zonal = J2_WGS84 * (wgs84.A / size) ** 2 * (1.5 * (r[:, 2] / size) ** 2 - 0.5)
    energy = (v**2).sum(axis=1) / 2.0 - wgs84.GM / size * (1.0 - zonal)
    assert relative_change(energy) < 1e-9
    momentum = np.cross(r, v)
    assert relative_change(momentum[:, 2]) < 1e-9
    assert relative_change(momentum) > 1e-5  # the others do change


def potential(r_e, degree):
    """Potential of EGM96 from its table, by the textbook sum over associated Legendre functions."""
    radius = np.linalg.norm(r_e)
    sine, longitude = r_e[2] / radius, np.arctan2(r_e[1], r_e[0])
    total = 1.0
    with (resources.files("shefex_nav") / "data" / "egm96_36x36.csv").open(newline="") as lines:
        for row in csv.DictReader(lines):
            n, m = int(row["n"]), int(row["m"])
            if not 2 <= n <= degree:
                continue
            factor = (1.0 if m == 0 else 2.0) * (2 * n + 1) * np.exp(gammaln(n - m + 1) - gammaln(n + m + 1))
            legendre = (-1.0) ** m * np.sqrt(factor) * lpmv(m, n, sine)
            c, s = float(row["C_normalised"]), float(row["S_normalised"])
            wave = c * np.cos(m * longitude) + s * np.sin(m * longitude)
            total += (6378136.3 / radius) ** n * legendre * wave
    return 3.986004415e14 / radius * total


def test_rotating_earth_with_harmonics_keeps_the_jacobi_integral():
    x0 = state([6.6e6, 1e5, 3e5], [200.0, 5300.0, 5500.0])
    x, rows = propagate(x0, LONG, COASTING, world(gravity.load("egm96", 12), TURNING), dt=20.0)
    omega_e = frames.omega_ie_i(TURNING)
    jacobi, energy = [], []
    for t, s in [*((20.0 * k, row) for k, row in enumerate(rows)), (LONG, x)]:
        r_i, v_i = s[0:3], s[3:6]
        own = v_i @ v_i / 2.0 - potential(frames.dcm_ie(TURNING, t).T @ r_i, 12)
        energy.append(own)
        jacobi.append(own - omega_e @ np.cross(r_i, v_i))
    assert relative_change(jacobi) < 1e-9
    assert relative_change(energy) > 1e-7  # what does not stay without the rotation


def kepler(r_0, v_0, gm, t):
    """Position and velocity t s later on an ellipse, by Kepler's equation for the change of anomaly."""
    r, sigma = np.linalg.norm(r_0), r_0 @ v_0 / np.sqrt(gm)
    a = 1.0 / (2.0 / r - v_0 @ v_0 / gm)
    mean = np.sqrt(gm / a**3) * t

    def residual(e):
        return e + sigma / np.sqrt(a) * (1.0 - np.cos(e)) - (1.0 - r / a) * np.sin(e) - mean

    e = brentq(residual, -20.0, 20.0, xtol=1e-15, rtol=1e-15)
    f = 1.0 - a / r * (1.0 - np.cos(e))
    g = t - np.sqrt(a**3 / gm) * (e - np.sin(e))
    r_1 = f * r_0 + g * v_0
    size = np.linalg.norm(r_1)
    df, dg = -np.sqrt(a * gm) / (size * r) * np.sin(e), 1.0 - a / size * (1.0 - np.cos(e))
    return r_1, df * r_0 + dg * v_0


@pytest.mark.parametrize("t_s", [37.0, 600.0])
def test_kepler_arc(t_s):
    x, _ = propagate(ORBIT, t_s, COASTING, world(POINT))
    r, v = kepler(ORBIT[0:3], ORBIT[3:6], POINT.gm, t_s)
    assert np.allclose(x[0:3], r, rtol=0.0, atol=1e-6)
    assert np.allclose(x[3:6], v, rtol=0.0, atol=1e-9)


def test_rocket_equation_with_staging():
    # the first stage burns with the second on top, falls off, the second burns; nothing else acts
    q = S44.propellant
    upper = part(q.mass_kg[-1], q.station_m[-1], q.inertia_roll[-1], q.inertia_pitch[-1])
    second = S44._replace(t_ignition_s=61.234567)
    lower = body([BODY, S40.dry, S44.dry, upper], S40)
    alone = body([BODY, S44.dry], second)
    x, t, _, _ = section(state(FAR), 0.0, 60.3, lower, world())
    x, t, _, rows = section(x, t, 140.0, alone, world())
    gain = 0.0
    for stage, rest in ((S40, 980.0 + 500.0 + 200.0 + 814.0), (S44, 500.0 + 200.0)):
        gain += stage.motor.exhaust_speed * np.log((rest + stage.propellant.mass_kg[-1]) / rest)
    assert x[3] == pytest.approx(gain, rel=1e-11)
    assert np.allclose(x[4:6], 0.0, atol=1e-9)
    assert rows[-1, 22] == pytest.approx(700.0, rel=1e-13)
    assert rows[0, 22] == pytest.approx(1514.0, rel=1e-13)


def test_thrust_that_jumps_at_an_odd_time_loses_nothing():
    c = body(mass=np.array([[0.0, 500.0, 3.0, 60.0, 900.0, 900.0], [90.0, 590.0, 3.0, 60.0, 900.0, 900.0]]),
             thrust=np.array([[1.23456789, 27e3, 90.0], [8.73456789, 27e3, 0.0]]),
             exhaust_speed=27e3 * 7.5 / 90.0)  # fmt: skip
    x, rows = propagate(state(FAR), 12.0, c, dt=2.5e-3)
    assert x[3] == pytest.approx(c.exhaust_speed * np.log(590.0 / 500.0), rel=1e-13)
    # and before ignition nothing: the samples see the jump where it is
    t = np.arange(len(rows)) * 2.5e-3
    assert np.array_equal(rows[:, 25] > 0.0, (t >= 1.23456789) & (t < 8.73456789))
    assert rows[t < 1.23456789, 3].max() == 0.0
    assert np.allclose(rows[t >= 8.73456789, 3], x[3], rtol=0.0, atol=1e-10)


def test_spin_motors_give_their_impulse():
    c = body(spin_motors=np.array([[0.31, 2.77, 150.0], [1.0, 1.5, -40.0]]))
    x, _ = propagate(state(FAR), 5.0, c)
    assert x[10] == pytest.approx((150.0 * 2.46 - 40.0 * 0.5) / BODY.inertia_roll, rel=1e-12)


def test_yo_yo_conserves_energy_and_momentum_of_vehicle_and_masses():
    mass, radius = 2.0, 0.5
    length = 0.9 * np.sqrt(radius**2 + BODY.inertia_roll / mass)
    row = devices.yo_yo_row(
        YoYo(at=1.2345, mass=mass, cord_length=length, radius=radius), SPIN, BODY.inertia_roll
    )
    c = body(imu=AT_CG, yo_yo=row)
    x, rows = propagate(state(FAR, omega_b=(SPIN, 0.0, 0.0)), 5.0, c, dt=2.5e-3)
    t = np.arange(len(rows)) * 2.5e-3
    spin, on = rows[:, 10], (t >= row[0]) & (t < row[1])
    assert np.allclose(spin[t < row[0]], SPIN, rtol=1e-14)
    # a mass at the end of the cord, which leaves the drum along the tangent: R e_r - l e_t, the tangent
    # point going round with spin + omega_0, so that v = R spin e_t + l (spin + omega_0) e_r
    unwound, around = radius * SPIN * (t[on] - row[0]), spin[on] + SPIN
    body_and_drum = BODY.inertia_roll + mass * radius**2
    energy = 0.5 * body_and_drum * spin[on] ** 2 + 0.5 * mass * (unwound * around) ** 2
    momentum = body_and_drum * spin[on] + mass * unwound**2 * around
    assert np.allclose(energy, 0.5 * body_and_drum * SPIN**2, rtol=1e-9)
    assert np.allclose(momentum, body_and_drum * SPIN, rtol=1e-9)
    assert row[1] - row[0] == pytest.approx(length / (radius * SPIN), rel=1e-14)
    left = (1.0 - 0.81) / (1.0 + 0.81)  # K and l^2 = 0.81 K
    assert x[10] == pytest.approx(left * SPIN, rel=1e-10)
    assert np.allclose(spin[t >= row[1]], x[10], rtol=0.0, atol=1e-12)


def test_parachute_comes_to_its_terminal_velocity():
    # weight = drag; the vehicle hangs below: its lines are at the nose, ahead of the centre of mass
    area, height = 60.0, 1500.0
    blunt = STACK._replace(area_m2=1e-9)
    c = body(imu=AT_CG, aerodynamics=blunt, parachute=np.array([2.0, 1.5, area, 0.0, 0.0]))
    still = world(POINT, EarthRotation(np.eye(3), np.eye(3), 0.0, 0.0), STANDARD)
    x0 = state([wgs84.A + height, 0.0, 0.0], [-60.0, 0.0, 0.0])
    _, rows = propagate(x0, 60.0, c, still, dt=0.1)
    falling, high = -rows[-1, 3], rows[-1, 26]
    density = us76(high)[0]
    weight = BODY.mass * POINT.gm / (wgs84.A + high) ** 2
    assert falling == pytest.approx(np.sqrt(2.0 * weight / (density * area)), rel=2e-3)  # air gets denser
    before = rows[19]
    assert before[3] < -70.0  # still closed: it falls
    braking = np.diff(rows[19:36, 3]) / 0.1  # filling: it grows from nothing
    assert braking[0] < -9.7
    assert braking[0] < braking[1] < braking[2] < braking[3]
    assert braking[1] < 0.25 * braking.max()


def test_parachute_drifts_with_the_wind():
    c = body(imu=AT_CG, aerodynamics=STACK._replace(area_m2=1e-9),
             parachute=np.array([0.0, 0.0, 60.0, 0.0, 0.0]))  # fmt: skip
    wind = np.array([[0.0, 4.0, 7.0], [5000.0, 4.0, 7.0]])
    still = EarthRotation(np.eye(3), np.eye(3), 0.0, 0.0)
    x0 = state([wgs84.A + 1500.0, 0.0, 0.0], [-8.0, 0.0, 0.0])
    x, _ = propagate(x0, 60.0, c, world(POINT, still, STANDARD, wind))
    # on the equator at longitude zero: east is y, north is z
    assert x[4] == pytest.approx(7.0, abs=0.1)
    assert x[5] == pytest.approx(4.0, abs=0.1)


def test_sphere_dropped_from_30000_feet():
    # NASA/TM-2015-218675, check case 1: no drag, J2, from rest over the equator; altitude after 30 s
    foot = 0.3048  # m
    earth = EarthRotation(np.eye(3), np.eye(3), 0.0, wgs84.OMEGA)
    around = world(gravity.load("j2"), earth)
    start = wgs84.ecef_from_geodetic(0.0, 0.0, 30000.0 * foot)
    r_i, v_i = frames.inertial_from_ecef(earth, 0.0, start, np.zeros(3))
    x, _ = propagate(state(r_i, v_i), 30.0, COASTING, around)
    fallen, _ = surroundings.free_fall(around, 0.0, r_i, v_i, 30.0)
    for r in (x[0:3], fallen):
        _, longitude, height = wgs84.geodetic_from_ecef(frames.dcm_ie(earth, 30.0).T @ r)
        assert height / foot == pytest.approx(15598.90435228, abs=1e-6)
        assert np.degrees(longitude) == pytest.approx(5.74552213e-5, abs=1e-12)


def test_gravitation_differs_over_the_vehicle():
    # an IMU above the centre of mass is pulled down by the body, which falls faster: 2 GM/r^3 l
    r = 7.0e6
    c = body(imu=AT_CG + np.array([10.0, 0.0, 0.0]))
    _, rows = propagate(state([r, 0.0, 0.0]), 0.1, c, world(POINT), dt=0.05)
    assert rows[0, 19] == pytest.approx(-2.0 * POINT.gm / r**3 * 10.0, rel=1e-5)
    g = gravity_e(POINT, np.array([r - 10.0, 0.0, 0.0])) - gravity_e(POINT, np.array([r, 0.0, 0.0]))
    assert rows[0, 19] == pytest.approx(g[0], rel=1e-5)
