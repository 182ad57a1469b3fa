"""External data through the on-board navigation: a Dataset in, the records of a run out."""

import time
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__
from shefex_nav.clock import SAME_S
from shefex_nav.environment import atmosphere, ephemeris
from shefex_nav.geometry import frames, wgs84
from shefex_nav.log.topics import Mission
from shefex_nav.onboard.driving import Recorded, drive
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.hypotheses import Bank, is_wide
from shefex_nav.onboard.navigator import Navigator
from shefex_nav.records import Alignment, Event, GpsFix, ImuBlock, Phase, StarFix, TruthSample, row
from shefex_nav.replay import align, clocks, dataset, imu_units, params, plausible, reference, said
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
    check(scenario, data)
    odd_times = plausible.meeting(scenario, data)
    data, common = clocks.made_one(scenario, data)
    odd_force = imu_units.accelerometers(scenario, data)
    oddities = plausible.check(scenario, data)
    imu_units.gyros(scenario, data)
    odd = [*odd_times, *odd_force, *data.oddities, *clocks.oddities(common)]
    odd += plausible.repeats(data.imu, data.fixes)
    oddities += [plausible.Oddity(*one) for one in odd]
    orientation = scenario.earth
    earth = ephemeris.earth_rotation(
        scenario.mission.epoch, orientation.ut1_minus_utc, orientation.pole_x, orientation.pole_y
    )
    n = scenario.navigation.samples_per_tick

    def blocks_from(start_s):
        return imu_blocks(data.imu, n, start_s, scenario.mission.end)

    alignment = align.align(scenario, data, earth)
    alignment, since_s = settle(scenario, data, alignment, earth, blocks_from)
    blocks = blocks_from(alignment.t_valid_s)
    if not len(blocks.t_valid_s):
        raise DataError(f"{files['imu']}: {_too_short(scenario, data.imu.t_s, alignment.t_valid_s)}")
    ends_s = np.append(alignment.t_valid_s, blocks.t_valid_s)
    truth = None if data.truth is None else reference.as_felt(data.truth, earth, data.imu, ends_s)
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
        camera=params.NO_CAMERA,
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
    flies = params.navigation(scenario, alignment, replay.earth) or _built_in(replay)
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


# ----------------------------------------------------------------------------------------------------------
# Whether a barometer says what the air weighs where the vehicle starts: units that are wrong are told.
#
# The pressure at a height differs from that of the standard atmosphere by a few percent, with the weather; a
# wrong unit changes it by a factor of seven and more.


WEATHER = 0.12  # [E] share by which the pressure may differ: 1000 m of wrong height, or a record low
FIRST = 20  # readings
UNITS = {"Pa": 1.0, "hPa or mbar": 100.0, "kPa": 1000.0, "mmHg": 133.322, "psi": 6894.76, "bar": 1e5}


def check(scenario, data):
    """DataError if the first readings cannot be pressures of the air at the first fix, in the unit said."""
    fixes = [fix for fix in data.fixes if fix.valid]
    pressures = data.readings.get("barometer", ())
    if not pressures or not fixes:
        return
    pressure = float(np.median([one.pressure for one in pressures[:FIRST]]))
    height = wgs84.geodetic_from_ecef(fixes[0].r_ea_e)[2]
    standard = float(atmosphere.us76(height)[1])
    if abs(pressure / standard - 1.0) < WEATHER:
        return
    columns = scenario.data.barometer
    said = columns.pressure_unit.factor if columns.pressure else 1.0
    words = f"the first readings are {pressure:.4g} Pa; at {height:.0f} m the air has about {standard:.4g} Pa"
    fitting = [
        name for name, factor in UNITS.items() if abs(pressure / said * factor / standard - 1.0) < WEATHER
    ]
    hint = (
        f"they fit as {fitting[0]}" if fitting and columns.pressure else "check data.barometer and the height"
    )
    field = "data.barometer.pressure_unit" if columns.pressure else "data.barometer.height"
    raise DataError(f"{field}: {words}; {hint}")


# ----------------------------------------------------------------------------------------------------------
# An alignment whose heading, or roll on a rail, is hardly known: found from the first motion that shows it.
#
# The recorded data are at hand, so that is done before the navigation begins: several filters start at
# different angles and go through the data until they agree (`onboard.navigation.hypotheses`). The navigation
# begins there.


HEADING = (
    "what is not known shows when the vehicle accelerates along the ground; give a heading, or more of the "
    "motion"
)
HINTS = {
    "rail": "gravity shows the roll about the nose as imu.accelerometer.bias allows: a smaller one, if "
    "the sensors are that good, or a rail that leans more"
}


def settle(scenario, data, alignment, earth, blocks_from):
    """Alignment that one filter can start from: the same, or a later one.

    Parameters
    ----------
    scenario, data, alignment, earth : ReplayScenario, Dataset, Alignment, EarthRotation
    blocks_from : function of a time [s] -> ImuBlock of arrays from there on

    Returns
    -------
    Alignment, and its time before [s], None if it is the same

    Raises
    ------
    DataError : the data end before the filters agree
    """
    if not is_wide(alignment):
        return alignment, None
    blocks = blocks_from(alignment.t_valid_s)
    if not len(blocks.t_valid_s):
        return alignment, None  # the caller says so
    bank = Bank(params.nav_params(scenario, float(blocks.dt_s[0])), alignment, earth)
    mixture = None
    for mixture in mixtures(bank, blocks, data.received):
        if mixture.is_settled:
            return mixture.alignment(), alignment.t_valid_s
    raise DataError(_not_found(alignment, mixture, HINTS.get(scenario.alignment.method, HEADING)))


def _not_found(alignment, mixture, hint):
    begin = f"from {alignment.t_valid_s:g} s on"
    if mixture is None:
        return f"alignment: the heading is not known, and there is no fix {begin} to find it by"
    words = f"to {min(np.degrees(mixture.sigma), 180.0):.0f} deg only (1 sigma) at {mixture.t_s:g} s"
    if mixture.others > 0.01:
        words += f", with another answer of weight {mixture.others:.2g}"
    return f"alignment: {begin} the data show the attitude {words}; {hint}"


def mixtures(bank, blocks, received):
    """Go through blocks and what is received with a Bank; Mixture after every tick in which a fix arrived.

    received : GpsFix, GpsRanges and readings of instruments, in any order; a StarFix is not used
    """
    start_s = bank.members[0].nav.history.ends_s[-1]
    waiting = [one for one in received if one.t_valid_s > start_s and not isinstance(one, StarFix)]
    waiting.sort(key=lambda one: one.t_available_s, reverse=True)
    for k in range(len(blocks.t_valid_s)):
        block, arrived = row(blocks, k), []
        while waiting and waiting[-1].t_available_s <= block.t_valid_s + 1e-6:
            arrived.append(waiting.pop())
        for member in bank.members:
            fusion.advance(member.nav, block)
            if arrived:
                fusion.take(member.nav, arrived)
        if any(isinstance(one, GpsFix) for one in arrived):
            bank.prune()
            yield bank.mixture()
