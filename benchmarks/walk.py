"""How far a star frame and an IMU sample walk through the package: files in which code runs, and moves.

    uv run python benchmarks/walk.py                          # the table, compiled and interpreted
    uv run python benchmarks/walk.py --files                  # with calls and moves of each file
    uv run python benchmarks/walk.py --moves --only compiled  # with the moves from one file to another

The scenario night_sky is flown until two star fixes have been used. Then, until the next one has been:

frame     from `Computer.update` being handed a frame to the filter having used its fix: that call ("chain"),
          and the later one at whose tick the fix is due ("fusion"). Ticks between the two are not counted.
samples   the IMU samples: `imu.sense`, `imu.reported` and `imu.stacked`, which make those of the whole flight
          at once ("world"); from every call of `Computer.advance` to the next of `Computer.update`
          ("ticks"); and the log, from taking the ticks' ImuBlock, NavSolution and NavCovariance to having
          them on the disk ("log").

Counted are calls and returns of functions, generators and comprehensions, as `sys.setprofile` reports them.
A file counts if code of it ran. A move is a call or a return after which code of another file of the package
runs than before. What is not in the package (NumPy, the standard library, what makes named tuples) is looked
through: what it calls of the package, the file that called it has called. The way into the first file of a
part and out of it at the end is no move. Imports and tables that are made once have been made before.

A compiled kernel is a call from Python into the file of the kernel; what it calls itself is compiled into it
and not seen. "interpreted" is with NUMBA_DISABLE_JIT=1, in a process of its own and with a smaller picture:
kernels are Python like all else. It shows every file; its moves are many, for loops over pixels go from file
to file.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

import shefex_nav

# isort: split
import numba
from missions import SCENARIOS

from shefex_nav import prepare, simulate
from shefex_nav.clock import SAME_S
from shefex_nav.compiled.numba_hooks import Kernel
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.writer import LogWriter
from shefex_nav.onboard.computer import Computer
from shefex_nav.records import Frame, GateResult, ImuBlock, NavCovariance, NavSolution
from shefex_nav.scenario import load
from shefex_nav.world import imu

PACKAGE = Path(shefex_nav.__file__).parent
SEED = 1
BEFORE = 2  # star fixes that have been used before anything is followed
BRIEF = ["mission.time_limit=10 s", "star_tracker.off=10 s"]
SMALL = ["star_camera.detector.columns=330", "star_camera.detector.rows=246"]
PARTS = {"frame": ("chain", "fusion"), "samples": ("world", "ticks", "log")}
OF_WORLD = "sense", "reported", "stacked"  # of world.imu
OF_SAMPLES = ImuBlock, NavSolution, NavCovariance
COMPILED, INTERPRETED = "compiled", "interpreted"
GOALS = {"frame": "goal: 25 files, 120 moves", "samples": "goal: 12 files"}  # compiled


class Walk:
    """Calls of functions by their files, and moves by the files (from, to)."""

    def __init__(self):
        self.calls, self.moves, self._stack = Counter(), Counter(), []

    @contextmanager
    def followed(self):
        """Count what happens within."""
        self.begin()
        try:
            yield
        finally:
            self.end()

    def begin(self):
        """Count from now on; this thread alone."""
        self._stack = []
        sys.setprofile(self._event)

    def end(self):
        """Count no more."""
        sys.setprofile(None)

    def _event(self, frame, event, _):
        if frame.f_code.co_filename.startswith(f"{PACKAGE}{os.sep}"):
            if event == "call":
                self.enter(frame.f_code.co_filename)
            elif event == "return":
                self.leave()

    def enter(self, path):
        """A function of this file is called."""
        name = Path(path).relative_to(PACKAGE).as_posix()
        self.calls[name] += 1
        if self._stack and self._stack[-1] != name:
            self.moves[self._stack[-1], name] += 1
        self._stack.append(name)

    def leave(self):
        """The last function that was called returns; those that were called before `begin` are not known."""
        left = self._stack.pop() if self._stack else None
        if self._stack and self._stack[-1] != left:
            self.moves[left, self._stack[-1]] += 1

    def add(self, other):
        """Count what another Walk has counted."""
        self.calls.update(other.calls)
        self.moves.update(other.moves)

    def figures(self):
        """What --json prints of it."""
        into = Counter()
        for (_, to), times in self.moves.items():
            into[to] += times
        return {
            "files": len(self.calls),
            "calls": self.calls.total(),
            "moves": self.moves.total(),
            "of_files": {name: [times, into[name]] for name, times in self.calls.most_common()},
            "of_moves": [[*pair, times] for pair, times in self.moves.most_common()],
        }


def call_of(kernel_call, walks):
    """Kernel.__call__ that the Walk hears of which counts just now, if any does."""

    def call(kernel, *arguments):
        counting = sys.getprofile()
        walk = next((walk for walk in walks if counting == walk._event), None)
        if walk is None:
            return kernel_call(kernel, *arguments)
        walk.enter(kernel.py_func.__code__.co_filename)
        try:
            return kernel_call(kernel, *arguments)
        finally:
            walk.leave()

    return call


class Follower:
    """Stands in for the functions with which the parts begin, and switches the counting on and off."""

    def __init__(self):
        self.walks = {part: Walk() for parts in PARTS.values() for part in parts}
        self.used = 0  # star fixes
        self.frame = None  # number of the frame that is followed
        self._advance, self._update = Computer.advance, Computer.update
        walks = list(self.walks.values())
        self.stand_ins = [
            patch.object(Computer, "advance", lambda *given: self.advance(*given)),
            patch.object(Computer, "update", lambda *given: self.update(*given)),
            *(patch.object(imu, name, self._made(getattr(imu, name))) for name in OF_WORLD),
            patch.object(Kernel, "__call__", call_of(Kernel.__call__, walks)),
        ]

    @property
    def is_between(self):
        """Whether two star fixes have been used, and not yet three."""
        return self.used == BEFORE

    def _made(self, function):
        """A function of `imu`, counted."""

        def followed(*arguments):
            with self.walks["world"].followed():
                return function(*arguments)

        return followed

    def advance(self, computer, *arguments):
        """`Computer.advance`; counted with what comes after it, until `update`."""
        if self.is_between:
            self.walks["ticks"].begin()
        return self._advance(computer, *arguments)

    def update(self, computer, arrived):
        """`Computer.update`, counted if the frame comes in or its fix is due."""
        self.walks["ticks"].end()
        part = self._part(computer, arrived) if self.is_between else None
        if part is None:
            outputs = self._update(computer, arrived)
        else:
            with self.walks[part].followed():
                outputs = self._update(computer, arrived)
        self.used += any(is_used(record) for record in outputs)
        return outputs

    def _part(self, computer, arrived):
        """Which part this tick is; None: neither."""
        frames = [one for one in arrived if isinstance(one, Frame)]
        until_s = computer.now_s + SAME_S
        due = [fix.number for fix in computer.waiting if fix.t_available_s <= until_s]
        first = bool(frames) and self.frame is None
        if first:
            self.frame = frames[0].number
        if not first and self.frame not in due:
            return None
        if len(arrived) > len(frames) or (frames and due):
            raise SystemExit("something else arrives at the same tick: choose another BEFORE")
        return "chain" if first else "fusion"


def is_used(record):
    """Whether a record says that a star fix has been used."""
    return isinstance(record, GateResult) and record.sensor.startswith("star") and record.accepted


def fly(overrides):
    """Fly and follow. -> {part: Walk}"""
    follower, records = Follower(), []
    scenario = load.load(str(SCENARIOS / "night_sky.yaml"), overrides)
    prepare.build_world(scenario, SEED)  # loads what is compiled
    with ExitStack() as open_ones:
        folder = open_ones.enter_context(tempfile.TemporaryDirectory())
        for stand_in in follower.stand_ins:
            open_ones.enter_context(stand_in)
        world = prepare.build_world(scenario, SEED)
        mission = prepare.mission(scenario, SEED, world.flight.trajectory)
        log = open_ones.enter_context(
            LogWriter(Path(folder) / "run.mcap", mission, FramePolicy(1, "none", 5.0))
        )
        for record in simulate.route(world, scenario, SEED):
            if follower.used > BEFORE:
                break
            if follower.is_between and isinstance(record, OF_SAMPLES):
                records.append(record)
            else:
                log.write(record)
        log.flush()
        with follower.walks["log"].followed():
            for record in records:
                log.write(record)
            log.flush()
    return follower.walks


def measured():
    """What is counted in this process: {frame or samples: {part or "all": figures}}."""
    walks, result = fly(BRIEF + (SMALL if numba.config.DISABLE_JIT else [])), {}
    for what, parts in PARTS.items():
        whole = Walk()
        for part in parts:
            whole.add(walks[part])
        result[what] = {part: walks[part].figures() for part in parts} | {"all": whole.figures()}
    return result


def in_process(way):
    """`measured` by another process. way : COMPILED or INTERPRETED"""
    environment = os.environ | {"NUMBA_DISABLE_JIT": str(int(way == INTERPRETED)), "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(
        [sys.executable, __file__, "--here"], env=environment, stdout=subprocess.PIPE, check=True, text=True
    )
    return json.loads(done.stdout)


def show(way, result, with_files, with_moves):
    """Print the table of one way."""
    print(f"{way:22}  files   calls   moves")
    for what, parts in result.items():
        for part, one in parts.items():
            name, goal = (f"{what}, {part}", "") if part != "all" else (what, f"  {GOALS[what]}")
            goal = goal if way == COMPILED else ""
            print(f"  {name:20}  {one['files']:5}  {one['calls']:6}  {one['moves']:6}{goal}")
        if with_files:
            for name, (calls, into) in parts["all"]["of_files"].items():
                print(f"    {name:44} {calls:6} calls {into:6} moves into it")
        if with_moves:
            for before, after, times in parts["all"]["of_moves"]:
                print(f"    {times:6}  {before} -> {after}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=[COMPILED, INTERPRETED], help="one of the two ways")
    parser.add_argument("--files", action="store_true", help="list the files with their calls and moves")
    parser.add_argument("--moves", action="store_true", help="list the moves from one file to another")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)  # in this process, as JSON
    asked = parser.parse_args()
    if asked.here:
        print(json.dumps(measured()))
        return
    found = {way: in_process(way) for way in (COMPILED, INTERPRETED) if asked.only in (None, way)}
    if asked.json:
        print(json.dumps(found, indent=1))
        return
    for way, result in found.items():
        show(way, result, asked.files, asked.moves)


if __name__ == "__main__":
    main()
