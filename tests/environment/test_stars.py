"""The star catalogue against published counts, ERFA and simple geometry."""

import csv
import gzip
import io
from importlib.resources import files

import erfa
import numpy as np
import pytest

from shefex_nav.environment import stars
from shefex_nav.environment.constants import SPEED_OF_LIGHT

ARCSEC = np.pi / 180.0 / 3600.0
PIXEL = 9.9e-6 / 24.95e-3  # rad, pixel of the SHEFEX-2 star camera


@pytest.fixture(scope="module")
def catalogue():
    return stars.load_catalogue(np.inf)


def synthetic(ra_dec_arcsec, vmag, bv):
    """Stars within a few arcseconds of RA = Dec = 0."""
    a, d = ARCSEC * np.asarray(ra_dec_arcsec, dtype=float).T
    u_i = np.column_stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)])
    n = len(u_i)
    vmag, bv = np.asarray(vmag, dtype=float), np.asarray(bv, dtype=float)
    return stars.StarCatalogue(np.arange(1, n + 1), u_i, np.zeros((n, 3)), vmag, vmag + 0.1, bv, 2012.0)


def test_counts_by_hp_are_those_of_the_literature(catalogue):
    # table 2 of "Brightness Independent/Referenced Star Identification": Hp bins of the Hipparcos catalogue
    counts = np.histogram(catalogue.hpmag, [-2.0, 3.0, 4.0, 5.0, 6.0, 7.0 - 1e-9])[0]
    assert list(counts) == [165, 315, 991, 3088, 9381]
    assert np.count_nonzero(catalogue.hpmag < 5.0) == 1471


def test_counts_by_v(catalogue):
    assert len(catalogue.hip) == 41079
    assert np.count_nonzero(catalogue.vmag < 8.0) == 41074
    assert np.count_nonzero(catalogue.vmag <= 5.5) == 2851
    assert np.count_nonzero(catalogue.vmag <= 4.5) == 921
    assert len(stars.load_catalogue(7.0).hip) == 15544


def test_the_file_is_read_as_python_reads_it(catalogue):
    """Bit by bit, against csv and float."""
    packed = (files("shefex_nav") / "data" / "hipparcos_v8.csv.gz").read_bytes()
    _, *lines = csv.reader(io.StringIO(gzip.decompress(packed).decode()))
    table = np.array([[float(text or "nan") for text in line] for line in lines])
    for k, column in ((0, catalogue.hip), (6, catalogue.vmag), (7, catalogue.hpmag), (8, catalogue.bv)):
        np.testing.assert_array_equal(column, table[:, k])
    ra, dec = np.radians(table[:, 1]), np.radians(table[:, 2])
    np.testing.assert_array_equal(catalogue.u_i[:, 1], np.cos(dec) * np.sin(ra))
    np.testing.assert_array_equal(catalogue.u_i[:, 2], np.sin(dec))


@pytest.mark.parametrize("numbers", [stars._numbers, getattr(stars._numbers, "py_func", stars._numbers)])
def test_decimals_in_bytes(numbers):
    """Compiled, and as Python, whose bytes of NumPy must not overflow."""
    text = b"12,-0.5\n,.25\n-123456.789012345,7.\n"
    expected = [12.0, -0.5, np.nan, 0.25, -123456.789012345, 7.0]
    np.testing.assert_array_equal(numbers(np.frombuffer(text, dtype=np.uint8)), expected)


@pytest.mark.parametrize("text", [b"1e5\n", b"1.2.3\n", b"1-2\n", b"-\n", b".\n", b"1234567890123456\n"])
def test_what_is_no_decimal_is_refused(text):
    with pytest.raises(ValueError, match="not a table of decimals"):
        stars._numbers(np.frombuffer(text, dtype=np.uint8))


def test_sirius_at_j2000(catalogue):
    now = stars.at_epoch(catalogue, 2000.0)
    u_i = now.u_i[now.hip == 32349][0]
    expected = erfa.s2c(
        np.radians(15.0 * (6 + 45 / 60 + 8.917 / 3600)), np.radians(-(16 + 42 / 60 + 58.02 / 3600))
    )
    assert erfa.sepp(u_i, expected) < 0.03 * ARCSEC  # the digits of the file (0.004") and of the almanac


def test_groombridge_1830_moves_seven_arcseconds_a_year(catalogue):
    row = catalogue.hip == 57939
    moved = stars.at_epoch(catalogue, 2000.0).u_i[row][0]
    assert erfa.sepp(catalogue.u_i[row][0], moved) == pytest.approx(61.75 * ARCSEC, rel=2e-3)


def test_displacements_from_1991_to_2012(catalogue):
    bright = stars.select(catalogue, catalogue.vmag <= 5.5)
    shift = erfa.sepp(bright.u_i, stars.at_epoch(bright, 2012.47).u_i)
    assert np.median(shift) == pytest.approx(0.96 * ARCSEC, rel=0.01)
    assert np.sqrt((shift**2).mean()) == pytest.approx(6.1 * ARCSEC, rel=0.01)
    assert shift.max() == pytest.approx(112 * ARCSEC, rel=0.01)
    assert np.percentile(shift, 99) == pytest.approx(22 * ARCSEC, rel=0.02)


def test_proper_motion_against_erfa(catalogue):
    sample = stars.select(catalogue, np.arange(0, len(catalogue.hip), 200))
    ra, dec = erfa.c2s(sample.u_i)
    east = np.column_stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)])
    north = np.cross(sample.u_i, east)
    pm_ra = (sample.pm_i * east).sum(1) / np.cos(dec)
    pm_dec = (sample.pm_i * north).sum(1)
    start, end = erfa.epj2jd(1991.25), erfa.epj2jd(2012.47)
    ra2, dec2, *_ = erfa.pmsafe(ra, dec, pm_ra, pm_dec, 0.1, 0.0, *start, *end)
    moved = stars.at_epoch(sample, 2012.47)
    # with a parallax of 0.1": ERFA adds the change of light time, far below 1 mas
    assert erfa.sepp(moved.u_i, erfa.s2c(ra2, dec2)).max() < 0.1e-3 * ARCSEC
    assert moved.epoch == 2012.47


def test_aberration_against_erfa(catalogue):
    v_i = np.array([12e3, -25e3, 9e3])
    v = v_i / SPEED_OF_LIGHT
    expected = erfa.ab(catalogue.u_i, v, 1e12, np.sqrt(1.0 - v @ v))  # far from the Sun: no light bending
    seen = stars.aberrate(catalogue.u_i, v_i)
    np.testing.assert_allclose(seen, expected, atol=2e-15)
    np.testing.assert_allclose(stars.aberrate(seen, -v_i), catalogue.u_i, atol=2e-15)


def test_aberration_is_20_arcseconds_towards_the_motion():
    u_i = np.array([[0.0, 0.0, 1.0]])
    seen = stars.aberrate(u_i, np.array([29.785e3, 0.0, 0.0]))[0]  # mean speed of the Earth
    assert np.arctan2(seen[0], seen[2]) == pytest.approx(20.4955 * ARCSEC, rel=3e-4)  # constant of aberration


def test_photocentres_count(catalogue):
    now = stars.at_epoch(catalogue, 2012.47)
    assert len(stars.photocentres(now, 5.5, 3 * PIXEL).hip) == 2834
    assert len(stars.photocentres(now, 5.5, 5 * PIXEL).hip) == 2820
    merged = stars.photocentres(now, 5.5, 3 * PIXEL)
    assert np.all(np.diff(merged.vmag) >= 0.0)
    assert len(np.unique(merged.hip)) == 2834
    cosines = merged.u_i @ merged.u_i.T
    np.fill_diagonal(cosines, -1.0)
    # centres of light come closer than the stars did, but not by much
    assert np.arccos(cosines.max()) > 2.0 * PIXEL


def test_photocentres_are_those_of_a_search_among_all_stars(catalogue):
    """Which stars take others, and whom: brightest first, each looks at all that nobody has taken."""
    radius = 180.0 * ARCSEC
    merged = stars.photocentres(catalogue, 5.5, radius)
    free, heads, pulled = np.ones(len(catalogue.hip), dtype=bool), [], 0
    for k in np.argsort(catalogue.vmag, kind="stable"):
        if catalogue.vmag[k] > 5.5:
            break
        if free[k]:
            near = free & (catalogue.u_i @ catalogue.u_i[k] >= np.cos(radius))
            free[near] = False
            heads.append(catalogue.hip[k])
            pulled += near.sum() > 1
    assert sorted(merged.hip) == sorted(heads)
    row = {hip: k for k, hip in enumerate(catalogue.hip)}
    moved = [
        not np.array_equal(u, catalogue.u_i[row[hip]]) for hip, u in zip(merged.hip, merged.u_i, strict=True)
    ]
    assert sum(moved) == pulled > 20


def test_photocentre_of_a_double():
    pair = synthetic([(0, 0), (100, 0), (5000, 0)], [4.0, 5.0, 4.5], [0.3, 0.3, 0.3])
    merged = stars.photocentres(pair, 4.6, 200 * ARCSEC)
    assert list(merged.hip) == [1, 3]
    ratio = 10.0**-0.4
    ra = np.arctan2(merged.u_i[0, 1], merged.u_i[0, 0])
    assert ra == pytest.approx(100 * ARCSEC * ratio / (1 + ratio), rel=1e-6)
    assert merged.vmag[0] == pytest.approx(4.0 - 2.5 * np.log10(1 + ratio))
    assert merged.bv[0] == pytest.approx(0.3)
    np.testing.assert_array_equal(merged.u_i[1], pair.u_i[2])


def test_photocentre_weighs_in_the_band_of_the_detector():
    """A red star of the same V is brighter for silicon and pulls the centre its way."""
    pair = synthetic([(0, 0), (100, 0)], [4.0, 4.0], [0.0, 1.5])
    merged = stars.photocentres(pair, 5.0, 200 * ARCSEC)
    assert np.arctan2(merged.u_i[0, 1], merged.u_i[0, 0]) > 55 * ARCSEC


def test_silicon_magnitude():
    vmag = np.full(4, 5.0)
    red, white, unknown, solar = stars.silicon_magnitude(vmag, np.array([1.5, 0.0, np.nan, 0.65]))
    assert white == pytest.approx(5.0 - 0.0218)
    # G - V = -0.0218 - 0.0887 b - 0.1305 b^2 + 0.0017 b^3 - 0.0247 b^4, by hand at b = 1.5
    assert red == pytest.approx(5.0 - 0.0218 - 0.13305 - 0.293625 + 0.0057375 - 0.12504375)
    assert unknown == solar
    extremes = stars.silicon_magnitude(np.zeros(2), np.array([2.45, 6.0]))
    assert extremes[0] == extremes[1]  # the fit is not used beyond its range
