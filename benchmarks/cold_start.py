"""How long a fresh machine takes to its first table, and a changed program to its next one.

    uv run python benchmarks/cold_start.py            # on a quiet machine, about five minutes
    uv run python benchmarks/cold_start.py --json

Copies of this checkout are run with this Python and its packages (so nothing is downloaded) and with an empty
folder of compiled kernels:

    first run        README's first command, nothing compiled before
    again            the same, everything compiled before
    another folder   the same in a second copy with the first one's kernels
    docstring        the same after an edit of the docstring of records.py
    one line: test   a file of tests after an edit of one line of arithmetic that it runs
    one line: run    the mission after the same edit
    method           another identification method, for the first time

"compiled" counts the files of kernels that are new.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parent.parent
MISSION = ["-m", "shefex_nav", "run", "scenarios/shefex2_andoya.yaml", "--force", "--out", "run.mcap"]
LOST = ["--set", "star_tracker.identification.tracking=false", "--until", "250s"]
METHOD = [*MISSION, "--set", "star_tracker.identification.method=pyramid", *LOST]
TEST = ["-m", "pytest", "-q", "-n", "0", "tests/onboard/test_nav_blocks.py"]
KERNELS = "shefex_nav/onboard/navigation/error_model.py"
LINE = "t3.cross(dtheta, dv), T * T / 12.0", "t3.cross(dtheta, dv), T / 12.0 * T"


class Machine:
    """A folder of compiled kernels, and copies of the checkout."""

    def __init__(self, folder):
        self.folder, self.cache = folder, folder / "cache"

    def copy(self, name):
        """The files that git knows, in a folder of that name. -> its path"""
        files = subprocess.run(
            ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        for file in files.splitlines():
            there = self.folder / name / file
            there.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / file, there)
        return self.folder / name

    def measure(self, checkout, command):
        """(wall seconds, processor seconds, kernels compiled) of a command in a copy."""
        environment = {
            **os.environ,
            "PYTHONPATH": str(checkout),
            "NUMBA_CACHE_DIR": str(self.cache),
        }
        before, began = _used_s(), time.perf_counter()
        files = _kernels(self.cache)
        done = subprocess.run(
            [sys.executable, *command],
            cwd=checkout,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(done.stderr)
        return time.perf_counter() - began, _used_s() - before, len(_kernels(self.cache) - files)


def _kernels(cache):
    return {path.name for path in cache.rglob("*.kernel")}


def _used_s():
    """Processor seconds of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def edit(path, old, new):
    """Replace a text that is there once."""
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{path}: {old!r} is there {text.count(old)} times"
    path.write_text(text.replace(old, new), encoding="utf-8")


def measure(folder):
    """{what: (wall s, processor s, kernels)}"""
    machine = Machine(folder)
    one = machine.copy("one")
    found = {"first run": machine.measure(one, MISSION), "again": machine.measure(one, MISSION)}
    two = machine.copy("two")
    found["another folder"] = machine.measure(two, MISSION)
    records = two / "shefex_nav" / "records.py"
    records.write_text(records.read_text(encoding="utf-8").replace('"""', '"""Edited. ', 1), encoding="utf-8")
    found["docstring"] = machine.measure(two, MISSION)
    machine.measure(two, TEST)
    edit(two / KERNELS, *LINE)
    found["one line: test"] = machine.measure(two, TEST)
    found["one line: run"] = machine.measure(two, MISSION)
    found["method"] = machine.measure(two, METHOD)
    return found


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = measure(Path(folder))
    if arguments.json:
        print(json.dumps(found))
        return
    table = Table("", "wall [s]", "processor [s]", "kernels compiled")
    for what, (wall_s, used_s, kernels) in found.items():
        table.add_row(what, f"{wall_s:.1f}", f"{used_s:.1f}", str(kernels))
    Console().print(table)


if __name__ == "__main__":
    main()
