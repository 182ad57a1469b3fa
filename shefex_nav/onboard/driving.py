"""The one loop in which software on board flies: missions, replays, studies and benchmarks use it.

    for k, arrived, outputs in drive(software, blocks, arrivals):
        ...

`software` is whatever has `advance` and `update` (`Software`): the computer with its star tracker, or the
navigation alone. `arrivals` says what comes when: `Recorded` where it is known beforehand; in a mission
pictures depend on what the software has commanded (`simulate.Link`).
"""

from bisect import bisect_right
from typing import Protocol

import numpy as np

from shefex_nav.clock import SAME_S


class Software(Protocol):
    """What flies on board, as the loop sees it."""

    def advance(self, blocks, first, last):
        """On with IMU samples, up to the first tick at which the software itself has something to do.

        blocks : ImuBlock of arrays, of which rows first ... last - 1 are meant; nothing arrives at the ticks
            before the last
        -> number of ticks made, at least one; list of (k, records), output of the ticks k (rows of blocks)
        before the last one made
        """

    def update(self, arrived):
        """What is done at the tick that has been reached, with the records that arrive at it.

        -> list of records, the output of the tick
        """

    def close(self):
        """There are no more ticks."""


class Arrivals(Protocol):
    """What comes to the software; ticks are counted from 1, tick n is the one of row n - 1."""

    def next_tick(self, n):
        """The first tick after n at which something may come; inf without."""

    def at(self, n):
        """List of records that come at tick n, asked for once, after what the ticks before it put out."""


class Recorded:
    """Arrivals that are known beforehand.

    ends_s : (N,) s, ends of the ticks
    lists : of records with t_available_s, each in the order in which they come: what stands behind one that
        is not available yet waits with it. At one tick those of the first list come first
    stops : ticks at which the loop stops although nothing comes
    """

    def __init__(self, ends_s, *lists, stops=()):
        self._due = [_by_tick(ends_s, records) for records in lists]
        self._busy = sorted({*stops, *(n for due in self._due for n in due)})

    def next_tick(self, n):
        """As of Arrivals."""
        k = bisect_right(self._busy, n)
        return self._busy[k] if k < len(self._busy) else np.inf

    def at(self, n):
        """As of Arrivals; may be asked for again."""
        return [one for due in self._due for one in due.get(n, ())]


def _by_tick(ends_s, records):
    """{tick: list of records}."""
    available_s = np.maximum.accumulate([one.t_available_s for one in records])
    due = {}
    for k, one in zip(np.searchsorted(ends_s + SAME_S, available_s).tolist(), records, strict=True):
        due.setdefault(k + 1, []).append(one)
    return due


def drive(software, blocks, arrivals, ticks=None, done=0, closes=True):
    """Run software over IMU blocks and over what arrives.

    Parameters
    ----------
    software : Software, of which the first block is the next
    blocks : ImuBlock of arrays over N
    arrivals : Arrivals
    ticks : number of the last one; None: N
    done : ticks that have been made before
    closes : False if more ticks are to come after the last one

    Yields
    ------
    k : int, row of the blocks whose tick has been made, in order: every tick if the software puts out
        records of it, else those at which something arrives, and some between them
    arrived : list of records, what came then
    outputs : list of records
    """
    n, end = done, len(blocks.t_valid_s) if ticks is None else ticks
    try:
        while n < end:
            made, passed = software.advance(blocks, n, min(end, arrivals.next_tick(n)))
            for k, outputs in passed:
                yield k, [], outputs
            n += made
            arrived = arrivals.at(n)
            yield n - 1, arrived, software.update(arrived)
    finally:
        if closes:
            software.close()
