"""The route: what is told of a mission does not change the mission."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shefex_nav import prepare, simulate
from shefex_nav.clock import SAMPLES_PER_TICK
from shefex_nav.log import thinning
from shefex_nav.log.run_data import RunData, RunDataBuilder, stack
from shefex_nav.onboard.navigator import Columns
from shefex_nav.records import (
    CameraCommand,
    ComputeTime,
    ControlSample,
    Frame,
    ImuBlock,
    NavCovariance,
    NavSolution,
    Reason,
    StarFix,
    TruthSample,
)
from shefex_nav.scenario import load
from shefex_nav.settings import changed
from shefex_nav.world.camera.camera import frame_of

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


TICK_US, EVERY = 10_000, 10  # of the computer; ticks from picture to picture
EXPOSURE_US, READOUT_US = 50_000, (15_000, 20_000)  # a picture arrives between two ticks, or on one
WITHIN_TICK_US = 0, 0.5, 2, 1000, 5000, 9000, 9998, 9999.5
SWITCHES_US = [
    *((500_000.0, 2_050_000.0 + k * TICK_US + us) for k in range(5) for us in WITHIN_TICK_US),
    *((490_000.0 + k * TICK_US + us, 2_100_000.0) for k in range(3) for us in WITHIN_TICK_US),
    *((500_000.0 + us, 570_000.0 + us) for us in WITHIN_TICK_US),  # on for a picture, or not quite
    (503_000.0, 508_000.0),  # for no tick
]


@pytest.fixture(scope="module")
def still():
    return resting([])


def tick_of(us):
    """The first tick that ends then or later, an instant being a microsecond wide."""
    return int(np.ceil((us - 1.0) / TICK_US))


def switched(still, monkeypatch, on_us, off_us, readout_us):
    """Star camera and tracker that give no attitude and want the same exposure again. -> records"""

    def expose(camera, command, trajectory, number, t_start_s, rng):
        times_s = t_start_s, t_start_s + 0.5 * command.exposure_s, t_start_s + command.exposure_s
        frame = frame_of(camera.settings.detector, command, number, times_s, np.zeros((8, 8), dtype=np.uint8))
        return frame, number

    def step(tracker, state, frame, context):
        fix = made_up_fix(frame.number, frame.t_valid_s, frame.t_available_s)
        return state, fix, CameraCommand(frame.t_available_s, 1e-6 * EXPOSURE_US, 0.0)

    scenario, world = still
    monkeypatch.setattr(simulate.camera, "expose", expose)
    start = simulate.star_tracker.start
    monkeypatch.setattr(
        simulate.star_tracker, "start",
        lambda tracker, now_s: (start(tracker, now_s)[0], CameraCommand(now_s, 1e-6 * EXPOSURE_US, 0.0)),
    )  # fmt: skip
    tracker = world.computer.tracker
    settings = replace(tracker.settings, on=1e-6 * on_us, off=1e-6 * off_us)
    computer = world.computer._replace(tracker=tracker._replace(settings=settings))
    of_camera = changed(
        world.camera.settings, {"detector.readout": 1e-6 * readout_us, "detector.shutter": "global"}
    )
    world = world._replace(computer=computer, camera=world.camera._replace(settings=of_camera))
    return list(simulate.route(world, scenario, SEED, until_s=2.2, step=step))


def made_up_fix(number, t_valid_s, t_available_s):
    """StarFix of a frame without stars."""
    unknown = np.full(4, np.nan), np.full((3, 3), np.nan)
    few = int(Reason.TOO_FEW_STARS)
    return StarFix(
        number, t_valid_s, t_available_s, few, *unknown, None, None, np.nan, 0.0, 0.05, False, True
    )


@pytest.mark.parametrize("readout_us", READOUT_US)
@pytest.mark.parametrize(("on_us", "off_us"), SWITCHES_US)
def test_computer_and_camera_agree_who_is_on(still, monkeypatch, on_us, off_us, readout_us):
    """Pictures are those that arrive at a tick at which the tracker is on, and none is left out."""
    records = switched(still, monkeypatch, on_us, off_us, readout_us)
    on, off = tick_of(on_us), tick_of(off_us)
    arrival = {n: tick_of(n * TICK_US + EXPOSURE_US + readout_us) for n in range(0, 221, EVERY)}
    expected = [n for n in arrival if n >= on and arrival[n] < off]
    frames = [record for record in records if isinstance(record, Frame)]
    assert [round(frame.t_start_s / (1e-6 * TICK_US)) for frame in frames] == expected
    for kind in (StarFix, ComputeTime):
        numbers = [
            one.number if kind is StarFix else one.frame_number for one in records if type(one) is kind
        ]
        assert numbers == [frame.number for frame in frames]
    commands = [record.t_s for record in records if isinstance(record, CameraCommand)]
    assert len(commands) == (1 + len(frames) if on < off else 0)
    if on < off:
        assert commands[0] == pytest.approx(1e-6 * TICK_US * on)


def test_a_picture_that_would_arrive_as_the_tracker_goes_off_is_not_taken():
    """Rendered, and with ticks that are made many at once."""
    scenario, world = resting(["star_tracker.off=2.07 s"])
    records = flown(scenario, world, until_s=4.0)
    frames = [record for record in records if isinstance(record, Frame)]
    fixes = [record for record in records if isinstance(record, StarFix)]
    assert len(frames) == len(fixes) == 10 and frames[-1].t_available_s <= 2.06
