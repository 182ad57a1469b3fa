"""The table of cells: which level of each factor every cell has. benchmarks/robustness_design.py made it.

The file has a row a cell, in the order in which they are to be flown: any number of them from the first on is
spread over all levels.
"""

import csv
from importlib.resources import files
from typing import NamedTuple

from shefex_nav.verify.robustness.factors import GRADES, TOLD
from shefex_nav.verify.robustness.happenings import HAPPENS, PHASES, STARS

FILE = "design.csv"
ROCKETS = {  # scenario -> settings; what is required of an attitude says when it may be used
    "shefex2_andoya": (),
    "rexus_like": ("requirements.attitude.limit=3 deg",),
    "rexus_spinning": (),
}
OWN, ANY = "own", "any"  # in the place of a grade and of a phase, where the scenario or chance has its own
FACTORS = {
    "rocket": tuple(ROCKETS),
    "grade": tuple(GRADES),
    "told": tuple(TOLD),
    "happens": tuple(HAPPENS),
    "phase": PHASES,
}


class Cell(NamedTuple):
    """One row."""

    number: int
    rocket: str
    grade: str
    told: str
    happens: str
    phase: str


def cells():
    """list of Cell."""
    text = (files(__package__) / FILE).read_text()
    rows = csv.DictReader(text.splitlines())
    return [Cell(int(row["cell"]), *(row[name] for name in FACTORS)) for row in rows]


def of_scenario(name, has_stars):
    """Cells that a scenario flies: its own of the design, or, of one that is not in it, all it can."""
    found = cells()
    if name in ROCKETS:
        return [cell for cell in found if cell.rocket == name]
    return [cell._replace(rocket=name) for cell in found if has_stars or not needs_stars(cell)]


def needs_stars(cell):
    """Whether a cell has levels that mean nothing without a star tracker."""
    return TOLD[cell.told].needs_stars or HAPPENS[cell.happens].device == STARS
