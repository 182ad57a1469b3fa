"""The default mission, flown once for all tests that look at a whole run."""

import json
import os
import subprocess
import sys
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent
DEFAULT = ROOT / "scenarios" / "shefex2_andoya.yaml"


class CommandResult(NamedTuple):
    """What a command printed and how it ended."""

    code: int
    out: str
    err: str


def shefex_nav(*arguments, timeout_s=600):
    """Run the command as a user would, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "shefex_nav", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "100"},
        check=False,
    )
    return CommandResult(done.returncode, done.stdout, done.stderr)


class DefaultRun(NamedTuple):
    """The default scenario with seed 1, from the command line."""

    log: Path
    summary: dict


@pytest.fixture(autouse=True)
def own_numbers(request):
    """A generator RNG of the test's module begins anew, by the test's name, whichever tests ran before."""
    rng = getattr(request.module, "RNG", None)
    if rng is not None:
        seed = zlib.crc32(request.node.name.encode())
        rng.bit_generator.state = np.random.default_rng(seed).bit_generator.state


@pytest.fixture(scope="session")
def command():
    """The command line: command("check", path) -> CommandResult."""
    return shefex_nav


@pytest.fixture(scope="session")
def default_scenario():
    """Path of the default scenario."""
    return DEFAULT


@pytest.fixture(scope="session")
def default_run(tmp_path_factory):
    """The default mission, flown and logged."""
    log = tmp_path_factory.mktemp("default") / "run.mcap"
    result = shefex_nav("run", DEFAULT, "--seed", 1, "--out", log, "--json")
    assert result.code == 0, result.err
    return DefaultRun(log, json.loads(result.out))
