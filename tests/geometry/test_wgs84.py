"""The ellipsoid against published points, its own inverse, and the definition of the horizon."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shefex_nav.geometry import wgs84


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "height", "r_e"),
    [  # the axes of the ellipsoid are its definition
        (0, 0, 0, [6378137.0, 0, 0]),
        (0, 90, 1000, [0, 6379137.0, 0]),
        (90, 0, 0, [0, 0, 6356752.3142452]),
        (-90, 0, 100, [0, 0, -6356852.3142452]),
    ],
)
def test_ecef_of_points_on_the_axes(lat_deg, lon_deg, height, r_e):
    assert_allclose(
        wgs84.ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height), r_e, atol=1e-6
    )


def test_geodetic_inverts_ecef():
    rng = np.random.default_rng(2)
    for _ in range(300):
        point = rng.uniform(-np.pi / 2, np.pi / 2), rng.uniform(-np.pi, np.pi), rng.uniform(-5e3, 2e6)
        back = wgs84.geodetic_from_ecef(wgs84.ecef_from_geodetic(*point))
        assert_allclose(back[:2], point[:2], atol=1e-13)
        assert_allclose(back[2], point[2], atol=2e-8)


def test_height_at_the_poles():
    assert_allclose(wgs84.geodetic_from_ecef(np.array([0.0, 0.0, wgs84.B + 500.0]))[2], 500.0, atol=1e-8)


def test_local_axes_are_the_gradients_of_the_coordinates():
    lat, lon, h, step = 0.7, -2.1, 5e4, 1e-6
    north = wgs84.ecef_from_geodetic(lat + step, lon, h) - wgs84.ecef_from_geodetic(lat - step, lon, h)
    east = wgs84.ecef_from_geodetic(lat, lon + step, h) - wgs84.ecef_from_geodetic(lat, lon - step, h)
    up = wgs84.ecef_from_geodetic(lat, lon, h + 1) - wgs84.ecef_from_geodetic(lat, lon, h - 1)
    C_en = wgs84.dcm_en(lat, lon)
    for column, axis in zip(C_en.T, (north, east, -up), strict=True):
        assert_allclose(column, axis / np.linalg.norm(axis), atol=1e-8)
    assert_allclose(wgs84.dcm_el(lat, lon), np.column_stack([C_en[:, 1], C_en[:, 0], -C_en[:, 2]]), atol=0)


def touches_earth(r_e, u_e):
    """Does the ray from r_e along u_e meet the ellipsoid? Straight from the quadratic."""
    scale = np.array([1 / wgs84.A, 1 / wgs84.A, 1 / wgs84.B])
    r, u = r_e * scale, u_e * scale
    b = r @ u
    return b < 0 and b * b >= (u @ u) * (r @ r - 1.0)


@pytest.mark.parametrize("lat_deg", [0, 72.5, -40])
@pytest.mark.parametrize("height", [1e3, 177e3, 4e5])
def test_limb_angle_is_zero_where_rays_begin_to_touch_the_earth(lat_deg, height):
    r_e = wgs84.ecef_from_geodetic(np.radians(lat_deg), 0.3, height)
    C_en = wgs84.dcm_en(np.radians(lat_deg), 0.3)
    for azimuth in np.radians([0, 60, 135, 250]):
        for elevation in np.radians([-60, -10, 5, 50, 89]):
            level = C_en @ [np.cos(azimuth), np.sin(azimuth), 0]
            u_e = np.cos(elevation) * level - np.sin(elevation) * C_en[:, 2]
            angle = wgs84.limb_angle(r_e, u_e)
            # turning the direction by the angle towards the nadir must bring it on to the limb
            nadir = -r_e / np.linalg.norm(r_e)
            across = u_e - (u_e @ nadir) * nadir
            across /= np.linalg.norm(across)
            to_nadir = np.arccos(u_e @ nadir) - angle
            for offset, hit in ((-1e-6, True), (1e-6, False)):
                x = to_nadir + offset
                assert touches_earth(r_e, np.cos(x) * nadir + np.sin(x) * across) is np.bool_(hit)


@pytest.mark.parametrize("lat_deg", [0, 53, -40, 89])
@pytest.mark.parametrize("height", [10.0, 0.0, -30.0])
def test_limb_angle_on_the_ground_is_the_elevation(lat_deg, height):
    """In every direction; the horizon of 10 m is 0.10 deg below the horizontal."""
    r_e = wgs84.ecef_from_geodetic(np.radians(lat_deg), 0.3, height)
    C_en = wgs84.dcm_en(np.radians(lat_deg), 0.3)
    dip = np.sqrt(2.0 * max(height, 0.0) / wgs84.A)
    for azimuth in np.radians([0, 60, 180, 250]):
        for elevation in np.radians([-60, -5, 5, 45, 88]):
            level = C_en @ [np.cos(azimuth), np.sin(azimuth), 0]
            u_e = np.cos(elevation) * level - np.sin(elevation) * C_en[:, 2]
            # in the plane of the geocentric nadir, 0.2 deg off the vertical, the limb is as much off
            assert abs(wgs84.limb_angle(r_e, u_e) - elevation - dip) < 2e-3 * np.tan(abs(elevation)) + 1e-4
    assert wgs84.limb_angle(r_e, C_en[:, 2]) == pytest.approx(-np.pi / 2, abs=5e-3)


def test_limb_angle_straight_down_is_finite():
    r_e = wgs84.ecef_from_geodetic(1.2, 0.1, 2e5)
    assert wgs84.limb_angle(r_e, -r_e) < 0
