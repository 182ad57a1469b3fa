"""Section of a scenario about what its mission requires. A campaign says how often each of them is met.

Each is judged on the figures of a single run, as `report` prints them; one that is left out is not required.
Entry is the first descent through 100 km. A figure that a mission does not have (no entry, no star tracker)
is not met by its runs; take away with `null` what it inherits and cannot mean.
"""

from pydantic import Field, StrictBool

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Count, Quantity


class Requirements(Block):
    """Limits that a run has to keep."""

    attitude_at_entry: (
        Quantity("rad", "0.17 deg", "navigation error at most, about each axis", positive=True) | None
    ) = None
    position_at_entry: Quantity("m", "100 m", "navigation error at most", positive=True) | None = None
    velocity_at_entry: Quantity("m/s", "1 m/s", "navigation error at most", positive=True) | None = None
    usable_at_entry: StrictBool = Field(
        False, description="true: the navigation must not say 'do not use' at entry"
    )
    protection_at_entry: (
        Quantity("rad", "0.17 deg", "protection level at most, about each axis", positive=True) | None
    ) = None
    misleading: (
        Quantity(
            "", "0 %", "share of the time at most with errors beyond the protection level",
            non_negative=True, at_most="100 %",
        ) | None
    ) = None  # fmt: skip
    wrong_star_fixes: Count("0", "given as good at most", non_negative=True) | None = None
    star_fixes: (
        Quantity("", "95 %", "share of the frames in the window that give an attitude, at least",
                 non_negative=True, at_most="100 %") | None
    ) = None  # fmt: skip
    pointing_error: Quantity("rad", "3 deg", "at most while pointing", positive=True) | None = None
    cold_gas: Quantity("kg", "8 kg", "used at most", positive=True) | None = None
    apogee: Quantity("m", "170 km", "height at least", positive=True) | None = None
