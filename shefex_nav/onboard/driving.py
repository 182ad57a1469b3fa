"""The one loop in which a filter without camera hears a flight: replays, studies and benchmarks use it."""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.onboard.computer import predict_filter, update_filter
from shefex_nav.onboard.telemetry import RECORDS


def arrivals(records, ends_s):
    """When records arrive: what stands behind one that is not available yet waits with it.

    records with t_available_s, in the order in which they come; (N,) s, ends of ticks
    -> {tick, counted from 0: list of records}
    """
    available_s = np.maximum.accumulate([one.t_available_s for one in records])
    due = {}
    for tick, one in zip(np.searchsorted(ends_s + SAME_S, available_s).tolist(), records, strict=True):
        due.setdefault(tick, []).append(one)
    return due


def drive(nav, blocks, received, star_fixes, telemetry=RECORDS):
    """Run a filter over IMU blocks and over what arrives.

    Parameters
    ----------
    nav : fusion.Filter, of which the first block is the next
    blocks : ImuBlock of arrays over N
    received, star_fixes : of `arrivals`: GpsFix, GpsRanges and readings of instruments; StarFix
    telemetry : who is told of the ticks, such as `telemetry.Records`

    Yields
    ------
    k : int, tick that has been made, counted from 0, in order: each tick if the telemetry hands over records,
        else those at which something arrives, and some between them
    arrived : list of records, what came then
    outputs : list of GateResult and NavHealth, then what the telemetry hands over
    """
    n, end = 0, len(blocks.t_valid_s)
    for k in sorted({k for k in (*received, *star_fixes, end - 1) if 0 <= k < end}):
        while n <= k:
            done, passed = predict_filter(nav, n, blocks, n, k + 1, telemetry)
            for tick, outputs in passed:
                yield tick - 1, [], outputs
            n += done
            heard, fixes = (due.get(n - 1, []) for due in (received, star_fixes))
            yield n - 1, [*heard, *fixes], update_filter(nav, n, heard, fixes, telemetry)
