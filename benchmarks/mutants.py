"""Do the tests notice a wrong program? Mutation testing of what the truthfulness of the program rests on.

    uv run --with coverage python benchmarks/mutants.py lines --work DIR   # once: which test runs which line
    uv run --with coverage python benchmarks/mutants.py run --work DIR [--each 40] [--seed 1] [--part gates]
    uv run python benchmarks/mutants.py show --work DIR

A mutant is the package with one change in one file (`mutant_places`): a sign, a comparison, a number, a
statement left out. It is killed if a test that runs the line fails with it. A seeded sample is drawn from
each part alike. Where the change is in a kernel, or in a constant that one reads, kernels are Python
functions (NUMBA_DISABLE_JIT=1): compiled anew for each mutant, they would take minutes. Elsewhere the
compiled ones serve. Tests which take over 8 s in a mode have no say in it; what survives may be killed by
them. `--flights` takes up the survivors with the tests of FLIGHTS, compiled.

DIR keeps the copy of the package that is changed, which `lines` and `run` bring up to date, the tables of
lines of both modes (a test file that has changed is mapped again; where lines of the package have moved,
delete the tables) and a line a mutant in mutants.jsonl: `run` goes on where it was stopped. Survivors that a
reader found equivalent do not count, if `mutants_same.json` beside this file says why, by file, line of the
source and change: {"FILE: SOURCE: CHANGE": "argument"}. `show` prints the score of each part with its 95 %
interval, and the survivors.
"""

import argparse
import compileall
import hashlib
import json
import os
import py_compile
import random
import shutil
import signal
import subprocess
import sys
import time
from itertools import zip_longest
from pathlib import Path

import mutant_places
from scipy import stats

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
SAME = HERE / "mutants_same.json"
NAVIGATION, IDENTIFY = "onboard/navigation", "onboard/startracker/identify"
PARTS = {  # files of the package, as glob patterns
    "faults": ("world/faults.py", "world/gps_errors.py"),
    "gates": tuple(f"{NAVIGATION}/{name}.py" for name in ("gate", "eskf", "adaptation", "measurements")),
    "integrity": (
        f"{NAVIGATION}/integrity*.py",
        f"{NAVIGATION}/unknown_attitude.py",
        "onboard/navigator.py",
    ),
    "verdict": tuple(
        f"{IDENTIFY}/{n}.py" for n in ("bayes", "evidence", "odds", "verify", "doubts", "completeness")
    ),
}
TESTS = (
    "world/test_fault*.py",
    "world/test_gps*.py",
    "world/test_instrument_faults.py",
    "onboard/test_*.py",
    "scenario/test_told.py",
)
FLIGHTS = {
    "faults": ("tests/test_faulty_gps.py", "tests/test_faulty_imu.py", "tests/test_faulty_star_tracker.py"),
    "gates": ("tests/test_faulty_gps.py", "tests/test_steady_flight.py", "tests/test_told_flights.py"),
    "integrity": ("tests/test_faulty_gps.py", "tests/test_faulty_imu.py", "tests/test_faulty_gyro.py",
                  "tests/test_faulty_star_tracker.py", "tests/test_wrong_constants.py",
                  "tests/test_protection_levels.py"),
    "verdict": ("tests/onboard/test_tracker_rendered.py", "tests/test_blinded_statistic.py"),
}  # fmt: skip
MODES = {"compiled": {}, "python": {"NUMBA_DISABLE_JIT": "1"}}  # of kernels: variables of the environment
LONGEST_S = 8  # of a test in the table of lines
MOST_S = 10.0  # of all tests of one mutant, by the table; the fastest first
FLIGHT_S = 900.0  # of the flights of one mutant
NOT_COLLECTED = (2, 4)  # codes of pytest where a test file cannot be imported: without the mutant it could
KILLED, SURVIVED, UNSEEN, STOPPED = "killed", "survived", "unseen", "stopped"  # the last one for its time


def copied(work):
    """The copy of the package and its tests that mutants are made in, brought up to date."""
    tree, leave = work / "tree", shutil.ignore_patterns("__pycache__")
    for name in ("shefex_nav", "tests", "scenarios", "benchmarks", "docs", "notebooks"):
        shutil.copytree(ROOT / name, tree / name, ignore=leave, dirs_exist_ok=True)
    for file in ROOT.glob("*.*"):
        if file.is_file():
            shutil.copy(file, tree)
    # bytecode that is checked by the hash of its source: a mutant may be as long and as old as the original
    mode = py_compile.PycInvalidationMode.CHECKED_HASH
    compileall.compile_dir(tree / "shefex_nav", quiet=1, invalidation_mode=mode)
    return tree


def _environment(tree, **more):
    """Variables of a process that runs the copy's tests."""
    paths = os.pathsep.join([str(tree), str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**os.environ, "PYTHONPATH": paths, **more}


WORDS = ["-q", "-n", "0", "-p", "no:cacheprovider"]


def tested(tree, arguments, timeout_s, **environment):
    """Exit code of pytest in the copy, None if it was stopped for its time; and what it printed."""
    with subprocess.Popen(
        [sys.executable, "-m", "pytest", *WORDS, *arguments],
        cwd=tree,
        env=_environment(tree, **environment),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            said, _ = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return None, process.communicate()[0]
    return process.returncode, said


SERVERS = {}  # mode -> process of mutant_server.py


def tested_fast(tree, arguments, timeout_s, mode):
    """As `tested`, in a fork of a process that has imported what no mutant changes."""
    if mode not in SERVERS:
        SERVERS[mode] = subprocess.Popen(
            [sys.executable, str(HERE / "mutant_server.py")],
            cwd=tree,
            env=_environment(tree, **MODES[mode]),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
    server = SERVERS[mode]
    server.stdin.write(json.dumps([[*WORDS, *arguments], timeout_s]) + "\n")
    server.stdin.flush()
    return json.loads(server.stdout.readline())


def lines(work, mode, patterns):
    """Write the table of a mode: {file: {line: [test, ...]}} and the seconds of each test."""
    tree, kept = copied(work), work / f"lines_{mode}"
    kept.mkdir(exist_ok=True)
    for test in sorted({test for pattern in patterns for test in (tree / "tests").glob(pattern)}):
        name, part = test.relative_to(tree).as_posix(), kept / f"{test.stem}.json"
        digest = hashlib.sha256(test.read_bytes()).hexdigest()
        if not part.exists() or json.loads(part.read_text()).get("digest") != digest:
            print(mode, name, flush=True)
            part.write_text(json.dumps({**_mapped(tree, name, mode, part), "digest": digest}))
    seconds, found = {}, {}
    for part in sorted(kept.glob("*.json")):
        told = json.loads(part.read_text())
        seconds.update(told["seconds"])
        for file, of in told["lines"].items():
            for line, tests in of.items():
                found.setdefault(file, {}).setdefault(line, []).extend(tests)
    (work / f"lines_{mode}.json").write_text(json.dumps({"seconds": seconds, "lines": found}))
    print(f"{mode}: {len(seconds)} tests")


def _mapped(tree, name, mode, part):
    """What the tests of a file run: as `mutant_lines` writes it."""
    part.unlink(missing_ok=True)
    environment = {**MODES[mode], "MUTANT_LINES": str(part), "MUTANT_LONGEST_S": str(LONGEST_S)}
    code, said = tested(tree, ["-p", "mutant_lines", name], FLIGHT_S, **environment)
    if code is None:  # too many slow tests: they have no say
        return {"seconds": {}, "lines": {}}
    if not part.exists():
        sys.exit(said)
    return json.loads(part.read_text())


def compiled_names():
    """Names that the kernels of the package use, constants among them: set of str."""
    sources = (file.read_text(encoding="utf-8") for file in (ROOT / "shefex_nav").rglob("*.py"))
    return {name for text in sources for _, _, names in mutant_places.kernels(text) for name in names}


def mode_of(text, line, in_kernels):
    """The mode in which a mutant is judged: str of MODES.

    text, line : its source and its line;  in_kernels : as `compiled_names`
    """
    if any(first <= line <= last for first, last, _ in mutant_places.kernels(text)):
        return "python"
    return "python" if mutant_places.constant(text, line) in in_kernels else "compiled"


def sample(each, seed, wanted):
    """Mutants in the order in which they are flown: the first of each part, the second of each, and so on."""
    drawn = []
    for part in wanted:
        files = sorted({file for pattern in PARTS[part] for file in (ROOT / "shefex_nav").glob(pattern)})
        places = []
        for file in files:
            name = file.relative_to(ROOT).as_posix()
            places += [(part, name, *place) for place in mutant_places.of(file.read_text(encoding="utf-8"))]
        random.Random(f"{seed} {part}").shuffle(places)
        drawn.append(places[:each])
    return [one for together in zip_longest(*drawn) for one in together if one is not None]


def _current(work, tree, mode):
    """The table of a mode without tests of files that have changed since they were mapped."""
    table, changed = json.loads((work / f"lines_{mode}.json").read_text()), set()
    for name in {test.split("::")[0] for test in table["seconds"]}:
        part = json.loads((work / f"lines_{mode}" / f"{Path(name).stem}.json").read_text())
        file = tree / name
        if not file.exists() or part["digest"] != hashlib.sha256(file.read_bytes()).hexdigest():
            print(f"{mode}: {name} has changed since it was mapped and has no say", flush=True)
            changed.add(name)
    table["seconds"] = {test: s for test, s in table["seconds"].items() if test.split("::")[0] not in changed}
    return table


def fast(table, file, first, last):
    """Tests that run a line of a mutant, fastest first, as many as MOST_S allows."""
    of = table["lines"].get(file, {})
    names = {name for line in range(first, last + 1) for name in of.get(str(line), ())}
    names &= table["seconds"].keys()
    chosen, left_s = [], MOST_S
    for name in sorted(names, key=table["seconds"].__getitem__):
        left_s -= table["seconds"][name]
        if left_s < 0.0 and chosen:
            break
        chosen.append(name)
    return chosen


def judged(tree, tables, in_kernels, mutant, flights):
    """What becomes of a mutant: its line in mutants.jsonl."""
    part, name, line, (first, last), begin, end, new, what = mutant
    file, begun = tree / name, time.perf_counter()
    good = file.read_bytes()
    mode = mode_of(good.decode(), line, in_kernels)
    table = tables[mode]
    row = {"part": part, "file": name, "line": line, "begin": begin, "what": what, "mode": mode}
    bad = good[:begin] + new.encode() + good[end:]
    compile(bad, name, "exec")
    file.write_bytes(bad)
    try:
        if flights:
            code, said = tested(tree, ["-x", *FLIGHTS[part]], FLIGHT_S)
        elif chosen := fast(table, name, first, last):
            most_s = 20.0 + 3.0 * sum(table["seconds"][test] for test in chosen)
            code, said = tested_fast(tree, ["-x", *chosen], most_s, mode)
        else:
            return {**row, "verdict": UNSEEN, "by": "", "s": 0.0}
    finally:
        file.write_bytes(good)
    if code not in (0, 1, *NOT_COLLECTED, None) or "ERROR: not found: " in said:  # a test that was renamed
        sys.exit(f"{name}:{line} {what}: pytest ended with code {code}\n{said}")
    failed = [line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))]
    by = "time" if code is None else failed[0].split(" - ")[0] if failed else ""
    if code in NOT_COLLECTED:
        by = "import"
    verdict = STOPPED if code is None else SURVIVED if code == 0 else KILLED
    return {**row, "verdict": verdict, "by": by, "s": round(time.perf_counter() - begun, 1)}


def told(work):
    """Verdicts by (file, begin, what), the last one of each."""
    kept = work / "mutants.jsonl"
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    return {(row["file"], row["begin"], row["what"]): row for row in rows}


def run(work, options):
    """Judge the mutants of a sample that have no verdict yet."""
    if options.flights:
        _check_flights(work, options.part or PARTS)
    tree, in_kernels, known = copied(work), compiled_names(), told(work)
    tables = {mode: _current(work, tree, mode) for mode in MODES}
    mutants = sample(options.each, options.seed, options.part or PARTS)
    for k, mutant in enumerate(mutants):
        before = known.get((mutant[1], mutant[4], mutant[7]))
        if before is not None and not (
            options.flights and before["verdict"] != KILLED and "flown" not in before
        ):
            continue
        if options.flights and before is None:
            continue
        row = judged(tree, tables, in_kernels, mutant, options.flights)
        if options.flights:
            row["flown"] = True
        with (work / "mutants.jsonl").open("a") as out:
            out.write(json.dumps(row) + "\n")
        print(
            f"{k + 1}/{len(mutants)} {row['file']}:{row['line']} {row['what']}: {row['verdict']} {row['by']} "
            f"{row['s']} s",
            flush=True,
        )


def _check_flights(work, parts):
    """End where a flight fails of the program as it is: it would kill every mutant."""
    for part in parts:
        code, said = tested(copied(work), ["-x", *FLIGHTS[part]], FLIGHT_S)
        if code != 0:
            sys.exit(f"{part}: the tests fail without any mutant, or take over {FLIGHT_S:.0f} s\n{said}")


def show(work):
    """Print scores and survivors."""
    same = json.loads(SAME.read_text()) if SAME.exists() else {}
    rows = list(told(work).values())
    sources = {row["file"]: (work / "tree" / row["file"]).read_text().splitlines() for row in rows}
    counted = [
        row
        for row in rows
        if f"{row['file']}: {sources[row['file']][row['line'] - 1].strip()}: {row['what']}" not in same
    ]
    for part in [*PARTS, None]:
        own = [row for row in counted if part in (row["part"], None)]
        if own:
            killed = sum(row["verdict"] == KILLED for row in own)
            low, high = stats.binomtest(killed, len(own)).proportion_ci(method="exact")
            print(f"{part or 'all':10} {killed:4} of {len(own):4} killed, {100 * killed / len(own):.0f} % "
                  f"({100 * low:.0f} to {100 * high:.0f})")  # fmt: skip
    for row in counted:
        if row["verdict"] != KILLED:
            print(f"{row['verdict']:9} {row['file']}:{row['line']}  {row['what']}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("lines", "run", "show"))
    parser.add_argument("--work", type=Path, required=True, help="folder for what is kept")
    parser.add_argument("--each", type=int, default=100, help="mutants of each part")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--tests", action="append", help="of which lines are mapped: glob pattern in tests/")
    parser.add_argument("--mode", choices=MODES, action="append", help="of the tables of lines: both")
    parser.add_argument("--flights", action="store_true", help="survivors, with flights")
    options = parser.parse_args()
    work = options.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    {
        "lines": lambda: [lines(work, mode, options.tests or TESTS) for mode in options.mode or MODES],
        "run": lambda: run(work, options),
        "show": lambda: show(work),
    }[options.what]()


if __name__ == "__main__":
    main()
