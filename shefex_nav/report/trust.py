"""Whether the navigation knew when not to be trusted: protection levels, doubts and what was noticed.

Definitions
-----------
- Position, velocity and attitude are each usable where the solution does not say `do_not_use` of it.
- One of them is misleading where it is usable although its error along an axis has been beyond the protection
  level for more than TIME_TO_ALERT_S: the whole of such a stretch counts, and each is one event. A protection
  level that is never exceeded is no proof, one that is is wrong.
- The axes are those of the levels: horizontal distance and height in the level plane of the true position,
  velocity against the Earth likewise, attitude about the body axes.
- A quantity that is usable at an instant without a level (software of a user's own) has no misleading share.
- Shares are of the instants with a solution, `usable_h` is in hours. `over_level` is the largest error over
  its level while usable, however short.
- The solution is usable where all three are, misleading where any is.
- Entry is that of `metrics`; a run without a solution at that instant has no figures of it.
- What was noticed is listed from when it was to when it was over, None if never.
"""

import math
from collections import Counter
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.records import QUANTITIES, Doubt, protected
from shefex_nav.report import doubts, local_level
from shefex_nav.report.configured import NOTHING
from shefex_nav.report.pairing import same_times, stretches

TIME_TO_ALERT_S = 1.0  # [E] an error that is over sooner has misled nobody
SHOWN = (("position", "m"), ("velocity", "m/s"), ("attitude", "deg"))
UNITS = {name: (unit.replace("/", "_"), factor) for name, (unit, factor) in doubts.UNITS.items()}


class Compared(NamedTuple):
    """Errors of one quantity beside its protection level, at the M ticks that have both."""

    t_s: np.ndarray  # (M,)
    error: np.ndarray  # (M, axes) sizes, m, m/s, rad
    level: np.ndarray  # (M, axes)
    usable: np.ndarray  # (M,) bool

    @property
    def over_level(self):
        """(M,) the largest error over its level."""
        return (self.error / self.level).max(axis=1)

    @property
    def has_all_levels(self):
        """Whether there is a level wherever it is usable."""
        return not np.isnan(self.level[self.usable]).any()


def has_levels(nav):
    """Whether a NavSolution of arrays has protection levels. Those of an older log are not numbers."""
    return bool(len(nav.t_s)) and bool(np.isfinite(nav.protection_attitude).any())


def axis_errors(data):
    """Sizes of the errors along the axes of the levels: t_s (N,), {quantity: (N, 2 or 3)}."""
    t_s, error = local_level.level_errors(data)
    i, j = same_times(data.truth.t_s, data.nav.t_s)
    attitude_b = rotvec_between(data.nav.q_ib[j], data.truth.q_ib[i])
    return t_s, {
        "position": np.column_stack([np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])]),
        "velocity": np.column_stack([np.hypot(error[:, 3], error[:, 4]), np.abs(error[:, 5])]),
        "attitude": np.abs(attitude_b),
    }


def compare(data):
    """{quantity: Compared} of a RunData."""
    t_s, errors = axis_errors(data)
    _, j = same_times(t_s, data.nav.t_s)
    found = {}
    for quantity in QUANTITIES:
        said = protected(data.nav, quantity)
        found[quantity] = Compared(t_s, errors[quantity], said.level[j], ~said.do_not_use[j])
    return found


def misleading(one):
    """Where a quantity is misleading, (M,) bool, and how many times it becomes so. Compared"""
    over = one.usable & (one.error > one.level).any(axis=1)
    marks, events = np.zeros(len(over), dtype=bool), 0
    for first, end in stretches(over):
        if one.t_s[end - 1] - one.t_s[first] > TIME_TO_ALERT_S + SAME_S:
            marks[first:end] = True
            events += 1
    return marks, events


def trust(data, entry_s, known=NOTHING):
    """Figures of a RunData: dict of numbers and texts; None for a log that has no protection levels.

    entry_s : mission time, None without an entry;  known : Configured of the run
    """
    nav = data.nav
    if not has_levels(nav):
        return None
    compared = compare(data)
    wrong = {quantity: misleading(one) for quantity, one in compared.items()}
    usable = np.logical_and.reduce([~protected(nav, quantity).do_not_use for quantity in QUANTITIES])
    limits = limits_of(known)
    found = {q: limits[q] | _of_quantity(nav, q, compared[q], *wrong[q], entry_s) for q in QUANTITIES}
    any_wrong = np.logical_or.reduce([marks for marks, _ in wrong.values()])
    entries = [one["at_entry"] for one in found.values()]
    return found | {
        "usable_share": float(np.mean(usable)),
        "misleading_share": _share(any_wrong, all(one.has_all_levels for one in compared.values())),
        "at_entry": None if None in entries else {"usable": all(one["usable"] for one in entries)},
        "noticed": noticed(data.health),
    }


def limits_of(known):
    """{quantity: {"limit_...", "limit_by_default"}} of a Configured; None where nothing says it."""
    found = {}
    for quantity in QUANTITIES:
        unit, factor = UNITS[quantity]
        limit = known.limits.get(quantity)
        found[quantity] = {
            f"limit_{unit}": None if limit is None else factor * limit,
            "limit_by_default": limit is not None and quantity not in known.given,
        }
    return found


def _share(marks, is_known):
    return float(np.mean(marks)) if len(marks) and is_known else math.nan


def _of_quantity(nav, quantity, one, marks, events, entry_s):
    """Figures of one quantity."""
    said, n = protected(nav, quantity), len(nav.t_s)
    found = Counter(said.doubt[said.do_not_use].tolist())
    step_s = float(np.median(np.diff(nav.t_s))) if n > 1 else 0.0
    return {
        "usable_share": float(np.mean(~said.do_not_use)),
        "usable_h": float(np.count_nonzero(one.usable)) * step_s / 3600.0,
        "doubts": {Doubt(k).name.lower(): count / n for k, count in sorted(found.items())},
        "misleading_share": _share(marks, one.has_all_levels),
        "misleading_events": events if len(marks) and one.has_all_levels else None,
        "over_level": float(one.over_level[one.usable].max()) if one.usable.any() else math.nan,
        "at_entry": _at(nav, quantity, entry_s),
    }


def _at(nav, quantity, t_s):
    """Protection level and doubt at a mission time; None without one, and without a solution then."""
    at = [] if t_s is None else np.flatnonzero(np.abs(nav.t_s - t_s) <= SAME_S)
    if not len(at):
        return None
    k, said = int(at[0]), protected(nav, quantity)
    unit, factor = UNITS[quantity]
    return {
        "usable": not bool(said.do_not_use[k]),
        "doubt": Doubt(int(said.doubt[k])).name.lower(),
        f"protection_{unit}": (factor * said.level[k]).tolist(),
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
