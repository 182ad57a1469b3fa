"""Which errors of the sensors the filter estimates, and why, as a table for people.

In: what `prepare.wanted` says of a scenario that leaves the choice to the program.
"""

import math

from shefex_nav.report import columns
from shefex_nav.scenario.wanted_states import SWAMPS, WINDOW_S

COLUMNS = ("block of states", "its error moves", "noise makes", "estimated", "because")


def table(effects):
    """rich Table of a list of wanted_states.Effect."""
    title = (
        f"navigation.states: automatic. 1 sigma, in the worst {WINDOW_S:g} s of the planned flight; "
        f"estimated from {SWAMPS:g} times the noise on"
    )
    rows = (
        (one.block, *(_size(size, one.unit) for size in (one.effect, one.noise)), _yes(one.on), one.why)
        for one in effects
    )
    return columns.table(title, COLUMNS, rows, no_wrap=True)


def _yes(on):
    return "yes" if on else "no"


def _size(value, unit):
    """A figure in its unit, angles in degrees."""
    if math.isnan(value):
        return ""
    return f"{math.degrees(value) if unit == 'deg' else value:.3g} {unit}"
