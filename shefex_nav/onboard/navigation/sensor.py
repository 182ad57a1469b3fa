"""What a sensor of the filter is: how it is linearised, gated and, after contradiction, believed.

And what a recorder of the filter is told: each step of prediction and each correction that is final.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from shefex_nav.onboard.navigation import integrity
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.history import Moment
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.settings import Release
from shefex_nav.onboard.navigation.state import NavState
from shefex_nav.onboard.navigation.strapdown import ImuWindow

Fix = Any  # a record with t_valid_s: GpsFix, GpsRanges, StarFix, or a reading of an instrument
Agree = Callable[[integrity.Evidence, integrity.Evidence], bool]

# sigma of what is measured, or (3,) of each axis of some blocks, or the whole covariance
Admitted = float | dict[str, np.ndarray] | Grown


class Measurement(NamedTuple):
    """A measurement in the history of the filter."""

    sensor: str  # of SENSORS
    fix: Fix
    fate: integrity.Fate
    rows: np.ndarray | None = None  # (m,) bool, rows that are used; None: all
    admitted: Admitted | None = None  # what a reset adds; None: it forgets all of what is measured
    doubts: dict | None = None  # (size,) sigma of blocks that is added before it, `integrity_learnt`
    teaches: bool = True  # whether the learnt blocks take part
    grown: float = 1.0  # factor of the noise of its sensor, standard deviation


class Innovation(NamedTuple):
    """What a measurement says against the filter, at its instant."""

    z: np.ndarray  # (m,)
    H: np.ndarray  # (m, n)
    R: np.ndarray  # (m, m)
    S: np.ndarray  # (m, m) covariance of z
    nis: float  # z^T S^-1 z
    limit: float  # of it, at the gate


class Trial(NamedTuple):
    """What decides whether a sensor that contradicts the filter is believed after all."""

    rule: Release
    evidence: integrity.Evidence | None  # what is kept of the fix if it is rejected
    agree: Agree  # the earlier evidence with this
    steady: Agree | None = None  # the first with this; None: always
    still: Agree | None = None  # whether this, inside the gate, is off as the earlier was; None: never


class Linearise(Protocol):
    """How a measurement is linearised: the same rows at every call with one fix."""

    def __call__(self, nav, now: Moment, fix: Fix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """fusion.Filter, Moment, fix -> z (m,), H (m, n), R (m, m)"""


class MakeTrial(Protocol):
    """What a fix has to stand if it contradicts the filter."""

    def __call__(self, nav, now: Moment, z: np.ndarray, R: np.ndarray, fix: Fix) -> Trial:
        """fusion.Filter, Moment, z and R as linearised, fix -> Trial"""


class Sensor(NamedTuple):
    """One measurement."""

    linearise: Linearise
    block: str | None  # of the layout, which a reset forgets; None: it is never reset
    forgotten: float  # standard deviation that says nothing, in the units of the block
    trial: MakeTrial
    with_it: tuple[str, ...] = ()  # blocks that a reset takes back to what was known at the start
    rows: int = 0  # rows of a group, which is gated given the other groups (`integrity_rows`); 0: all are one
    labels: Callable[[Fix], list[str]] | None = None  # name of each group of rows, for notes
    reset_note: str = "reset after timeout"
    # (nav, S) -> whether one fix inside the gate is enough; None: always
    alone: Callable | None = None
    # (nav, now, fix) -> Health after it was used, in which it is there to confirm the next one
    confirmed: Callable | None = None
    # (nav, z) -> standard deviation of the error that a reset admits in the block and those with it, if it
    # explains the contradiction without forgetting everything; None: it does not
    admits: Callable | None = None
    # (nav, fix, R, gap_s) -> the noise with which a measurement that has passed the gate counts; None: R
    counted: Callable | None = None
    # (nav, t_s, x, fix) -> why it is not to be used where packed values x are, '' if it may; None: always
    unfit: Callable | None = None
    apart: Callable | None = None  # (nav, now, fix) -> aid.Linearised of an instrument; None: it is none
    gate_probability: float | None = None  # that a healthy one is rejected; None: of the scenario


def never(nav, now, z, R, fix):
    """Trial of a sensor that is never believed against the gate."""
    return Trial(Release(rejections=np.inf, duration=np.inf), None, None)


class Interval(NamedTuple):
    """For a recorder: prediction over a tick, or over a part of it between measurements."""

    t_begin_s: float
    t_end_s: float
    state: NavState  # at the beginning, and its covariance
    P: np.ndarray  # (n, n)
    Phi: np.ndarray  # (n, n)
    Q: np.ndarray  # (n, n)
    state_after: NavState
    P_after: np.ndarray  # (n, n)
    imu: ImuWindow  # of the tick


class Correction(NamedTuple):
    """For a recorder: one update. What is not used is not recorded, but for what it makes doubtful.

    A DOUBTED measurement has no rows, and P_after is P_forgotten.
    """

    t_s: float  # of the state; the fix's, but for rounding
    sensor: str
    fix: Fix
    fate: Fate  # USED, RESET or DOUBTED
    state: NavState  # before
    P: np.ndarray  # (n, n) before
    P_forgotten: np.ndarray  # (n, n) the same after a reset forgot or doubt added; P where there was neither
    z: np.ndarray  # (m,) rows used
    H: np.ndarray  # (m, n)
    R: np.ndarray  # (m, m)
    dx: np.ndarray  # (n,) taken into the state
    G: np.ndarray  # (3, 3) attitude error -> attitude error in the new body axes
    state_after: NavState
    P_after: np.ndarray  # (n, n)
    cut: tuple = ()  # slices of the blocks that were forgotten with all their ties to others
