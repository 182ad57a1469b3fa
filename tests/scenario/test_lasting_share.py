"""The share of a fix's variance that is of errors which last, as the filter is told it."""

import numpy as np
import pytest

from shefex_nav.geometry import wgs84
from shefex_nav.scenario import load, params_onboard
from shefex_nav.scenario.of_settings import settings
from shefex_nav.world import gps_errors

ALCANTARA = ["launch.latitude=-2.3 deg", "launch.longitude=-44.4 deg"]
STRONG = "{alpha: [4.7e-8, 1.5e-8, -1.2e-7, -1.2e-7], beta: [1.2e5, 1.6e4, -2.6e5, -6.5e4], residual: 30 %}"
NOON_S, NIGHT_S = 17.0 * 3600.0, 6.0 * 3600.0  # UTC


def of(hour_s, residual=0.3):
    hours = f"{round(hour_s / 3600.0):02d}"
    section = STRONG.replace("30 %", f"{100.0 * residual:g} %")
    overrides = [f"mission.epoch=2014-03-21T{hours}:00:00Z", f"gps.errors={{ionosphere: {section}}}"]
    return load.load("rexus_like", [*ALCANTARA, "gps.range_noise=3 m", *overrides])


@pytest.mark.parametrize("residual", [0.1, 0.3])
def test_a_strong_ionosphere_is_told_as_large_as_it_is(residual):
    """Satellites all over the sky, as the world has them: rms of what is left of their delays.

    Taken for 6 m, the share was 0.26 for 0.9, and the squared error of the position 2.4 of its variance.
    """
    scenario = of(NOON_S, residual)
    rng = np.random.default_rng(1)
    u_n = rng.standard_normal((400, 3))
    u_n[:, 2] = -np.abs(u_n[:, 2]) - 0.3  # up
    u_n /= np.linalg.norm(u_n, axis=1)[:, None]
    latitude, longitude = scenario.launch.latitude, scenario.launch.longitude
    r_e, C_en = wgs84.ecef_from_geodetic(latitude, longitude, 0.0), wgs84.dcm_en(latitude, longitude)
    given = settings(scenario.gps.errors).ionosphere
    delays = gps_errors.ionospheric_delay(given, np.array([NOON_S]), r_e[None], (u_n @ C_en.T)[None])
    true = residual * np.sqrt(np.mean(delays**2))
    assert 0.7 * true < params_onboard._lasting_sigma(scenario) < 1.4 * true
    share = true**2 / (true**2 + 9.0)
    assert params_onboard.lasting_share(scenario) == pytest.approx(share, abs=0.12)


def test_at_night_and_for_what_moves_around_the_earth_it_is_six_metres():
    assert params_onboard._lasting_sigma(of(NIGHT_S)) == pytest.approx(0.3 * 6.0)
    orbit = load.load("orbit", [f"gps.errors={{ionosphere: {STRONG}}}"])
    assert params_onboard._lasting_sigma(orbit) == pytest.approx(0.3 * 6.0)
