"""Range errors that last and the clock of the receiver, as the computer is told of them."""

import numpy as np
import pytest

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.onboard.navigation.measurements import understood
from shefex_nav.records import GpsFix, GpsRanges
from shefex_nav.scenario import params_onboard
from shefex_nav.scenario.load import load

NAME = "shefex2_andoya"
STATES = "navigation.states=[gyro_roll_column, mounting, clock, range_bias]"
TRUE_NOISE, TRUE_LASTING = 1.5, 2.0  # m
COFACTOR = np.diag([1.0, 2.0, 4.0])  # m^2 of a fix by ranges of 1 m


def multipath(key, size):
    """Errors that last of which each satellite has its own: they are in a fix as its noise is."""
    return f"{key}.errors.multipath={{range: {size:g} m, time: 300 s}}"


def taken(*values, lasting=TRUE_LASTING):
    """Sigma of a fix by the cofactor, of the noise of ranges and of what lasts in them, as the filter has it.

    The receiver says what is true of it.
    """
    true = [STATES, f"gps.range_noise={TRUE_NOISE:g} m"] + ([multipath("gps", lasting)] if lasting else [])
    nav = params_onboard.nav_params(load(NAME, [*true, *values]))
    v, n = np.ones(3), np.full(2, 1.0)
    fix = GpsFix(1.0, 1.2, True, v, v, (TRUE_NOISE**2 + lasting**2) * COFACTOR, np.eye(3), 8, 2.0, "")
    said = {"sigma_lasting": lasting * n, "sigma_shared": 0.0 * n} if lasting else {}
    ranges = GpsRanges(1.0, 1.2, n, n, n, n, n, TRUE_NOISE * n, 0.1 * n, **said)
    R = understood(nav.gps_told, fix).R_r_e
    np.testing.assert_allclose(R / R[0, 0], COFACTOR, rtol=1e-12)
    ranges = understood(nav.gps_told, ranges)
    last = ranges.sigma_lasting[0] if lasting else nav.range_bias_sigma
    return np.sqrt(R[0, 0]), ranges.sigma_range[0], last


def in_a_fix(noise, lasting):
    return np.hypot(noise, lasting), noise, lasting


def test_what_lasts_is_as_large_as_it_is_told_in_ranges_and_in_fixes():
    assert taken() == pytest.approx(in_a_fix(TRUE_NOISE, TRUE_LASTING))
    assert taken(multipath("navigation.told.gps", 8.0)) == pytest.approx(in_a_fix(TRUE_NOISE, 8.0))
    assert taken(multipath("navigation.told.gps", 0.5)) == pytest.approx(in_a_fix(TRUE_NOISE, 0.5))
    assert taken("navigation.sensors.range_bias=8 m") == pytest.approx(in_a_fix(TRUE_NOISE, 8.0))


def test_less_noise_that_is_told_leaves_what_lasts_as_it_is():
    less = taken("navigation.told.gps.range_noise=0.5 m")
    assert less == pytest.approx(in_a_fix(0.5, TRUE_LASTING))
    both = taken("navigation.told.gps.range_noise=6 m", multipath("navigation.told.gps", 1.0))
    assert both == pytest.approx(in_a_fix(6.0, 1.0))


def test_a_receiver_without_lasting_errors_may_be_told_some():
    for word in (multipath("navigation.told.gps", 4.0), "navigation.sensors.range_bias=4 m"):
        assert taken(word, lasting=0.0) == pytest.approx(in_a_fix(TRUE_NOISE, 4.0))


def clock_known(*values):
    tight = [STATES, "navigation.gps=tight", *values]
    return params_onboard.nav_params(load(NAME, tight)).sigma_blocks["clock"]


def test_a_clock_is_known_no_better_than_it_is():
    """Nobody has set it: 1 ms and 1 ppm; a worse oscillator is as bad as its section says."""
    assert clock_known() == pytest.approx([300e3, 300.0])
    bad = ["gps.clock.bias=10 ms", "gps.clock.drift=10 ppm"]
    assert clock_known(*bad) == pytest.approx([10e-3 * SPEED_OF_LIGHT, 10e-6 * SPEED_OF_LIGHT])
    told = [word.replace("gps.", "navigation.told.gps.") for word in bad]
    assert clock_known(*told) == pytest.approx([10e-3 * SPEED_OF_LIGHT, 10e-6 * SPEED_OF_LIGHT])
    given = ["navigation.sensors.clock_bias=5 km", "navigation.sensors.clock_drift=20 m/s"]
    assert clock_known(*bad, *given) == pytest.approx([5e3, 20.0])
