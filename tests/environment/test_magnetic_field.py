"""Magnetic field: against the test values published with each World Magnetic Model, and closed forms."""

import time

import numpy as np
import pytest
from magnetic_elements import declination_sigma, elements, field_n

from shefex_nav.environment import magnetic_field
from shefex_nav.geometry import wgs84

# From WMM2025_TEST_VALUES.txt of NCEI, which comes with the coefficients (read in its authors' repository,
# github.com/CIRES-Geomagnetism/wmm, wmm/WMM2025_FINAL_TEST_VALUES.txt): every fifth row and those nearest to
# the magnetic poles. year, height [km], latitude, longitude [deg], declination, inclination [deg], H, X, Y,
# Z, F [nT], and the rates of declination, inclination [deg/a], H, X, Y, Z, F [nT/a]
WMM2025 = """
2025.0 28  89 -121  -99.77  88.47  1504  -255  -1482  56194 56214  2.49 -0.01  10.3  62.7 -21.2   18.1   18.3
2025.0 48  80  -96  -29.91  87.77  2164  1876  -1079  55623 55665  1.25 -0.06  55.5  71.6  13.2  -12.1  -10.0
2025.0 39 -59   -8  -15.75 -58.55 14918 14358  -4049 -24389 28590  0.01  0.06  -0.9  -0.1   3.0   55.0  -47.4
2025.0 18   0   21    1.29 -26.06 29282 29275    660 -14317 32595  0.03  0.08  -8.8  -9.1  15.4   54.6  -31.8
2025.5  8 -52  -75   14.91 -49.63 20006 19332   5148 -23533 30887 -0.10 -0.03 -58.5 -47.7 -48.3   44.8  -72.0
2025.5 50 -81  -67   28.13 -67.61 18293 16133   8623 -44412 48032 -0.10  0.02 -12.9   3.6 -34.0   75.0  -74.2
2026.0 83  86  -46  -30.61  86.84  3000  2582  -1528  54279 54362  1.22 -0.00   3.3  35.4  53.4   15.6   15.7
2026.0 82 -64   87  -81.74 -75.40 13974  2007 -13829 -53664 55453 -0.19 -0.03 -23.1 -48.5  16.3  -24.6   18.0
2026.5 64  10   78   -1.53   7.53 39442 39428  -1050   5215 39785  0.03  0.02  27.8  28.4  20.8   18.5   30.0
2026.5 12 -79  115 -137.58 -77.37 13023 -9614  -8786 -58104 59546 -0.24  0.01   7.5 -42.6  35.5   37.0  -34.5
2027.0 67  72 -115   13.73  84.84  5027  4883   1193  55690 55916 -0.32 -0.07  66.6  71.3 -11.1  -50.9  -44.7
2027.0 12 -63  178   57.87 -79.14 11721  6234   9925 -61076 62190  0.15  0.04  27.4 -11.7  39.7   69.3  -62.9
2027.5  0 -13  -59  -17.49 -15.26 22401 21366  -6733  -6112 23220 -0.17 -0.39 -68.9 -86.1 -44.1 -143.2  -28.7
2028.0 75  79  125  -18.59  87.42  2582  2448   -823  57309 57367 -0.91  0.02 -21.2 -33.2 -32.1   39.1   38.1
2028.0 11 -22  -21  -23.24 -57.67 13528 12431  -5338 -21374 25295  0.18 -0.20 -92.6 -68.7  74.7  -16.0  -36.0
2028.5 11  34    0    1.57  46.77 29089 29078    798  30946 42471  0.11  0.01  15.4  13.8  56.9   27.7   30.7
2028.5 55  86   70   67.64  87.57  2370   902   2192  55926 55976  1.34  0.01 -13.2 -56.3   8.9   32.4   31.8
2029.0 50  87 -154  -73.48  89.07   907   258   -869  55992 56000  1.56 -0.06  62.9  41.6 -53.3   13.4   14.4
2029.0 90 -55 -171   38.65 -72.79 16417 12822  10252 -52995 55480  0.12  0.02   2.6 -18.9  27.9   70.3  -66.4
2029.5 33  17    5    0.89  13.77 34026 34022    531   8341 35034  0.08  0.03   3.1   2.4  46.7   17.8    7.2
2029.5 77 -18  138    4.45 -47.55 31848 31751   2472 -34817 47186 -0.04  0.01   0.9   2.5 -20.2   14.3   -9.9
"""
# From WMM2010testvalues.pdf, WMM2015v2testvalues.pdf and WMM2020testvalues.pdf of NCEI (as text in
# github.com/boxpet/pygeomag, test/test_values): year, height, latitude, longitude, X, Y, Z [nT]
EARLIER = """
2010.0   0  80   0  6649.5  -714.6  54346.2
2010.0   0   0 120 39428.8   664.9 -11683.8
2010.0   0 -80 240  5657.7 15727.3 -53407.5
2010.0 100  80   0  6332.2  -729.1  52194.9
2012.5   0  80   0  6658.0  -606.7  54420.4
2012.5   0   0 120 39423.9   608.1 -11540.5
2012.5 100 -80 240  5535.5 14765.4 -50625.9
2015.0   0  80   0  6636.6  -451.9  54408.9
2015.0   0   0 120 39521.1   377.7 -11228.8
2015.0 100 -80 240  5612.2 14789.3 -50385.8
2017.5   0  80   0  6605.2  -298.7  54506.3
2017.5 100   0 120 37584.4   235.7 -10600.5
2017.5   0 -80 240  5864.6 15764.1 -52706.1
2020.0   0  80   0  6570.4  -146.3  54606.0
2020.0 100   0 120 37636.7   104.9 -10474.8
2020.0   0 -80 240  5940.6 15772.1 -52480.8
2022.5 100  80   0  6224.0   -44.5  52527.0
2022.5   0   0 120 39684.7   -42.2 -10809.5
2022.5 100 -80 240  5815.0 14803.0 -49755.3
"""


def table(text):
    return [tuple(float(word) for word in line.split()) for line in text.split("\n") if line]


def field_nt(year, height_km, latitude_deg, longitude_deg):
    """North, east and down [nT]."""
    harmonics = magnetic_field.load(year)
    place = np.radians([latitude_deg, longitude_deg])
    return field_n(harmonics, *place, 1e3 * height_km) * 1e9


@pytest.mark.parametrize("row", table(WMM2025), ids=lambda row: f"{row[0]} {row[2]:g} {row[3]:g}")
def test_published_values_of_wmm2025(row):
    b_n = field_nt(*row[:4]) * 1e-9
    seen = elements(b_n)
    angles = np.degrees([seen.declination, seen.inclination])
    forces = np.array([seen.horizontal, *b_n, seen.total]) * 1e9
    assert np.abs(angles - row[4:6]).max() < 0.0051  # the last digit printed
    assert np.abs(forces - row[6:11]).max() < 0.51


@pytest.mark.parametrize("row", table(WMM2025)[::3], ids=lambda row: f"{row[0]} {row[2]:g} {row[3]:g}")
def test_published_rates_of_wmm2025(row):
    year = min(row[0], 2029.0)  # within one model; the rates of X, Y and Z do not change
    rate = field_nt(year + 0.5, *row[1:4]) - field_nt(year, *row[1:4])
    assert np.abs(2.0 * rate - row[14:17]).max() < 0.051


@pytest.mark.parametrize("row", table(EARLIER), ids=lambda row: f"{row[0]} {row[2]:g} {row[3]:g}")
def test_published_values_of_earlier_models(row):
    assert np.abs(field_nt(*row[:4]) - row[4:]).max() < 0.051


def test_dipole_by_its_closed_form():
    """The three terms of degree 1 are a dipole: B = (3 (m.u) u - m) (a/r)^3, m = (g11, h11, g10)."""
    epoch = 2025.0
    name, arrays = magnetic_field._models()[epoch]
    assert name == "WMM-2025"
    keep = np.zeros((13, 13))
    keep[1] = 1.0
    g, h = arrays[0] * keep, arrays[1] * keep
    factor = -1e-9 / np.sqrt(3.0)
    harmonics = magnetic_field.gravity.from_normalised(6371200.0**2, 6371200.0, g * factor, h * factor)
    moment = np.array([g[1, 1], h[1, 1], g[1, 0]]) * 1e-9
    for r_e in np.random.default_rng(3).normal(size=(20, 3)) * 6.0e6:
        r = np.linalg.norm(r_e)
        u = r_e / r
        expected = (3.0 * (moment @ u) * u - moment) * (6371200.0 / r) ** 3
        assert np.allclose(magnetic_field.field_e(harmonics, r_e), expected, rtol=0, atol=1e-14 * 6e-5)


def test_it_has_no_sources_where_one_flies():
    """Divergence and curl vanish, at the pole too."""
    harmonics = magnetic_field.load(2027.3)
    for r_e in ([6.4e6, 0.0, 0.0], [0.0, 0.0, 6.4e6], [2175000.0, 624500.0, 6043000.0]):
        step, gradient = 10.0, np.empty((3, 3))
        for axis in range(3):
            offset = np.eye(3)[axis] * step
            ends = [magnetic_field.field_e(harmonics, np.array(r_e) + sign * offset) for sign in (1, -1)]
            gradient[:, axis] = (ends[0] - ends[1]) / (2.0 * step)
        size = np.abs(gradient).max()
        assert abs(np.trace(gradient)) < 1e-7 * size
        assert np.abs(gradient - gradient.T).max() < 1e-7 * size


def test_a_year_has_the_model_made_for_it():
    """The mission of 2012 flies in the field of 2012; between models it jumps by less than their errors."""
    for epoch in (2015.0, 2020.0, 2025.0):
        jump = field_nt(epoch, 0, 69.3, 16.0) - field_nt(epoch - 1e-6, 0, 69.3, 16.0)
        assert 0.0 < np.abs(jump).max() < 3.0 * 1e9 * min(magnetic_field.SIGMA_N)


def places(count):
    rng = np.random.default_rng(0)
    return np.degrees([np.arcsin(rng.uniform(-1, 1, count)), rng.uniform(-np.pi, np.pi, count)]).T


def test_error_of_a_carried_model_is_within_what_is_said(monkeypatch):
    """WMM-2010 alone, carried to 2020, 2025 and 2030, against the models made for then: rms of 300 places."""
    truth = {year: [field_nt(year, 0, *place) for place in places(300)] for year in (2020.0, 2025.0, 2030.0)}
    models = magnetic_field._models()
    monkeypatch.setattr(magnetic_field, "_models", lambda: {2010.0: models[2010.0]})
    monkeypatch.setattr(magnetic_field, "LAST_YEAR", 2015.0)
    for year, fields in truth.items():
        carried = [field_nt(year, 0, *place) for place in places(300)]
        rms = np.sqrt(np.mean((np.array(carried) - fields) ** 2, axis=0))
        said = magnetic_field.sigma_n(year) * 1e9
        assert (rms < said).all() and (rms > 0.3 * said).all(), (year, rms, said)


def test_outside_its_years():
    assert max(magnetic_field.sigma_n(2033.0)) == pytest.approx(185e-9, abs=0.5e-9)
    before = magnetic_field.load(1995.0)
    assert magnetic_field.field_e(before, np.array([6.4e6, 0.0, 0.0])).shape == (3,)
    for year in (1989.9, 2050.1, float("nan")):
        with pytest.raises(ValueError, match="made for 2010 to 2030 and carried on to 1990 and 2050 at most"):
            magnetic_field.load(year)


def test_declination_sigma_grows_towards_the_magnetic_pole():
    """About sqrt(0.26^2 + (5417/H)^2) deg, H in nT, as the report has it; useless near the pole."""
    for latitude, longitude in ((48.0, 11.0), (-30.0, 140.0), (0.0, 20.0)):
        b_n = field_nt(2026.0, 0, latitude, longitude) * 1e-9
        published = np.hypot(0.26, 5417e-9 / np.hypot(b_n[0], b_n[1]))
        here = np.degrees(declination_sigma(b_n, 2026.0))
        assert 0.5 * published < here < 1.6 * published
    near = field_nt(2026.0, 0, 86.0, 140.0) * 1e-9
    assert np.degrees(declination_sigma(near, 2026.0)) > 3.0


def test_decimal_year():
    assert magnetic_field.decimal_year("2012-01-01T00:00:00") == 2012.0
    assert magnetic_field.decimal_year("2025-07-02T12:00:00Z") == 2025.5
    assert magnetic_field.decimal_year("2024-07-02T00:00:00+00:00") == 2024.5  # a leap year


def test_fast_enough_for_every_tick():
    """A hundredth of the 10 ms of a tick: 100 us; it takes about half a microsecond."""
    harmonics, r_e = magnetic_field.load(2025.5), wgs84.ecef_from_geodetic(0.8, 0.2, 1e3)
    magnetic_field.field_e(harmonics, r_e)
    begin = time.perf_counter()
    for _ in range(1000):
        magnetic_field.field_e(harmonics, r_e)
    assert (time.perf_counter() - begin) / 1000 < 100e-6
