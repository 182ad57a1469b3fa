"""Blocks of errors that a scenario may switch on.

`STATES` is the table of the program's blocks, in the order of the errors. It is apart from `state`, so that a
scenario can be checked without a compiler. Three compiled files do the rest: `calibration` takes the estimate
of a block out of the increments of the IMU, `laws` says how it changes by itself, `measurements` what a
sensor sees of it.

Blocks from outside (`Block`) stand behind all of these, in the errors and in the packed values. Instruments
bring them along with their measurements; plug-ins may bring one by itself (`OwnState`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

GYROS, ACCELEROMETERS, SHAKEN = range(3)  # what is driven; SHAKEN: accelerometers, by the power of vibration
DURATION, ANGLE, SPEED = 0, 1, 4  # first weight of each kind: s; rad about x, y, z; m/s along x, y, z
WEIGHTS = 7
OFF_DIAGONAL = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # order of misalignments


class Drive(NamedTuple):
    """What one error does to the increments: it adds itself times a weight, on one axis of a triad."""

    triad: int  # GYROS, ACCELEROMETERS or SHAKEN
    weight: int  # of the corrected motion: DURATION, ANGLE + axis, SPEED + axis
    axis: int  # of the triad


class Beforehand(NamedTuple):
    """What is known of the sensors before the flight: by data sheets, or as the filter is told otherwise."""

    gyro: Any  # settings of the gyros
    accelerometer: Any  # settings of the accelerometers
    gyro_roll: float  # scale factor of the roll gyro
    gyro_misalignment: float  # rad
    rectified: float = 0.0  # m/s^2, bias while the strongest motor burns
    gravity: float = 0.0  # m/s^2, what the on-board field leaves out
    mounting: float = 0.0  # rad, each axis
    lever_arm: float = 0.0  # m, each axis
    clock: tuple = (0.0, 0.0)  # m, m/s
    gps_latency: float = 0.0  # s
    range_bias: float = 0.0  # m


class State(NamedTuple):
    """A block of errors of the program."""

    name: str
    size: int
    unit: str  # SI; "" of what has none
    label: str  # for people
    known: Callable[[Beforehand], tuple]  # sigma of each error at the start
    drives: tuple[Drive, ...] = ()  # what each error does to the increments of the IMU; (): nothing
    noise: Callable[[Beforehand], float] | None = None  # sigma of the noise that stands for it if it is off
    lasts: bool = False  # through a flight, as one smooths it; what is noise on board is a state then
    of_data: bool = False  # a replay of external data may estimate it
    learnt: bool = True  # from stars and GPS: whatever misled the filter has misled it, too


def _diagonal(triad, first):
    """Drives of scale factors. first : ANGLE or SPEED"""
    return tuple(Drive(triad, first + i, i) for i in range(3))


def _off_diagonal(triad, first):
    """Drives of misalignments."""
    return tuple(Drive(triad, first + j, i) for i, j in OFF_DIAGONAL)


SATELLITES = 32  # that have an error of their own
STATES = (
    State(
        "gyro_roll_column", 3, "", "error of the gyros on x, y, z per unit of roll rate",
        known=lambda told: (told.gyro_roll, told.gyro_misalignment, told.gyro_misalignment),
        drives=tuple(Drive(GYROS, ANGLE, i) for i in range(3)),
        of_data=True,
    ),
    State(
        "gyro_scale", 3, "", "scale factor error of the gyros",
        known=lambda told: (told.gyro_roll, told.gyro.scale_factor, told.gyro.scale_factor),
        drives=_diagonal(GYROS, ANGLE),
        noise=lambda told: told.gyro.scale_factor,
        lasts=True, of_data=True,
    ),
    State(
        "gyro_misalignment", 6, "rad", "rate about j seen by gyro i, ij = xy, xz, yx, yz, zx, zy",
        known=lambda told: (told.gyro_misalignment,) * 6,
        drives=_off_diagonal(GYROS, ANGLE),
        noise=lambda told: told.gyro.misalignment,
        lasts=True, of_data=True,
    ),
    State(
        "gyro_g_sensitivity", 9, "rad s/m", "specific force along j seen by gyro i, row by row",
        known=lambda told: (told.gyro.g_sensitivity,) * 9,
        drives=tuple(Drive(GYROS, SPEED + j, i) for i in range(3) for j in range(3)),
        noise=lambda told: told.gyro.g_sensitivity,
        lasts=True, of_data=True,
    ),
    State(
        "accel_scale", 3, "", "scale factor error of the accelerometers",
        known=lambda told: (told.accelerometer.scale_factor,) * 3,
        drives=_diagonal(ACCELEROMETERS, SPEED),
        noise=lambda told: told.accelerometer.scale_factor,
        lasts=True, of_data=True,
    ),
    State(
        "accel_misalignment", 6, "rad", "force along j seen by accelerometer i, order as of the gyros",
        known=lambda told: (told.accelerometer.misalignment,) * 6,
        drives=_off_diagonal(ACCELEROMETERS, SPEED),
        noise=lambda told: told.accelerometer.misalignment,
        lasts=True, of_data=True,
    ),
    State(
        "accel_rectification", 3, "m/s2", "bias of the accelerometers under the strongest motor",
        known=lambda told: (told.rectified,) * 3,
        drives=tuple(Drive(SHAKEN, DURATION, i) for i in range(3)),
        noise=lambda told: told.rectified,
        lasts=True,
    ),
    State(
        "gravity", 3, "m/s2", "what the on-board field leaves out, inertial axes, Gauss-Markov",
        known=lambda told: (told.gravity,) * 3,
        noise=lambda told: told.gravity,
    ),
    State(
        "mounting", 3, "rad", "star camera against its nominal mounting, rotation vector in body axes",
        known=lambda told: (told.mounting,) * 3,
    ),
    State(
        "lever_arm", 3, "m", "GPS antenna against its nominal place, body axes",
        known=lambda told: (told.lever_arm,) * 3,
        of_data=True,
    ),
    State(
        "clock", 2, "m, m/s", "clock of the GPS receiver ahead of GPS time: bias, drift",
        known=lambda told: told.clock,
        learnt=False,
    ),
    State(
        "gps_latency", 1, "s", "a fix belongs to an instant so much before its t_valid_s",
        known=lambda told: (told.gps_latency,),
        of_data=True,
    ),
    State(
        "range_bias", SATELLITES + 1, "m",
        "range errors that last, of satellites 1 to 32 and one of all, Gauss-Markov",
        known=lambda told: (told.range_bias,) * (SATELLITES + 1),
        learnt=False,
    ),
)  # fmt: skip
OPTIONAL = {state.name: state.size for state in STATES}  # blocks and their sizes, in the order of the errors
CORE_BLOCKS = ("position", "velocity", "attitude", "gyro_bias", "accel_bias")  # always there
DEFAULT_STATES = ("gyro_roll_column", "mounting")
CONTAINED = {"gyro_roll_column": ("gyro_scale", "gyro_misalignment")}  # its errors are errors of those, too


def known_sigmas(states, told):
    """{name: (size,) sigma at the start} of those of some blocks that are of `STATES`. told : Beforehand"""
    return {state.name: np.array(state.known(told)) for state in STATES if state.name in states}


def left_as_noise(states, told):
    """{name: sigma} of the noise that stands for a block: 0 if it is estimated. told : Beforehand"""
    of_noise = [state for state in STATES if state.noise is not None]
    return {state.name: 0.0 if state.name in states else state.noise(told) for state in of_noise}


class ImuMean(NamedTuple):
    """What the IMU measured in a tick, means, errors not taken out: for a block that drives increments."""

    t_s: float  # mission time in the middle of the tick
    omega_b: np.ndarray  # (3,) rad/s
    f_b: np.ndarray  # (3,) m/s^2


class Block(NamedTuple):
    """Errors from outside that the filter estimates, with the law by which they grow.

        d/dt e = F e + walk * white noise of density one

    Where `drives` is given they make errors of the IMU besides: in a tick, `drives(ImuMean) @ e` in rad/s and
    m/s^2 is added to what the gyros (rows 0 to 2) and the accelerometers (3 to 5) measure, body axes.
    """

    name: str
    P: np.ndarray  # (size, size) covariance at the start, symmetric, no variance below zero
    walk: np.ndarray  # (size,) density of a random walk, in the unit of the error per sqrt(s), >= 0; 0: none
    F: np.ndarray | None = None  # (size, size) 1/s; None: 0, the errors are constant but for the random walk
    drives: Callable[[ImuMean], np.ndarray] | None = None  # -> (6, size); None: they drive nothing

    @property
    def size(self):
        """Number of errors."""
        return len(self.P)


class OwnState(NamedTuple):
    """A block of errors that a plug-in brings by itself, without an instrument."""

    name: str  # in `navigation.states`, and of its section `navigation.<name>`
    size: int
    unit: str  # SI; "" of what has none
    label: str  # for people
    settings: type  # a class of `settings.Settings`: what is known of it before the flight
    block: Callable  # of its settings -> Block
    plugin: Any = None  # plugins.Plugin that brought it


class LayoutError(ValueError):
    """Blocks that do not exist or do not go together; `name` is the one to blame."""

    def __init__(self, name, message):
        super().__init__(message)
        self.name = name


def checked(names, others=()):
    """The names as a tuple, or a LayoutError.

    names : of OPTIONAL, or of `others`, which instruments and plug-ins bring along
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


# ----------------------------------------------------------------------------------------------------------
# What blocks from outside do to the increments of the IMU in a tick: coefficients for kernels.
#
# In: the blocks that a filter has (`Block`), and what the IMU has measured. Out: `drive` (6, m) of an
# ImuWindow, rad/s and m/s^2 for each of the last m errors, those from outside; they are constant in a tick.


def drive_of_tick(nav, readings, end_s, dt_s):
    """`drive` of a tick that ends at end_s.

    nav : fusion.Filter;  readings : (n, 6) increments over dt_s each -> (6, m)
    """
    n = len(readings)
    mean = readings.sum(axis=0) / (n * dt_s)
    sensed = ImuMean(end_s - 0.5 * n * dt_s, mean[:3], mean[3:])
    columns = [
        np.zeros((6, block.size)) if block.drives is None else block.drives(sensed)
        for block in nav.params.blocks
        if block.name in nav.layout.names
    ]
    return np.hstack(columns)
