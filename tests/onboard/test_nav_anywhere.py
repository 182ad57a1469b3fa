"""The filter where no rocket flies: at rest on the ground, and for a whole revolution in orbit.

The truth is exact kinematics on the ground and an integration by scipy in orbit, both in the gravity that
the filter knows; the sensors are that plus errors.
"""

import numpy as np
import pytest
from navigation_flight import DT, EARTH, P_STAR_C, PARAMS, SIGMA_R, SIGMA_V, alignment
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from shefex_nav.environment.gravity import gravity_j2_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import fusion, solution, ticks
from shefex_nav.onboard.navigation.state import NavState
from shefex_nav.records import GpsFix, ImuBlock, StarFix

# sensors without any errors but biases and white noise, and a filter that knows it
SENSORS = PARAMS.imu._replace(
    gyro_bias_walk=0.0,
    gyro_cross=0.0,
    gyro_g_sensitivity=0.0,
    accel_bias_walk=0.0,
    accel_scale=0.0,
    accel_misalignment=0.0,
    gravity=0.0,
)
PARAMS = PARAMS._replace(imu=SENSORS)
GROUND_S, ORBIT_S = 60, 5600  # a little more than a revolution at 400 km
NEVER = np.zeros(100, dtype=bool)
Q_BC = rotation.quat_from_dcm(PARAMS.C_bc)


class Ground:
    """Stands on the Earth, body x pointing north at 60 degrees elevation."""

    def __init__(self):
        latitude, longitude = np.radians([48.0, 11.0])
        self.r_e = wgs84.ecef_from_geodetic(latitude, longitude, 500.0)
        C_nb = rotation.dcm_from_rotvec(np.radians([0.0, 60.0, 0.0]))
        self.C_eb = wgs84.dcm_en(latitude, longitude) @ C_nb
        omega_e = EARTH.C_re.T @ np.array([0.0, 0.0, EARTH.rate])
        self.omega_b = self.C_eb.T @ omega_e
        f_e = np.cross(omega_e, np.cross(omega_e, self.r_e)) - gravity_j2_e(self.r_e)
        self.f_b = self.C_eb.T @ f_e

    def state(self, t_s):
        r_i, v_i = frames.inertial_from_ecef(EARTH, t_s, self.r_e, np.zeros(3))
        q_ib = rotation.quat_from_dcm(frames.dcm_ie(EARTH, t_s) @ self.C_eb)
        return NavState(t_s, r_i, v_i, q_ib, *[np.zeros(3)] * 4)


class Orbit:
    """400 km high, inclined by 51.6 degrees, the body following the velocity once a revolution."""

    f_b = np.zeros(3)

    def __init__(self):
        radius, inclination = wgs84.A + 400e3, np.radians(51.6)
        speed = np.sqrt(wgs84.GM / radius)
        start = [radius, 0.0, 0.0, 0.0, speed * np.cos(inclination), speed * np.sin(inclination)]

        def fall(t_s, x):
            C_ie = frames.dcm_ie(EARTH, t_s)
            return np.concatenate([x[3:], C_ie @ gravity_j2_e(C_ie.T @ x[:3])])

        self.path = solve_ivp(
            fall, (0.0, ORBIT_S), start, method="DOP853", rtol=1e-12, atol=1e-6, dense_output=True
        ).sol
        self.omega_b = np.array([0.0, -speed / radius, 0.0])
        self.q_0 = rotation.quat_normalise(np.array([0.6, 0.2, -0.5, 0.3]))

    def state(self, t_s):
        x = self.path(t_s)
        q_ib = rotation.quat_multiply(self.q_0, rotation.quat_from_rotvec(self.omega_b * t_s))
        return NavState(t_s, x[:3], x[3:], q_ib, *[np.zeros(3)] * 4)


def gps_fix(place, t_s, rng):
    state = place.state(t_s)
    C_ib = rotation.dcm_from_quat(state.q_ib)
    arm, noise = PARAMS.l_ba_b, rng.standard_normal((2, 3))
    r_e, v_e = frames.ecef_from_inertial(
        EARTH, t_s, state.r_i + C_ib @ arm, state.v_i + C_ib @ np.cross(place.omega_b, arm)
    )
    R_r, R_v = SIGMA_R**2 * np.eye(3), SIGMA_V**2 * np.eye(3)
    r_e, v_e = r_e + SIGMA_R * noise[0], v_e + SIGMA_V * noise[1]
    return GpsFix(t_s, t_s, True, r_e, v_e, R_r, R_v, 8, 2.0, "")


def star_fix(place, t_s, mounting, rng):
    noise = np.sqrt(np.diag(P_STAR_C)) * rng.standard_normal(3)
    q_bc = rotation.quat_multiply(rotation.quat_from_rotvec(mounting), Q_BC)
    q_ic = rotation.quat_multiply(place.state(t_s).q_ib, q_bc)
    q_ic = rotation.quat_multiply(q_ic, rotation.quat_from_rotvec(noise))
    return StarFix(0, t_s, t_s, 0, q_ic, P_STAR_C, None, None, 0.3, 12.0, 0.05, False, False)


def navigate(place, duration_s, rng, star_every_s=None):
    """Fly the filter. Yields (whole second, Filter, [GateResult])."""
    imu, start = PARAMS.imu, alignment(place.state(0.0), rng)
    nav = fusion.start(PARAMS, start, EARTH)
    drawn = rng.standard_normal((3, 3))
    bias_g, bias_a = PARAMS.sigma_gyro_bias * drawn[0], PARAMS.sigma_accel_bias * drawn[1]
    mounting = PARAMS.sigma_blocks["mounting"] * drawn[2]
    for second in range(1, duration_s + 1):
        noise = np.sqrt(DT) * rng.standard_normal((2, 400, 3))
        dtheta_b = (place.omega_b + bias_g) * DT + imu.gyro_random_walk * noise[0]
        dv_b = (place.f_b + bias_a) * DT + imu.accel_random_walk * noise[1]
        t_s, increments = second - 1 + np.arange(1, 101) / 100, (dtheta_b, dv_b)
        increments = (values.reshape(100, 4, 3) for values in increments)
        blocks, n = ImuBlock(t_s, t_s, np.full(100, DT), *increments, NEVER, ~NEVER), 0
        while n < 100:
            n += ticks.advance(nav, blocks, n, 100)
        fixes = [("gps", gps_fix(place, float(second), rng))]
        if star_every_s and second % star_every_s == 0:
            fixes.append(("star_tracker", star_fix(place, float(second), mounting, rng)))
        yield second, nav, fusion.fuse(nav, fixes)


def nees(nav, place):
    """Normalised squared error of position, velocity and attitude at the last tick."""
    state, P = nav.history[-1].state, nav.history[-1].P[:9, :9]
    truth = place.state(state.t_s)
    attitude = rotation.rotvec_between(state.q_ib, truth.q_ib)
    dx = np.concatenate([truth.r_i - state.r_i, truth.v_i - state.v_i, attitude])
    scale = np.sqrt(np.diag(P))
    return (dx / scale) @ np.linalg.solve(P / np.outer(scale, scale), dx / scale)


@pytest.mark.compiled
def test_at_rest_on_the_ground():
    """Twelve runs of a minute: consistent, and no angle of a velocity that is none comes out as NaN."""
    place, total, n = Ground(), 0.0, 12
    for seed in range(n):
        for _, nav, gates in navigate(place, GROUND_S, np.random.default_rng(seed)):  # noqa: B007
            assert all(gate.accepted for gate in gates)
        total += nees(nav, place)
        answer = solution.solution(nav)
        assert np.isfinite(np.concatenate([np.ravel(value) for value in answer])).all()
        assert nav.history[-1].imu.vibration == 0.0
        assert np.linalg.norm(answer.v_e) < 0.15  # m/s, four sigma
        assert answer.sigma_flight_path_angle > 0.1  # a direction of 1 cm/s means little
    low, high = chi2.ppf([0.001, 0.999], 9 * n)
    assert low < total < high


def test_exactly_at_rest_the_angles_are_numbers():
    """v_e = 0: no direction, so the angles are zero and nothing is known of them."""
    state = Ground().state(0.0)
    nav = fusion.start(PARAMS, alignment(state), EARTH)
    found = solution.solution(nav)
    assert all(np.isfinite(getattr(found, name)).all() for name in solution.FIELDS)
    assert np.linalg.norm(found.v_e) < 1e-9
    for name in ("sigma_flight_path_angle", "sigma_angle_of_attack", "sigma_sideslip"):
        assert getattr(found, name) == pytest.approx(np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1])
def test_a_revolution_in_orbit(seed):
    """GPS every second, a star fix every ten: consistent to the end, all is believed but for chance."""
    place = Orbit()
    values, rejected = [], 0
    for second, nav, gates in navigate(place, ORBIT_S, np.random.default_rng(seed), star_every_s=10):
        rejected += sum(not gate.accepted for gate in gates)
        assert not any("reset" in gate.note for gate in gates)
        if second % 100 == 0:
            values.append(nees(nav, place))
    assert rejected <= 8  # one in ten thousand of 11 800
    # errors 100 s apart are nearly independent, those of slow states are not: wide bounds
    assert 6.0 < np.mean(values) < 12.5
    answer = solution.solution(nav)
    assert np.isfinite(np.concatenate([np.ravel(value) for value in answer])).all()
    truth = place.state(float(ORBIT_S))
    assert np.linalg.norm(answer.r_i - truth.r_i) < 4.0
    assert np.linalg.norm(answer.v_i - truth.v_i) < 0.05
    assert abs(answer.flight_path_angle) < np.radians(0.5)
