"""Differences and verdicts, with made-up trajectories."""

import numpy as np
import pytest

from shefex_nav.verify import compare, flight
from shefex_nav.verify.data import Series

T_S = np.linspace(0.0, 200.0, 2001)


def history(**values):
    """A flight in which every quantity is zero but those given."""
    zero = np.zeros(T_S.size)
    all_values = {name: zero for name in compare.QUANTITIES} | values
    return flight.History(T_S, values.get("altitude", zero), all_values)


def simulator(**columns):
    return Series(T_S, columns)


def test_differences_are_in_the_units_of_the_trajectories():
    """1 m = 3.28084 ft, 1 rad = 57.29578 deg, 1 kg/m^3 = 0.00194032 slug/ft^3."""
    ours = history(
        altitude=np.full(T_S.size, 1.0), pitch=np.full(T_S.size, 1.0), density=np.full(T_S.size, 1.0)
    )
    zero = np.zeros(T_S.size)
    one = simulator(altitudeMsl_ft=zero, eulerAngle_deg_Pitch=zero, airDensity_slug_ft3=zero)
    found = compare.compare("06", ours, {"04": one})
    assert found["altitude"].against["04"] == pytest.approx(3.2808399, rel=1e-7)
    assert found["pitch"].against["04"] == pytest.approx(57.2957795, rel=1e-7)
    assert found["density"].against["04"] == pytest.approx(0.001940320, rel=1e-6)
    assert set(found) == {"altitude", "pitch", "density"}


def test_angles_differ_by_the_shorter_way_round():
    ours = history(yaw=np.full(T_S.size, np.radians(-179.9)))
    found = compare.compare("06", ours, {"04": simulator(eulerAngle_deg_Yaw=np.full(T_S.size, 179.95))})
    assert found["yaw"].against["04"] == pytest.approx(0.15)


def test_a_stated_tolerance_has_to_be_kept_to_against_one_simulator():
    def altitudes(**feet):
        return {s: simulator(altitudeMsl_ft=np.full(T_S.size, value)) for s, value in feet.items()}

    def good(**feet):
        return compare.compare("01", history(), altitudes(**feet))["altitude"].ok

    assert good(s4=1e-6)
    assert not good(s4=2e-5)
    assert not good(s4=2e-5, s6=2e-5)
    assert good(s4=1e-6, s6=3e-5)  # they are apart by as much
    assert not good(s4=2e-5, s6=-2e-5)  # in the middle between two is near to none
    assert good(s2=1.0, s4=1e-6, s6=-1e-6)


def test_other_quantities_may_differ_as_much_as_the_simulators_do():
    def verdict(**gravity):
        them = {s: simulator(localGravity_ft_s2=np.full(T_S.size, value)) for s, value in gravity.items()}
        return compare.compare("06", history(), them)["gravity"]

    assert verdict(s4=0.5e-6).ok  # below the floor
    assert not verdict(s4=2e-6).ok
    assert not verdict(s4=2e-6, s6=2.1e-6).ok  # both of them far from ours
    between = verdict(s4=-1e-5, s6=1e-5)
    assert between.ok
    assert between.spread == pytest.approx(2e-5)
    assert verdict(s4=1.0).spread is None


def test_the_rocket_is_judged_at_four_instants():
    feet = 1e5 + 1e3 * T_S
    ours = history(altitude=feet * compare.FOOT)
    wild = np.where(np.abs(T_S % 50.0) < 0.05, 0.5e-3, 0.1) * feet + feet
    wild[0] = 0.0
    assert compare.compare("17", ours, {"06": simulator(altitudeMsl_ft=wild)})["altitude"].ok
    wild[1500] *= 1.002
    assert not compare.compare("17", ours, {"06": simulator(altitudeMsl_ft=wild)})["altitude"].ok
    short = Series(T_S[:1900], {"altitudeMsl_ft": feet[:1900]})
    assert not compare.compare("17", ours, {"06": short})["altitude"].ok


def test_air_is_compared_where_the_simulators_have_tables_of_it():
    high = np.where(T_S < 100.0, 80e3, 90e3)
    theirs = np.where(T_S < 100.0, 0.0, 1.0)
    found = compare.compare("17", history(altitude=high), {"06": simulator(airDensity_slug_ft3=theirs)})
    assert found["density"].against["06"] == 0.0


def test_a_flight_that_is_no_number_is_no_success():
    with pytest.raises(ArithmeticError, match="pitch"):
        compare.compare(
            "06", history(pitch=np.full(T_S.size, np.nan)), {"04": simulator(mach=np.zeros(2001))}
        )
