"""Section of a scenario about what its mission requires. A campaign says how often each of them is met.

`position.limit`, `velocity.limit` and `attitude.limit` are the numbers that say how wrong each may be: the
computer on board says of each 'do not use' while its protection level exceeds the limit, and what is required
of it, or of its protection level, is that. Each requirement is judged on the figures of a single run, as
`report` prints them; one that is left out is not required. Entry is the first descent through 100 km. A
figure that a mission does not have (no entry, no star tracker) is not met by its runs; take away with `null`
what it inherits and cannot mean.
"""

from pydantic import Field, StrictBool

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Count, Quantity

NOT_USED = "the computer on board says 'do not use' while the protection level exceeds it"
WHOLE = "of the whole error, for the level horizontal and vertical together"


class PositionLimit(Block):
    """How wrong the position may be."""

    limit: Quantity("m", "100 m", f"{WHOLE}; {NOT_USED}", positive=True) = "100 m"


class VelocityLimit(Block):
    """How wrong the velocity may be."""

    limit: Quantity("m/s", "1 m/s", f"{WHOLE}; {NOT_USED}", positive=True) = "1 m/s"


class AttitudeLimit(Block):
    """How wrong the attitude may be."""

    limit: Quantity("rad", "0.17 deg", f"about each axis; {NOT_USED}", positive=True) = "0.17 deg"


class Within(Block):
    """What of a quantity is required to be within its limit."""

    at_entry: StrictBool = Field(False, description="true: the navigation error at entry")
    while_pointing: StrictBool = Field(
        False,
        description="true: the navigation error in the tasks dwell, turn_with_orbit and hold, from the first "
        "of them on, before the first star fixes too",
    )
    protection_at_entry: StrictBool = Field(False, description="true: the protection level at entry")


class Position(Within, PositionLimit):
    """How wrong the position may be, and what is required to be within that."""


class Velocity(Within, VelocityLimit):
    """How wrong the velocity may be, and what is required to be within that."""


class Attitude(Within, AttitudeLimit):
    """How wrong the attitude may be, and what is required to be within that."""


IntegrityRisk = Quantity(
    "1/h", "1e-5 /h",
    "how often in an hour of use each of position, velocity and attitude may be beyond its protection level"
    " unnoticed; the levels are made for it",
    positive=True, at_most="100 /h",
)  # fmt: skip


Probability = Quantity(
    "", "99.865 %", "of the flights in which a requirement has to be met: `trade` predicts it, campaigns"
    " verify it", at_least="50 %", at_most="99.9999 %",
)  # fmt: skip


Confidence = Quantity(
    "", "90 %", "with which a campaign says of each requirement that it is met, or that it is not, with that"
    " probability", at_least="50 %", at_most="99.9999 %",
)  # fmt: skip


class ReplayRequirements(Block):
    """What is required of the solution."""

    position: PositionLimit = PositionLimit()
    velocity: VelocityLimit = VelocityLimit()
    attitude: AttitudeLimit = AttitudeLimit()
    integrity_risk: IntegrityRisk = "1e-5 /h"


class Requirements(Block):
    """Limits that a run has to keep."""

    position: Position = Field(
        default_factory=Position, description="how wrong it may be, for the computer on board, too"
    )
    velocity: Velocity = Field(
        default_factory=Velocity, description="how wrong it may be, for the computer on board, too"
    )
    attitude: Attitude = Field(
        default_factory=Attitude, description="how wrong it may be, for the computer on board, too"
    )
    probability: Probability = "99.865 %"
    confidence: Confidence = "90 %"
    integrity_risk: IntegrityRisk = "1e-5 /h"
    usable_at_entry: StrictBool = Field(
        False, description="true: the navigation must not say 'do not use' of any of the three at entry"
    )
    misleading: (
        Quantity(
            "", "0 %", "share of the time at most in which position, velocity or attitude is usable although "
            "its error has been beyond its protection level for more than a second",
            non_negative=True, at_most="100 %",
        ) | None
    ) = None  # fmt: skip
    wrong_star_fixes: Count("0", "given as good at most", non_negative=True) | None = None
    star_fixes: (
        Quantity("", "95 %", "share of the frames in the window that give an attitude, at least",
                 non_negative=True, at_most="100 %") | None
    ) = None  # fmt: skip
    pointing_error: (
        Quantity("rad", "3 deg", "at most while pointing", positive=True, at_most="180 deg") | None
    ) = None
    cold_gas: Quantity("kg", "8 kg", "used at most", positive=True) | None = None
    apogee: Quantity("m", "170 km", "height at least", positive=True, at_most="1000000 km") | None = None
