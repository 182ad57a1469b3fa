"""What is required of all flights, and whether it is met: in plain words, with the numbers."""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, poisson

from shefex_nav.verify.robustness import cells
from shefex_nav.verify.robustness.factors import CONSTANT, RIGHT, SHOWS
from shefex_nav.verify.robustness.happenings import HAPPENS

HOUR_S = 3600.0
POISSON = 0.99
MOST_OF_CONSTANTS = 1e-3  # of usable time
NEES = 5.0, 15.0
ENOUGH = 9  # flights, from which on the mean of a cell is held to `NEES`
CHANCE = 1e-3  # with fewer: probability that a consistent filter's mean is outside
NOISES = 0.3, 3.0  # told over true, between which the upper limit of the NEES holds
ALARMS = (  # key of the flight, name, what is required
    (
        "late_s",
        "alarm",
        "a detectable fault is followed by 'do not use' within 1 s of the later of: it can be noticed, the "
        "error exceeds its level",
    ),
    (
        "wrong_words",
        "reason",
        "the reason that is given then is the sensor that failed; or any, where the twin is withdrawn too "
        "and both levels are too high, or the twin errs beyond the same level",
    ),
)
KNOWN_DEG = 5.0  # sigma of the attitude; what is less known has no normal error


class Judged(NamedTuple):
    """One requirement."""

    name: str
    words: str  # what is required
    found: str  # what was found
    good: bool | None  # None: nothing was flown that it is about


def judge(records):
    """list of Judged of all flights that have been flown."""
    flown = [record for record in records if "failed" not in record]
    found = [_flown(records), *_alarms(flown)]
    for name in quantities(flown):
        found += [_misleading(flown, name), _constants(flown, name)]
    return [*found, _nees_right(flown), _nees_noises(flown)]


def in_short(judged):
    """How many of all are met, in words: those about which nothing was flown are neither."""
    bad, good, none = (sum(one.good is state for one in judged) for state in (False, True, None))
    number, met = (bad, "not met") if bad else (good, "met")
    of_all = f"all {good}" if good == len(judged) else f"{number} of {len(judged)}"
    more = f", {none} {'was' if none == 1 else 'were'} not flown" if none else ""
    return f"{of_all} requirements {'is' if number == 1 else 'are'} {met}{more}"


def counted(number, word):
    """`1 flight`, `2 flights`."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def quantities(flown):
    """Names of what has a protection level, in order."""
    return list(dict.fromkeys(name for record in flown for name in record["quantities"]))


def _flown(records):
    bad = [record for record in records if "failed" in record]
    words = f"{len(records) - len(bad)} of {len(records)}"
    if bad:
        words += f"; cell {bad[0]['cell']}, flight {bad[0]['flight']}: {bad[0]['failed']}"
    return Judged("flown", "every flight comes to its end", words, not bad if records else None)


def _alarms(flown):
    """Detectable faults: in time, by the right words."""
    faults = [record for record in flown if record["fault"]]
    found = []
    for key, name, words in ALARMS:
        bad = [one for one in faults if any(alarm[key] for alarm in one["fault"]["alarm"].values())]
        met = sum(any(alarm["beyond_s"] for alarm in one["fault"]["alarm"].values()) for one in faults)
        kinds = cells.grouped(bad, "told_kind")
        of_kinds = "; ".join(f"{len(several)} told {kind}" for (kind,), several in sorted(kinds.items()))
        words_found = (
            f"{len(bad)} of {counted(len(faults), 'flight')} with a fault failed ({met} had errors beyond a "
            f"level); {of_kinds}; {_where(bad)}"
        ).rstrip("; ")
        found.append(Judged(name, words, words_found, not bad if faults else None))
    return found


def _where(bad, most=8):
    """Cells of flights, those with the most first."""
    numbers = sorted(cells.grouped(bad, "cell").items(), key=lambda item: -len(item[1]))
    shown = [f"cell {number}: {len(several)}" for (number,), several in numbers[:most]]
    left = len(numbers) - most
    more = [f"and {counted(left, 'cell')} more"] if left > 0 else []
    return ", ".join(shown + more)


def _misleading(flown, name):
    chosen = [record for record in flown if record["told_kind"] in (RIGHT, SHOWS)]
    sums = [cells.healthy(record)["quantities"][name] for record in chosen]
    usable_s = sum(one["usable_s"] for one in sums)
    times, seconds = (sum(one[key] for one in sums) for key in ("misleading_times", "misleading_s"))
    expected = sum(
        record["risk"] / HOUR_S * one["usable_s"] for record, one in zip(chosen, sums, strict=True)
    )
    most = int(poisson.ppf(POISSON, expected)) if expected else 0
    bad = [record for record, one in zip(chosen, sums, strict=True) if one["misleading_times"]]
    flights = counted(len(chosen), "flight")
    return Judged(
        f"misleading {name}",
        "nothing happens, told rightly or noise within a factor of two: misleads no oftener than the stated "
        "risk allows (99 % Poisson)",
        f"{counted(times, 'time')}, {seconds:.1f} s, in {usable_s:.0f} s of {flights}; allowed {most}; "
        f"{_where(bad)}".rstrip("; "),
        times <= most if usable_s else None,
    )


def _constants(flown, name):
    chosen = [record for record in flown if record["told_kind"] == CONSTANT]
    sums = [cells.healthy(record)["quantities"][name] for record in chosen]
    usable_s, seconds = (sum(one[key] for one in sums) for key in ("usable_s", "misleading_s"))
    bad = [record for record, one in zip(chosen, sums, strict=True) if one["misleading_times"]]
    flights = counted(len(chosen), "flight")
    return Judged(
        f"constants {name}",
        "nothing happens, constants told wrongly by up to two: misleads for at most 0.001 of the usable time",
        f"{seconds:.1f} s of {usable_s:.0f} s in {flights}; {_where(bad)}".rstrip("; "),
        seconds <= MOST_OF_CONSTANTS * usable_s if usable_s else None,
    )


def _nees_right(flown):
    chosen = [record for record in flown if record["told_kind"] == RIGHT]
    outside, number = [], 0
    for cell, several in _together(chosen).items():
        ends = [cells.healthy(record) for record in several]
        known = [one["nees_end"] for one in ends if (one["sigma_deg"] or np.inf) < KNOWN_DEG]
        unknown = [one["nees_end"] for one in ends if (one["sigma_deg"] or np.inf) >= KNOWN_DEG]
        number += 1
        if lost := sum(value is None for value in (*known, *unknown)):
            outside.append(f"{cell}: no number in {lost} of {len(several)}")
            continue
        for values, bounded in ((known, True), (unknown, False)):
            mean, (low, high) = _mean(values), _bounds(len(values))
            if mean is not None and not (low if bounded else 0.0) <= mean <= high:
                outside.append(f"{cell}: {mean:.1f} of {len(values)}")
    words = (
        "nothing happens, all told rightly: mean NEES of 9 degrees of freedom at the end 5 to 15 in each "
        "cell (at most 15 where the attitude is known to 5 deg or worse); with fewer than nine flights, in "
        "the 99.9 % interval of chi-square"
    )
    return Judged("NEES told rightly", words, _outside(outside, number), not outside if number else None)


def _nees_noises(flown):
    low, high = NOISES
    chosen = [record for record in flown if low <= record["noise_told"] <= high and _about_noise(record)]
    outside, number = [], 0
    for cell, several in _together(chosen).items():
        mean = _mean([cells.healthy(record)["nees_usable"] for record in several])
        number += mean is not None
        if mean is not None and mean > NEES[1]:
            outside.append(f"{cell}: {mean:.1f}")
    words = (
        "nothing happens, noises told 0.3 to 3 times: mean NEES while usable after 100 innovations at most 15"
    )
    return Judged("NEES noises", words, _outside(outside, number), not outside if number else None)


def _bounds(count):
    """What the mean NEES of so many flights may be: of few, whatever chance does to a consistent filter."""
    if count >= ENOUGH or not count:
        return NEES
    low, high = chi2.ppf([0.5 * CHANCE, 1.0 - 0.5 * CHANCE], 9 * count) / count
    return min(low, NEES[0]), max(high, NEES[1])


def _together(chosen):
    """Flights whose NEES is averaged: those of a cell; of random faults, which have no cells, of a rocket."""
    found = {}
    for record in chosen:
        of_cell = record["happens"] in HAPPENS
        found.setdefault(f"cell {record['cell']}" if of_cell else record["rocket"], []).append(record)
    return found


def _about_noise(record):
    return record["told_kind"] in (RIGHT, SHOWS) or record["noise_told"] != 1.0


def _mean(values):
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _outside(outside, number, most=8):
    more = [f"and {len(outside) - most} more"] if len(outside) > most else []
    means = f"{len(outside)} of {counted(number, 'mean')} outside"
    return f"{means}; {', '.join(outside[:most] + more)}".rstrip("; ")


def undetectable(records):
    """What misled and could not be noticed: list of dict, what, rocket, phase, told, flights, seconds."""
    found = {}
    for record in records:
        if "failed" in record or not record["fault"]:
            continue
        for name, alarm in record["fault"]["alarm"].items():
            if alarm["undetected_s"] > 0.0:
                what = " + ".join(row["what"] for row in record["fault"]["detectable"])
                place = what, name, record["rocket"], record["grade"], record["phase"], record["told"]
                found.setdefault(place, []).append(alarm["undetected_s"])
    names = "what", "quantity", "rocket", "grade", "phase", "told"
    rows = [
        dict(zip(names, place, strict=True)) | {"flights": len(seconds), "seconds": round(sum(seconds), 1)}
        for place, seconds in found.items()
    ]
    return sorted(rows, key=lambda row: -row["seconds"])
