"""A package of two small files of kernels, in a folder of its own, to be edited and run."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent

LOWER = '''"""Lower file."""

import numpy as np

from shefex_nav.compiled import inner

TABLE = np.array([1.0, 2.0, 4.0])


@inner
def product(a, b):
    """Product of two numbers."""
    return a * b  # of any sign


@inner
def unused(a):
    return a
'''

UPPER = '''"""Upper file."""

from typing import NamedTuple

import numpy as np
from lower import TABLE, product
from shefex_nav.compiled import kernel


class Pair(NamedTuple):
    x: float
    y: float


@kernel
def total(pair, n=2):
    """x times the table, and y."""
    s = 0.0
    for k in range(TABLE.shape[0]):
        s += product(pair.x, TABLE[k])
    return n * (s + pair.y)


@kernel
def other(x):
    return np.sqrt(x)
'''

USE = """
import sys
sys.path.insert(0, {folder!r})
from shefex_nav.compiled import digest
import upper
values = upper.total(upper.Pair(2.0, 3.0)), upper.other(9.0)
print(digest.of_kernel(upper.total), digest.of_kernel(upper.other), *values)
"""


class Result:
    """What a process found: digests and values of `total` and `other`, and how many files it wrote."""

    def __init__(self, done):
        lines = done.stdout.splitlines()
        self.total, self.other, self.value, self.root = lines[-1].split()
        self.saved = [line for line in lines if "data saved to" in line]
        self.loaded = [line for line in lines if "data loaded from" in line]
        self.err = done.stderr


class Package:
    """Two files of kernels in a folder."""

    def __init__(self, folder, cache):
        self.folder, self.cache = folder, cache
        self.write(LOWER, UPPER)

    def write(self, lower=LOWER, upper=UPPER):
        self.folder.mkdir(exist_ok=True)
        self.folder.joinpath("lower.py").write_text(lower, encoding="utf-8")
        self.folder.joinpath("upper.py").write_text(upper, encoding="utf-8")

    def start(self, **environment):
        """A process that calls both kernels; numba says what it saves and loads."""
        return subprocess.Popen(
            [sys.executable, "-c", USE.format(folder=str(self.folder))],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={
                **os.environ,
                "PYTHONPATH": str(ROOT),
                "PYTHONDONTWRITEBYTECODE": "1",
                "NUMBA_DEBUG_CACHE": "1",
                "NUMBA_CACHE_DIR": str(self.cache),
                **environment,
            },
        )

    def finish(self, process):
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        return Result(subprocess.CompletedProcess((), 0, out, err))

    def run(self, **environment):
        return self.finish(self.start(**environment))
