"""Plug-in of pytest for `mutants.py`: which test runs which line of the package, and how long each takes."""

import json
import os
import signal
import time
from pathlib import Path

import coverage
import pytest

LONGEST_S = int(os.environ["MUTANT_LONGEST_S"])
TREE = Path.cwd()


class TooLong(Exception):
    """A test that takes too long to have a say."""


def _stop(*_):
    raise TooLong


def pytest_configure(config):
    config.cover = coverage.Coverage(data_file=None, include=[f"{TREE}/shefex_nav/*"])
    config.cover.start()
    config.seconds = {}
    signal.signal(signal.SIGALRM, _stop)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    item.config.cover.switch_context(item.nodeid)
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    begun = time.perf_counter()
    signal.alarm(LONGEST_S)
    try:
        result = yield
        item.config.seconds[item.nodeid] = round(time.perf_counter() - begun, 3)
        return result
    finally:
        signal.alarm(0)


def pytest_unconfigure(config):
    config.cover.stop()
    data, lines = config.cover.get_data(), {}
    for file in data.measured_files():
        of = lines.setdefault(Path(file).relative_to(TREE).as_posix(), {})
        for line, tests in data.contexts_by_lineno(file).items():
            if passed := [name for name in tests if name in config.seconds]:
                of[line] = passed
    text = json.dumps({"seconds": config.seconds, "lines": lines})
    Path(os.environ["MUTANT_LINES"]).write_text(text, encoding="utf-8")
