"""Steps of the chain that can be done in several ways, and where the ways are looked up by their names.

The tables hold the default chain. What the papers bring (`papers/*/methods`) and what users bring is added to
them (`plugins`); the papers' when a way is first looked up, so that scenarios are read without kernels.
"""

from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

SCAN = "star_tracker", "detection", "scan"
WAITING = []  # names of modules whose PROVIDES, a list of Method, are yet to be added


class Method(NamedTuple):
    """A way to do one step of the star tracker chain, chosen by its name in the scenario."""

    step: str  # of STEPS
    name: str
    function: Any  # with the signature of those beside it
    plugin: Any = None  # plugins.Plugin that brought it; None: it came with the program


class Step(NamedTuple):
    """A step of the chain."""

    path: tuple  # of the key of the scenario that chooses
    module: str  # of this folder
    name: str  # of the table in it

    @property
    def table(self):
        """{name: function} as it is now."""
        return _table(self.module, self.name)

    def ways(self):
        """The same with what was waiting."""
        while WAITING:
            for one in import_module(WAITING.pop(0)).PROVIDES:
                add(one)
        return self.table


STEPS = {
    "identification": Step(("star_tracker", "identification", "method"), "identify", "IDENTIFIERS"),
    "search": Step(SCAN, "objects", "SEARCHES"),
    "scan": Step(SCAN, "detect", "SCANS"),
    "centroid": Step(("star_tracker", "detection", "centroid"), "detect", "CENTROIDS"),
}


@cache
def _table(module, name):
    """The table of that name in a module of this folder."""
    return getattr(import_module(f"shefex_nav.onboard.startracker.{module}"), name)


def add(one):
    """Put a Method into the table of its step."""
    STEPS[one.step].table[one.name] = one.function


def ways(path):
    """Names that may stand at a key of the scenario: tuple."""
    return tuple(name for step in STEPS.values() if step.path == path for name in step.ways())
