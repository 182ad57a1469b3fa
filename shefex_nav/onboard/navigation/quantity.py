"""What each sensor of the filter measures: the one table that its checks ask, so that none compares a name.

A sensor that is not in it, such as an instrument (`aiding`), measures something else.
"""

from enum import Enum
from typing import NamedTuple


class Quantity(Enum):
    """A quantity that GPS or stars measure."""

    POSITION = "position"
    VELOCITY = "velocity"
    ATTITUDE = "attitude"


class Measures(NamedTuple):
    """What a sensor measures."""

    quantity: Quantity
    whole: bool  # whether one fix says all of it; or a row for each satellite or star


POSITION, VELOCITY, ATTITUDE = Quantity
TABLE = {
    "gps_position": Measures(POSITION, whole=True),
    "gps_velocity": Measures(VELOCITY, whole=True),
    "gps_range": Measures(POSITION, whole=False),
    "gps_range_rate": Measures(VELOCITY, whole=False),
    "star_tracker": Measures(ATTITUDE, whole=True),
    "star_vectors": Measures(ATTITUDE, whole=False),
}
VECTORS = tuple(name for name, of in TABLE.items() if of.whole and of.quantity is not ATTITUDE)
# the position of a receiver -> the velocity that comes with it
BESIDE = {"gps_position": "gps_velocity", "gps_range": "gps_range_rate"}
# positions whose velocity is told along lines of sight from them: where the place is wrong, so are these
SIGHTS = tuple(name for name, of in TABLE.items() if of.quantity is POSITION and not of.whole)
# velocity that is told along lines of sight -> the position whose they are
PLACE = {beside: name for name, beside in BESIDE.items() if name in SIGHTS}
RATES = tuple(name for name, of in TABLE.items() if of.quantity is VELOCITY)
# about(name): the quantity that a sensor measures, whole or in rows; None: another one
about = {name: of.quantity for name, of in TABLE.items()}.get
# fix_of(name): quantity of which one fix of a sensor says all; None: of none of these
fix_of = {name: of.quantity for name, of in TABLE.items() if of.whole}.get
