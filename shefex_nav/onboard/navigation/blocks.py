"""The blocks of errors that a scenario may switch on, and which go together.

Apart from `state`, so that a scenario can be checked without a compiler. Instruments bring further blocks
along (`Block`), which stand behind these.
"""

from typing import NamedTuple

import numpy as np

OPTIONAL = {  # blocks and their sizes, in the order of the errors; what drives the first nine comes first
    "gyro_roll_column": 3,  # error on x, y, z per unit of roll rate [-]: scale factor and two misalignments
    "gyro_scale": 3,  # [-]
    "gyro_misalignment": 6,  # elements ij = xy, xz, yx, yz, zx, zy: rate about j seen on axis i [rad]
    "gyro_g_sensitivity": 9,  # row by row, ij: specific force along j seen on axis i [rad/s per m/s^2]
    "accel_scale": 3,  # [-]
    "accel_misalignment": 6,  # as of the gyros [rad]
    "accel_rectification": 3,  # bias under the strongest motor; goes with the power of vibration [m/s^2]
    "gravity": 3,  # what the on-board field leaves out, inertial axes, first-order Gauss-Markov [m/s^2]
    "mounting": 3,  # star camera against its nominal mounting, rotation vector in body axes [rad]
    "lever_arm": 3,  # GPS antenna against its nominal place, body axes [m]
    "clock": 2,  # of the GPS receiver, ahead of GPS time: bias [m], drift [m/s]
    "gps_latency": 1,  # a fix belongs to an instant so much before its t_valid_s [s]
    "range_bias": 32,  # range errors that last, of satellites 1 to 32, first-order Gauss-Markov [m]
}
CORE_BLOCKS = ("position", "velocity", "attitude", "gyro_bias", "accel_bias")  # always there
DEFAULT_STATES = ("gyro_roll_column", "mounting")
CONTAINED = {"gyro_roll_column": ("gyro_scale", "gyro_misalignment")}  # its errors are errors of those, too


class Block(NamedTuple):
    """Errors of an instrument that the filter estimates; they drive no other errors."""

    name: str
    P: np.ndarray  # (size, size) covariance at the start
    walk: np.ndarray  # (size,) density of a random walk, in the unit of the error per sqrt(s); 0: constant

    @property
    def size(self):
        """Number of errors."""
        return len(self.P)


class LayoutError(ValueError):
    """Blocks that do not exist or do not go together; `name` is the one to blame."""

    def __init__(self, name, message):
        super().__init__(message)
        self.name = name


def checked(names, others=()):
    """The names as a tuple, or a LayoutError.

    names : of OPTIONAL, or of `others`, which instruments bring along
    """
    names, known = tuple(names), (*OPTIONAL, *others)
    for k, name in enumerate(names):
        if name not in known:
            raise LayoutError(name, f"there is no block of states '{name}'; there are {', '.join(known)}")
        if name in names[:k]:
            raise LayoutError(name, f"'{name}' is named twice")
        for whole in CONTAINED.get(name, ()):
            if whole in names:
                raise LayoutError(name, f"'{name}' and '{whole}' estimate the same error; name one of them")
    return names
