"""The route: what is told of a mission does not change the mission."""

from pathlib import Path

import numpy as np
import pytest

from shefex_nav import prepare, simulate
from shefex_nav.clock import SAMPLES_PER_TICK
from shefex_nav.log import thinning
from shefex_nav.log.run_data import RunData, RunDataBuilder, stack
from shefex_nav.onboard.telemetry import Columns
from shefex_nav.records import (
    ComputeTime,
    ControlSample,
    ImuBlock,
    NavCovariance,
    NavSolution,
    TruthSample,
)
from shefex_nav.scenario import load

SCENARIOS = Path(__file__).parent.parent / "scenarios"
TICKS, SEED = 10, 4
COLUMNS = TruthSample, ControlSample, NavSolution, NavCovariance  # what is told in columns
FAULTS = [  # between ticks that are told
    "faults.imu=[{fault: dropout, from: 0.613 s, until: 0.78 s}]",
    "faults.star_tracker=[{fault: blinded, from: 1.33 s, until: 1.77 s}]",
]
SWITCHED = ["star_tracker.on=0 s", "star_tracker.off=1.777 s", "star_tracker.rate=4 Hz"]
LATE = [  # commands come at the tick of the next picture
    "star_camera.detector.readout=45 ms",
    "star_tracker.latency=0 ms",
]
STEERED_S = 68.016  # neither on a tick nor on a sample; attitude control begins at 65 s


def resting(overrides):
    """The first seconds under the night sky, with frames. -> Scenario, World"""
    scenario = load.load(SCENARIOS / "night_sky.yaml", overrides)
    return scenario, prepare.build_world(scenario, SEED, brief=True)


def steered():
    """Boost, and three seconds under attitude control, of which the rest is cut off; no frames."""
    scenario = load.load(SCENARIOS / "no_star_tracker.yaml")
    flight = prepare.fly_vehicle(scenario, SEED)
    n = int(np.searchsorted(flight.trajectory.t_s, STEERED_S))
    trajectory = flight.trajectory._make(np.ascontiguousarray(part[:n]) for part in flight.trajectory)
    return scenario, prepare.build_world(scenario, SEED, flight=flight._replace(trajectory=trajectory))


def flown(scenario, world, **how):
    """All records but the measured times."""
    records = simulate.route(world, scenario, SEED, **how)
    return [record for record in records if type(record) is not ComputeTime]


def run_data(scenario, world, records, columns=()):
    """RunData of records, those of the IMU left out, and of records of arrays."""
    builder = RunDataBuilder(prepare.mission(scenario, SEED, world.flight.trajectory))
    for record in records:
        if type(record) is not ImuBlock:
            builder.add(record)
    return builder.build(columns)


def bits(value):
    """A record, or what is in it, as something that is equal only if every bit is."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, tuple | list):
        return type(value).__name__, *map(bits, value)
    return repr(value)


CASES = {
    "plain": lambda: resting([]),
    "faults": lambda: resting(FAULTS),
    "switched": lambda: resting(SWITCHED),
    "steered": steered,
}


@pytest.mark.parametrize("case", CASES)
def test_columns_hold_what_the_records_tell_of_the_same_mission(case):
    """At every tenth tick; the other records are the same, and in the same order."""
    scenario, world = CASES[case]()
    start_s = float(world.flight.trajectory.t_s[0])
    everything = flown(scenario, world)
    columns = Columns(TICKS)
    few = flown(scenario, world, columns=columns)
    assert len(few) < 0.3 * len(everything)
    assert bits(few) == bits([one for one in everything if type(one) not in (*COLUMNS, ImuBlock)])
    arrays = simulate.truth_columns(world, TICKS) + columns.read()
    told = [one for one in everything if thinning.stays(one, TICKS, start_s)]
    assert {type(one) for one in arrays} == {type(one) for one in told if type(one) in COLUMNS}
    assert (ControlSample in map(type, arrays)) == (case == "steered")
    found, expected = run_data(scenario, world, few, arrays), run_data(scenario, world, told)
    assert (
        len(found.nav.t_s) == len(found.truth.t_s) == (len(world.imu.t_s) - 1) // (TICKS * SAMPLES_PER_TICK)
    )
    for name in RunData._fields:
        assert bits(getattr(found, name)) == bits(getattr(expected, name)), name


@pytest.mark.parametrize("overrides", [FAULTS, FAULTS + LATE, SWITCHED], ids=["faults", "late", "switched"])
def test_ticks_one_by_one_are_the_same_mission(overrides, monkeypatch):
    """Without ticks that are made many in one call, and without pictures that are taken ahead of time."""
    scenario, world = resting(overrides)
    expected = flown(scenario, world)
    monkeypatch.setattr(simulate.Shutter, "ahead", lambda self, n, tick, ends_s: n + 1)
    assert bits(flown(scenario, world)) == bits(expected)


def test_columns_of_a_part_of_a_mission_end_with_it():
    """Between two ticks that are told, while a picture is under way."""
    scenario, world = resting(FAULTS)
    columns, until_s = Columns(TICKS), 2.345
    few = flown(scenario, world, until_s=until_s, columns=columns)
    everything = flown(scenario, world, until_s=until_s)
    assert bits(few) == bits([one for one in everything if type(one) not in (*COLUMNS, ImuBlock)])
    told = [one for one in everything if type(one) in COLUMNS and thinning.stays(one, TICKS, 0.0)]
    for found in columns.read():
        rows = [one for one in told if type(one) is type(found)]
        assert found.t_s[-1] == pytest.approx(2.3) and bits(found) == bits(stack(type(found), rows))


def test_no_picture_is_taken_that_begins_after_the_end(monkeypatch):
    """Pictures are taken ahead of time, up to what comes next: that may lie beyond."""
    taken, expose = [], simulate.camera.expose

    def noted(camera, command, trajectory, number, t_start_s, rng):
        taken.append(t_start_s)
        return expose(camera, command, trajectory, number, t_start_s, rng)

    monkeypatch.setattr(simulate.camera, "expose", noted)
    flown(*resting([]), until_s=2.39)  # the picture of 2.3 s has been read, a fix of the GPS comes after 3 s
    assert len(taken) > 10 and 2.2 < max(taken) <= 2.39


@pytest.mark.parametrize("overrides", [[], FAULTS], ids=["plain", "faults"])
def test_warming_up_leaves_the_world_as_it_was(overrides):
    """The world that a run is going to fly is the one that it is warmed up with."""
    expected = flown(*resting(overrides), until_s=3.0)
    scenario, world = resting(overrides)
    simulate.warm_up(scenario, world)
    assert bits(flown(scenario, world, until_s=3.0)) == bits(expected)
