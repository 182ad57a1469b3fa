"""Whether the navigation knew when not to be trusted: protection levels, doubts and what was noticed.

Definitions
-----------
- The solution is usable where it does not say `do_not_use`.
- It is misleading where it is usable although the attitude error about an axis exceeds the protection level:
  a protection level that never does is no proof, one that does is wrong.
- Entry is that of `metrics`. What was noticed is listed from when it was to when it was over, None if never.
"""

import math
from collections import Counter

import numpy as np

from shefex_nav.records import Doubt
from shefex_nav.report.pairing import same_times


def trust(data, errors, entry_s):
    """Figures of a RunData: dict of numbers and texts; None for a log that has no protection levels.

    errors : metrics.NavErrors;  entry_s : mission time, None without an entry
    """
    nav = data.nav
    if not len(nav.t_s) or not np.isfinite(nav.protection_b).any():
        return None
    i, j = same_times(errors.t_s, nav.t_s)
    usable = ~nav.do_not_use[j]
    wrong = (np.abs(errors.attitude_b[i]) > nav.protection_b[j]).any(axis=1)
    doubts = Counter(nav.doubt[nav.do_not_use].tolist())
    n = len(nav.t_s)
    return {
        "usable_share": float(np.mean(~nav.do_not_use)),
        "doubts": {Doubt(k).name.lower(): count / n for k, count in sorted(doubts.items())},
        "misleading_share": float(np.mean(wrong & usable)) if len(j) else math.nan,
        "at_entry": _at(nav, entry_s),
        "noticed": noticed(data.health),
    }


def _at(nav, t_s):
    """Protection level and doubt at a mission time."""
    if t_s is None:
        return None
    k = int(np.argmin(np.abs(nav.t_s - t_s)))
    return {
        "usable": not bool(nav.do_not_use[k]),
        "doubt": Doubt(int(nav.doubt[k])).name.lower(),
        "protection_deg": np.degrees(nav.protection_b[k]).tolist(),
    }


def noticed(health):
    """What was wrong with which sensor, and for how long: list of dicts, by time. list of NavHealth."""
    found, open_ = [], {}
    for record in health:
        if record.source in open_:
            open_.pop(record.source)["until_s"] = record.t_s
        if not record.healthy:
            entry = {
                "source": record.source, "from_s": record.t_s, "until_s": None, "reason": record.reason
            }  # fmt: skip
            found.append(entry)
            open_[record.source] = entry
    return found
