"""Which errors of the sensors the filter estimates, and why, as a table for people.

In: what `prepare.wanted` says of a scenario that leaves the choice to the program.
"""

import math

from shefex_nav.scenario.wanted_states import SWAMPS, WINDOW_S

COLUMNS = ("block of states", "its error moves", "noise makes", "estimated", "because")


def table(effects):
    """rich Table of a list of wanted_states.Effect."""
    from rich.table import Table

    title = (
        f"navigation.states: automatic. 1 sigma, in the worst {WINDOW_S:g} s of the planned flight; "
        f"estimated from {SWAMPS:g} times the noise on"
    )
    made = Table(title=title, title_justify="left")
    for name in COLUMNS:
        made.add_column(name, no_wrap=True)
    for one in effects:
        sizes = (_size(one.effect, one.unit), _size(one.noise, one.unit))
        made.add_row(one.block, *sizes, "yes" if one.on else "no", one.why)
    return made


def _size(value, unit):
    """A figure in its unit, angles in degrees."""
    if math.isnan(value):
        return ""
    return f"{math.degrees(value) if unit == 'deg' else value:.3g} {unit}"
