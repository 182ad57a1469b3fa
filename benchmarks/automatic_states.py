"""What the states that the program chooses do for errors and sigmas, with an IMU of each grade.

uv run python benchmarks/automatic_states.py [--scenario rexus_like] [--flights 20] [--first 1] [--jobs 2]

The filter flies with IMU and GPS, no star tracker, one flight with new errors of the sensors for each seed:
with the two blocks that were the default before (`OLD`) and with `navigation.states: automatic`. Ranges are
those of `RANGES`: what a sensor does at the end of its range is another study (`saturation.py`). Prints rms
errors and mean NEES per degree of freedom (1 is right) at some moments and over the flight, once a second.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context

import numpy as np

OLD = ("gyro_roll_column", "mounting")
UNITS = ("hg9900", "ln_200s", "adis16470", "icm_42688_p")
RANGES = ("imu.gyro.range=3000 deg/s", "imu.accelerometer.range=60 gee")
PARTS = {"position m": slice(0, 3), "velocity m/s": slice(3, 6), "attitude deg": slice(6, 9)}


@cache
def planned(name):
    """Flight of a scenario."""
    from shefex_nav import Scenario, prepare

    return prepare.fly_vehicle(Scenario.load(name), prepare.PLANNED)


@cache
def scenario_of(name, unit, states):
    """Scenario with a unit and states of its filter, or 'automatic'."""
    from shefex_nav import Scenario, prepare

    told = states if isinstance(states, str) else f"[{', '.join(states)}]"
    loaded = Scenario.load(name, [f"imu.use={unit}", *RANGES, f"navigation.states={told}"])
    return prepare.settled(loaded, planned(name))


def fly(name, unit, states, seed):
    """One flight: {moment: (errors (9,), NEES of position, velocity, attitude (3,))}, once a second."""
    from shefex_nav import prepare, simulate
    from shefex_nav.onboard.navigation import fusion, ticks
    from shefex_nav.world import imu

    world = prepare.build_world(scenario_of(name, unit, states), seed, flight=planned(name))
    nav = fusion.start(world.computer.nav, world.alignment, world.earth)
    blocks, n, rows = imu.stacked(world.imu), 0, {}
    gps = sorted(world.gps_fixes, key=lambda fix: fix.t_available_s, reverse=True)
    while n < len(blocks.t_valid_s):
        arrives_s = gps[-1].t_available_s if gps else np.inf
        stop = min(n - n % 100 + 100, len(blocks.t_valid_s))
        stop = min(stop, int(np.searchsorted(blocks.t_valid_s + 1e-6, arrives_s)) + 1)
        while n < stop:
            n += ticks.advance(nav, blocks, n, stop)
        if arrived := simulate.due(gps, blocks.t_valid_s[n - 1]):
            fusion.fuse(nav, [("gps", fix) for fix in arrived])
        if n % 100 == 0 and blocks.t_valid_s[n - 1] > 0.0:
            rows[round(float(blocks.t_valid_s[n - 1]))] = errors(nav, world.flight.trajectory, 4 * n)
    return rows


def errors(nav, truth, k):
    """Errors (9,), attitude in body axes, and NEES (3,) of the present solution; k : sample of the truth."""
    from shefex_nav.geometry import rotation
    from shefex_nav.onboard.navigation import covariance, solution

    out, P = solution.solution(nav), covariance.reported(nav)
    attitude = rotation.rotvec_between(out.q_ib, truth.q_ib[k])
    error = np.concatenate([truth.r_i[k] - out.r_i, truth.v_i[k] - out.v_i, attitude])
    return error, np.array([error[j] @ np.linalg.solve(P[j, j], error[j]) for j in PARTS.values()])


def show(unit, label, flown, moments):
    """Print the rows of one unit with one choice of states."""
    over_all = [row for rows in flown for row in rows.values()]
    for moment, rows in {
        **{m: [one[t] for one in flown] for m, t in moments.items()},
        "flight": over_all,
    }.items():
        error, nees = (np.array(column) for column in zip(*rows, strict=True))
        words = []
        for k, (part, j) in enumerate(PARTS.items()):
            rms = np.sqrt((error[:, j] ** 2).sum(axis=1).mean())
            scale = np.degrees(1.0) if part.endswith("deg") else 1.0
            words.append(f"{part} {scale * rms:9.3g} (NEES {nees[:, k].mean() / 3.0:5.2f})")
        print(f"{unit:12} {label:10} {moment:12} {'  '.join(words)}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="rexus_like")
    parser.add_argument("--flights", type=int, default=20, help="of each unit, with each choice of states")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--unit", choices=UNITS, action="append")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    at = {event.name: round(event.t_s) for event in planned(given.scenario).events}
    moments = {"burn-out": at["burn_out_1"] + 1, "apogee": at["apogee"], "end": at["impact"] - 1}
    seeds = range(given.first, given.first + given.flights)
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        for unit in given.unit or UNITS:
            for label, states in (("before", OLD), ("automatic", "automatic")):
                n = len(seeds)
                flown = pool.map(fly, [given.scenario] * n, [unit] * n, [states] * n, seeds)
                show(unit, label, list(flown), moments)
    return 0


if __name__ == "__main__":
    sys.exit(main())
