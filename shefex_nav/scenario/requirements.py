"""Section of a scenario about what its mission requires. A campaign says how often each of them is met.

`attitude.limit` is the one number that says how wrong the attitude may be: the computer on board says 'do not
use' while the protection level exceeds it, and what is required of the attitude, or of its protection level,
is that. Each requirement is judged on the figures of a single run, as `report` prints them; one that is left
out is not required. Entry is the first descent through 100 km. A figure that a mission does not have (no
entry, no star tracker) is not met by its runs; take away with `null` what it inherits and cannot mean.
"""

from pydantic import Field, StrictBool

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Count, Quantity


class AttitudeLimit(Block):
    """How wrong the attitude may be."""

    limit: Quantity(
        "rad", "0.17 deg",
        "about each axis; the computer on board says 'do not use' while the protection level exceeds it",
        positive=True,
    ) = "0.17 deg"  # fmt: skip


class Attitude(AttitudeLimit):
    """How wrong the attitude may be, and what is required to be within that."""

    at_entry: StrictBool = Field(False, description="true: the navigation error at entry")
    protection_at_entry: StrictBool = Field(False, description="true: the protection level at entry")


class Requirements(Block):
    """Limits that a run has to keep."""

    attitude: Attitude = Field(
        default_factory=Attitude, description="how wrong it may be, for the computer on board, too"
    )
    position_at_entry: Quantity("m", "100 m", "navigation error at most", positive=True) | None = None
    velocity_at_entry: Quantity("m/s", "1 m/s", "navigation error at most", positive=True) | None = None
    usable_at_entry: StrictBool = Field(
        False, description="true: the navigation must not say 'do not use' at entry"
    )
    misleading: (
        Quantity(
            "", "0 %", "share of the time at most in which the solution is usable although an error "
            "of the attitude exceeds the protection level",
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
