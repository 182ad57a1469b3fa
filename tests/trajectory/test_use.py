"""What works on flights of this program works on those along a trajectory."""

import json

import numpy as np
import pytest
from given_flight import EXAMPLE, scenario
from made import AEM, OEM, ROOT
from made import EXAMPLE as FILE

from shefex_nav import prepare, runs
from shefex_nav.log import reader
from shefex_nav.records import Reason
from shefex_nav.scenario import load

SATELLITE = f"""extends: {ROOT}/scenarios/orbit.yaml
mission: {{name: satellite, epoch: 2012-06-22T19:18:00Z, time_limit: 20 s}}
earth: {{ut1_minus_utc: -0.58479 s, pole_x: 0.0787 arcsec, pole_y: 0.4084 arcsec}}
orbit: null
vehicle: null
programme: null
attitude: null
trajectory: {{file: {OEM}, format: oem, attitude: {{aem: {AEM}}}}}
star_tracker: {{on: 1 s, off: 20 s}}
"""


@pytest.fixture(scope="module")
def example(once, command):
    """The shipped example, flown by the command: log and summary."""

    def make(folder):
        result = command("run", EXAMPLE, "--out", folder / "run.mcap", "--json")
        assert result.code == 0, result.err
        (folder / "summary.json").write_text(result.out)

    folder = once("given_trajectory", make)
    return folder / "run.mcap", json.loads((folder / "summary.json").read_text())


def test_the_example_is_good_and_navigated(example, command):
    result = command("check", EXAMPLE)
    assert result.code == 0 and "good" in result.out and "warning" not in result.out + result.err
    _, summary = example
    navigation = summary["navigation"]
    assert navigation["position_error_m"]["rms"] < 5.0 and navigation["attitude_error_deg"]["rms"] < 0.5
    events = {one.name: one.t_s for one in reader.read(example[0]).events}
    assert list(events) == ["lift_off", "max_dynamic_pressure", "burn_out_1", "apogee"]
    assert events["burn_out_1"] == pytest.approx(8.9, abs=0.1)


def test_its_log_is_replayed_and_smoothed(example, command, tmp_path):
    replayed = command("replay", example[0], "--log", tmp_path / "again.mcap")
    assert replayed.code == 0, replayed.err
    was, now = reader.read(example[0]).nav, reader.read(tmp_path / "again.mcap").nav
    assert np.array_equal(was.r_i, now.r_i) and np.array_equal(was.q_ib, now.q_ib)
    assert command("smooth", example[0], "--out", tmp_path / "smooth.mcap").code == 0


def test_the_log_says_what_was_flown(example):
    told = load.load_text(reader.read(example[0]).mission.scenario_text, "log").trajectory
    assert told.file == str(FILE) and len(told.sha256) == 64
    assert prepare.fly_vehicle(load.load(EXAMPLE), 1).trajectory.t_s[-1] == pytest.approx(70.0)


def test_campaigns_and_faults(command, tmp_path):
    fault = "faults={gps: [{fault: outage, from: 20 s, until: 25 s}]}"
    given = "campaign", EXAMPLE, "--runs", 2, "--workers", 1, "--out", tmp_path / "campaign", "--set", fault
    result = command(*given)
    assert result.code == 0, result.err
    assert (tmp_path / "campaign" / "results.parquet").exists()


def test_a_roll_rate_may_be_dispersed():
    attitude = {"along": "velocity", "roll_rate": "1 Hz"}
    told = load.load(EXAMPLE).trajectory.model_dump(include={"position", "velocity"})
    section = {"file": FILE, "format": "csv", "time": "t_s", "attitude": attitude, **told}
    section |= {"position_frame": "launch_enu", "velocity_frame": "launch_enu"}
    section["origin"] = {"latitude": "69.2942 deg", "longitude": "16.0190 deg", "height": "10 m"}
    one = scenario(section, "dispersions={trajectory.attitude.roll_rate: {normal: 0.1 Hz}}")
    pattern = load.Pattern(one.source, "text")
    drawn = pattern.with_draws({"trajectory.attitude.roll_rate": 0.25})
    assert drawn.trajectory.attitude.roll_rate == pytest.approx(2.0 * np.pi * 1.25)


def test_a_satellite_sees_its_stars(tmp_path):
    """Frames are rendered and solved at the attitude of the AEM."""
    (tmp_path / "satellite.yaml").write_text(SATELLITE)
    run = runs.fly(load.load(tmp_path / "satellite.yaml"), 1)
    solved = [fix for fix in run.data.star_fixes if fix.reason == Reason.NONE]
    assert len(solved) > 15
    last = run.errors().at(20.0)
    assert np.linalg.norm(last.attitude_b) < 3.0 * np.linalg.norm(last.sigma_attitude_b) < np.radians(0.2)
