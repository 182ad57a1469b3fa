"""Fewer records of a long run: the steady ones at a lower rate, everything else as it comes.

Truth, IMU and solution come at every tick of the on-board clock and fill gigabytes within hours. Thinned
are what is written and what is kept in memory, never what the on-board computer gets.
"""

from shefex_nav.clock import TICK_HZ
from shefex_nav.records import ImuBlock, NavSolution, TruthSample

LOWEST_HZ = 10  # as the covariance comes, so that its times are always among those of the solution
_AT_EVERY_TICK = {TruthSample: "t_s", ImuBlock: "t_valid_s", NavSolution: "t_s"}  # and their time


def earliest_end(start_s):
    """Mission time [s] by which every log has a record of each kind that comes at a steady rate."""
    return start_s + 1.0 / LOWEST_HZ


def ticks(rate_hz):
    """Ticks from one record to the next; ValueError for another rate than 10, 20, 50 or 100 Hz."""
    every = round(TICK_HZ / rate_hz)
    if every * rate_hz != TICK_HZ or every > TICK_HZ // LOWEST_HZ:
        raise ValueError(f"a log has 10, 20, 50 or 100 samples a second, not {rate_hz:g}")
    return every


def stays(record, every, start_s):
    """Whether a record stays; ticks are counted from start_s, as those of the covariance are."""
    time = _AT_EVERY_TICK.get(type(record))
    return time is None or round((getattr(record, time) - start_s) * TICK_HZ) % every == 0


def thinned(records, rate_hz, start_s):
    """The records without those of truth, IMU and solution that `rate_hz` has no room for. Yields records."""
    every = ticks(rate_hz)
    if every == 1:
        yield from records
        return
    for record in records:
        if stays(record, every, start_s):
            yield record
