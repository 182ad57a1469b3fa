"""Python processes that this one starts: they look for modules where it does, not in the current folder.

Python itself puts the current folder first where it is started by `-c` or `-m`: a file `multiprocessing.py`
beside somebody's scenario would be run by the workers of a campaign.
"""

import os
import sys
from contextlib import contextmanager

SAFE = "PYTHONSAFEPATH"  # variable of Python: the current folder is not put first
MINE = "shefex_nav"  # its value as told here; any text means yes


def of_module(name, *arguments):
    """(command, environment) of a process that runs a module of the package."""
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    return [sys.executable, "-P", "-m", name, *arguments], {**os.environ, "PYTHONPATH": paths}


@contextmanager
def safe():
    """Context in which `multiprocessing` starts processes; each calls `begun` first of all."""
    if SAFE in os.environ:
        yield
        return
    os.environ[SAFE] = MINE
    try:
        yield
    finally:
        del os.environ[SAFE]


def begun():
    """In such a process: programs of somebody's own that it starts are not concerned."""
    if os.environ.get(SAFE) == MINE:
        del os.environ[SAFE]
