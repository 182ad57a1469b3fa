"""How soon `run --live` shows the flight: from the prompt to the first data that the viewer has.

    uv run python benchmarks/start_live.py                  # 5 starts; a display, or Xvfb, is needed
    uv run python benchmarks/start_live.py --repeats 9 --json
    uv run python benchmarks/start_live.py --other ../old   # another checkout in turn with this one

Wall seconds, medians; processor seconds of the flight, of what reads its log, and of the viewer, until the
first data are sent. Kernels are compiled and bytecode is kept by a first start that is not counted. Without
a graphics card the viewer draws on the processor, and the three share its cores.
"""

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).parent
STAGES = ("first tick", "viewer asked for", "viewer listens", "connected", "first data sent")
PROCESSES = ("flight", "reader", "viewer")
LONGEST_S = 300.0


@contextmanager
def screen(folder):
    """Environment with a display; an Xvfb of its own if there is none."""
    own = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}
    if "DISPLAY" in own:
        yield own
        return
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1600x1000x24"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as number:
            yield {**own, "DISPLAY": f":{number.readline().strip()}"}
    finally:
        server.terminate()
        server.wait()


def environment(own, checkout, folder, marks):
    """Environment in which bytecode is kept and `start_live_marks` is there."""
    paths = os.pathsep.join(map(str, (HERE / "start_live_marks", checkout)))
    own = {**own, "PYTHONPATH": paths, "PYTHONPYCACHEPREFIX": str(folder / "bytecode")}
    own.pop("PYTHONDONTWRITEBYTECODE", None)
    return {**own, "START_LIVE_MARKS": str(marks)}


def started(checkout, folder, pace):
    """One start. -> {stage: wall s}, {process: processor s}"""
    marks, log = folder / "marks", folder / "flight.mcap"
    for old in (marks, log):
        old.unlink(missing_ok=True)
    words = [sys.executable, "-m", "shefex_nav", "run", "shefex2_andoya", "--live", "--out", str(log)]
    words += ["--pace", str(pace)] if pace else []
    with screen(folder) as own, tempfile.TemporaryFile("w+") as said:
        began = time.time()
        flight = subprocess.Popen(
            words, env=environment(own, checkout, folder, marks), stdout=said, stderr=said, cwd=folder
        )
        try:
            found = _wait(marks, flight, said)
            pids = {name: pid for name, pid, _ in found.values() if name != "flight"} | {"flight": flight.pid}
            took = {name: _processor_s(pid) for name, pid in pids.items()}
            if "reader" in pids:
                took["viewer"] = sum(_processor_s(pid) for pid in _below(pids["reader"]))
        finally:
            # its reader and the viewer are found as long as it lives, and in the marks if it has ended
            known = {flight.pid, *(pid for _, pid, _ in _reached(marks).values())}
            for pid in known | {below for one in known for below in _below(one)}:
                _end(pid)
            flight.wait()
    return {stage: at - began for stage, (_, _, at) in found.items()}, took


def _reached(marks):
    """{stage: (process, its number, time)} so far."""
    text = marks.read_text(encoding="utf-8") if marks.exists() else ""
    lines = [line.split(",") for line in text.splitlines() if line.count(",") == 3]
    return {stage: (name, int(pid), float(at)) for stage, name, pid, at in lines}


def _wait(marks, flight, said):
    """{stage: (process, its number, time)} when all stages have been reached."""
    until = time.time() + LONGEST_S
    while time.time() < until:
        found = _reached(marks)
        if set(found) >= set(STAGES):
            return found
        if flight.poll():
            break
        time.sleep(0.01)
    said.seek(0)
    sys.exit(f"no data were sent; reached: {', '.join(found)}\n{said.read()}")


def _stat(pid):
    """Fields of /proc/PID/stat after the name; [] if there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def _processor_s(pid):
    fields = _stat(pid)
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK") if fields else 0.0


def _below(pid):
    """Processes that a process has started, and those that they have."""
    own = [int(one.name) for one in Path("/proc").iterdir() if one.name.isdecimal()]
    children = [one for one in own if _stat(one)[1:2] == [str(pid)]]
    return [*children, *(one for child in children for one in _below(child))]


def _end(pid):
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


def measured(checkouts, repeats, pace):
    """{checkout: {stage or process: median s}}"""
    runs = {one: [] for one in checkouts}
    with tempfile.TemporaryDirectory() as temporary:
        folders = {one: Path(temporary) / str(k) for k, one in enumerate(checkouts)}
        for repeat in range(repeats + 1):
            for checkout, folder in folders.items():
                folder.mkdir(exist_ok=True)
                stages, took = started(checkout, folder, pace)
                if repeat:
                    runs[checkout].append(stages | {f"{name}, processor": s for name, s in took.items()})
    return {
        str(one): {key: statistics.median(run[key] for run in found) for key in sorted(found[0])}
        for one, found in runs.items()
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--pace", type=float, help="of the flight, as of `run`")
    parser.add_argument("--other", type=Path, action="append", default=[], help="another checkout")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    asked = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # what has been started is ended on the way out
    checkouts = [HERE.parent.resolve(), *(one.resolve() for one in asked.other)]
    result = measured(checkouts, asked.repeats, asked.pace)
    if asked.json:
        print(json.dumps(result, indent=1))
        return
    for checkout, found in result.items():
        print(checkout)
        for stage in (*STAGES, *(f"{name}, processor" for name in PROCESSES)):
            print(f"  {stage:20s} {found[stage]:8.2f} s")


if __name__ == "__main__":
    main()
