"""The broadcast model of the ionosphere against published figures, and the layer above a height."""

import numpy as np
import pytest
from scipy.integrate import quad

from shefex_nav.environment import ionosphere

DEG = np.pi / 180.0
ALPHA, BETA = [0.2e-7, -0.8e-8, -0.5e-7, 0.1e-6], [0.2e6, 0.2e6, -0.1e6, -0.1e7]
# place [deg], azimuth and elevation [deg], hour of the day, delay [m]: test figures of RTKLIB 2.4.2,
# test/utest/t_atmos.c (T. Takasu), GPS time
PUBLISHED = [
    ((35, 140), (60, 75), 1, 6.73590532099438),
    ((-80, -170), (60, 75), 1, 3.56895382197387),
    ((10, 30), (60, 75), 1, 3.80716435655161),
    ((35, 140), (60, 75), 13, 5.21796954585452),
    ((35, 140), (60, 75), 22, 5.90190539264777),
    ((35, 140), (190, 3), 1, 21.6345415123632),
    ((35, 140), (350, 60), 1, 7.33844278822561),
    ((35, 140), (0, 90), 1, 6.58339711400694),
]


@pytest.mark.parametrize(("place", "direction", "hour", "delay"), PUBLISHED)
def test_broadcast_model_against_published_figures(place, direction, hour, delay):
    latitude, longitude = np.array(place) * DEG
    azimuth, elevation = np.array(direction) * DEG
    # 16 January 2007 is a Tuesday: seconds of the week, as a receiver would use them
    gps_s = (2 * 24 + hour) * 3600.0
    got = ionosphere.klobuchar(ALPHA, BETA, latitude, longitude, elevation, azimuth, gps_s)
    assert got == pytest.approx(delay, abs=1e-8)


def test_share_above_is_the_integral_of_the_chapman_layer():
    def density(h):
        z = (h - ionosphere.PEAK_HEIGHT) / ionosphere.SCALE_HEIGHT
        return np.exp(0.5 * (1.0 - z - np.exp(-z)))

    def electrons(low):
        return quad(density, low, 3000e3, limit=200, points=[max(low, ionosphere.PEAK_HEIGHT)])[0]

    whole = electrons(-200e3)
    for height in (0.0, 100e3, 177e3, 250e3, 350e3, 500e3, 900e3):
        assert ionosphere.share_above(height) == pytest.approx(electrons(height) / whole, abs=1e-6)
    assert ionosphere.share_above(0.0) == pytest.approx(1.0, abs=1e-6)
    assert ionosphere.share_above(20_200e3) < 1e-12


@pytest.mark.parametrize("height", [0.0, 177e3, 350e3, 500e3])
def test_zenith_ray_meets_the_share_above(height):
    assert ionosphere.electrons(height, 0.5 * np.pi) == pytest.approx(
        ionosphere.share_above(height), abs=2e-3
    )
    share = ionosphere.slant_share(height, 0.5 * np.pi)
    assert share == pytest.approx(ionosphere.share_above(height), abs=2e-3)


@pytest.mark.parametrize("elevation", [10, 20, 45, 70])
def test_slant_from_the_ground_is_about_the_obliquity_of_the_broadcast_model(elevation):
    """Klobuchar (IEEE Trans. AES-23, 1987) gives his for a shell at 350 km, within 2 % above 5 degrees."""
    shell = 1.0 / np.sqrt(1.0 - (6371.0 / 6721.0 * np.cos(elevation * DEG)) ** 2)
    assert ionosphere.obliquity(elevation * DEG) == pytest.approx(shell, rel=0.03)
    assert ionosphere.electrons(0.0, elevation * DEG) == pytest.approx(shell, rel=0.08)


def test_ray_downwards_against_the_abel_integral():
    """By radius: dr = ds sqrt(1 - (p/r)^2), once from the lowest point up and once to the receiver."""
    radius = 6371e3

    def up(low, p):
        def integrand(x):  # r = low + x^2 takes the singularity at the lowest point away
            r = low + x * x
            z = (r - radius - ionosphere.PEAK_HEIGHT) / ionosphere.SCALE_HEIGHT
            return np.exp(0.5 * (1.0 - z - np.exp(-z))) * r * 2.0 * x / np.sqrt(max(r * r - p * p, 1e-300))

        return quad(integrand, 1e-6, np.sqrt(2500e3), limit=500)[0]

    for height, elevation in ((400e3, -15.0), (600e3, -20.0), (500e3, -5.0), (400e3, 8.0)):
        p = (radius + height) * np.cos(elevation * DEG)
        rest = up(radius + height, p)
        whole = 2.0 * up(p, p) - rest if elevation < 0.0 else rest
        expected = whole / (ionosphere.SCALE_HEIGHT * np.sqrt(2.0 * np.pi * np.e))
        assert ionosphere.electrons(height, elevation * DEG) == pytest.approx(expected, rel=5e-3)


def test_continuous_through_the_horizontal_and_nothing_above_the_layer():
    below, above = (ionosphere.slant_share(177e3, e) for e in (-1e-9, 1e-9))
    assert below == pytest.approx(above, abs=1e-6)
    assert ionosphere.slant_share(3000e3, 0.2) < 1e-8
