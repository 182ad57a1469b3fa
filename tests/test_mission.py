"""The default mission end to end: the promises of the README, on one seed.

The statistics over many seeds are in docs/verification/, made by the studies in benchmarks/.
"""

import json

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from shefex_nav import prepare, simulate
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.records import ComputeTime
from shefex_nav.scenario import load

FLIGHT_KEYS = {"apogee_km", "range_km", "max_speed_m_s", "events"}
STAR_KEYS = {"frames", "in_window", "solved", "wrong", "no_fix", "error_arcsec", "chain_ms"}
NAV_KEYS = {"position_error_m", "velocity_error_m_s", "attitude_error_deg", "at_entry", "nees"}


def test_flight_of_the_reconstruction(default_run):
    flight = default_run.summary["flight"]
    assert flight.keys() >= FLIGHT_KEYS
    assert flight["apogee_km"] == pytest.approx(177.0, abs=3.0)
    assert flight["range_km"] == pytest.approx(800.0, abs=20.0)
    at = {event["name"]: event["t_s"] for event in flight["events"]}
    assert 52.0 < at["altitude_20km"] - at["entry"] < 62.0
    assert list(at) == sorted(at, key=at.get)
    assert "impact" in at


def test_star_tracker_in_its_window(default_run):
    star = default_run.summary["star_tracker"]
    assert star.keys() >= STAR_KEYS
    assert star["in_window"] > 1000
    assert star["wrong"] == 0
    assert star["solved"] >= 0.97 * star["in_window"]
    assert star["error_arcsec"]["max"] < 360.0


def test_cold_gas_points_the_star_camera(default_run, default_scenario):
    """The attitude is flown: a few tenths of a degree of dead band and reference errors, and gas to spare."""
    control = default_run.summary["attitude_control"]
    assert 0.0 < control["propellant_kg"] < load.load(default_scenario).vehicle.cold_gas.propellant
    assert 0.02 < control["pointing_error_deg"]["rms"] < 3.0
    assert control["pointing_error_deg"]["max"] < 8.0


def test_navigation_at_entry(default_run):
    navigation = default_run.summary["navigation"]
    assert navigation.keys() >= NAV_KEYS
    entry = navigation["at_entry"]
    assert entry["altitude_km"] == pytest.approx(100.0, abs=0.05)
    assert np.abs(entry["attitude_error_deg"]).max() < 0.17
    assert entry["position_error_m"] < 15.0
    assert entry["velocity_error_m_s"] < 0.3
    assert entry["nees"] < 27.9  # 99.9 % of chi-square with 9 degrees of freedom
    assert navigation["nees"]["dof"] == 9
    assert navigation["nees"]["samples"] > 100


def test_star_fixes_are_taken_without_a_fight(default_data):
    """No attitude reset, and hardly a fix rejected: covariance of fixes and filter are both honest."""
    gates = [gate for gate in default_data.gates if gate.sensor == "star_tracker"]
    assert not [gate for gate in gates if "reset" in gate.note]
    assert np.mean([gate.accepted for gate in gates]) > 0.99


def test_report_of_the_log_is_what_run_printed(default_run, command):
    result = command("report", default_run.log, "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out) == default_run.summary


def test_log_is_small_and_every_message_decodes(default_run):
    assert default_run.log.stat().st_size < 60e6
    counts = {}
    with default_run.log.open("rb") as stream:
        log = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, decoded in log.iter_decoded_messages():
            assert decoded is not None
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
        stream.seek(0)
        assert counts == {
            log.get_summary().channels[key].topic: n
            for key, n in log.get_summary().statistics.channel_message_counts.items()
        }
    assert counts["/nav/solution"] == counts["/truth/state"] == counts["/imu"]
    assert {
        "/truth/attitude_control",
        "/gps/fix",
        "/star_tracker/fix",
        "/nav/covariance",
        "/nav/gates",
        "/timing",
        "/tf",
    } <= counts.keys()


@pytest.mark.slow
def test_same_seed_same_records(default_data, default_scenario):
    """Every record but the measured durations, to the last bit, in another process than the first run's."""
    scenario = load.load(default_scenario)
    world = prepare.build_world(scenario, 1)
    again = RunDataBuilder(prepare.mission(scenario, 1, world.flight.trajectory))
    for record in simulate.route(world, scenario, 1):
        if not isinstance(record, ComputeTime):
            again.add(record)
    first, second = default_data, again.build()
    measured = {"compute_times", "summary"}
    for name in set(first._fields) - measured:
        assert_identical(getattr(first, name), getattr(second, name), name)


def assert_identical(a, b, where):
    if isinstance(a, np.ndarray):
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), where
    elif isinstance(a, dict):
        assert list(a) == list(b), where
        assert_identical(list(a.values()), list(b.values()), where)
    elif isinstance(a, tuple | list):
        assert len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_identical(x, y, f"{where}.{k}")
    else:
        assert a == b or (a != a and b != b), where
