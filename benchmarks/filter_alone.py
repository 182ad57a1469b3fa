"""How fast the navigation filter alone runs, in processor time on one core, against real time.

The default mission's flight: IMU at 400 Hz, prediction at 100 Hz, GPS at 1 Hz (0.2 s late), star fixes at
10 Hz (0.1 s late) from the first tick to the last: more than ever flies, and no frames. Each fix makes the
filter integrate again from the instant it measures. Best of the rounds, since the machine is shared.

uv run python benchmarks/filter_alone.py [--rounds 5] [--json]
"""

import argparse
import json
import os
import time

import numpy as np
from missions import SCENARIOS

from shefex_nav.scenario import load

SIGMA_C = np.radians(np.array([15.0, 15.0, 90.0]) / 3600.0)  # of a star fix, camera axes
LATE_S = 0.1
STATES = {"15": (), "21": ("gyro_roll_column", "mounting")}


def flight(seed):
    """Params, alignment, Earth, duration [s], and at each tick (ImuBlock, what arrives)."""
    from shefex_nav import prepare
    from shefex_nav.geometry import rotation
    from shefex_nav.records import StarFix
    from shefex_nav.world import imu

    scenario = load.load(str(SCENARIOS / "shefex2_andoya.yaml"), ["star_tracker.enabled=false"])
    world = prepare.build_world(scenario, seed)
    truth, nav = world.flight.trajectory, world.computer.nav
    q_bc, rng = rotation.quat_from_dcm(nav.C_bc), np.random.default_rng(seed)
    blocks = list(imu.blocks(world.imu))
    arrivals = [[] for _ in blocks]

    def put(name, fix):
        tick = int(np.ceil((fix.t_available_s - truth.t_s[0]) * 100.0 - 1e-6)) - 1
        if tick < len(arrivals):
            arrivals[tick].append((name, fix))

    for fix in world.gps_fixes:
        put("gps", fix)
    for k in range(40, len(truth.t_s), 40):
        t_s, noise = float(truth.t_s[k]), rotation.quat_from_rotvec(SIGMA_C * rng.standard_normal(3))
        q_ic = rotation.quat_multiply(rotation.quat_multiply(truth.q_ib[k], q_bc), noise)
        fix = StarFix(k, t_s, t_s + LATE_S, 0, q_ic, np.diag(SIGMA_C**2), None, None, 0, 0, 0, False, False)
        put("star_tracker", fix)
    return nav, world.alignment, world.earth, len(blocks) / 100.0, list(zip(blocks, arrivals, strict=True))


def measure(params, alignment, earth, ticks, with_solution):
    """Processor time [s] of the filter over the ticks."""
    from shefex_nav.onboard.navigation import fusion, solution

    nav = fusion.start(params, alignment, earth)
    begin = time.process_time()
    for block, arrived in ticks:
        fusion.advance(nav, block)
        if arrived:
            fusion.fuse(nav, arrived)
        if with_solution:
            solution.solution(nav)
    return time.process_time() - begin


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    nominal, alignment, earth, duration_s, ticks = flight(options.seed)
    best = {}
    for _ in range(options.rounds):
        for states, names in STATES.items():
            sigmas = {name: nominal.sigma_blocks[name] for name in names}
            params = nominal._replace(states=names, sigma_blocks=sigmas)
            for with_solution in (False, True):
                key = (states, with_solution)
                used_s = measure(params, alignment, earth, ticks, with_solution)
                best[key] = min(best.get(key, np.inf), used_s)
    rows = [
        {
            "states": int(states),
            "solution": with_solution,
            "us_per_tick": round(used_s / len(ticks) * 1e6, 2),
            "times_real_time": round(duration_s / used_s, 1),
        }
        for (states, with_solution), used_s in best.items()
    ]
    if options.json:
        print(json.dumps({"flight_s": duration_s, "rounds": options.rounds, "rows": rows}))
        return
    print(f"flight of {duration_s:.1f} s, seed {options.seed}, best of {options.rounds}")
    print("states   solution   us/tick   x real time")
    for row in rows:
        word = "yes" if row["solution"] else "no"
        print(f"{row['states']:6d} {word:>10s} {row['us_per_tick']:9.1f} {row['times_real_time']:13.0f}")


if __name__ == "__main__":
    main()
