"""How fast the camera turns by its own attitudes, where the gyros say too fast for any.

A gyro that is suddenly off by more than the highest rate would take the stars from the filter at the instant
at which they alone show that it is wrong. Stars that were identified in two frames, one soon after the other,
and have turned far less than the gyros say, are believed: two frames are not mistaken for the same wrong sky.
The gyros have to say too fast at both, for a camera that has just begun to turn has not turned much. The
filter then has fixes that contradict its gyros, and finds out which of them it is.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.rotation import rotvec_between

LONGEST_S = 1.5  # [E] between two frames, in which a camera does not turn there and back
LESS = 0.5  # [E] of the rate of the gyros, below which the stars contradict it


class Seen(NamedTuple):
    """The attitude of a frame, whether it was given out or not."""

    t_valid_s: float
    rate: float  # rad/s, by the gyros; NaN: not known
    q_ic: np.ndarray  # (4,), NaN: none


NOTHING = Seen(np.nan, np.nan, np.full(4, np.nan))


def is_fast(highest, before, now):
    """Whether a frame was taken while the camera turned too fast; not if its rate is not known.

    highest : rad/s, for which the tracker is made
    before, now : Seen of the last attitude and of the frame
    """
    if not now.rate > highest:
        return False
    since_s, least = now.t_valid_s - before.t_valid_s, min(before.rate, now.rate)
    if not (0.0 < since_s <= LONGEST_S and least > highest) or np.isnan(now.q_ic[0]):
        return True
    turned = np.linalg.norm(rotvec_between(before.q_ic, now.q_ic))
    return bool(turned >= since_s * min(highest, LESS * least))
