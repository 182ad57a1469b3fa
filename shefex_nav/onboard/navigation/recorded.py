"""What a recorder of the filter is told: each step of prediction and each correction that is final."""

from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.sensor import Fix
from shefex_nav.onboard.navigation.state import NavState
from shefex_nav.onboard.navigation.strapdown import ImuWindow


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
