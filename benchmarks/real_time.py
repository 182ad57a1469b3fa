"""How fast a whole mission runs on one core, and where the time goes. Prints ratios to real time.

uv run python benchmarks/real_time.py [--runs 3]
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

from missions import SCENARIOS

from shefex_nav.scenario import load


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3)
    runs = parser.parse_args().runs
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

    from shefex_nav import prepare, simulate
    from shefex_nav.log.drawings import FramePolicy
    from shefex_nav.log.writer import LogWriter

    scenario = load.load(str(SCENARIOS / "shefex2_andoya.yaml"))
    frames = scenario.log.frames
    policy = FramePolicy(frames.full_every, frames.otherwise, frames.threshold_sigma)
    simulate.warm_up(scenario)
    print("run   world s   route s   log s   simulated s   x real time")
    for run in range(1, runs + 1):
        times = [time.perf_counter()]
        world = prepare.build_world(scenario, 1)
        trajectory = world.flight.trajectory
        mission = prepare.mission(scenario, 1, trajectory)
        times.append(time.perf_counter())
        logging_s = 0.0
        with tempfile.TemporaryDirectory() as folder:
            with LogWriter(Path(folder) / "run.mcap", mission, policy) as log:
                for record in simulate.route(world, scenario, 1):
                    begin = time.perf_counter()
                    log.write(record)
                    logging_s += time.perf_counter() - begin
                begin = time.perf_counter()
            logging_s += time.perf_counter() - begin
            times.append(time.perf_counter())
        t_s = float(trajectory.t_s[-1] - trajectory.t_s[0])
        world_s, rest_s = times[1] - times[0], times[2] - times[1]
        print(
            f"{run:3d}  {world_s:8.2f}  {rest_s - logging_s:8.2f}  {logging_s:6.2f}  {t_s:12.1f}"
            f"  {t_s / (world_s + rest_s):12.1f}"
        )


if __name__ == "__main__":
    main()
