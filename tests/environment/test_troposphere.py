"""Delay in the air: published zenith values, height, mapping, the ray that grazes."""

import numpy as np
import pytest

from shefex_nav.environment import troposphere

DEG = np.pi / 180.0


def test_zenith_delay_is_that_of_saastamoinen_by_the_pressure_of_the_standard_atmosphere():
    """0.0022768 m/hPa of the pressure (US76: 1013.25, 540.20, 264.36 hPa); scale height within 5 %."""
    for height, pressure_hpa in ((0.0, 1013.25), (5e3, 540.20), (10e3, 264.36)):
        dry = troposphere.DRY_ZENITH * np.exp(-height / troposphere.DRY_HEIGHT)
        assert dry == pytest.approx(0.0022768 * pressure_hpa, rel=0.05)
    assert troposphere.zenith_delay(0.0) == pytest.approx(2.43, abs=0.01)


def test_nothing_is_left_in_space():
    assert troposphere.zenith_delay(75e3) < 2e-4
    assert troposphere.delay(177e3, 0.1, 177e3) < 1e-8


@pytest.mark.parametrize(("elevation", "factor"), [(90, 1.0), (30, 1.993), (15, 3.81), (5, 10.15)])
def test_mapping_against_exact_rays(elevation, factor):
    """Niell's hydrostatic mapping at 45 deg (J. Geophys. Res. 101, 1996, B2): 1.993, 3.81, 10.15; to 2 %."""
    assert troposphere.mapping(elevation * DEG) == pytest.approx(factor, rel=0.02)


def test_ray_that_grazes_the_air_twice_against_straight_lines():
    """From 177 km down to a lowest point of 20 to 60 km and out again, dry air alone dominates there."""
    radius, height = 6371e3, 177e3
    for lowest in (20e3, 40e3, 60e3):
        elevation = -np.arccos((radius + lowest) / (radius + height))
        s = np.linspace(0.0, 6000e3, 60001)
        h = np.sqrt((radius + height) ** 2 + s**2 + 2 * (radius + height) * s * np.sin(elevation)) - radius
        density = troposphere.DRY_ZENITH / troposphere.DRY_HEIGHT * np.exp(-h / troposphere.DRY_HEIGHT)
        expected = np.trapezoid(density, s)
        # the mapping function is a third too small at the horizon
        assert 0.6 < troposphere.delay(height, elevation, lowest) / expected < 1.0
