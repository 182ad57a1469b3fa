"""How long the program takes to start: from the prompt to the first tick of a flight, and to its end.

    uv run python benchmarks/start_up.py                      # run, check, --help; 5 processes each
    uv run python benchmarks/start_up.py run --repeats 9 --json
    uv run python benchmarks/start_up.py "export flight.mcap --out tables"     # any other command
    uv run python benchmarks/start_up.py run --imports 30     # and the modules that take longest to import

Processor and wall seconds, medians, of fresh processes; kernels are compiled and bytecode is kept by a first
process that is not counted. On a machine with other work compare processor seconds, and those of one call.
"""

import argparse
import json
import os
import re
import shlex
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent
FLIGHT = "run shefex2_andoya --until 0.1s --force --out"
COMMANDS = {"run": FLIGHT, "check": "check shefex2_andoya", "--help": "--help"}
IMPORTED = re.compile(r"import time:\s+(\d+) \|\s+(\d+) \|\s+(\S+)")


def words(command, folder):
    """Arguments of a command. command : of COMMANDS, or as it is typed"""
    found = shlex.split(COMMANDS.get(command, command))
    return [*found, str(folder / "flight.mcap")] if command == "run" else found


def environment(folder):
    """Environment in which bytecode is kept, whatever it says of that."""
    own = {**os.environ, "PYTHONPYCACHEPREFIX": str(folder / "bytecode"), "PYTHONPATH": str(HERE.parent)}
    own.pop("PYTHONDONTWRITEBYTECODE", None)
    return own


def start(command, folder, options=()):
    """Run a command in a process of its own. -> its marks, its standard error"""
    marks = folder / "marks.json"
    worker = [sys.executable, *options, str(HERE / "start_up_worker.py"), str(marks), repr(time.time())]
    done = subprocess.run(
        [*worker, *words(command, folder)], env=environment(folder), capture_output=True, text=True
    )
    if done.returncode:
        sys.exit(f"{command} ended with code {done.returncode}\n{done.stderr}")
    return json.loads(marks.read_text(encoding="utf-8")), done.stderr


def measured(command, folder, repeats):
    """Medians over processes: list of {stage, processor_s, wall_s}."""
    start(command, folder)
    runs = [start(command, folder)[0] for _ in range(repeats)]
    return [
        {
            "stage": same[0][0],
            "processor_s": statistics.median(one[1] for one in same),
            "wall_s": statistics.median(one[2] for one in same),
        }
        for same in zip(*runs, strict=True)
    ]


def imports(command, folder):
    """Seconds that imports take by themselves: {module: s}, {package: s}, longest first. With -X importtime,
    which makes all of them longer.
    """
    _, said = start(command, folder, ("-X", "importtime"))
    modules, packages = {}, {}
    for own, _, name in IMPORTED.findall(said):
        package = name.partition(".")[0]
        modules[name] = 1e-6 * int(own)
        packages[package] = packages.get(package, 0.0) + modules[name]
    return [dict(sorted(one.items(), key=lambda item: -item[1])) for one in (modules, packages)]


def told(command, stages):
    """Print the stages of a command."""
    print(f"{command:24s} processor s   wall s   since the stage before")
    before = 0.0
    for one in stages:
        since, before = one["processor_s"] - before, one["processor_s"]
        print(f"  {one['stage']:22s} {one['processor_s']:11.3f} {one['wall_s']:8.3f} {since:+10.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "command", nargs="*", help=f"{', '.join(COMMANDS)} (default: these), or as it is typed"
    )
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--imports", type=int, default=12, metavar="N", help="modules that are named; 0: none"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    asked = parser.parse_args()
    result = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for command in asked.command or COMMANDS:
            stages = measured(command, folder, asked.repeats)
            modules, packages = imports(command, folder)
            result[command] = {"stages": stages, "import_s": modules, "package_import_s": packages}
            if not asked.json:
                told(command, stages)
                for title, found in (("packages", packages), ("modules", modules)):
                    longest = [f"{name} {took:.3f}" for name, took in list(found.items())[: asked.imports]]
                    print(f"  import of {title}: {', '.join(longest)}" if longest else "", flush=True)
    if asked.json:
        print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
