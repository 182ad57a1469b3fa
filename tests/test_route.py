"""The route: what is told of a mission does not change the mission."""

from pathlib import Path

import numpy as np
import pytest

from shefex_nav import prepare, simulate
from shefex_nav.log import thinning
from shefex_nav.records import ComputeTime
from shefex_nav.scenario import load

SCENARIO = Path(__file__).parent.parent / "scenarios" / "night_sky.yaml"
TICKS = 10
FAULTS = [  # between ticks that are told
    "faults.imu=[{fault: dropout, from: 0.613 s, until: 0.78 s}]",
    "faults.star_tracker=[{fault: blinded, from: 1.33 s, until: 1.77 s}]",
]


def flown(overrides, *, warm=False, **how):
    """Records of three seconds with frames, all but the measured times."""
    scenario = load.load(SCENARIO, overrides)
    world = prepare.build_world(scenario, 4, brief=True)
    if warm:
        simulate.warm_up(scenario, world)
    start_s = float(world.flight.trajectory.t_s[0])
    records = simulate.route(world, scenario, 4, until_s=start_s + 3.0, **how)
    return start_s, [record for record in records if type(record) is not ComputeTime]


def bits(value):
    """A record, or what is in it, as something that is equal only if every bit is."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, tuple | list):
        return type(value).__name__, *map(bits, value)
    return repr(value)


@pytest.mark.parametrize(
    "overrides",
    [[], FAULTS, ["star_tracker.on=0 s", "star_tracker.off=1.777 s", "star_tracker.rate=4 Hz"]],
    ids=["plain", "faults", "switched"],
)
def test_fewer_records_are_told_of_the_same_mission(overrides):
    start_s, everything = flown(overrides)
    _, few = flown(overrides, every=TICKS)
    expected = [record for record in everything if thinning.stays(record, TICKS, start_s)]
    assert len(few) < 0.3 * len(everything)
    assert bits(few) == bits(expected)


@pytest.mark.parametrize("overrides", [[], FAULTS], ids=["plain", "faults"])
def test_warming_up_leaves_the_world_as_it_was(overrides):
    """The world that a run is going to fly is the one that it is warmed up with."""
    _, expected = flown(overrides)
    _, found = flown(overrides, warm=True)
    assert bits(found) == bits(expected)
