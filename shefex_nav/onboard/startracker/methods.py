"""Steps of the chain that can be done in several ways, and where the ways are looked up by their names.

The tables hold the default chain. What the papers bring (`papers/*/methods`) and what users bring is added to
them (`plugins`); the papers' when a way is first looked up, so that scenarios are read without kernels.
"""

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
        return getattr(import_module(f"shefex_nav.onboard.startracker.{self.module}"), self.name)

    def ways(self):
        """The same with what was waiting."""
        while WAITING:
            for one in import_module(WAITING.pop(0)).PROVIDES:
                add(one)
        return self.table


STEPS = {
    "identification": Step(("star_tracker", "identification", "method"), "identify", "IDENTIFIERS"),
    "search": Step(SCAN, "objects", "SEARCHES"),
    "scan": Step(SCAN, "objects", "SCANS"),
    "centroid": Step(("star_tracker", "detection", "centroid"), "objects", "CENTROIDS"),
}


class Table(dict):
    """{name: function} of a step; a name that is not in it may be one of those that are waiting."""

    def __init__(self, step, **ways):
        super().__init__(ways)
        self.step = step  # of STEPS

    def __missing__(self, name):
        known = STEPS[self.step].ways()
        if name not in known:
            raise ValueError(f"{self.step}: {name!r} is not known; choose from: {', '.join(known)}")
        return known[name]


def add(one):
    """Put a Method into the table of its step."""
    STEPS[one.step].table[one.name] = one.function


def ways(path):
    """Names that may stand at a key of the scenario: tuple."""
    return tuple(name for step in STEPS.values() if step.path == path for name in step.ways())
