"""The table of NRLMSIS 2.1 against values of the model, hydrostatics and the gas law."""

import sys

import numpy as np
import pytest

from shefex_nav.environment import msis, sampling
from shefex_nav.environment.gravity import normal_gravity_e
from shefex_nav.environment.models import BUILT_IN, Atmosphere, Msis, Site
from shefex_nav.geometry import wgs84

ANDOYA = ("2012-06-22T19:18:00Z", np.deg2rad(69.2942), np.deg2rad(16.0209))
INDICES = (97.7, 127.3, 4.0)
MODEL = BUILT_IN[Atmosphere]["msis"]


def site(epoch, latitude, longitude, f107, f107_average, ap):
    return Site(epoch, latitude, longitude, Msis(f107=f107, f107_average=f107_average, ap=ap))


def table_of(*given):
    return sampling.air_table(MODEL, site(*given))


@pytest.fixture(scope="module")
def air():
    pytest.importorskip("pymsis")
    return table_of(*ANDOYA, *INDICES)


def at(table, height, column):
    return np.interp(height, table[:, 0], table[:, column])


def test_layout(air):
    assert air.shape[1] == 4 and air.dtype == np.float64 and air.flags.c_contiguous
    assert air[0, 0] <= -100.0 and air[-1, 0] == 1.0e6
    assert np.all(np.diff(air[:, 0]) > 0.0) and np.all(np.isfinite(air))


def test_values_of_the_model():
    pytest.importorskip("pymsis")
    # pymsis 0.13.0, NRLMSIS 2.1, Andoya at the launch of SHEFEX 2, F10.7 100 and 120: density; temperature
    table = table_of(*ANDOYA, 100.0, 120.0, 4.0)
    for height, density, temperature in (
        (0.0, 1.2479, 279.747),
        (10e3, 0.39614, 227.233),
        (50e3, 1.2409e-3, 281.373),
        (100e3, 3.3771e-7, 201.064),
        (150e3, 1.5709e-9, 713.465),
        (177e3, 4.6747e-10, 862.467),
    ):
        rho, p = np.exp(at(table, height, 1)), np.exp(at(table, height, 2))
        assert rho == pytest.approx(density, rel=1e-4)
        molar = rho * 8314.462618 * temperature / p  # kg/kmol, gas law
        if height <= 50e3:
            assert molar == pytest.approx(28.960, rel=3e-4)  # dry air of the model
        else:
            assert 24.0 < molar < 28.5  # thins out with dissociation
        assert at(table, height, 3) == pytest.approx(
            np.sqrt(1.4 * 8314.462618 * temperature / molar), rel=3e-4
        )


def test_hydrostatic_balance(air):
    # NRLMSIS 2 is hydrostatic where the air is mixed, in its own model of gravity
    for height in np.arange(1e3, 73e3, 2.3e3):
        slope = (at(air, height + 200.0, 2) - at(air, height - 200.0, 2)) / 400.0  # of ln(pressure), 1/m
        g_e = normal_gravity_e(wgs84.ecef_from_geodetic(ANDOYA[1], 0.0, height))
        weight = np.exp(at(air, height, 1) - at(air, height, 2)) * np.linalg.norm(g_e)
        assert slope == pytest.approx(-weight, rel=5e-4)


@pytest.mark.parametrize("latitude", [-80.0, 0.0, 69.3])
def test_interpolation_between_the_rows(latitude):
    pytest.importorskip("pymsis")
    given = (ANDOYA[0], np.deg2rad(latitude), 0.3, *INDICES)
    rows = table_of(*given)
    between = 0.5 * (rows[1:] + rows[:-1])
    exact = msis.air(between[:, 0], site(*given))
    assert np.abs(np.log(exact.density) - between[:, 1]).max() < 1.2e-4
    assert np.abs(np.log(exact.pressure) - between[:, 2]).max() < 1.2e-4
    assert np.abs(np.sqrt(1.4 * exact.pressure / exact.density) / between[:, 3] - 1.0).max() < 1e-4


def test_activity_of_the_sun_counts_high_up_only(air):
    active = table_of(*ANDOYA, 200.0, 200.0, 4.0)
    assert at(active, 70e3, 1) == pytest.approx(at(air, 70e3, 1), abs=1e-3)
    assert at(active, 400e3, 1) > at(air, 400e3, 1) + 0.5


def test_without_pymsis_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymsis", None)  # what a failing import leaves
    with pytest.raises(msis.MissingModelError, match=r"shefex-nav\[msis\]"):
        table_of(*ANDOYA, *INDICES)
