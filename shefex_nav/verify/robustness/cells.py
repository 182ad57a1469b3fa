"""Sums over the flights of a cell, and over those with one level: plain dicts."""

import numpy as np

from shefex_nav.verify.robustness import design


def healthy(record):
    """Figures of the flight in which nothing happens: its own, or those of its twin."""
    return record if record["twin"] is None else record["twin"]


def grouped(records, *names):
    """Flights by the values of some of their keys: dict, tuple -> list, in order."""
    found = {}
    for record in records:
        found.setdefault(tuple(record[name] for name in names), []).append(record)
    return found


def of_cell(records):
    """Figures of the flights of a cell, or of any others: dict."""
    flown = [record for record in records if "failed" not in record]
    faults = [record["fault"] for record in flown if record["fault"]]
    quantities = sorted({name for record in flown for name in record["quantities"]})
    again = [one["usable_again_s"] for one in faults if one["usable_again_s"] is not None]
    found = {"flights": len(records), "failed": len(records) - len(flown)}
    found["quantities"] = {name: _quantity(flown, name) for name in quantities}
    return found | {
        "nees_end": _spread([record["nees_end"] for record in flown]),
        "nees_healthy_end": _spread([healthy(record)["nees_end"] for record in flown]),
        "nees_healthy_usable": _spread([healthy(record)["nees_usable"] for record in flown]),
        "false_alarms": sum(len(healthy(record)["alarms"]) for record in flown),
        "others_blamed": sum(len(record["alarms"]) for record in flown if record["fault"]),
        "detectable": sum(all(row["t_s"] is not None for row in one["detectable"]) for one in faults),
        "faults": len(faults),
        "usable_again_s": _middle([value for value in again if value >= 0.0]),
        "never_usable_again": sum(value < 0.0 for value in again),
    }


def _quantity(flown, name):
    """Of one quantity in some flights: dict."""
    own = [record["quantities"][name] for record in flown]
    there = [healthy(record)["quantities"][name] for record in flown]
    alarms = [record["fault"]["alarm"][name] for record in flown if record["fault"]]
    after = [one["after_s"] for one in alarms if one["after_s"] is not None]
    return {
        "usable_s": sum(one["usable_s"] for one in own),
        "misleading_s": sum(one["misleading_s"] for one in own),
        "misleading_flights": sum(one["misleading_times"] > 0 for one in own),
        "largest_ratio": max((one["largest_ratio"] or np.inf for one in own if one["usable_s"]), default=0.0),
        "healthy_usable_s": sum(one["usable_s"] for one in there),
        "healthy_misleading_s": sum(one["misleading_s"] for one in there),
        "healthy_misleading_times": sum(one["misleading_times"] for one in there),
        "late_flights": sum(one["late_s"] > 0.0 for one in alarms),
        "late_s": sum(one["late_s"] for one in alarms),
        "wrong_words_flights": sum(one["wrong_words"] > 0 for one in alarms),
        "undetected_flights": sum(one["undetected_s"] > 0.0 for one in alarms),
        "undetected_s": sum(one["undetected_s"] for one in alarms),
        "alarm_s": {"median": _middle(after), "most": max(after, default=None), "flights": len(after)},
    }


def _spread(values):
    """Mean, standard deviation, 5th and 95th percentile of what there is: dict."""
    known = np.array([value for value in values if value is not None], dtype=float)
    if not len(known):
        return {"mean": None, "sd": None, "p5": None, "p95": None, "flights": 0}
    low, high = np.percentile(known, [5.0, 95.0])
    spread = float(known.std(ddof=1)) if len(known) > 1 else None
    numbers = {"mean": float(known.mean()), "sd": spread, "p5": float(low), "p95": float(high)}
    return numbers | {"flights": len(known)}


def _middle(values):
    return float(np.median(values)) if values else None


def table(records):
    """Cells in the order of their numbers: list of (dict of levels, figures)."""
    found = []
    for (number, _), several in sorted(grouped(records, "cell", "rocket").items()):
        levels = {"cell": number} | {name: several[0][name] for name in design.FACTORS}
        found.append((levels, of_cell(several)))
    return found


def badness(figures):
    """Sort key of a cell, the worst largest: flights that misled with a detectable fault, then at all."""
    sums = figures["quantities"].values()
    late = sum(one["late_flights"] + one["wrong_words_flights"] for one in sums)
    misled = sum(one["misleading_s"] for one in sums)
    ratio = max((one["largest_ratio"] for one in sums), default=0.0)
    nees = figures["nees_healthy_end"]["mean"] or 0.0
    return figures["failed"] > 0, late, misled, ratio, nees
