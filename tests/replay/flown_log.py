"""The log of a short flight: real on-board computer over noisy fixes, truth beside it."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from navigation_flight import C_BC, EARTH, alignment, fly, gps_fix, star_fix

from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.thinning import thinned
from shefex_nav.log.topics import Mission
from shefex_nav.log.writer import LogWriter
from shefex_nav.onboard import computer
from shefex_nav.onboard.navigation import fusion
from shefex_nav.records import Detections, Event, Phase, TruthSample
from shefex_nav.scenario import load, params_onboard

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"
END_S = 30.0
NOTHING = Detections(np.empty((0, 2)), np.empty(0), np.empty(0, int), np.empty(0, int), np.empty((0, 2, 2)))


class Options(NamedTuple):
    """What is special about a flight."""

    seed: int = 1
    overrides: tuple = ()  # of the scenario
    rate_hz: float = 100.0  # of truth, IMU and solution in the log
    stars_s: tuple = (22.0, 28.0)  # from, until
    gps_moved_m: float = 0.0  # of all GPS fixes from 10 s


def mission(scenario, options):
    """Mission of the log; the Earth is that of the flight."""
    return Mission(
        scenario="short_flight",
        scenario_text=scenario.source,
        seed=options.seed,
        version="0.1.0",
        epoch_utc="2012-06-22T19:18:00Z",
        start_s=0.0,
        earth=EARTH,
        launch_latitude=1.2,
        launch_longitude=0.3,
        launch_height=0.0,
        camera=pinhole(659, 493, 2500.0),
        C_bc=C_BC,
    )


def fixes(flight, options):
    """GPS every second, 0.2 s late; stars at 10 Hz, 0.09 s late, every seventh frame in vain."""
    rng = np.random.default_rng(options.seed)
    gps = [gps_fix(*flight, float(t), 0.2, rng) for t in range(1, round(END_S))]
    moved = np.array([options.gps_moved_m, 0.0, 0.0])
    gps = [fix._replace(r_ea_e=fix.r_ea_e + moved) if fix.t_valid_s >= 10.0 else fix for fix in gps]
    stars = []
    for number, t_s in enumerate(np.arange(options.stars_s[0] + 0.013, options.stars_s[1], 0.1)):
        fix = star_fix(*flight, float(t_s), 0.09, rng)
        fix = fix._replace(number=number, detections=NOTHING, hip=np.empty(0, int))
        if number % 7 == 3:
            fix = fix._replace(reason=2, q_ic=np.full(4, np.nan), P_c=np.full((3, 3), np.nan))
        stars.append(fix)
    return gps, stars


def records(options):
    """Mission, then an iterator of the records, as a run gives them."""
    scenario = load.load(SCENARIO, options.overrides)
    flight = fly(END_S)
    return mission(scenario, options), _fly(scenario, flight, options)


def _fly(scenario, flight, options):
    gps, stars = fixes(flight, options)
    start = alignment(flight[1][0], np.random.default_rng(1000 + options.seed))
    params = computer.ComputerParams(params_onboard.nav_params(scenario), None, np.inf, np.inf, np.zeros(3))
    nav = fusion.start(params.nav, start, EARTH)
    solved = tuple(fix for fix in stars if fix.reason == 0)
    onboard = computer.Computer(params, EARTH, nav, None, None, solved, 0)
    yield start
    for block, state in zip(flight[0], flight[1][1:], strict=True):
        now_s = block.t_valid_s
        if now_s in (20.0, END_S):
            yield Event(now_s, "burn_out_1" if now_s == 20.0 else "impact", 1e5, "")
        phase = Phase.BOOST if now_s < 20.0 else Phase.POINTING
        yield TruthSample(now_s, int(phase), state.r_i, state.v_i, state.q_ib, np.zeros(3), np.zeros(3), 0.0)
        yield block
        due = [fix for fix in gps if now_s - 0.01 + 1e-6 < fix.t_available_s <= now_s + 1e-6]
        yield from due
        yield from (fix for fix in stars if now_s - 0.01 < fix.t_available_s - 0.05 <= now_s)
        onboard, outputs = computer.tick(onboard, block, due, [])
        yield from outputs


def write(path, options=None):
    """Write the log of a flight. -> path"""
    options = options or Options()
    head, stream = records(options)
    with LogWriter(path, head, FramePolicy(0, "none", 4.0)) as log:
        for record in thinned(stream, options.rate_hz, head.start_s):
            log.write(record)
    return path
