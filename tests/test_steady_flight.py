"""A flight that is logged from columns: file and data in memory are those of a record at every tick."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from shefex_nav import prepare, simulate
from shefex_nav.log import reader, thinning, writer
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.run_data import RunData, RunDataBuilder
from shefex_nav.log.steady import Reached
from shefex_nav.log.writer import LogWriter
from shefex_nav.pacing import Pace
from shefex_nav.records import ComputeTime, Event, NavSolution, TruthSample
from shefex_nav.scenario import load
from tests.software.own_flights import reckoning

SCENARIOS = Path(__file__).parent.parent / "scenarios"
POLICY, SEED = FramePolicy(10, "thresholded", 4.0), 4
FAULTS = [
    "faults.imu=[{fault: dropout, from: 0.613 s, until: 0.78 s}]",
    "faults.star_tracker=[{fault: blinded, from: 1.33 s, until: 1.77 s}]",
]
STEERED_S = 67.2  # attitude control begins at 65 s, after the motor has burnt out


def resting(*overrides):
    """The first seconds under the night sky. -> Scenario, World"""
    scenario = prepare.settled(load.load(SCENARIOS / "night_sky.yaml", overrides, trust=True))
    return scenario, prepare.build_world(scenario, SEED, brief=True)


def steered():
    """Boost and the begin of attitude control, between two ticks and two samples; no frames."""
    scenario = load.load(SCENARIOS / "no_star_tracker.yaml")
    flight = prepare.fly_vehicle(scenario, SEED)
    n = int(np.searchsorted(flight.trajectory.t_s, STEERED_S + 0.0013))
    trajectory = flight.trajectory._make(np.ascontiguousarray(part[:n]) for part in flight.trajectory)
    return scenario, prepare.build_world(scenario, SEED, flight=flight._replace(trajectory=trajectory))


def logged(path, flown, rate=100.0, steadily=True, records=lambda them: them, **how):
    """Log a flight. -> RunData of what was told

    flown : Scenario, World;  records : function of the records that come;  how : of the route
    """
    scenario, world = flown
    mission = prepare.mission(scenario, SEED, world.flight.trajectory)
    steady = simulate.steady_columns(world, thinning.ticks(rate)) if steadily else None
    kept, told = RunDataBuilder(mission), simulate.route(world, scenario, SEED, columns=steady, **how)
    with LogWriter(path, mission, POLICY, steady=steady) as log:
        for record in records(thinning.thinned(told, rate, mission.start_s)):
            log.write(record)
            if type(record) not in (Reached, ComputeTime):
                kept.add(record)
    return kept.build(steady.read() if steadily else ())


def messages(path):
    """(topic, number and bytes) of all messages but measured times, in the order of the file."""
    with path.open("rb") as file:
        found = make_reader(file).iter_messages(log_time_order=False)
        return [
            (channel.topic, message.log_time, message.sequence, message.data)
            for _, channel, message in found
            if channel.topic != "/timing"
        ]


def bits(value):
    """What is in a record as something that is equal only if every bit is."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, tuple | list):
        return type(value).__name__, *map(bits, value)
    if isinstance(value, dict):
        return bits(list(value.items()))
    return repr(value)


def assert_one_log(tmp_path, make, **how):
    """From records and from columns the same file and the same data come."""
    paths = tmp_path / "records.mcap", tmp_path / "columns.mcap"
    expected, found = (logged(path, make(), steadily=k == 1, **how) for k, path in enumerate(paths))
    one, other = map(messages, paths)
    assert one == other and len(one) > 300
    for name in RunData._fields:
        assert bits(getattr(expected, name)) == bits(getattr(found, name)), name
    assert found.nav.r_i.flags.c_contiguous and found.imu.dtheta_b.flags.c_contiguous


CASES = {
    "plain": resting,
    "faults": lambda: resting(*FAULTS),
    "switched": lambda: resting("star_tracker.off=1.777 s", "star_tracker.rate=4 Hz"),
    "states": lambda: resting("navigation.states=[gyro_scale, mounting]"),
    "unknown heading": lambda: resting("pad_alignment.azimuth=unknown"),
    "steered": steered,
}


@pytest.mark.parametrize("case", CASES)
def test_a_log_from_columns_is_the_log_of_the_records(case, tmp_path):
    assert_one_log(tmp_path, CASES[case])


@pytest.mark.parametrize("rate", [10.0, 20.0, 50.0])
def test_thinned_logs_too(rate, tmp_path):
    assert_one_log(tmp_path, lambda: resting(*FAULTS), rate=rate)


def test_the_log_of_a_part_of_a_flight_too(tmp_path):
    assert_one_log(tmp_path, resting, until_s=2.345)


def test_the_log_of_a_paced_flight_too(tmp_path):
    """There every tick is made by itself."""
    paths = tmp_path / "fast.mcap", tmp_path / "paced.mcap"
    for path, pace in zip(paths, (None, Pace(50.0)), strict=True):
        logged(path, resting(), until_s=2.0, pace=pace)
    one, other = map(messages, paths)
    assert one == other


def test_own_software_tells_records_between_the_columns(tmp_path):
    own = reckoning(tmp_path)
    assert_one_log(tmp_path, lambda: resting(f"navigation.software={own}:Reckoning"), until_s=2.0)


@pytest.mark.parametrize("after", [1, 40, 63, 100])
def test_an_interrupted_flight_leaves_all_that_was_before(after, tmp_path):
    """Wherever it stops: of the log of the whole flight the messages up to that record, and no other."""

    def stopped(records):
        for k, record in enumerate(records):
            if k == after:
                raise KeyboardInterrupt
            yield record

    whole, part = tmp_path / "whole.mcap", tmp_path / "part.mcap"
    logged(whole, resting())
    with pytest.raises(KeyboardInterrupt):
        logged(part, resting(), records=stopped)
    found = messages(part)
    assert found == messages(whole)[: len(found)]
    data = reader.read(part)
    assert data.ended_early
    if after > 40:
        assert len(data.truth.t_s) >= len(data.nav.t_s) >= len(data.truth.t_s) - 1 > 0


def test_a_killed_flight_would_keep_all_but_its_last_second(tmp_path, monkeypatch):
    """No flush takes more than a second of truth and of solution, and both end at the same tick."""
    parts, take = [], simulate.Steady.take

    def noted(self):
        new = take(self)
        parts.append({type(arrays): arrays.t_s for arrays, _ in new if hasattr(arrays, "t_s")})
        return new

    monkeypatch.setattr(simulate.Steady, "take", noted)
    logged(tmp_path / "run.mcap", resting())
    told = [part for part in parts if TruthSample in part]
    assert len(told) > 2
    for part in told:
        assert len(part[TruthSample]) <= 100 and len(part[NavSolution]) <= 100
    assert all(part[TruthSample][-1] == part[NavSolution][-1] for part in told)


def test_a_slow_flight_is_written_once_a_second_of_the_wall_clock(tmp_path, monkeypatch):
    """Ticks of 0.3 s: four of them at most wait."""
    clock, waiting, most = [0.0], [0], [0]

    class Slow(Pace):
        def advance(self, blocks, first, last):
            clock[0] += 0.3
            waiting[0] += 1
            most[0] = max(most[0], waiting[0])
            return super().advance(blocks, first, last)

    take = simulate.Steady.take

    def taken(self):
        waiting[0] = 0
        return take(self)

    monkeypatch.setattr(simulate.Steady, "take", taken)
    monkeypatch.setattr(writer.time, "monotonic", lambda: clock[0])
    logged(tmp_path / "run.mcap", resting(), until_s=1.0, pace=Slow(1000.0, lambda: clock[0], lambda s: None))
    assert 1 < most[0] <= 5


@pytest.mark.slow
def test_an_event_is_written_at_once(tmp_path):
    """With the truth of all ticks before it."""
    seen = []

    def watched(records):
        for record in records:
            yield record
            if type(record) is Event:
                data = reader.read(tmp_path / "run.mcap")
                seen.append((record, data.events, data.truth.t_s[-1] if len(data.truth.t_s) else None))

    logged(tmp_path / "run.mcap", steered(), records=watched)
    assert len(seen) > 2
    for record, events, last_s in seen:
        assert events[-1] == record
        reached_s = min(record.t_s, STEERED_S)  # what would come later in the flight comes at its end
        assert last_s is None or reached_s - 0.0101 <= last_s <= reached_s + 1e-9
