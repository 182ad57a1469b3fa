"""The default mission, flown once for all tests that look at a whole run."""

import gc
import io
import json
import os
import subprocess
import sys
import tempfile
import time
import zlib
from contextlib import redirect_stderr, redirect_stdout
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import shefex_nav  # noqa: F401 first: it chooses for which processor NumPy computes, as for the command

# isort: split
import numpy as np
import pytest
from affected import changes, select

os.environ["XDG_CONFIG_HOME"] = tempfile.mkdtemp()  # consent to plug-ins is no test's to give for later
ROOT = Path(__file__).parent.parent
DEFAULT = ROOT / "scenarios" / "shefex2_andoya.yaml"


def pytest_addoption(parser):
    words = "only the test files that reach what has changed since a commit, HEAD if none is named"
    parser.addoption("--affected", nargs="?", const="HEAD", metavar="BASE", help=words)


def pytest_configure(config):
    """What --affected chooses: by the process that starts the workers, and told to them."""
    if config.option.affected is not None and not hasattr(config, "workerinput"):
        changed, known = changes(ROOT, config.option.affected), config.cache.get("affected", {})
        config.chosen, kept = select(ROOT, changed, known)
        config.cache.set("affected", kept)


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node):
    node.workerinput["chosen"] = getattr(node.config, "chosen", None)


def pytest_ignore_collect(collection_path, config):
    if config.option.affected is not None and collection_path.suffix == ".py":
        chosen = config.workerinput["chosen"] if hasattr(config, "workerinput") else config.chosen
        return collection_path.relative_to(ROOT).as_posix() not in chosen or None


class CommandResult(NamedTuple):
    """What a command printed and how it ended."""

    code: int
    out: str
    err: str


def alone(*arguments, timeout_s=600, **environment):
    """Run the command as a user would, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "shefex_nav", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "100", **environment},
        check=False,
    )
    return CommandResult(done.returncode, done.stdout, done.stderr)


class DefaultRun(NamedTuple):
    """The default scenario with seed 1, from the command line."""

    log: Path
    summary: dict
    kernels: Path  # those that it called, a line of JSON each


@pytest.fixture(autouse=True)
def own_numbers(request):
    """A generator RNG of the test's module begins anew, by the test's name, whichever tests ran before."""
    rng = getattr(request.module, "RNG", None)
    if rng is not None:
        seed = zlib.crc32(request.node.name.encode())
        rng.bit_generator.state = np.random.default_rng(seed).bit_generator.state


def here(*arguments):
    """Run the command line in this process, which has loaded everything; a fault is not caught."""
    from shefex_nav.commands.app import main

    out, err, code, searched = io.StringIO(), io.StringIO(), 0, gc.get_threshold()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(ROOT)
        patch.setenv("COLUMNS", "100")
        patch.setattr(sys, "argv", ["shefex-nav", *map(str, arguments)])
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
        finally:
            gc.set_threshold(
                *searched
            )  # a command has Python search for cycles seldom; many would fill the memory
    return CommandResult(code, out.getvalue(), err.getvalue())


@pytest.fixture(scope="session", autouse=True)
def read_once():
    """What a YAML text says, which nobody changes, is found out once: most of the time that loading takes."""
    from shefex_nav.scenario import document

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(document, "_compose", lru_cache(200)(document._compose))
        yield


@pytest.fixture(scope="session")
def command():
    """The command line in this process: command("check", path) -> CommandResult."""
    return here


@pytest.fixture(scope="session")
def process():
    """The same in a process of its own: for what a process writes by itself, and how it ends."""
    return alone


@pytest.fixture(scope="session")
def default_scenario():
    """Path of the default scenario."""
    return DEFAULT


@pytest.fixture(scope="session")
def once(tmp_path_factory):
    """once(name, make): a folder that `make(folder)` fills, once for all processes that tests run in."""

    def shared(name, make):
        base = tmp_path_factory.getbasetemp()
        folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
        done, failed = folder / "done", folder / "failed"
        try:
            folder.mkdir()
        except FileExistsError:  # the others wait
            end_s = time.monotonic() + 900.0
            while not done.exists():
                assert not failed.exists() and time.monotonic() < end_s, f"{name} could not be made"
                time.sleep(0.05)
            return folder
        try:
            make(folder)
        except BaseException:
            failed.touch()
            raise
        done.touch()
        return folder

    return shared


@pytest.fixture(scope="session")
def default_run(once):
    """The default mission, flown and logged."""

    def make(folder):
        flight = "run", DEFAULT, "--seed", 1, "--out", folder / "run.mcap", "--json"
        result = alone(*flight, SHEFEX_NAV_KERNELS_USED=str(folder / "kernels.jsonl"))
        assert result.code == 0, result.err
        (folder / "summary.json").write_text(result.out)

    folder = once("default", make)
    summary = json.loads((folder / "summary.json").read_text())
    return DefaultRun(folder / "run.mcap", summary, folder / "kernels.jsonl")


@pytest.fixture(scope="session")
def default_data(default_run):
    """RunData of its log; tests change nothing in it."""
    from shefex_nav.log import reader

    return reader.read(default_run.log)
