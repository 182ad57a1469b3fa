"""US Standard Atmosphere 1976 against its own printed tables."""

import numpy as np
import pytest

from shefex_nav.environment.atmosphere import EARTH_RADIUS, G_0, us76

# geometric height km, temperature K, pressure Pa, density kg/m^3: NOAA-S/T 76-1562, tables I
PRINTED = [
    (0.0, 288.150, 1.01325e5, 1.2250),
    (5.0, 255.676, 5.4048e4, 7.3643e-1),
    (11.0, 216.774, 2.2699e4, 3.6480e-1),
    (20.0, 216.650, 5.5293e3, 8.8910e-2),
    (30.0, 226.509, 1.1970e3, 1.8410e-2),
    (50.0, 270.650, 7.9779e1, 1.0269e-3),
    (70.0, 219.585, 5.2209e0, 8.2829e-5),
    (80.0, 198.639, 1.0524e0, 1.8458e-5),
    (86.0, 186.87, 3.7338e-1, 6.958e-6),
    (100.0, 195.08, 3.2011e-2, 5.604e-7),
    (110.0, 240.00, 7.1042e-3, 9.708e-8),
    (120.0, 360.00, 2.5382e-3, 2.222e-8),
    (150.0, 634.39, 4.5422e-4, 2.076e-9),
    (200.0, 854.56, 8.4736e-5, 2.541e-10),
    (300.0, 976.01, 8.7704e-6, 1.916e-11),
    (400.0, 995.83, 1.4518e-6, 2.803e-12),
    (500.0, 999.24, 3.0236e-7, 5.215e-13),
    (800.0, 999.99, 1.7036e-8, 1.136e-14),
]


@pytest.mark.parametrize("height_km, temperature, pressure, density", PRINTED)
def test_printed_tables(height_km, temperature, pressure, density):
    rho, p, t, _ = us76(1e3 * height_km)
    assert t == pytest.approx(temperature, abs=6e-3)
    # four to five printed digits
    assert p == pytest.approx(pressure, rel=3e-4)
    assert rho == pytest.approx(density, rel=3e-4)


def test_speed_of_sound():
    assert us76(0.0)[3] == pytest.approx(340.294, abs=1e-3)
    assert us76(20e3)[3] == pytest.approx(295.07, abs=5e-3)


@pytest.mark.parametrize(
    "height_km", [11.019, 20.063, 32.162, 47.350, 51.413, 71.802, 80.0, 86.0, 91.0, 110.0, 120.0]
)
def test_no_steps_where_formulas_meet(height_km):
    below, above = us76(1e3 * height_km - 1e-3), us76(1e3 * height_km + 1e-3)
    assert np.allclose(below, above, rtol=2e-5)


def test_hydrostatic_balance():
    for height in np.arange(500.0, 85e3, 777.0):
        gradient = (us76(height + 1.0)[1] - us76(height - 1.0)[1]) / 2.0
        weight = us76(height)[0] * G_0 * (EARTH_RADIUS / (EARTH_RADIUS + height)) ** 2
        assert gradient == pytest.approx(-weight, rel=2e-6)


def test_interpolation_above_86_km_is_smooth():
    heights = np.arange(86e3, 300e3, 100.0)
    density = np.array([us76(h)[0] for h in heights])
    slope = np.diff(np.log(density)) / 100.0
    assert np.all(slope < 0.0)
    # the scale height changes by less than 3 % from one node of the interpolation to the next
    assert np.abs(np.diff(slope) / slope[1:]).max() < 0.03


def test_outside_the_standard():
    assert us76(1.0e6)[:2] == (0.0, 0.0)
    assert us76(-100.0)[1] > 101325.0
