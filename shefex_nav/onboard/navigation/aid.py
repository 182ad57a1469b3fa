"""What an instrument gives the filter, beside GPS and stars: `aiding` makes a sensor of it.

Apart from that, so that an instrument can be described without a compiler.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.onboard.navigation.blocks import Block

__all__ = ["Aid", "Block", "Linearised", "Renewal"]


class Linearised(NamedTuple):
    """What a reading says about the errors: z = H dx + noise."""

    z: np.ndarray  # (m,) reading less what was expected
    H: np.ndarray  # (m, n)
    R: np.ndarray  # (m, m) noise of this reading alone
    lasting: tuple = ()  # of (covariance (m, m), s for which it lasts): errors that readings share


class Renewal(NamedTuple):
    """When readings that contradict the filter are believed, and what that costs."""

    block: str  # of which nothing is known then
    forgotten: float  # standard deviation that says nothing, in its units
    rejections: int  # one after the other, that agree
    duration_s: float  # from the first to the last of them
    note: str  # for the log, 'new bias'


class DriftRule(NamedTuple):
    """How an instrument is watched that may drift, `integrity_drift`."""

    chance: float  # of one healthy reading being called a drift
    fastest: float  # that a drift may be, in the unit of its readings a second
    unit: str  # of its readings
    # reading -> second derivative by what is measured, over the square of the first; None: it is linear
    bend: Callable[[Any], float] | None = None


class Aid(NamedTuple):
    """An instrument, as the filter uses it."""

    name: str
    record: type  # of its readings
    expect: Callable[[Any, Any], Linearised]  # aiding.Here, reading
    blocks: tuple[Block, ...] = ()  # states that it brings along
    holds: Callable[[Any], bool] | None = None  # whether a reading measures anything; None: each does
    unfit: Callable[[Any, Any], str] | None = None  # why a reading is not to be used; '' if it may
    renewal: Renewal | None = None  # None: it is never believed against the filter
    sees_attitude: bool = True  # but for errors that last
    gate_probability: float | None = None  # that a healthy reading is rejected; None: of the scenario
    drift: DriftRule | None = None  # of readings of one number; None: it is not watched for drifts
