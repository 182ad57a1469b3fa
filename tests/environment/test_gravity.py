"""Gravitation: against a slow potential, published normal gravity, and closed forms."""

import csv
from decimal import Decimal, localcontext
from importlib import resources
from math import factorial, sqrt

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.special import lpmv

from shefex_nav.environment import gravity, models
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


def test_the_highest_degree_is_the_gradient_of_its_potential():
    """Terms of that degree alone, by central differences over 100 m, which are good to 1e-7 there."""
    n, rng, gm, radius = models.HIGHEST_DEGREE, np.random.default_rng(1), 4.0e14, 6.4e6
    cosine, sine = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    cosine[n], sine[n, 1:] = rng.normal(size=n + 1), rng.normal(size=n)
    m = np.arange(n + 1)
    norm = np.array(
        [sqrt((1 if k == 0 else 2) * (2 * n + 1) * factorial(n - k) / factorial(n + k)) for k in range(n + 1)]
    )

    def term(r_e):
        r, longitude = np.linalg.norm(r_e), np.arctan2(r_e[1], r_e[0])
        p_nm = norm * (-1.0) ** m * lpmv(m, n, r_e[2] / r)  # without the phase of Condon and Shortley
        waves = cosine[n] * np.cos(m * longitude) + sine[n] * np.sin(m * longitude)
        return gm / r * (radius / r) ** n * (p_nm @ waves)

    model = gravity.from_normalised(gm, radius, cosine, sine)
    for r_e in rng.normal(size=(8, 3)):
        r_e *= 6.5e6 / np.linalg.norm(r_e)
        expected = [(term(r_e + step) - term(r_e - step)) / 200.0 for step in 100.0 * np.eye(3)]
        assert gravity.gravity_e(model, r_e) == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_egm96_table_has_its_published_low_degrees():
    # unnormalised J2 = -sqrt(5) C20; C22, S22 as published with EGM96
    model = gravity.load("egm96", 36)
    assert model.degree == 36
    flat = gravity.load("egm96", 2)
    zonal = np.zeros((3, 3))
    zonal[0, 0] = 1.0
    zonal[2] = -0.484165371736e-3, -0.186987635955e-9, 0.243914352398e-5
    sine = np.zeros((3, 3))
    sine[2, 1], sine[2, 2] = 0.119528012031e-8, -0.140016683654e-5
    published = gravity.from_normalised(3.986004415e14, 6378136.3, zonal, sine)
    r_e = np.array([3e6, -4e6, 4.5e6])
    assert np.array_equal(gravity.gravity_e(flat, r_e), gravity.gravity_e(published, r_e))


def egm96_table():
    """{(n, m): (C, S)} of the file, its digits as they stand."""
    with (resources.files("shefex_nav") / "data" / "egm96_36x36.csv").open(newline="") as lines:
        rows = csv.DictReader(lines)
        table = {
            (int(row["n"]), int(row["m"])): (Decimal(row["C_normalised"]), Decimal(row["S_normalised"]))
            for row in rows
        }
    return {(0, 0): (Decimal(1), Decimal(0))} | table


def potential_in_decimals(table, degree, x, y, z):
    """R U / GM by unnormalised Legendre functions, column by column; `Decimal` in and out."""
    r = (x * x + y * y + z * z).sqrt()
    t, radius = z / r, Decimal("6378136.3")
    total = Decimal(0)
    cosine, sine = Decimal(1), Decimal(0)  # of m longitude, times cos(latitude)^m
    sector = Decimal(1)  # d^m P_m / dt^m = (2 m - 1)!!
    for m in range(degree + 1):
        before, p = Decimal(0), sector
        norm = Decimal(1 if m == 0 else 2)  # (n - m)! / (n + m)! times the factor of the order
        for k in range(1, 2 * m + 1):
            norm /= k
        for n in range(m, degree + 1):
            c, s = table.get((n, m), (Decimal(0), Decimal(0)))
            total += (radius / r) ** (n + 1) * (norm * (2 * n + 1)).sqrt() * p * (c * cosine + s * sine)
            before, p = p, ((2 * n + 1) * t * p - (n + m) * before) / (n - m + 1)
            norm *= Decimal(n - m + 1) / Decimal(n + m + 1)
        cosine, sine = (cosine * x - sine * y) / r, (cosine * y + sine * x) / r
        sector *= 2 * m + 1
    return total


PLACES = [  # m: both poles, equator, the launch site, low and high, far away
    (0.0, 0.0, 6356752.0),
    (0.0, 0.0, -6700000.0),
    (6378137.0, 0.0, 0.0),
    (-1e-3, 2e-3, 6400000.0),
    (2175000.0, 624500.0, 5943000.0),
    (-4500000.0, 3000000.0, -3700000.0),
    (1.2e7, -3.0e7, 2.5e7),
]


@pytest.mark.parametrize("degree", [2, 3, 12, 36])
def test_egm96_in_fifty_digits(degree):
    # gradient by central differences over 1e-12 m, wrong by 1e-37 of it: the rounding of the model is left
    table, model = egm96_table(), gravity.load("egm96", degree)
    with localcontext(prec=60):
        step = Decimal("1e-12")
        scale = Decimal("3.986004415e14") / Decimal("6378136.3") / (2 * step)
        for place in PLACES:
            r = [Decimal(c) for c in place]
            expected = []
            for axis in range(3):
                ends = []
                for sign in (1, -1):
                    moved = list(r)
                    moved[axis] += sign * step
                    ends.append(potential_in_decimals(table, degree, *moved))
                expected.append(float(scale * (ends[0] - ends[1])))
            error = np.abs(gravity.gravity_e(model, np.array(place)) - expected).max()
            assert error < 1e-14 * degree * np.linalg.norm(expected)


def even_zonals():
    """Normalised C20, C40 ... of the ellipsoid, and their J2: Heiskanen & Moritz 2-90 and 2-92."""
    b = wgs84.B
    focus = np.sqrt(wgs84.A**2 - b**2)
    m = wgs84.OMEGA**2 * wgs84.A**2 * b / wgs84.GM
    q_0 = 0.5 * ((1.0 + 3.0 * b**2 / focus**2) * np.arctan(focus / b) - 3.0 * b / focus)
    j2 = wgs84.E2 / 3.0 * (1.0 - 2.0 / 15.0 * m * focus / b / q_0)
    cosine = np.zeros((21, 21))
    cosine[0, 0] = 1.0
    for n in range(1, 11):
        ratio = 1.0 - n + 5.0 * n * j2 / wgs84.E2
        j_2n = (-1) ** (n + 1) * 3.0 * wgs84.E2**n / ((2 * n + 1) * (2 * n + 3)) * ratio
        cosine[2 * n, 0] = -j_2n / np.sqrt(4 * n + 1)
    return cosine, j2


def turning(r_e):
    """Centrifugal acceleration."""
    return wgs84.OMEGA**2 * r_e * np.array([1.0, 1.0, 0.0])


# m/s^2 at 0, 1, 100, 177, 1000 km by latitude: boule 0.6.0, which gives the component along the normal of the
# confocal ellipsoid
BOULE = {
    0.0: (9.78032533590406, 9.777238264593727, 9.478661321437203, 9.255729949317944, 7.291917597927627),
    45.0: (9.806197769377293, 9.803112896926828, 9.504743909688264, 9.28196222489686, 7.319371286250578),
    90.0: (9.832184937863067, 9.829102274251976, 9.530942199932175, 9.308310903555581, 7.346946649429957),
    69.2942: (9.825676743958033, 9.822593527150861, 9.524381130091083, 9.301712167413568, 7.340040718837246),
    -30.97: (9.794013247588042, 9.79092733955989, 9.49246041151662, 9.269608227123724, 7.306442085412644),
}
HEIGHTS = (0.0, 1e3, 100e3, 177e3, 1000e3)


@pytest.mark.parametrize("latitude", BOULE)
def test_normal_gravity(latitude):
    cosine, j2 = even_zonals()
    assert j2 == pytest.approx(gravity.J2_WGS84, abs=5e-12)
    series = gravity.from_normalised(wgs84.GM, wgs84.A, cosine, np.zeros_like(cosine))
    for height, value in zip(HEIGHTS, BOULE[latitude], strict=True):
        r_e = wgs84.ecef_from_geodetic(np.deg2rad(latitude), 0.3, height)
        g_e = gravity.normal_gravity_e(r_e)
        # the closed form is the sum of the ellipsoid's harmonics
        assert np.allclose(g_e, gravity.gravity_e(series, r_e) + turning(r_e), rtol=0.0, atol=5e-12)
        # confocal ellipsoid through r_e: x^2 / (u^2 + E^2) + z^2 / u^2 = 1
        focus2 = wgs84.A**2 - wgs84.B**2
        half = 0.5 * (r_e @ r_e - focus2)
        u2 = half + np.sqrt(half**2 + focus2 * r_e[2] ** 2)
        normal = r_e / np.array([u2 + focus2, u2 + focus2, u2])
        assert -(g_e @ normal) / np.linalg.norm(normal) == pytest.approx(value, abs=5e-12)


def test_normal_gravity_on_the_ellipsoid():
    # perpendicular to it, of the size of Somigliana's formula with the constants of TR8350.2
    for latitude in np.deg2rad([-90.0, -33.0, 0.0, 12.0, 69.2942, 90.0]):
        down = wgs84.dcm_en(latitude, -1.1)[:, 2]
        g_e = gravity.normal_gravity_e(wgs84.ecef_from_geodetic(latitude, -1.1, 0.0))
        s2 = np.sin(latitude) ** 2
        size = 9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - wgs84.E2 * s2)
        assert np.allclose(g_e, size * down, rtol=0.0, atol=1e-9)


def test_j2_is_the_normal_gravity_but_for_the_higher_zonals():
    # what the J2 field leaves out of the ellipsoid's own: J4 = -2.37e-6 makes up to 1e-4 m/s^2
    worst = 0.0
    for latitude in np.deg2rad(np.arange(-90.0, 91.0, 7.5)):
        r_e = wgs84.ecef_from_geodetic(latitude, 2.0, 0.0)
        difference = gravity.gravity_j2_e(r_e) + turning(r_e) - gravity.normal_gravity_e(r_e)
        worst = max(worst, np.linalg.norm(difference))
    assert 5e-5 < worst < 1.5e-4


def test_j2_closed_form():
    zonal = np.zeros((3, 3))
    zonal[0, 0], zonal[2, 0] = 1.0, -gravity.J2_WGS84 / np.sqrt(5.0)
    model = gravity.from_normalised(wgs84.GM, wgs84.A, zonal, np.zeros((3, 3)))
    for r_e in np.array([[6.5e6, 0.0, 0.0], [0.0, 0.0, 6.4e6], [2e6, -1e6, 6.1e6]]):
        assert np.allclose(gravity.gravity_j2_e(r_e), gravity.gravity_e(model, r_e), rtol=1e-14, atol=1e-14)


def test_truth_differs_from_on_board_by_what_a_real_field_does():
    # the on-board J2 model is wrong by tens of micro-g, no more and no less
    r_e = wgs84.ecef_from_geodetic(np.deg2rad(75.0), 0.25, 150e3)
    difference = np.linalg.norm(gravity.gravity_e(gravity.load("egm96", 36), r_e) - gravity.gravity_j2_e(r_e))
    assert 5e-5 < difference < 1e-3  # m/s^2


def test_fields_by_name():
    r_e = np.array([3.1e6, -2.2e6, 5.4e6])
    assert np.allclose(gravity.gravity_e(gravity.load("j2"), r_e), gravity.gravity_j2_e(r_e), rtol=1e-14)
    point = gravity.gravity_e(gravity.load("point"), r_e)
    assert np.allclose(point, -wgs84.GM * r_e / np.linalg.norm(r_e) ** 3, rtol=1e-14)
    fifth = gravity.gravity_e(gravity.load("egm96", 5), r_e)
    cut = [part[:6, :6] if np.ndim(part) else part for part in gravity.egm96(36)]
    assert np.array_equal(fifth, gravity.gravity_e(gravity.from_normalised(*cut), r_e))


@pytest.mark.parametrize("degree", [-1, 37])
def test_degree_beyond_the_table_is_refused(degree):
    with pytest.raises(ValueError, match="0 to 36"):
        gravity.egm96(degree)


@pytest.mark.parametrize(
    "kind, degree, message", [("egm96", 1, "from degree 2"), ("egm2008", 12, "egm96, j2, point")]
)
def test_unknown_fields_are_refused(kind, degree, message):
    with pytest.raises(ValueError, match=message):
        gravity.load(kind, degree)
