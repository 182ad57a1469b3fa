"""The scale of a curve that a few values would flatten."""

from typing import NamedTuple

import numpy as np

BETTER_PART = 95.0  # percent of the values that is always shown
FLATTENED = 3.0  # times the better part: what does not exceed it is shown too
ROOM = 1.3  # above the better part


class Cut(NamedTuple):
    """Where a scale from zero ends, and what lies above."""

    top: float
    count: int  # values above
    largest: float


def cut_about(known, shown):
    """Cut of a scale about zero by the values of a time in which they are known; None where all can be shown.

    known : (n,) values then;  shown : (m,) of the whole curve. The scale ends at FLATTENED times the better
    part of the former. Values that are not finite do not count.
    """
    known, shown = (np.abs(one[np.isfinite(one)]) for one in (np.ravel(known), np.ravel(shown)))
    if not len(known) or not len(shown):
        return None
    top, largest = FLATTENED * float(np.percentile(known, BETTER_PART)), float(shown.max())
    if top <= 0.0 or largest <= ROOM * top:
        return None
    return Cut(top, int(np.count_nonzero(shown > top)), largest)


def cut(values):
    """Cut of values of at least zero, (n,); None where all can be shown and the most are still to be seen.

    Values that are not finite do not count.
    """
    known = np.ravel(values)
    known = known[np.isfinite(known)]
    if not len(known):
        return None
    part, largest = float(np.percentile(known, BETTER_PART)), float(known.max())
    if part <= 0.0 or largest <= FLATTENED * part:
        return None
    top = ROOM * part
    return Cut(top, int(np.count_nonzero(known > top)), largest)
