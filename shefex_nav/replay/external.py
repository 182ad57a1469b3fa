"""External data through the on-board navigation: a Dataset in, the records of a run out."""

import time
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__
from shefex_nav.clock import SAME_S, SAMPLES_PER_TICK
from shefex_nav.environment import ephemeris
from shefex_nav.geometry import frames, wgs84
from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.log.topics import Mission
from shefex_nav.onboard import computer
from shefex_nav.onboard.navigation import fusion
from shefex_nav.records import Alignment, Event, ImuBlock, Phase, TruthSample
from shefex_nav.replay import align, dataset, params, reference
from shefex_nav.replay.table import DataError

BLOCK = SAMPLES_PER_TICK  # at whatever rate they come, so that every log has them alike
TIMED = 100  # ticks whose processor time is taken together: asking for it costs as much as a tick
NO_CAMERA = pinhole(1, 1, 1.0)


class Replay(NamedTuple):
    """What is replayed, ready to go."""

    scenario: object  # ReplayScenario
    data: dataset.Dataset
    earth: object  # EarthRotation
    alignment: Alignment
    blocks: list  # of ImuBlock, from the alignment on
    truth: reference.States | None  # at the ends of blocks


class Clock:
    """Processor time that the filter itself takes, whatever else the machine does."""

    def __init__(self):
        self.filter_s = 0.0


def prepare(scenario, files):
    """Replay of a ReplayScenario and the paths of its files; DataError where the data do not allow it."""
    data = dataset.read(scenario, files)
    orientation = scenario.earth
    earth = ephemeris.earth_rotation(
        scenario.mission.epoch, orientation.ut1_minus_utc, orientation.pole_x, orientation.pole_y
    )
    alignment = align.align(scenario, data, earth)
    blocks = imu_blocks(data.imu, alignment.t_valid_s, scenario.mission.end)
    if not blocks:
        words = f"ends at {data.imu.t_s[-1]:g} s; nothing is left to navigate after {alignment.t_valid_s:g} s"
        raise DataError(f"{files['imu']}: {words}")
    ends_s = np.array([alignment.t_valid_s] + [block.t_valid_s for block in blocks])
    truth = None if data.truth is None else reference.at(data.truth, earth, ends_s)
    return Replay(scenario, data, earth, alignment, blocks, truth)


def imu_blocks(imu, start_s, end_s=None):
    """ImuBlock after ImuBlock from the sample that ends at start_s to end_s, or as far as there are samples.

    Samples of slightly unequal length count as equal within a block; its beginning and its end are exact.
    """
    n, first = BLOCK, align.first_sample(imu, start_s)
    last = len(imu.t_s) - 1 if end_s is None else int(np.searchsorted(imu.t_s, end_s + SAME_S)) - 1
    out = []
    for k in range(first, last - n + 1, n):
        rows = slice(k + 1, k + n + 1)
        begin_s, t_s = float(imu.t_s[k]), float(imu.t_s[k + n])
        measured = not imu.bridged[rows].any()
        out.append(
            ImuBlock(t_s, t_s, (t_s - begin_s) / n, imu.dtheta_b[rows], imu.dv_b[rows], False, measured)
        )
    return out


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
        camera=NO_CAMERA,
        C_bc=np.eye(3),
    )


def run(replay, clock):
    """Tick by tick through a Replay; the time that the filter takes is added to `clock`.

    Yields
    ------
    Alignment, Event 'replay_start', then with every ImuBlock TruthSample (where there is truth), ImuBlock,
    GpsFix, GateResult, NavSolution and NavCovariance
    """
    alignment, scenario = replay.alignment, replay.scenario
    yield alignment
    height = mission(replay).launch_height
    yield Event(alignment.t_valid_s, "replay_start", height, f"{scenario.data.format} data")
    nav = fusion.start(params.nav_params(scenario, replay.blocks[0].dt_s), alignment, replay.earth)
    waiting = [fix for fix in replay.data.fixes if fix.t_valid_s > alignment.t_valid_s][::-1]
    truth = _truth_samples(replay.truth)
    for first in range(0, len(replay.blocks), TIMED):
        began = time.process_time()
        done = [
            _tick(nav, ticks, block, waiting)
            for ticks, block in enumerate(replay.blocks[first : first + TIMED], first + 1)
        ]
        clock.filter_s += time.process_time() - began
        for block, arrived, outputs in done:
            if block.t_valid_s in truth:
                yield truth[block.t_valid_s]
            yield block
            yield from arrived
            yield from outputs


def _tick(nav, ticks, block, waiting):
    """One tick without stars -> block, fixes that have arrived, what the filter says.

    waiting : GpsFix, the last is the next to arrive
    """
    arrived = []
    while waiting and waiting[-1].t_available_s <= block.t_valid_s + SAME_S:
        arrived.append(waiting.pop())
    fusion.advance(nav, block)
    return block, arrived, computer.conclude(nav, ticks, arrived, ())


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
    brief = replay.blocks[:20]
    if fixes and len(brief) > 10:  # one fix, late, in the middle of what is flown
        at_s = brief[5].t_valid_s - 0.3 * brief[5].dt_s
        fixes = [fixes[0]._replace(t_valid_s=at_s, t_available_s=brief[8].t_valid_s)]
    data = replay.data._replace(fixes=fixes)
    for _ in run(replay._replace(blocks=brief, data=data), Clock()):
        pass
