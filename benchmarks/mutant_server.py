"""For `mutants.py`: runs pytest again and again, each time in a fork of a process that has imported what no
mutant changes, which is most of the time that a fast test takes.

In: a line of JSON on stdin each time, the arguments of pytest and a limit of processor time [s], as a busy
machine is no mutant's doing. Out: a line of JSON with the exit code, null if it was stopped for its time, and
what it printed. The working directory is the copy of
the project that has the mutant.
"""

import importlib
import json
import math
import os
import resource
import signal
import sys
import tempfile
import time

import shefex_nav  # noqa: F401 first: it chooses for which processor NumPy computes, as for the command

# isort: split
import pytest

PACKAGES = (
    "numpy", "numpy.testing", "scipy.stats", "scipy.special", "scipy.linalg", "scipy.integrate",
    "scipy.optimize", "scipy.spatial.transform", "numba", "_pytest.assertion.rewrite", "_pytest.doctest",
    "_pytest.unittest", "pydantic",
)  # fmt: skip
IDLE = 40.0  # times the limit of processor time: one that only waits is stopped, too
BROKEN = 70  # exit code where pytest itself failed: no code of its own


def tested(arguments, most_s):
    """Run pytest in a fork. -> exit code or None, what it printed"""
    with tempfile.TemporaryFile("w+") as out:
        child = os.fork()
        if not child:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(most_s), math.ceil(most_s)))
            os.dup2(out.fileno(), 1)
            os.dup2(out.fileno(), 2)
            code = BROKEN
            try:
                code = int(pytest.main(arguments))
                sys.stdout.flush()
            finally:
                os._exit(code)
        code = _waited(child, IDLE * most_s)
        out.seek(0)
        return code, out.read()


def _waited(child, timeout_s):
    """Exit code of a child; None, and it is killed with all of its own, after timeout_s."""
    begun = time.monotonic()
    while time.monotonic() - begun < timeout_s:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else None
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def main():
    for name in PACKAGES:
        importlib.import_module(name)
    for line in sys.stdin:
        print(json.dumps(tested(*json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
