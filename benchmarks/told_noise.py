"""A filter that is told other noise of its IMU than is true: what it costs, and what the filter says of it.

uv run python benchmarks/told_noise.py [DATA] [--factors 0.1 0.3 3 10] [--seeds 3] [--first 1] [--jobs 1]

Random walk, in-run bias and turn-on bias of gyros and accelerometers are told as a factor times what is true
of them: the default mission (with a star tracker by statistics) and `rexus_like` with some seeds, and with
DATA, the folder of NaveGo's files, its drive from 60 s on. Each is compared with the flight of the same seed
whose noise is told right. Wanted are a position error (root mean square) of at most 1.5 times that of the
right noise, and no sensor that is believed against the filter more than twice. Prints each flight with what
was said of the noise; exit code 1 if something is not as wanted.
"""

import argparse
import os
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from missions import SCENARIOS

from shefex_nav.report.navigation_errors import navigation_errors

WORSE, RESETS = 1.5, 2
MISSIONS = {"shefex2_andoya": ["star_tracker.frames=statistical"], "rexus_like": []}
KEYS = ("random_walk", "in_run_bias", "bias")
UNITS = {"gyro": ("rad/sqrt(s)", "rad/s", "rad/s"), "accelerometer": ("m/s/sqrt(s)", "m/s2", "m/s2")}


def told(scenario, factor, section):
    """Overrides by which so many times the true noise is told. Scenario, float, section -> list"""
    return [
        f"{section}.{triad}.{key}={factor * getattr(getattr(scenario.imu, triad), key)!r} {unit}"
        for triad, units in UNITS.items()
        for key, unit in zip(KEYS, units, strict=True)
    ]


def fly(job):
    """(name, seed, factor, data) -> position error m, Counter of resets, what is said of noise."""
    name, seed, factor, data = job
    from shefex_nav.log.run_data import RunDataBuilder

    if data:
        mission, records = _drive(Path(data), factor)
    else:
        mission, records = _flight(name, seed, factor)
    kept = RunDataBuilder(mission)
    for record in records:
        kept.add(record)
    run = kept.build()
    errors = navigation_errors(run)
    r_i = errors.position_i[errors.t_s >= 60.0] if data else errors.position_i
    resets = Counter(gate.sensor for gate in run.gates if gate.accepted and gate.note)
    said = [f"T{one.t_s:+.0f} s {one.reason or 'right again'}" for one in run.health if "noise" in one.source]
    return float(np.sqrt((r_i**2).sum(axis=1).mean())), resets, said


def _flight(name, seed, factor):
    """Mission and records of a flight."""
    from shefex_nav import prepare, simulate
    from shefex_nav.log.thinning import thinned
    from shefex_nav.scenario import load

    path, overrides = SCENARIOS / f"{name}.yaml", MISSIONS[name]
    more = told(load.load(path, overrides), factor, "navigation.told.imu")
    scenario = load.load(path, [*overrides, *(more if factor != 1.0 else [])])
    world = prepare.build_world(scenario, seed)
    mission = prepare.mission(scenario, seed, world.flight.trajectory)
    return mission, thinned(simulate.route(world, scenario, seed), scenario.log.rate, mission.start_s)


def _drive(data, factor):
    """Mission and records of NaveGo's drive."""
    from shefex_nav.replay import external, load

    path = SCENARIOS / "replay" / "navego.yaml"
    more = told(load.load(path, [], data)[0], factor, "imu")
    ready = external.prepare(*load.load(path, more, data))
    return external.mission(ready), external.run(ready, external.Clock())


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", nargs="?", help="folder with NaveGo's three files")
    parser.add_argument("--factors", type=float, nargs="+", default=[0.1, 0.15, 0.2, 0.3, 3.0, 10.0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    seeds = range(options.first, options.first + options.seeds)
    cases = [(name, seed, None) for name in MISSIONS for seed in seeds]
    cases += [("navego", 0, options.data)] if options.data else []
    factors = [1.0, *options.factors]
    jobs = [(name, seed, factor, data) for name, seed, data in cases for factor in factors]
    kept, right = True, np.nan
    with ProcessPoolExecutor(max_workers=options.jobs, mp_context=get_context("spawn")) as pool:
        for (name, seed, factor, _), (error, resets, said) in zip(jobs, pool.map(fly, jobs), strict=True):
            right = error if factor == 1.0 else right
            met = error <= WORSE * right and max(resets.values(), default=0) <= RESETS
            met &= factor != 1.0 or not said
            kept &= met
            words = "; ".join(said) or "nothing said"
            times = f"{factor:5g} times: {error:7.3f} m, {error / right:5.2f} times that of the right noise"
            print(
                f"{name} {seed}, {times}, resets {dict(resets)}, {words}{'' if met else '  NOT met'}",
                flush=True,
            )
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
