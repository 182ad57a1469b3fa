"""Python imports this at its start where `start_live.py` has put it: marks when `run --live` got how far.

START_LIVE_MARKS : file to which `stage,process,number of the process,time` is appended
"""

import os
import sys
import time
from importlib.abc import MetaPathFinder
from importlib.util import find_spec

DONE = set()


def mark(stage, process):
    """This process has got so far, for the first time."""
    if stage not in DONE:
        DONE.add(stage)
        with open(os.environ["START_LIVE_MARKS"], "a", encoding="utf-8") as file:
            file.write(f"{stage},{process},{os.getpid()},{time.time()!r}\n")


def after(owner, name, stage, holds=lambda *arguments: True):
    """Mark a stage when a function of a module or class has been called and something holds."""
    function = getattr(owner, name)

    def wrapped(*arguments, **more):
        result = function(*arguments, **more)
        if holds(*arguments):
            mark(stage, "reader")
        return result

    setattr(owner, name, wrapped)


def watch_the_flight(simulate):
    """Mark the first tick; a flight that warms up, which one in real time does, does not count."""
    route, warm_up = simulate.route, simulate.warm_up

    def ticks(*arguments, **more):
        for k, record in enumerate(route(*arguments, **more)):
            if k == 1 and not warming:
                mark("first tick", "flight")
            yield record

    def warmed_up(*arguments, **more):
        warming.append(True)
        result = warm_up(*arguments, **more)
        warming.clear()
        return result

    warming = []
    simulate.route, simulate.warm_up = ticks, warmed_up


def watch_the_window(program):
    """Mark when the viewer is started, and when it takes what is sent to it."""
    after(program.Window, "__init__", "viewer asked for")
    after(program.Window, "wait_until_it_listens", "viewer listens")


def watch_what_is_sent(live):
    """Mark the first data after the words that wait for them."""
    after(live, "wait_for", "connected")
    after(live.Live, "take", "first data sent", lambda self, *_: self._laid_out is not None)


WATCHED = {
    "shefex_nav.simulate": watch_the_flight,
    "shefex_nav.report.viewer.program": watch_the_window,
    "shefex_nav.report.viewer.live": watch_what_is_sent,
}


class Watch(MetaPathFinder):
    """Finds the modules that are watched as Python does, and changes them when they have been imported."""

    looking = False

    def find_spec(self, name, path=None, target=None):
        if name not in WATCHED or Watch.looking:
            return None
        Watch.looking = True
        try:
            spec = find_spec(name)
        finally:
            Watch.looking = False
        execute = spec.loader.exec_module

        def watched(module):
            execute(module)
            WATCHED[name](module)

        spec.loader.exec_module = watched
        return spec


if "START_LIVE_MARKS" in os.environ:
    sys.meta_path.insert(0, Watch())
