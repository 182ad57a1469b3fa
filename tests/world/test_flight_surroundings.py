"""Height, gravitation in two parts, and rest on the Earth, each against its plain counterpart."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from shefex2 import EARTH, STACK

from shefex_nav.environment.gravity import gravity_e, gravity_j2_e, load_egm96
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.world.flight import attitude_program as attitude
from shefex_nav.world.flight import dynamics, surroundings, vehicle

RAIL = surroundings.Rail(np.zeros(3), np.array([1.0, 0.0, 0.0]), 1e9)


@pytest.mark.parametrize("height_m", [-100.0, 0.0, 10e3, 180e3, 1000e3])
def test_height_is_that_of_the_geodetic_coordinates(height_m):
    for latitude in np.radians([-90.0, -60.0, -1e-3, 0.0, 30.0, 45.0, 69.3, 76.0, 89.999, 90.0]):
        r_e = wgs84.ecef_from_geodetic(latitude, 0.3, height_m)
        assert surroundings.height(r_e) == pytest.approx(height_m, abs=1e-8)


@pytest.mark.parametrize("degree", [0, 2, 12])
def test_gravitation_in_two_parts_is_the_whole(degree):
    world = surroundings.World(load_egm96(degree), EARTH, RAIL)
    r_e = wgs84.ecef_from_geodetic(1.2, 0.3, 1e5)
    C_ie = frames.dcm_ie(EARTH, 200.0)
    c, s = surroundings.turned(EARTH, 200.0)
    coarse = surroundings.coarse_gravity_i(EARTH, c, s, r_e)
    fine = surroundings.fine_gravity_i(world, 200.0, *(C_ie @ r_e), np.empty(3))
    assert np.allclose(np.add(coarse, fine), C_ie @ gravity_e(world.gravity, r_e), rtol=0, atol=1e-13)


@pytest.mark.parametrize("sample_rate_hz", [400.0, 100.0])
def test_harmonics_held_for_a_step_cost_no_accuracy(sample_rate_hz):
    """100 s through degree 12 in vacuum against an integration that evaluates all of it every time."""
    gravity = load_egm96(12)
    world = surroundings.World(gravity, EARTH, RAIL)
    part = vehicle.Part(500.0, 3.0, 60.0, 900.0)
    at_cg = vehicle.configure(
        [part], None, 0.0, np.array([-part.station_m, 0.0, 0.0]), STACK._replace(area_m2=0.0)
    )
    r_e = wgs84.ecef_from_geodetic(1.2, 0.3, 170e3)
    r_i, v_i = frames.inertial_from_ecef(EARTH, 0.0, r_e, np.array([-2500.0, 500.0, 2000.0]))

    def rate(field):
        def of(t_s, x):
            C_ie = frames.dcm_ie(EARTH, t_s)
            return np.concatenate([x[3:], C_ie @ field(np.ascontiguousarray(C_ie.T @ x[:3]))])

        return of

    def reference(field):
        start, tolerances = np.concatenate([r_i, v_i]), {"rtol": 1e-13, "atol": 1e-8}
        return solve_ivp(rate(field), (0.0, 100.0), start, method="DOP853", **tolerances).y[:, -1]

    x = np.concatenate([r_i, v_i, [1.0, 0.0, 0.0, 0.0], np.zeros(9)])
    rows = np.zeros((round(100.0 * sample_rate_hz) + 1, dynamics.ROW))
    idle, dt = attitude.hold(0.0, 1.0, 0.0), 1.0 / sample_rate_hz
    dynamics.integrate(x, 0.0, 100.0, 0, 0.0, dt, dynamics.FREE, idle, at_cg, world, rows)
    exact = reference(lambda r: gravity_e(gravity, r))
    assert np.abs(x[:3] - exact[:3]).max() < 1e-6
    assert np.abs(x[3:6] - exact[3:]).max() < 1e-8
    without = reference(gravity_j2_e)  # and the harmonics matter
    assert np.abs(without[:3] - exact[:3]).max() > 0.1


def test_rest_on_the_earth():
    r_e, q_eb = wgs84.ecef_from_geodetic(1.2, 0.3, 10.0), np.array([0.5, -0.5, 0.5, 0.5])
    t_s, states = np.array([-10.0, 0.0, 300.0]), np.empty((3, dynamics.STATE))
    surroundings.rest_on_earth(EARTH, r_e, q_eb, t_s, states)
    for t, state in zip(t_s, states, strict=True):
        back_e, v_e = frames.ecef_from_inertial(EARTH, t, state[0:3], state[3:6])
        assert np.allclose(back_e, r_e, atol=1e-8)
        assert np.allclose(v_e, 0.0, atol=1e-10)
        C_eb = frames.dcm_ie(EARTH, t).T @ rotation.dcm_from_quat(state[6:10])
        assert np.allclose(C_eb, rotation.dcm_from_quat(q_eb), atol=1e-14)
