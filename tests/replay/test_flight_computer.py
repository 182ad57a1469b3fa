"""A student rocket's flight computer: Hedy (TU Wien Space Team, EuRoC 2025), 5.2 km, and what its files lack.

The data are not part of the project (RocketPy-Team/RocketPy, data/rockets/hedy, MIT licence, commit d41dd11).
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from shefex_nav.environment import atmosphere
from shefex_nav.records import GpsFix
from shefex_nav.replay import dataset, plausible, replayed

HEDY = Path(os.environ.get("SHEFEX_NAV_HEDY", Path(__file__).parents[3] / "shared/data/rockets/hedy"))
needs_data = pytest.mark.skipif(not HEDY.is_dir(), reason=f"needs the flight log of Hedy in {HEDY}")
APOGEE_M, APOGEE_S = 5230.4, 34.05  # of the flight computer, above the pad, after the first sample


def fixes(times_s, places, satellites=8):
    """GpsFix at metres along x."""
    noise = np.eye(3)
    return [
        GpsFix(t_s, t_s, True, np.array([6.4e6 + place, 0.0, 0.0]), np.full(3, np.nan), noise,
               np.full((3, 3), np.nan), satellites, np.nan, "")
        for t_s, place in zip(times_s, places, strict=True)
    ]  # fmt: skip


def increments(shaken, length_s=30.0):
    rng = np.random.default_rng(1)
    t_s = np.arange(0.0, length_s, 0.01)
    dv_b = (np.array([9.8, 0.0, 0.0]) + shaken * rng.standard_normal((len(t_s), 3))) * 0.01
    return dataset.Increments(t_s, np.zeros_like(dv_b), dv_b, np.zeros(len(t_s), dtype=bool))


def test_the_longest_repetition_in_motion():
    times_s = np.arange(0.0, 30.0, 1.0)
    places = [*range(5), *([5] * 12), 6, 7, *([8] * 7), *range(9, 13)]
    first_s, last_s, count = plausible.longest_repeat(increments(5.0), fixes(times_s, places))
    assert (first_s, last_s, count) == (5.0, 16.0, 12)
    assert plausible.longest_repeat(increments(0.01), fixes(times_s, places)) is None  # it stands still
    assert plausible.longest_repeat(increments(5.0), fixes(times_s, range(30))) is None


def test_what_is_strange_is_told():
    said = dict(plausible.repeats(increments(5.0), fixes(range(20), [3] * 20, dataset.NONSENSE)))
    assert "for 19.0 s, from T+0.0 s to T+19.0 s (20 fixes)" in said["data.gnss"]
    assert said["data.gnss.satellites"].startswith(
        "the number of satellites of 20 fixes is none that there can be"
    )


def test_pressure_altitude_is_that_of_the_standard():
    """Printed values of US Standard Atmosphere 1976, table I: geopotential altitude [m], pressure [Pa]."""
    for altitude, pressure in ((0.0, 101325.0), (5000.0, 54019.9), (11000.0, 22632.0), (20000.0, 5474.9)):
        assert replayed.pressure_altitude(np.array([pressure]))[0] == pytest.approx(altitude, abs=2.0)
    geometric = 5000.0
    seen = replayed.pressure_altitude(np.array([atmosphere.us76(geometric)[1]]))[0]
    assert seen == pytest.approx(
        atmosphere.EARTH_RADIUS * geometric / (atmosphere.EARTH_RADIUS + geometric), abs=0.1
    )


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """What `replay hedy --json` says, and the gates of its log."""
    from typer.testing import CliRunner

    from shefex_nav.commands.app import app
    from shefex_nav.log import reader

    log = tmp_path_factory.mktemp("hedy") / "hedy.mcap"
    done = CliRunner().invoke(app, ["replay", "hedy", "--data", str(HEDY), "--log", str(log), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout), reader.read(log)


@needs_data
@pytest.mark.slow
def test_heights_of_the_flight(flown):
    """By the standard atmosphere within 20 m of the flight computer; in truth higher: the day was warm."""
    found = flown[0]["barometer"]
    assert abs(found["pressure_altitude_m"] - APOGEE_M) < 20.0
    assert abs(found["t_s"] - APOGEE_S) < 1.0
    more = found["height_m"] - found["pressure_altitude_m"]
    assert 50.0 < more < 250.0
    assert 20.0 < found["sigma_height_m"] < 250.0
    # all sigmas have grown at T+18 s, where GPS contradicts the filter
    assert 0.0 < found["warmer_by"] < 0.06 and found["sigma_warmer_by"] < 0.08


@needs_data
@pytest.mark.slow
def test_the_page_shows_the_heights_of_today(flown):
    page = (Path(__file__).parents[2] / "docs/how-to/flight-computer.md").read_text()
    found = flown[0]["barometer"]
    height, sigma = f"{found['height_m']:.0f} m above the start", f"1 sigma {found['sigma_height_m']:.0f} m"
    warmer, of_it = (
        f"{100.0 * found['warmer_by']:+.1f} %",
        f"1 sigma {100.0 * found['sigma_warmer_by']:.1f} %",
    )
    assert f"{height}, {sigma}" in page and f"{warmer}, {of_it}" in page


@needs_data
@pytest.mark.slow
def test_what_is_said_of_the_receiver(flown):
    said = {one["field"]: one["text"] for one in flown[0]["warnings"]}
    assert "for 67.8 s, from T+37.2 s to T+105.0 s" in said["data.gnss"]
    assert "of 31 fixes" in said["data.gnss.satellites"]
    noticed = flown[0]["navigation"]["integrity"]["noticed"]
    assert any("frozen" in one["reason"] for one in noticed)


@needs_data
@pytest.mark.slow
def test_the_flight_is_told_and_nothing_is_reset_again_and_again(flown):
    summary, data = flown
    assert 5.2 < summary["flight"]["apogee_km"] < 5.9
    assert 280.0 < summary["flight"]["max_speed_m_s"] < 400.0
    resets = [gate for gate in data.gates if "reset" in gate.note or "new bias" in gate.note]
    assert len(resets) < 5
    assert np.isfinite(data.nav.r_e).all() and np.isfinite(data.nav.sigma_r_e).all()
