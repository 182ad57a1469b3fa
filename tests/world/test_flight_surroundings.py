"""Height, gravitation in two parts, air, wind and rest on the Earth, each against its plain counterpart."""

import numpy as np
import pytest
from flight_bench import AT_CG, CALM, NONE, POINT, RAIL, STANDARD, STILL, body, propagate, state, world
from scipy.integrate import solve_ivp
from shefex2 import EARTH

from shefex_nav.environment import gravity
from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.gravity import GM_EGM96, RADIUS_EGM96, gravity_e, gravity_j2_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.world.flight import dynamics, given, integrate, scene, surroundings
from shefex_nav.world.flight.params import Air

WGS84 = np.array([wgs84.A, wgs84.E2])
LATITUDES = np.radians([-90.0, -60.0, -1e-3, 0.0, 30.0, 45.0, 69.3, 76.0, 89.999, 90.0])


@pytest.mark.parametrize("height_m", [-100.0, 0.0, 10e3, 180e3, 1000e3])
def test_level_is_that_of_the_geodetic_coordinates(height_m):
    for latitude in LATITUDES:
        r_e = wgs84.ecef_from_geodetic(latitude, 0.3, height_m)
        assert surroundings.height(WGS84, r_e) == pytest.approx(height_m, abs=1e-8)
        _, sine, cosine = surroundings.level(*WGS84, *r_e)
        assert np.allclose([sine, cosine], [np.sin(latitude), np.cos(latitude)], atol=2e-8)


def test_height_above_a_sphere():
    r_e = wgs84.ecef_from_geodetic(1.1, 0.3, 5e4)
    sphere = np.array([6.371e6, 0.0])
    assert surroundings.height(sphere, r_e) == pytest.approx(np.linalg.norm(r_e) - 6.371e6, abs=1e-8)


@pytest.mark.parametrize("degree", [0, 2, 12])
def test_gravitation_in_two_parts_is_the_whole(degree):
    field = gravity.from_normalised(*gravity.egm96(degree))
    around = world(field, EARTH)
    s, _ = scene.prepare(body(), around)
    r_e = wgs84.ecef_from_geodetic(1.2, 0.3, 1e5)
    C_ie = frames.dcm_ie(EARTH, 200.0)
    coarse = C_ie @ surroundings.coarse_gravity(s[0], *r_e)
    fine = surroundings.fine_gravity_i(field, s[0], 200.0, *(C_ie @ r_e))
    assert np.allclose(coarse + fine, C_ie @ gravity_e(field, r_e), rtol=0, atol=1e-13)
    assert np.linalg.norm(fine) < (1e-3 if degree > 2 else 2e-4)  # little is left for the second part


def test_closed_form_is_that_of_the_field():
    assert np.allclose(surroundings.closed_form(gravity.load("j2")), [wgs84.GM, wgs84.A, gravity.J2_WGS84])
    assert np.array_equal(surroundings.closed_form(gravity.load("point"))[2:], [0.0])
    gm, radius, j2 = surroundings.closed_form(gravity.load("egm96", 12))
    assert (gm, radius) == (GM_EGM96, RADIUS_EGM96)
    assert j2 == pytest.approx(0.484165371736e-3 * np.sqrt(5.0), rel=1e-9)
    s, _ = scene.prepare(body(), world(gravity.load("j2")))
    r_e = wgs84.ecef_from_geodetic(0.7, 0.3, 1e5)
    assert np.allclose(surroundings.coarse_gravity(s[0], *r_e), gravity_j2_e(r_e), rtol=1e-14)


@pytest.mark.parametrize("kind", ["suborbital", "orbit"])
def test_harmonics_linear_over_a_step_cost_no_accuracy(kind):
    """300 s through degree 12 with the largest step, against an integration that evaluates all of it."""
    field = gravity.load("egm96", 12)
    v_e = np.array([-2500.0, 500.0, 2000.0]) * (2.2 if kind == "orbit" else 1.0)
    r_e = wgs84.ecef_from_geodetic(1.2, 0.3, 170e3)
    r_i, v_i = frames.inertial_from_ecef(EARTH, 0.0, r_e, v_e)
    t_end = 300.0

    def reference(of):
        def rate(t_s, x):
            C_ie = frames.dcm_ie(EARTH, t_s)
            return np.concatenate([x[3:], C_ie @ of(np.ascontiguousarray(C_ie.T @ x[:3]))])

        options = {"rtol": 1e-13, "atol": 1e-8}
        return solve_ivp(rate, (0.0, t_end), np.concatenate([r_i, v_i]), method="DOP853", **options).y[:, -1]

    largest = -integrate.LARGEST_STEP
    x, _ = propagate(state(r_i, v_i), t_end, body(imu=AT_CG), world(field, EARTH), tolerance=largest)
    exact = reference(lambda r: gravity_e(field, r))
    assert np.abs(x[:3] - exact[:3]).max() < 2e-6
    assert np.abs(x[3:6] - exact[3:]).max() < 1e-8
    without = reference(gravity_j2_e)  # and the harmonics matter
    assert np.abs(without[:3] - exact[:3]).max() > 1.0


def test_air_of_a_table():
    height = np.array([0.0, 10e3, 20e3])
    table = np.column_stack(
        [height, np.log([1.2, 0.4, 0.09]), np.log([1e5, 2.6e4, 5.5e3]), [340.0, 300.0, 295.0]]
    )
    prepared = scene.prepare(body(), world(air=Air(table, 1.1)))
    s, tables = prepared.record[0], prepared.tables
    density, pressure, sound = surroundings.air(s, tables, 12.5e3)  # a quarter of the way
    assert density == pytest.approx(1.1 * 0.4**0.75 * 0.09**0.25, rel=1e-13)
    assert pressure == pytest.approx(2.6e4**0.75 * 5.5e3**0.25, rel=1e-13)  # the factor is one of the density
    assert sound == pytest.approx(298.75, rel=1e-13)
    assert surroundings.air(s, tables, 20e3)[0] == pytest.approx(1.1 * 0.09, rel=1e-12)
    assert surroundings.air(s, tables, -50.0) == pytest.approx((1.1 * 1.2, 1e5, 340.0), rel=1e-12)
    assert surroundings.air(s, tables, 20e3 + 1.0) == (0.0, 0.0, 295.0)
    # a flight along a given trajectory has the same: the vacuum above the table, too
    heights, speed = np.array([-50.0, 12.5e3, 20e3, 20e3 + 1.0, 150e3]), np.full(5, 2700.0)
    of_kernel = np.array([surroundings.air(s, tables, h) for h in heights])
    mach, dynamic = given._in_the_air(Air(table, 1.1), heights, speed)
    assert np.allclose(mach, speed / of_kernel[:, 2], rtol=1e-12)
    assert np.allclose(dynamic, 0.5 * of_kernel[:, 0] * speed**2, rtol=1e-12)


def test_air_without_a_table_is_the_standard():
    prepared = scene.prepare(body(), world(air=Air(np.zeros((0, 4)), 0.9)))
    for height in (0.0, 30e3, 150e3):
        density, pressure, _, sound = us76(height)
        got = surroundings.air(prepared.record[0], prepared.tables, height)
        assert got == pytest.approx((0.9 * density, pressure, sound), rel=1e-14)


@pytest.mark.parametrize("latitude", LATITUDES)
def test_wind_blows_in_the_local_level(latitude):
    table = np.array([[0.0, 3.0, -4.0], [10e3, 13.0, 16.0], [20e3, 0.0, 40.0]])
    prepared = scene.prepare(body(), world(wind=table))
    s, tables = prepared.record[0], prepared.tables
    longitude = 0.0 if abs(latitude) > 1.5707 else -2.1  # at a pole any longitude will do
    for height, north, east in ((-10.0, 3.0, -4.0), (5e3, 8.0, 6.0), (15e3, 6.5, 28.0), (30e3, 0.0, 40.0)):
        r_e = wgs84.ecef_from_geodetic(latitude, longitude, height)
        h, sine, cosine = surroundings.level(*WGS84, *r_e)
        wind = surroundings.wind_e(s, tables, 0.0, h, sine, cosine, r_e[0], r_e[1])
        expected = wgs84.dcm_en(latitude, longitude) @ [north, east, 0.0]
        assert np.allclose(wind, expected, atol=2e-6)


def test_a_wind_of_one_height_is_that_of_all():
    prepared = scene.prepare(body(), world(wind=np.array([[500.0, 3.0, -4.0]])))
    for height in (0.0, 500.0, 9e3):
        wind = surroundings.wind_e(prepared.record[0], prepared.tables, 9.0, height, 0.0, 1.0, 7e6, 0.0)
        assert wind == pytest.approx((0.0, -4.0, 3.0))  # over the equator: east is y, north is z


def test_a_wind_changes_over_the_time():
    """Linear in height and in time, as a table of both says; constant before the first and after the last."""
    rows, times = (
        np.array([[0.0, 1.0, 2.0, 3.0, 6.0, -5.0, 0.0], [1e3, 5.0, 4.0, 9.0, 8.0, 1.0, 2.0]]),
        (0.0, 10.0, 40.0),
    )
    around = surroundings.surround(POINT, STILL, RAIL, STANDARD, rows, times)
    prepared = scene.prepare(body(), around)
    for t_s in (-5.0, 0.0, 2.5, 10.0, 25.0, 40.0, 99.0):
        for height in (-10.0, 0.0, 250.0, 1000.0, 2000.0):
            seen = surroundings.wind_e(prepared.record[0], prepared.tables, t_s, height, 0.0, 1.0, 7e6, 0.0)
            at = [np.interp(height, rows[:, 0], column) for column in rows.T[1:]]
            north, east = np.interp(t_s, times, at[0::2]), np.interp(t_s, times, at[1::2])
            assert seen == pytest.approx((0.0, east, north), abs=1e-12)


def test_a_wind_of_one_height_changes_over_the_time():
    around = surroundings.surround(
        POINT, STILL, RAIL, STANDARD, np.array([[0.0, 1.0, 2.0, 3.0, 6.0]]), (0.0, 10.0)
    )
    prepared = scene.prepare(body(), around)
    seen = surroundings.wind_e(prepared.record[0], prepared.tables, 5.0, 4e3, 0.0, 1.0, 7e6, 0.0)
    assert seen == pytest.approx((0.0, 4.0, 2.0))


def test_unordered_tables_are_refused():
    falling = np.array([[1e3, 0.0, 0.0], [0.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match="heights of the wind"):
        surroundings.surround(POINT, STILL, RAIL, STANDARD, falling)
    with pytest.raises(ValueError, match="times of the wind"):
        surroundings.surround(POINT, STILL, RAIL, STANDARD, np.zeros((1, 5)), (1.0, 1.0))
    air = np.array([[1e3, 0.0, 0.0, 300.0], [0.0, 0.0, 0.0, 300.0]])
    with pytest.raises(ValueError, match="air"):
        surroundings.surround(POINT, STILL, RAIL, Air(air, 1.0), CALM)
    with pytest.raises(ValueError, match="two heights"):
        surroundings.surround(POINT, STILL, RAIL, Air(air[:1], 1.0), CALM)


def test_the_world_keeps_copies_of_its_own():
    wind = np.array([[0.0, 1.0, 2.0], [1e3, 1.0, 2.0]])
    wind.flags.writeable = False
    strided = np.asfortranarray(frames.dcm_ie(EARTH, 5.0))
    around = surroundings.surround(NONE, EARTH._replace(C_iq=strided), RAIL, STANDARD, wind)
    for array in (around.wind, around.air, around.earth.C_iq, around.rail.r_e, around.shape):
        assert array.flags.writeable
        assert array.flags.c_contiguous


def test_rest_on_the_earth():
    r_e, q_eb = wgs84.ecef_from_geodetic(1.2, 0.3, 10.0), np.array([0.5, -0.5, 0.5, 0.5])
    t_s, states = np.array([-10.0, 0.0, 300.0]), np.empty((3, dynamics.STATE))
    surroundings.rest_on_earth(EARTH, r_e, q_eb, t_s, states)
    for t, x in zip(t_s, states, strict=True):
        back_e, v_e = frames.ecef_from_inertial(EARTH, t, x[0:3], x[3:6])
        assert np.allclose(back_e, r_e, atol=1e-8)
        assert np.allclose(v_e, 0.0, atol=1e-10)
        C_eb = frames.dcm_ie(EARTH, t).T @ rotation.dcm_from_quat(x[6:10])
        assert np.allclose(C_eb, rotation.dcm_from_quat(q_eb), atol=1e-14)
