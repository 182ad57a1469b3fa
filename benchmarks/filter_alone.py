"""How fast the navigation filter alone runs, on one core, against real time: processor time and wall clock.

The default mission's flight: IMU at 400 Hz, prediction at 100 Hz, GPS at 1 Hz (0.2 s late), star fixes at
10 Hz (0.1 s late) from the first tick to the last: more than ever flies, and no frames. Each fix makes the
filter integrate again from the instant it measures. The ticks between two arrivals are one call, as in a
flight. Best of the rounds, since the machine is shared. The second table says what a tick of each kind costs
by itself, with 15 states.

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
STATES = {"15": ["navigation.states=[]"], "mission": []}  # those of the scenario
NO_FRAMES = "star_tracker.enabled=false"


def flight(seed):
    """Alignment, Earth, duration [s], ImuBlock of arrays, and what arrives at each tick."""
    from shefex_nav import prepare
    from shefex_nav.geometry import rotation
    from shefex_nav.records import StarFix
    from shefex_nav.world import imu

    scenario = load.load(str(SCENARIOS / "shefex2_andoya.yaml"), [NO_FRAMES])
    world = prepare.build_world(scenario, seed)
    truth, nav = world.flight.trajectory, world.computer.nav
    q_bc, rng = rotation.quat_from_dcm(nav.C_bc), np.random.default_rng(seed)
    blocks = imu.stacked(world.imu)
    arrivals = [[] for _ in blocks.t_valid_s]

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
    return world.alignment, world.earth, len(arrivals) / 100.0, blocks, arrivals


def parameters(overrides):
    """NavParams of the mission with other settings."""
    from shefex_nav.scenario import params_onboard

    scenario = load.load(str(SCENARIOS / "shefex2_andoya.yaml"), [NO_FRAMES, *overrides])
    return params_onboard.nav_params(scenario)


def measure(params, alignment, earth, blocks, arrivals, with_solution):
    """Processor time and wall clock [s] of the filter over the ticks."""
    from shefex_nav.onboard.navigation import fusion, solution, ticks
    from shefex_nav.onboard.navigator import Navigator
    from shefex_nav.records import row

    nav, n, busy = fusion.start(params, alignment, earth), 0, [k for k, what in enumerate(arrivals) if what]
    software, begin = Navigator(nav), (time.process_time(), time.perf_counter())
    for k in [*busy, len(arrivals)]:
        while n < k:
            if with_solution:
                done, _ = software.advance(blocks, n, k)
                solution.solution(nav)  # of the last, as a tick has it that is attended to
            else:
                done = ticks.advance(nav, blocks, n, k)
            n += done
        if k == len(arrivals):
            break
        fusion.advance(nav, row(blocks, k))
        fusion.fuse(nav, arrivals[k])
        if with_solution:
            solution.solution(nav)
        n = k + 1
    return time.process_time() - begin[0], time.perf_counter() - begin[1]


def by_kind(params, alignment, earth, blocks, arrivals):
    """Processor time [s] of each tick, without and with the derived solution: (n, 2)."""
    from shefex_nav.onboard.navigation import fusion, solution
    from shefex_nav.records import row

    nav, used_s = fusion.start(params, alignment, earth), np.empty((len(arrivals), 2))
    for k, arrived in enumerate(arrivals):
        begin = time.process_time()
        fusion.advance(nav, row(blocks, k))
        if arrived:
            fusion.fuse(nav, arrived)
        filtered = time.process_time()
        solution.solution(nav)
        used_s[k] = filtered - begin, time.process_time() - begin
    return used_s


def kinds(arrivals):
    """What arrives at each tick: '' or names, joined."""
    return np.array([" and ".join(sorted({name for name, _ in arrived})) for arrived in arrivals])


def of_kinds(arrivals, used_s):
    """Rows of the second table."""
    of_tick, rows = kinds(arrivals), []
    for kind in sorted(set(of_tick.tolist())):
        chosen = used_s[of_tick == kind]
        row = {
            "kind": kind or "no measurement",
            "ticks": len(chosen),
            "us_per_tick": round(float(chosen[:, 0].mean()) * 1e6, 2),
            "with_solution_us": round(float(chosen[:, 1].mean()) * 1e6, 2),
            "share": round(float(chosen[:, 0].sum() / used_s[:, 0].sum()), 3),
        }
        rows.append(row)
    return rows


def run(rounds, seed):
    """Flight time [s], rows of both tables."""
    alignment, earth, duration_s, *ticks = flight(seed)
    best, used_s = {}, np.inf
    for _ in range(rounds):
        for states, overrides in STATES.items():
            params = parameters(overrides)
            for with_solution in (False, True):
                key = (states, with_solution)
                best[key] = np.minimum(
                    best.get(key, np.inf), measure(params, alignment, earth, *ticks, with_solution)
                )
            if states == "15":
                used_s = np.minimum(used_s, by_kind(params, alignment, earth, *ticks))
    rows = [
        {
            "states": states,
            "solution": with_solution,
            "us_per_tick": round(cpu_s / len(ticks[1]) * 1e6, 2),
            "times_real_time": round(duration_s / cpu_s, 1),
            "times_real_time_wall": round(duration_s / wall_s, 1),
        }
        for (states, with_solution), (cpu_s, wall_s) in best.items()
    ]
    return duration_s, rows, of_kinds(ticks[1], used_s)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    duration_s, rows, of_ticks = run(options.rounds, options.seed)
    if options.json:
        print(json.dumps({"flight_s": duration_s, "rounds": options.rounds, "rows": rows, "ticks": of_ticks}))
        return
    print(f"flight of {duration_s:.1f} s, seed {options.seed}, best of {options.rounds}")
    print("states    solution   us/tick   x real time   by wall clock")
    for row in rows:
        word, found = "yes" if row["solution"] else "no", row["times_real_time"]
        wall = row["times_real_time_wall"]
        print(f"{row['states']:8s} {word:>9s} {row['us_per_tick']:9.1f} {found:13.0f} {wall:15.0f}")
    print("15 states, tick with           number   us/tick   with solution   share")
    for row in of_ticks:
        both = f"{row['us_per_tick']:9.1f} {row['with_solution_us']:15.1f}"
        print(f"{row['kind']:28s} {row['ticks']:8d} {both} {row['share']:7.1%}")


if __name__ == "__main__":
    main()
