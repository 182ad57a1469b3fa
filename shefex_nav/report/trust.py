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
from shefex_nav.report import local_level
from shefex_nav.report.configured import NOTHING
from shefex_nav.report.pairing import same_times, stretches
from shefex_nav.report.sizes import number

TIME_TO_ALERT_S = 1.0  # [E] an error that is over sooner has misled nobody
SELDOM = 0.05  # share of the time; usable for less is hardly usable
DOUBTS = {
    Doubt.LEVEL: "protection level above {limit}",
    Doubt.CONTRADICTED: "contradicted by a sensor",
    Doubt.IMU: "the IMU does not measure the motion",
    Doubt.SOFTWARE: "the navigation software says so",
}
SHOWN = {"position": ("m", 1.0), "velocity": ("m/s", 1.0), "attitude": ("deg", math.degrees(1.0))}  # of SI
UNITS = {name: (unit.replace("/", "_"), factor) for name, (unit, factor) in SHOWN.items()}


def doubt_words(doubt, quantity, limit=None, by_default=False):
    """A Doubt about a quantity, for people.

    limit : of its protection level, m, m/s or deg; None: not known
    by_default : whether the scenario says nothing of it
    """
    return DOUBTS.get(doubt, Doubt(doubt).name.lower()).format(
        limit=_limit_words(quantity, limit, by_default)
    )


def doubt_of(quantity, name, one):
    """The Doubt of a name about a quantity, for people. one : of the quantity, in the summary's integrity"""
    limit = one.get(f"limit_{UNITS[quantity][0]}")
    return doubt_words(Doubt[name.upper()], quantity, limit, one.get("limit_by_default", False))


def _limit_words(quantity, limit, by_default):
    key = f"requirements.{quantity}.limit"
    if limit is None:
        return key
    return f"{limit:.4g} {SHOWN[quantity][0]} ({key}{', by default' if by_default else ''})"


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


def vouched(summary, judged):
    """(quantity, sentence) of each quantity with a met requirement that is not usable when it counts.

    summary : of `metrics.summarise`;  judged : of requirements.Judged. Both are true: the truth says how
    large an error is, the computer on board what it can vouch for. A protection level is so many sigmas as
    the integrity risk asks, and what a fault that nobody has noticed may add (decision 0014).
    """
    nav = summary["navigation"]
    if nav["integrity"] is None:
        return
    met = {one.name for one in judged if one.passed and one.found is not None}
    for quantity in QUANTITIES:
        one = nav["integrity"][quantity]
        entry = one["at_entry"] if f"{quantity}_at_entry" in met else None
        if entry is not None and not entry["usable"]:
            yield quantity, _vouched(quantity, one, entry, nav["at_entry"])
        elif one["usable_share"] < SELDOM and met & {f"{quantity}_at_entry", f"{quantity}_while_pointing"}:
            yield quantity, _vouched(quantity, one)


def _vouched(quantity, one, entry=None, errors=None):
    """one, entry : of the integrity, the latter where it is not usable then;  errors : at entry"""
    name = entry["doubt"] if entry else max(one["doubts"], key=one["doubts"].get)
    why = doubt_of(quantity, name, one)
    when = "At entry" if entry else f"For {100.0 * one['doubts'][name]:.1f} % of the time"
    said = f"both are true: the error was small, but the computer on board cannot vouch for it. {when}: {why}"
    if name != Doubt.LEVEL.name.lower():
        return said
    size = _level_at_entry(quantity, entry, errors) if entry else ""
    return (
        f"{said}{size}. A level is as many sigmas as requirements.integrity_risk asks, and what an unnoticed "
        f"fault may add: make sigma smaller, or requirements.{quantity}.limit larger"
    )


def _level_at_entry(quantity, entry, errors):
    """The largest protection level at entry, and of an attitude the largest sigma beside it."""
    levels, unit = entry[f"protection_{UNITS[quantity][0]}"], SHOWN[quantity][0]
    if None in levels:
        return ""
    sigmas = errors["attitude_sigma_deg"] if quantity == "attitude" else None
    beside = f", with a sigma of {number(max(sigmas), 3, unit)}" if sigmas else ""
    return f": {number(max(levels), 3, unit)}{beside}"
