"""What a tick costs when navigation software is a program of its own: standard input and output, in lockstep.

uv run python benchmarks/software_link.py [--ticks 5000]

The ticks are those of the default mission from T-10 s on, without star fixes. The same bytes go
through `cat` first: what the machine needs for two processes to wake each other. Then a class in this process
and the same class as a program in Python, which say what they stand for and no more; and the program in C of
`shefex-nav new c`, which navigates. Microseconds, median and 99 %.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from shefex_nav import plugins, prepare
from shefex_nav.commands.new import TEMPLATES
from shefex_nav.onboard.driving import Recorded
from shefex_nav.onboard.own_navigation import Estimate, OwnNavigation
from shefex_nav.records import row
from shefex_nav.scenario import load, params_filter
from shefex_nav.software import messages, remote, serve
from shefex_nav.software.mission import mission_data
from shefex_nav.world import imu

WARM_UP = 100  # ticks


class Standing:
    """Says where it stood."""

    def start(self, alignment, mission):
        """Once."""
        self._estimate = Estimate(alignment.r_i, alignment.v_i, alignment.q_ib, 1e-3 * np.eye(9))

    def step(self, imu, arrived):
        """A tick."""
        return self._estimate


def ticks(count):
    """World, what is told of it, ImuBlock of arrays, list of (ImuBlock, list of records) of the first ticks.

    What is told: MissionData, and Requirement of protection levels
    """
    scenario = prepare.settled(load.load("shefex2_andoya", ["star_tracker.frames=statistical"]))
    world = prepare.build_world(scenario, 1)
    blocks = imu.stacked(world.imu)
    received = sorted(world.received, key=lambda one: one.t_available_s)
    arrivals = Recorded(blocks.t_valid_s, received)
    told = [(row(blocks, k), arrivals.at(k + 1)) for k in range(count)]
    mission = mission_data(scenario, world.computer, world.earth, {})
    return world, (mission, params_filter.required(scenario.requirements)), blocks, told


def echoed(told):
    """Seconds of each tick of the same bytes through `cat`."""
    data = [b"".join(map(messages.pack, [one, *more])) for one, more in told]
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as cat:
        durations_s = []
        for part in data:
            begin, left = time.perf_counter(), len(part)
            cat.stdin.write(part)
            while left:
                left -= len(cat.stdout.read(left))
            durations_s.append(time.perf_counter() - begin)
        cat.stdin.close()
    return durations_s


def flown(software, world, known, blocks, told):
    """Seconds of each tick of a Navigation."""
    own, durations_s = OwnNavigation(software, "benchmark", world.alignment, *known), []
    for k, (_, arrived) in enumerate(told):
        begin = time.perf_counter()
        own.advance(blocks, k, k + 1)
        own.update(arrived)
        durations_s.append(time.perf_counter() - begin)
    own.close()
    return durations_s


def program(words):
    """Remote of a program."""
    with plugins.trusting():
        words, sha256 = plugins.program(words)
    return remote.Remote(remote.started(words, sha256), 60.0, 120.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--ticks", type=int, default=5000)
    parser.add_argument("--serve", action="store_true", help="be the program in Python")
    options = parser.parse_args()
    if options.ticks <= WARM_UP:
        parser.error(f"--ticks is {options.ticks}; more than {WARM_UP} are needed, which are not counted")
    if options.serve:
        serve(Standing())
        return
    world, known, blocks, told = ticks(options.ticks)
    with tempfile.TemporaryDirectory() as folder:
        c = Path(folder) / "strapdown"
        source = str(TEMPLATES / "strapdown.c")
        subprocess.run(["cc", "-O2", "-o", str(c), source, "-lm"], check=True)
        ways = {
            "the same bytes through cat": lambda: echoed(told),
            "class, in this process": lambda: flown(Standing(), world, known, blocks, told),
            "program in Python": lambda: flown(
                program([sys.executable, __file__, "--serve"]), world, known, blocks, told
            ),
            "program in C": lambda: flown(program([str(c)]), world, known, blocks, told),
        }
        for name, measure in ways.items():
            us = 1e6 * np.array(measure())[WARM_UP:]
            print(f"{name:28s} {np.median(us):7.1f} {np.percentile(us, 99):8.1f}")


if __name__ == "__main__":
    main()
