"""The broadcast model of the ionosphere against published figures, and the layer above a height."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erf

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


@pytest.mark.parametrize(("height", "share"), [(0.0, 1.0), (177e3, None), (350e3, 0.6827), (500e3, None)])
def test_zenith_ray_meets_what_of_the_layer_is_above(height, share):
    """Closed form of the layer's integral; at the peak erf(1/sqrt(2)), what a Gaussian has within 1 sigma."""
    above = erf(np.exp(-0.5 * (height - 350e3) / 60e3) / np.sqrt(2.0))
    assert share is None or above == pytest.approx(share, abs=1e-4)
    assert ionosphere.electrons(height, 0.5 * np.pi) == pytest.approx(above, abs=2e-3)
    assert ionosphere.slant_share(height, 0.5 * np.pi) == pytest.approx(above, abs=2e-3)


@pytest.mark.parametrize("elevation", [0, 2, 10, 30, 60])
def test_slant_share_is_the_ratio_of_two_integrals_along_rays(elevation):
    """By quadrature along the ray, from 300 km and from the ground; low rays meet more than on the ground."""

    def met(height):
        def density(s):
            r = 6371e3 + height
            h = np.sqrt(r**2 + s**2 + 2.0 * r * s * np.sin(elevation * DEG)) - 6371e3
            z = (h - 350e3) / 60e3
            return np.exp(0.5 * (1.0 - z - np.exp(-z)))

        return quad(density, 0.0, 6000e3, limit=500, points=[500e3, 1500e3, 2500e3])[0]

    share = ionosphere.slant_share(300e3, elevation * DEG)
    assert share == pytest.approx(met(300e3) / met(0.0), rel=5e-3)
    assert (share > 1.0) == (elevation < 30)


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


@pytest.mark.parametrize("height", [1000e3, 2000e3, 5000e3, 8000e3, 20200e3, 36000e3])
@pytest.mark.parametrize("lowest", [200e3, 350e3, 500e3, 800e3])
def test_ray_that_grazes_the_layer_meets_both_halves_from_any_height(height, lowest):
    """The layer about the lowest point by quadrature; it is symmetric."""
    radius, p = 6371e3 + height, 6371e3 + lowest
    before = np.sqrt(radius**2 - p**2)

    def density(s):
        z = (np.hypot(p, s) - 6371e3 - 350e3) / 60e3
        return np.exp(0.5 * (1.0 - z - np.exp(-z)))

    far, near = (quad(density, 0.0, min(end, 7000e3), limit=500)[0] for end in (7000e3, before))
    expected = (far + near) / (60e3 * np.sqrt(2.0 * np.pi * np.e))
    got = ionosphere.electrons(height, -np.arccos(p / radius))
    assert got == pytest.approx(expected, rel=2e-3)


def test_grazing_rays_change_evenly_with_the_height_of_the_receiver():
    """Where the sum begins moves on with the height, and no step comes of it; rays at 350 km."""
    heights = np.linspace(500e3, 3000e3, 2501)
    met = ionosphere.electrons(heights, -np.arccos(6721e3 / (6371e3 + heights)))
    assert np.abs(np.diff(met)[heights[:-1] > 1200e3]).max() < 2e-3
    assert np.abs(np.diff(met, 2)).max() < 1e-3


def test_continuous_through_the_horizontal_and_nothing_above_the_layer():
    below, above = (ionosphere.slant_share(177e3, e) for e in (-1e-9, 1e-9))
    assert below == pytest.approx(above, abs=1e-6)
    assert ionosphere.slant_share(3000e3, 0.2) < 1e-8
