"""The nominal GPS constellation against published figures, and the geometry of signal paths."""

import erfa
import numpy as np
import pytest

from shefex_nav.environment import gnss
from shefex_nav.geometry import wgs84

EPOCH = "2012-06-22T19:18:00Z"
SIDEREAL_DAY_S = 2.0 * np.pi / wgs84.OMEGA
J2 = 1.08262668e-3  # WGS 84 / EGM96


def site(latitude_deg, longitude_deg, height, n):
    r_e = wgs84.ecef_from_geodetic(np.deg2rad(latitude_deg), np.deg2rad(longitude_deg), height)
    return np.tile(r_e, (n, 1))


def test_orbits_are_circular_at_the_published_radius():
    r_e = gnss.positions_e(gnss.nominal_24(EPOCH), np.array([0.0, 250.0, 500.0]))
    assert r_e.shape == (3, 24, 3)
    np.testing.assert_allclose(np.linalg.norm(r_e, axis=-1), 26_559.7e3, rtol=1e-12)
    heights = np.abs(gnss.positions_e(gnss.nominal_24(EPOCH), np.arange(0.0, 43200.0, 60.0))[..., 2])
    assert heights.max() == pytest.approx(26_559.7e3 * np.sin(np.deg2rad(55.0)), rel=1e-4)


def test_rates_are_those_of_the_orbit():
    """Station keeping gives the published node rate and period; J2 theory must agree with both."""
    n = np.sqrt(wgs84.GM / gnss.SEMI_MAJOR_AXIS**3)
    k = 1.5 * J2 * (wgs84.A / gnss.SEMI_MAJOR_AXIS) ** 2 * n
    assert gnss.NODE_RATE == pytest.approx(-k * np.cos(gnss.INCLINATION), rel=1e-3)
    constellation = gnss.nominal_24(EPOCH)
    by_theory = n + k * (3.0 - 4.0 * np.sin(gnss.INCLINATION) ** 2)
    assert constellation.latitude_rate == pytest.approx(by_theory, rel=5e-5)
    assert 2.0 * np.pi / constellation.latitude_rate == pytest.approx(SIDEREAL_DAY_S / 2.0, rel=2e-4)


def test_speed_and_sense_of_motion():
    """In inertial axes 3.87 km/s, eastward at the equator, at 55 degrees to it."""
    constellation = gnss.nominal_24(EPOCH)
    r_e = gnss.positions_e(constellation, np.array([-0.5, 0.0, 0.5]))
    v_e = r_e[2] - r_e[0]
    omega_e = np.array([0.0, 0.0, wgs84.OMEGA])
    v_i = v_e + np.cross(omega_e, r_e[1])
    np.testing.assert_allclose(np.linalg.norm(v_i, axis=1), 3874.0, atol=1.0)
    h = np.cross(r_e[1], v_i)
    np.testing.assert_allclose(h[:, 2] / np.linalg.norm(h, axis=1), np.cos(np.deg2rad(55.0)), atol=1e-4)


def test_ground_tracks_repeat():
    """Two orbits take the time in which the Earth turns once against the drifting nodes."""
    constellation = gnss.nominal_24(EPOCH)
    repeat_s = 2.0 * np.pi / (wgs84.OMEGA - gnss.NODE_RATE)
    r_e = gnss.positions_e(constellation, np.array([100.0, 100.0 + repeat_s]))
    np.testing.assert_allclose(r_e[0], r_e[1], atol=1e-2)


def test_table_is_placed_at_its_sidereal_time():
    """At the epoch of the table, right ascensions of nodes come out when the Earth is turned by GMST."""
    constellation = gnss.nominal_24("1993-07-01T00:00:00Z")
    gmst = erfa.gmst06(2449169.5, 0.0, 2449169.5, 0.0)
    right_ascension_deg = np.rad2deg(constellation.node + gmst) % 360.0
    np.testing.assert_allclose(right_ascension_deg[::4], gnss.NODES_DEG, atol=0.01)
    np.testing.assert_allclose(np.diff(np.sort(gnss.NODES_DEG)), 60.0)


def test_time_zone_of_the_epoch_is_respected():
    r_e = gnss.positions_e(gnss.nominal_24(EPOCH), np.array([0.0]))
    for same in ("2012-06-22T21:18:00+02:00", "2012-06-22T19:18:00"):
        np.testing.assert_allclose(gnss.positions_e(gnss.nominal_24(same), np.array([0.0])), r_e, atol=1e-6)
    later = gnss.positions_e(gnss.nominal_24("2012-06-22T19:28:00Z"), np.array([-600.0]))
    np.testing.assert_allclose(later, r_e, atol=0.1)


@pytest.mark.parametrize(
    ("place", "fewest", "most", "median_pdop"),
    [((69.2942, 16.019, 10.0), 6, 11, 1.96), ((-30.97, 136.5, 100.0), 5, 11, 1.82)],
)
def test_visibility_and_pdop_over_a_day(place, fewest, most, median_pdop):
    """Elevation above 5 degrees at Andoya and Woomera; medians from an independent computation."""
    t_s = np.arange(0.0, SIDEREAL_DAY_S, 120.0)
    r_e = site(*place, len(t_s))
    u_e = gnss.lines_of_sight_e(r_e, gnss.positions_e(gnss.nominal_24(EPOCH), t_s))
    seen = gnss.elevation(r_e, u_e) > np.deg2rad(5.0)
    H = np.concatenate([u_e, np.ones_like(u_e[..., :1])], axis=-1) * seen[..., None]
    pdop = np.sqrt([np.trace(np.linalg.inv(h.T @ h)[:3, :3]) for h in H])
    assert fewest <= seen.sum(axis=1).min() and seen.sum(axis=1).max() <= most
    assert np.median(pdop) == pytest.approx(median_pdop, abs=0.1)


def test_elevation_is_measured_from_the_geodetic_horizontal():
    latitude, longitude = np.deg2rad(69.2942), np.deg2rad(16.019)
    C_en = wgs84.dcm_en(latitude, longitude)
    r_e = site(69.2942, 16.019, 10.0, 1)
    for elevation_deg in (-20.0, 0.0, 5.0, 60.0):
        e, azimuth = np.deg2rad(elevation_deg), 1.0
        u_n = np.array([np.cos(e) * np.cos(azimuth), np.cos(e) * np.sin(azimuth), -np.sin(e)])
        got = gnss.elevation(r_e, (C_en @ u_n)[None, None, :])[0, 0]
        assert np.rad2deg(got) == pytest.approx(elevation_deg, abs=1e-4)


@pytest.mark.parametrize("height", [0.0, 177e3, 1000e3])
def test_lowest_height_of_a_path_against_walking_along_it(height):
    """Within 0.4 % of the smallest geodetic height of points 5 km apart."""
    rng = np.random.default_rng(4)
    r_e = wgs84.ecef_from_geodetic(*rng.uniform(-1.4, 1.4, 2), height)
    u_e = rng.standard_normal((1, 12, 3))
    u_e /= np.linalg.norm(u_e, axis=-1, keepdims=True)
    lowest = gnss.lowest_height(r_e[None], u_e)[0]
    for u, got in zip(u_e[0], lowest, strict=True):
        path = [wgs84.geodetic_from_ecef(r_e + s * u)[2] for s in np.arange(0.0, 10e6, 5e3)]
        if min(path) > -50e3:
            assert got == pytest.approx(min(path), rel=4e-3, abs=10.0)
        else:
            assert got < -40e3
