"""What is drawn of a series of samples: those that a curve needs, where it is interrupted, and where
its scale ends if a few values would flatten it.
"""

from typing import NamedTuple

import numpy as np

MOST_POINTS = 1200  # of a curve over the whole width, about: one for each dot of a screen
_GAP = 8.0  # times the usual step is a gap
_BESIDE = 5  # steps on each side of one that say what is usual there
BETTER_PART = 95.0  # percent of the values that is always shown
FLATTENED = 3.0  # times the better part: what does not exceed it is shown too
ROOM = 1.3  # above the better part


def envelope(values, most=MOST_POINTS):
    """Indices of the samples that a curve needs: the least and the largest of every stretch, the two ends.

    A curve through them covers what that through all samples covers, at a resolution of most / 2 stretches;
    averages would flatter. The first NaN of every gap is kept. (n,) -> (m,) ascending; all where n is small.
    """
    n = len(values)
    if n <= most:
        return np.arange(n)
    stretch = -(-n // (most // 2))
    full = n // stretch * stretch
    blocks = np.asarray(values[:full], dtype=float).reshape(-1, stretch)
    known = np.isfinite(blocks)
    least = np.argmin(np.where(known, blocks, np.inf), axis=1)
    largest = np.argmax(np.where(known, blocks, -np.inf), axis=1)
    first = np.arange(len(blocks)) * stretch
    unknown = ~np.isfinite(np.asarray(values, dtype=float))
    gaps = np.flatnonzero(unknown[1:] & ~unknown[:-1]) + 1  # one sample keeps a gap open
    rest = np.asarray(values[full:], dtype=float)
    tail = [full + int(f(rest)) for f in (np.argmin, np.argmax)] if len(rest) else []
    return np.unique(np.concatenate([[0, n - 1], first + least, first + largest, gaps, tail]).astype(int))


def gapped(t_s, *values):
    """The same series with a NaN wherever the time leaps, so that no line is drawn across.

    A leap is long beside the steps before it and beside those after it: where samples come less often from
    some time on there is none.
    """
    steps = np.diff(np.asarray(t_s, dtype=float))
    later = np.flatnonzero(steps > 0.0)  # of the instants: some records have one in common
    leaps = later[_leaps(steps[later])] + 1
    return tuple(np.insert(np.asarray(v, dtype=float), leaps, np.nan) for v in (t_s, *values))


def _leaps(steps):
    """Which of some steps of time, (n,) s above zero, are leaps: indices."""
    if len(steps) < 2:
        return np.zeros(0, dtype=int)
    long = np.flatnonzero(steps > _GAP * steps.min())
    beside = np.pad(steps, _BESIDE, constant_values=np.nan)
    usual = np.zeros(len(long))
    for first in (0, _BESIDE + 1):  # of the steps before, of those after
        side = beside[long[:, None] + first + np.arange(_BESIDE)]
        known = np.isfinite(side).any(axis=1)
        usual[known] = np.maximum(usual[known], np.nanmedian(side[known], axis=1))
    return long[steps[long] > _GAP * usual]


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
