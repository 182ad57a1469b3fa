"""Receivers that freeze as the motor burns: are they found out, and is the receiver believed when it is back?

uv run python benchmarks/frozen_gps.py [--flights 100] [--first 0] [--jobs 1] [--json FILE]

Each flight draws for itself: the boost of `rexus_like` or of the default mission; the scale factor of the
accelerometers, 0 to 10 000 ppm, of which the true one is drawn and which the filter is told, with the state
`accel_scale` or without; 1, 2, 5, 10 or 20 fixes a second; a freeze that begins 0 to 5 s after lift-off and
lasts 20 s, in which position and velocity are repeated as valid fixes. There are no other outages. Asked is:

- alarm: the receiver is called frozen by the second repeated fix after the vehicle's velocity has changed by
  more than 5 sigma (of one axis of a fix) since the fix that is repeated, or within 1 s if that is later;
- inside: position and velocity, each axis, are within 3 sigma of the truth when the first good fix is there;
- back: position and velocity of a good fix are used by the second one or within 1 s, whichever is later.

Wanted are 99 % of the flights, and inside the 3 sigma no fewer than a normal error would be (a number that
chance falls below once in a thousand). Exit code 1 if that is not kept. Every flight that was not is printed.
"""

import argparse
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from missions import SCENARIOS

RATES = (1, 2, 5, 10, 20)
LASTS_S, AFTER_S = 20.0, 3.0
SIGMAS, WANTED, INSIDE = 5.0, 0.99, 0.9973002
AXES = [f"{what} {axis}" for what in ("position", "velocity") for axis in "xyz"]


def drawn(k):
    """What flight k draws: dict."""
    rng = np.random.default_rng(np.random.SeedSequence(2205, spawn_key=(k,)))
    return {
        "seed": k,
        "scenario": ("rexus_like", "shefex2_andoya")[int(rng.integers(2))],
        "ppm": round(float(rng.uniform(0.0, 10_000.0)), 1),
        "rate": int(rng.choice(RATES)),
        "from": round(float(rng.uniform(0.0, 5.0)), 2),
        "state": bool(rng.integers(2)),
    }


def fly(k):
    """Flight k: what it drew, and how it went."""
    from shefex_nav import prepare, simulate
    from shefex_nav.onboard.navigator import Columns
    from shefex_nav.records import GateResult, GpsFix, NavHealth
    from shefex_nav.scenario import load

    draw = drawn(k)
    begin_s, end_s = draw["from"], draw["from"] + LASTS_S
    path, common = SCENARIOS / f"{draw['scenario']}.yaml", [
        f"imu.accelerometer.scale_factor={draw['ppm']} ppm",
        f"gps.rate={draw['rate']} Hz",
        "gps.outages=[]",
        "star_tracker.enabled=false",
        f"faults.gps=[{{fault: freeze, from: {begin_s} s, until: {end_s} s}}]",
    ]  # fmt: skip
    states = load.load(path, common).navigation.states
    kept = [name for name in states if name != "accel_scale"] + ["accel_scale"] * draw["state"]
    scenario = load.load(path, [*common, f"navigation.states=[{', '.join(kept)}]"])
    flight = cut(flown(draw["scenario"]), end_s + AFTER_S)
    world, columns = prepare.build_world(scenario, k, flight=flight), Columns(1)
    gates, health, fixes = [], [], []
    for record in simulate.route(world, scenario, k, columns=columns):
        for kind, into in ((GateResult, gates), (NavHealth, health), (GpsFix, fixes)):
            if isinstance(record, kind):
                into.append(record)
    return draw | judged(world, columns.read()[0], gates, health, fixes, begin_s, end_s)


@lru_cache(maxsize=2)
def flown(name):
    """The vehicle's flight, which no draw changes."""
    from shefex_nav import prepare
    from shefex_nav.scenario import load

    return prepare.fly_vehicle(load.load(SCENARIOS / f"{name}.yaml", []), 0)


def cut(flight, end_s):
    """The first part of a Flight."""
    trajectory = flight.trajectory
    n = int(np.searchsorted(trajectory.t_s, end_s))
    events = tuple(event for event in flight.events if event.t_s < end_s)
    return flight._replace(trajectory=trajectory._make(column[:n] for column in trajectory), events=events)


def judged(world, told, gates, health, fixes, begin_s, end_s):
    """What is asked of a flight; None where it could not be asked."""
    valid = [fix for fix in fixes if fix.valid]
    before = [fix for fix in valid if fix.t_valid_s < begin_s - 1e-6]
    repeats = [fix for fix in valid if begin_s - 1e-6 <= fix.t_valid_s < end_s - 1e-6]
    good = [fix for fix in valid if fix.t_valid_s >= end_s - 1e-6]
    row = {"alarm": None, "inside": None, "back": None}
    if not before or len(repeats) < 2 or len(good) < 2:
        return row
    alarm_s = next((one.t_s for one in health if one.source == "gps" and "frozen" in one.reason), np.inf)
    due_s = alarm_due_s(world, before[-1], repeats)
    back_s = max(
        min((gate.t_s for gate in gates if gate.sensor == sensor and gate.accepted
             and gate.t_valid_s >= end_s - 1e-6), default=np.inf)
        for sensor in ("gps_position", "gps_velocity")
    )  # fmt: skip
    back_due_s = max(good[1].t_available_s, good[0].t_available_s + 1.0) + 0.011  # the tick that takes it
    over = errors(world, told, good[0].t_valid_s)
    return {
        "alarm": None if due_s is None else bool(alarm_s <= due_s + 0.011),
        "alarm late, s": None if due_s is None else float(alarm_s - due_s),
        "inside": (np.abs(over) <= 3.0).tolist(),
        "over sigma": np.round(over, 2).tolist(),
        "back": bool(back_s <= back_due_s),
        "back after, s": float(back_s - good[0].t_available_s),
        "notes": sorted({gate.note for gate in gates if gate.t_valid_s >= end_s - 1e-6 and gate.note}),
    }


def alarm_due_s(world, frozen, repeats):
    """When the alarm is due at the latest; None: the velocity never changes by so much."""
    limit = SIGMAS * np.sqrt(np.trace(frozen.R_v_e) / 3.0)
    v_e = truth(world, frozen.t_valid_s)[1]
    for k, fix in enumerate(repeats[:-1]):
        if np.linalg.norm(truth(world, fix.t_valid_s)[1] - v_e) > limit:
            return max(repeats[k + 1].t_available_s, fix.t_available_s + 1.0)
    return None


def truth(world, t_s):
    """Position and velocity of the IMU against the Earth at a sample, frame e."""
    from shefex_nav.geometry import frames

    trajectory = world.flight.trajectory
    k = int(np.argmin(np.abs(trajectory.t_s - t_s)))
    return frames.ecef_from_inertial(world.earth, trajectory.t_s[k], trajectory.r_i[k], trajectory.v_i[k])


def errors(world, told, t_s):
    """Errors of position and velocity over their sigmas, (6,), at the last tick before t_s."""
    k = int(np.searchsorted(told.t_s, t_s - 1e-6)) - 1
    r_e, v_e = truth(world, told.t_s[k])
    position = (r_e - told.r_e[k]) / told.sigma_r_e[k]
    return np.concatenate([position, (v_e - told.v_e[k]) / told.sigma_v_e[k]])


def report(rows):
    """Print what was found. -> bool, whether it is kept"""
    from scipy.stats import binom

    kept = True
    for name in ("alarm", "back"):
        asked = [row for row in rows if row[name] is not None]
        share = np.mean([row[name] for row in asked]) if asked else np.nan
        kept &= bool(share >= WANTED)
        print(f"{name}: {100 * share:.2f} % of {len(asked)} flights, {100 * WANTED:.0f} % wanted")
    asked = np.array([row["inside"] for row in rows if row["inside"] is not None])
    fewest = binom.ppf(0.001, len(asked), INSIDE)
    for axis, count in zip(AXES, asked.sum(axis=0), strict=True):
        kept &= bool(count >= fewest)
        print(f"inside 3 sigma, {axis}: {count} of {len(asked)}, at least {fewest:.0f} wanted")
    return kept


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    began, rows = time.perf_counter(), []
    with ProcessPoolExecutor(max_workers=options.jobs, mp_context=get_context("spawn")) as pool:
        for row in pool.map(fly, range(options.first, options.first + options.flights)):
            rows.append(row)
            wrong = row["alarm"] is False or row["back"] is False or not all(row["inside"] or [True])
            if wrong:
                print(row, flush=True)
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    print(f"{len(rows)} flights, {time.perf_counter() - began:.0f} s")
    return 0 if report(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
