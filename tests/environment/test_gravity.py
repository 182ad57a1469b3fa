"""Gravitation: against a slow potential, published normal gravity, and closed forms."""

import numpy as np
import pytest
from numpy.polynomial import legendre

from shefex_nav.environment import gravity
from shefex_nav.geometry import wgs84


def potential(cosine, sine, gm, radius, r_e):
    """U of fully normalised coefficients straight from its definition; takes complex coordinates."""
    x, y, z = r_e
    r = np.sqrt(x * x + y * y + z * z)
    total = 0.0
    for n in range(cosine.shape[0]):
        series = np.zeros(n + 1)
        series[n] = 1.0
        c, s = 1.0, 0.0  # (cos(latitude))^m (cos, sin)(m longitude)
        ratio = 1.0  # (n - m)! / (n + m)!
        for m in range(n + 1):
            p_nm = legendre.legval(z / r, legendre.legder(series, m) if m else series)
            norm = np.sqrt((1 if m == 0 else 2) * (2 * n + 1) * ratio)
            total = total + gm / r * (radius / r) ** n * norm * p_nm * (cosine[n, m] * c + sine[n, m] * s)
            c, s = (c * x - s * y) / r, (c * y + s * x) / r
            if m < n:
                ratio /= (n - m) * (n + m + 1)
    return total


def gradient(function, r_e):
    """Derivative by a complex step: exact to rounding."""
    return np.array([function(r_e + 1e-20j * axis).imag for axis in np.eye(3) * 1.0]) / 1e-20


def coefficients(degree, rng):
    """Random harmonics that fall off as Kaula's rule."""
    n = np.arange(degree + 1)[:, None] * np.ones(degree + 1)
    size = 1e-5 / np.maximum(n, 1.0) ** 2 * np.tril(np.ones((degree + 1, degree + 1)))
    cosine, sine = rng.normal(size=size.shape) * size, rng.normal(size=size.shape) * size
    cosine[0, 0], sine[:, 0] = 1.0, 0.0
    return cosine, sine


@pytest.mark.parametrize("degree", [0, 1, 2, 4, 12, 36])
def test_gravity_is_the_gradient_of_the_potential(degree):
    rng = np.random.default_rng(degree)
    cosine, sine = coefficients(degree, rng)
    gm, radius = 4.0e14, 6.4e6
    model = gravity.from_normalised(gm, radius, cosine, sine)
    points = rng.normal(size=(5, 3))
    points *= rng.uniform(6.3e6, 9e6, size=(5, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    points = np.vstack([points, [0.0, 0.0, 6.5e6], [0.0, 0.0, -6.5e6], [7e6, 0.0, 0.0]])
    for r_e in points:
        expected = gradient(lambda r: potential(cosine, sine, gm, radius, r), r_e)
        error = np.abs(gravity.gravity_e(model, r_e) - expected).max()
        assert error < 1e-12 * np.linalg.norm(expected)


def test_egm96_table_has_its_published_low_degrees():
    # unnormalised J2 = -sqrt(5) C20; C22, S22 as published with EGM96
    model = gravity.load_egm96(36)
    assert model.degree == 36
    flat = gravity.load_egm96(2)
    zonal = np.zeros((3, 3))
    zonal[0, 0] = 1.0
    zonal[2] = -0.484165371736e-3, -0.186987635955e-9, 0.243914352398e-5
    sine = np.zeros((3, 3))
    sine[2, 1], sine[2, 2] = 0.119528012031e-8, -0.140016683654e-5
    published = gravity.from_normalised(3.986004415e14, 6378136.3, zonal, sine)
    r_e = np.array([3e6, -4e6, 4.5e6])
    assert np.array_equal(gravity.gravity_e(flat, r_e), gravity.gravity_e(published, r_e))


def test_normal_gravity_of_wgs84():
    # the ellipsoid's even zonals in closed form (Heiskanen & Moritz 2-92) plus the centrifugal acceleration
    # give Somigliana's normal gravity; values: boule 0.6.0
    cosine = np.zeros((13, 13))
    cosine[0, 0] = 1.0
    for n in range(1, 7):
        ratio = 1.0 - n + 5.0 * n * gravity.J2_WGS84 / wgs84.E2
        j_2n = (-1) ** (n + 1) * 3.0 * wgs84.E2**n / ((2 * n + 1) * (2 * n + 3)) * ratio
        cosine[2 * n, 0] = -j_2n / np.sqrt(4 * n + 1)
    model = gravity.from_normalised(wgs84.GM, wgs84.A, cosine, np.zeros((13, 13)))
    for latitude, value in (
        (0.0, 9.78032533590406),
        (45.0, 9.806197769377293),
        (90.0, 9.832184937863067),
        (69.2942, 9.825676743958033),
    ):
        r_e = wgs84.ecef_from_geodetic(np.deg2rad(latitude), 0.3, 0.0)
        g = gravity.gravity_e(model, r_e) + wgs84.OMEGA**2 * r_e * np.array([1.0, 1.0, 0.0])
        assert np.linalg.norm(g) == pytest.approx(value, abs=2e-9)


def test_j2_closed_form():
    zonal = np.zeros((3, 3))
    zonal[0, 0], zonal[2, 0] = 1.0, -gravity.J2_WGS84 / np.sqrt(5.0)
    model = gravity.from_normalised(wgs84.GM, wgs84.A, zonal, np.zeros((3, 3)))
    for r_e in np.array([[6.5e6, 0.0, 0.0], [0.0, 0.0, 6.4e6], [2e6, -1e6, 6.1e6]]):
        assert np.allclose(gravity.gravity_j2_e(r_e), gravity.gravity_e(model, r_e), rtol=1e-14, atol=1e-14)


def test_truth_differs_from_on_board_by_what_a_real_field_does():
    # the on-board J2 model is wrong by tens of micro-g, no more and no less
    r_e = wgs84.ecef_from_geodetic(np.deg2rad(75.0), 0.25, 150e3)
    difference = np.linalg.norm(gravity.gravity_e(gravity.load_egm96(36), r_e) - gravity.gravity_j2_e(r_e))
    assert 5e-5 < difference < 1e-3  # m/s^2


@pytest.mark.parametrize("degree", [-1, 37])
def test_degree_beyond_the_table_is_refused(degree):
    with pytest.raises(ValueError, match="0 to 36"):
        gravity.load_egm96(degree)
