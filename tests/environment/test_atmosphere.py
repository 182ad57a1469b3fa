"""US Standard Atmosphere 1976 against its own printed tables: NOAA-S/T 76-1562, table I."""

import importlib
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from shefex_nav.environment import atmosphere
from shefex_nav.environment.atmosphere import EARTH_RADIUS, G_0, us76

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

# geometric height km, temperature K, pressure Pa, density kg/m^3, with the digits as printed
PRINTED = """
    0   288.150 1.01325E+5 1.2250E+0
    5   255.676 5.4048E+4  7.3643E-1
    11  216.774 2.2699E+4  3.6480E-1
    20  216.650 5.5293E+3  8.8910E-2
    30  226.509 1.1970E+3  1.8410E-2
    50  270.650 7.9779E+1  1.0269E-3
    70  219.585 5.2209E+0  8.2829E-5
    80  198.639 1.0524E+0  1.8458E-5
    86  186.87  3.7338E-1  6.958E-6
    88  186.87  2.6173E-1  4.875E-6
    90  186.87  1.8359E-1  3.416E-6
    91  186.87  1.5381E-1  2.860E-6
    95  188.42  7.5966E-2  1.393E-6
    97  -       5.3571E-2  9.685E-7
    99  -       3.7948E-2  6.725E-7
    100 195.08  3.2011E-2  5.604E-7
    101 -       2.7192E-2  -
    103 -       1.9742E-2  -
    105 208.84  1.4477E-2  -
    110 240.00  7.1042E-3  9.708E-8
    112 -       5.5547E-3  6.838E-8
    114 -       4.4473E-3  4.975E-8
    115 -       4.0096E-3  -
    116 -       3.6312E-3  3.720E-8
    118 -       3.0144E-3  2.847E-8
    120 360.00  2.5382E-3  2.222E-8
    130 469.27  1.2505E-3  8.152E-9
    140 559.63  7.2028E-4  3.831E-9
    150 634.39  4.5422E-4  2.076E-9
    160 696.29  3.0395E-4  1.233E-9
    170 -       2.1210E-4  7.815E-10
    180 790.07  1.5271E-4  5.194E-10
    190 -       1.1266E-4  3.581E-10
    200 854.56  8.4736E-5  2.541E-10
    220 -       5.0149E-5  1.367E-10
    240 -       3.1059E-5  7.858E-11
    250 941.33  2.4767E-5  6.073E-11
    260 -       1.9894E-5  4.742E-11
    280 -       1.3076E-5  2.971E-11
    300 976.01  8.7704E-6  1.916E-11
    320 -       5.9796E-6  1.264E-11
    340 -       4.1320E-6  8.503E-12
    360 -       2.8878E-6  5.805E-12
    380 -       2.0384E-6  4.013E-12
    400 995.83  1.4518E-6  2.803E-12
    420 -       1.0427E-6  1.975E-12
    440 -       7.5517E-7  1.402E-12
    460 -       5.5155E-7  1.002E-12
    480 -       4.0642E-7  7.208E-13
    500 999.24  3.0236E-7  5.215E-13
    600 999.85  8.2130E-8  1.137E-13
    700 999.97  3.1908E-8  3.070E-14
    800 999.99  1.7036E-8  1.136E-14
    900 -       1.0873E-8  5.759E-15
    1000 1000.0 7.5138E-9  3.561E-15
"""


@pytest.mark.parametrize("row", PRINTED.split("\n")[1:-1])
def test_printed_tables(row):
    height_km, temperature, pressure, density = row.split()
    rho, p, t, _ = us76(1e3 * float(height_km))
    # to half a unit of the last digit printed, and 1e-4 to 500 km: worst is pressure, 4e-5 at 110 km
    share = 5e-5 if float(height_km) <= 500.0 else 1e-4
    for value, printed in ((t, temperature), (p, pressure), (rho, density)):
        if printed != "-":
            half = 0.5 * 10.0 ** Decimal(printed).as_tuple().exponent
            assert abs(value - float(printed)) < half * 1.01 + share * float(printed)


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


@pytest.fixture
def equations(monkeypatch):
    """The equations of the Standard above 86 km: the module that makes the kept table."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("us76_table")


def test_kept_table_is_what_the_equations_give(equations):
    """To the last digits, which depend on the processor; `benchmarks/us76_table.py` writes it."""
    wanted = equations.upper_table()
    assert atmosphere.UPPER.shape == wanted.shape
    assert np.abs(atmosphere.UPPER - wanted).max() < 1e-14


def test_integration_above_86_km_has_converged(equations, monkeypatch):
    monkeypatch.setattr(equations, "FINE", 4 * equations.FINE)
    assert np.abs(equations.upper_table() - atmosphere.UPPER).max() < 1e-7


def test_interpolation_above_86_km_is_close(equations, monkeypatch):
    monkeypatch.setattr(equations, "STEP", 0.5 * equations.STEP)
    between = equations.upper_table()[:, 1::2]
    interpolated = 0.5 * (atmosphere.UPPER[:, 1:] + atmosphere.UPPER[:, :-1])
    assert np.abs(interpolated - between).max() < 4e-5


def test_interpolation_above_86_km_is_smooth():
    heights = np.arange(86e3, 300e3, 100.0)
    density = np.array([us76(h)[0] for h in heights])
    slope = np.diff(np.log(density)) / 100.0
    assert np.all(slope < 0.0)
    # the scale height changes by less than 3 % from one node of the interpolation to the next
    assert np.abs(np.diff(slope) / slope[1:]).max() < 0.03


def test_outside_the_standard():
    assert us76(1.0e6 + 1.0)[:2] == (0.0, 0.0)
    assert us76(-100.0)[1] > 101325.0


def test_no_height_has_no_air():
    """As Python, which tells an index that is none: compiled code read beyond the end of the table."""
    for function in (us76, getattr(us76, "py_func", us76)):
        assert np.isnan(function(np.nan)).all()
