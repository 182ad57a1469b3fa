"""External data through the on-board navigation: a Dataset in, the records of a run out."""

import time
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__
from shefex_nav.clock import SAME_S
from shefex_nav.environment import ephemeris
from shefex_nav.geometry import frames, wgs84
from shefex_nav.log.topics import Mission
from shefex_nav.onboard.driving import Recorded, drive
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigator import Navigator
from shefex_nav.records import Alignment, Event, ImuBlock, Phase, TruthSample, row
from shefex_nav.replay import (
    align,
    clocks,
    dataset,
    gyro_unit,
    own,
    params,
    plausible,
    pressure,
    reference,
    repeats,
    said,
    settle,
)
from shefex_nav.scenario import plugged, software
from shefex_nav.scenario.data_table import DataError


class Replay(NamedTuple):
    """What is replayed, ready to go."""

    scenario: object  # ReplayScenario
    data: dataset.Dataset
    earth: object  # EarthRotation
    alignment: Alignment
    blocks: ImuBlock  # arrays, a row a block, from the alignment on
    truth: reference.States | None  # at the ends of blocks
    oddities: tuple[plausible.Oddity, ...] = ()  # what is to be warned of
    start: dict | None = None  # `said.alignment`
    common: clocks.Clocks | None = None  # what is known of the clocks


class Clock:
    """Processor time that the filter itself takes, whatever else the machine does."""

    def __init__(self):
        self.filter_s = 0.0


def prepare(scenario, files):
    """Replay of a ReplayScenario and the paths of its files; DataError where the data do not allow it."""
    data = dataset.read(scenario, files)
    pressure.check(scenario, data)
    data, common = clocks.made_one(scenario, data)
    oddities = plausible.check(scenario, data)
    gyro_unit.check(scenario, data)
    odd = (*data.oddities, *clocks.oddities(common), *repeats.oddities(data.imu, data.fixes))
    oddities += [plausible.Oddity(*one) for one in odd]
    orientation = scenario.earth
    earth = ephemeris.earth_rotation(
        scenario.mission.epoch, orientation.ut1_minus_utc, orientation.pole_x, orientation.pole_y
    )
    n = scenario.navigation.samples_per_tick

    def blocks_from(start_s):
        return imu_blocks(data.imu, n, start_s, scenario.mission.end)

    alignment = align.align(scenario, data, earth)
    alignment, since_s = settle.settle(scenario, data, alignment, earth, blocks_from)
    blocks = blocks_from(alignment.t_valid_s)
    if not len(blocks.t_valid_s):
        raise DataError(f"{files['imu']}: {_too_short(scenario, data.imu.t_s, alignment.t_valid_s)}")
    ends_s = np.append(alignment.t_valid_s, blocks.t_valid_s)
    truth = None if data.truth is None else reference.at(data.truth, earth, ends_s)
    start = said.alignment(alignment, earth, scenario.alignment.method, since_s)
    return Replay(scenario, data, earth, alignment, blocks, truth, tuple(oddities), start, common)


def _too_short(scenario, t_s, start_s):
    """Why there is not a single tick after start_s. ReplayScenario, (N,) s, s -> str"""
    n, end_s = scenario.navigation.samples_per_tick, scenario.mission.end
    end_s = t_s[-1] if end_s is None else min(end_s, t_s[-1])
    if end_s > start_s:
        return (
            f"{end_s - start_s:g} s after {start_s:g} s are no tick of {n} samples: "
            "a smaller navigation.samples_per_tick"
        )
    return f"ends at {t_s[-1]:g} s; nothing is left to navigate after {start_s:g} s"


def imu_blocks(imu, n, start_s, end_s=None):
    """Blocks of n samples from the one that ends at start_s to end_s, or as far as they go: one of arrays.

    Samples of slightly unequal length count as equal within a block; its beginning and its end are exact. A
    block with a sample that was missing is not valid.
    """
    first = align.first_sample(imu, start_s)
    last = len(imu.t_s) - 1 if end_s is None else int(np.searchsorted(imu.t_s, end_s + SAME_S)) - 1
    m = max((last - first) // n, 0)
    t_s, rows = imu.t_s[first : first + 1 + m * n : n], slice(first + 1, first + 1 + m * n)
    dtheta_b, dv_b = imu.dtheta_b[rows].reshape(m, n, 3), imu.dv_b[rows].reshape(m, n, 3)
    valid = ~imu.bridged[rows].reshape(m, n).any(axis=1)
    return ImuBlock(t_s[1:], t_s[1:], np.diff(t_s) / n, dtheta_b, dv_b, np.zeros(m, dtype=bool), valid)


def mission(replay):
    """Who, when and where, for the head of a log; drawings are in axes of the place of the alignment."""
    scenario, alignment = replay.scenario, replay.alignment
    r_e, _ = frames.ecef_from_inertial(replay.earth, alignment.t_valid_s, alignment.r_i, alignment.v_i)
    latitude, longitude, height = wgs84.geodetic_from_ecef(r_e)
    return Mission(
        scenario=scenario.mission.name,
        scenario_text=scenario.source,
        seed=0,
        version=__version__,
        epoch_utc=scenario.mission.epoch,
        start_s=alignment.t_valid_s,
        earth=replay.earth,
        launch_latitude=latitude,
        launch_longitude=longitude,
        launch_height=height,
        camera=own.NO_CAMERA,
        C_bc=np.eye(3),
        plugins=plugged.pinned(scenario),
        software=software.flown(scenario),
    )


def run(replay, clock):
    """Tick by tick through a Replay; the time that the filter takes is added to `clock`.

    Yields
    ------
    Alignment, Event 'replay_start', then with every ImuBlock TruthSample (where there is truth), ImuBlock,
    GpsFix, readings of instruments, GateResult, NavSolution and NavCovariance
    """
    alignment, scenario = replay.alignment, replay.scenario
    yield alignment
    height = mission(replay).launch_height
    yield Event(alignment.t_valid_s, "replay_start", height, f"{scenario.data.format} data")
    flies = own.navigation(scenario, alignment, replay.earth) or _built_in(replay)
    said = [one for one in replay.data.received if one.t_valid_s > alignment.t_valid_s]
    said = Recorded(replay.blocks.t_valid_s, sorted(said, key=lambda one: one.t_available_s))
    truth = _truth_samples(replay.truth)
    for k, arrived, outputs in _timed(drive(flies, replay.blocks, said), clock):
        block = row(replay.blocks, k)
        if block.t_valid_s in truth:
            yield truth[block.t_valid_s]
        yield block
        yield from arrived
        yield from outputs


def _built_in(replay):
    """Navigator with the filter at the alignment of a Replay."""
    nav_params = params.nav_params(replay.scenario, float(replay.blocks.dt_s[0]))
    return Navigator(fusion.start(nav_params, replay.alignment, replay.earth))


def _timed(steps, clock):
    """Steps of an iterator, the processor time that they take added to a clock."""
    while True:
        began = time.process_time()
        step = next(steps, None)
        clock.filter_s += time.process_time() - began
        if step is None:
            return
        yield step


def _truth_samples(states):
    """{time: TruthSample}; what external data do not say of the motion is NaN."""
    if states is None:
        return {}
    unknown = np.full(3, np.nan)
    return {
        t_s: TruthSample(t_s, int(Phase.COAST), r_i, v_i, q_ib, unknown, unknown, np.nan)
        for t_s, r_i, v_i, q_ib in zip(states.t_s.tolist(), *states[1:], strict=True)
    }


def warm_up(replay):
    """Compile or load every kernel of a replay, so that it is not measured with its compiler."""
    fixes = [fix for fix in replay.data.fixes if fix.valid][:1]
    brief = ImuBlock(*(column[:20] for column in replay.blocks))
    if fixes and len(brief.t_valid_s) > 10:  # one fix, late, in the middle of what is flown
        at_s = float(brief.t_valid_s[5] - 0.3 * brief.dt_s[5])
        fixes = [fixes[0]._replace(t_valid_s=at_s, t_available_s=float(brief.t_valid_s[8]))]
    data = replay.data._replace(fixes=fixes)
    scenario = software.with_built_in(replay.scenario)  # software of a user's own flies once, not here
    for _ in run(replay._replace(scenario=scenario, blocks=brief, data=data), Clock()):
        pass
