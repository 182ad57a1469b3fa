"""All combinations of some settings, flown with the same seeds: `shefex-nav campaign --sweep KEY=A,B,C`.

The runs of all combinations draw the same, so they are compared in pairs like any two campaigns.
"""

import re
from itertools import product
from pathlib import Path
from typing import NamedTuple

from shefex_nav.campaign import plan as planning
from shefex_nav.campaign.compare import comparison, paired, parts, sides
from shefex_nav.campaign.compare.flying import DIGITS, Flight
from shefex_nav.campaign.compare.given import CAMPAIGN, CompareError
from shefex_nav.campaign.parts import Part
from shefex_nav.scenario import instruments, load
from shefex_nav.scenario.use import USE

SHOWN = tuple(  # of `quantities`: the first that there is
    (f"{quantity} at entry", f"{quantity}, rms of the run")
    for quantity in ("position", "velocity", "attitude")
)
_APART = re.compile(r",(?![^\[{(]*[\]})])")  # a comma that is in no bracket


class Axis(NamedTuple):
    """A setting and its values, as `--set` takes them."""

    key: str
    values: tuple


def axis(text):
    """Axis of KEY=A,B,C; CompareError. `imu=stim300,adis16505` means instruments: imu.use."""
    key, equals, given = text.partition("=")
    values = tuple(value.strip() for value in _APART.split(given))
    if not equals or not key.strip() or not all(values):
        raise CompareError(f"--sweep {text}: expected KEY=A,B,C, such as imu=stim300,adis16505_1")
    twice = [value for value in values if values.count(value) > 1]
    if twice or len(values) < 2:
        what = f"{twice[0]} stands there twice" if twice else "there is one value"
        raise CompareError(f"--sweep {text}: {what}; expected two or more that differ")
    key = key.strip()
    return Axis(f"{key}.{USE}" if tuple(key.split(".")) in instruments.SECTIONS else key, values)


def planned(scenario, axes, overrides, out):
    """(Flight, settings) of each combination: list; ScenarioError, CompareError. Nothing is written.

    scenario : as `load` takes it;  axes : list of Axis;  out : Path of the folder for all
    settings : {key: value}
    """
    keys = [one.key for one in axes]
    if twice := [key for key in keys if keys.count(key) > 1]:
        raise CompareError(f"--sweep {twice[0]}: is given twice; give all its values at once")
    combined = [dict(zip(keys, values, strict=True)) for values in product(*(one.values for one in axes))]
    if len(combined) > len(sides.LETTERS):
        raise CompareError(f"--sweep: {len(combined)} combinations; expected {len(sides.LETTERS)} at most")
    found = []
    for settings in combined:
        loaded = load.load(scenario, (*overrides, *(f"{key}={value}" for key, value in settings.items())))
        label = ", ".join(f"{key} {value}" for key, value in settings.items())
        found.append((Flight(loaded, label, out / _folder(loaded, settings)), settings))
    return found


def _folder(scenario, settings):
    """Name of the folder of a combination: its values, and a digest of the whole scenario."""
    words = re.sub(r"[^\w.]+", "-", "_".join(settings.values())).strip("-.")
    return Path(f"{words[:60]}-{planning.digest(scenario.source)[:DIGITS]}")


def compared(flights):
    """(sides, Comparisons of the others with the first) of Flights that have flown."""
    letters = zip(sides.LETTERS, flights, strict=False)
    every = [sides.of(CAMPAIGN, one.folder, letter, one.label) for letter, one in letters]
    return every, [comparison.compare(every[0], other) for other in every[1:]]


def tables(every, found, settings):
    """list of campaign.parts.Part. settings : {key: value} of each side, in their order"""
    return [_combinations(every, found, settings), _pairs(found, every)]


def result(every, settings):
    """Plain dict of the combinations, for JSON: what `compare` has not."""
    return [
        {"letter": side.letter, "settings": own, "met": _met(side)[0], "judged": _met(side)[1]}
        for side, own in zip(every, settings, strict=True)
    ]


def _met(side):
    """(runs that met every requirement that can be judged, runs) of a Side; a failed run meets none."""
    kept = [not one.failed and all(j.passed for j in one.judged if j.judgeable) for one in side.runs.values()]
    return sum(kept), len(kept)


def _shown(found):
    """Names of the figures that are told: of those of the entry that some pair has, else of the run."""
    there = {row.quantity.name for one in found for row in one.rows if row.difference is not None}
    return [next((name for name in names if name in there), names[-1]) for names in SHOWN]


def _combinations(every, found, settings):
    """One row a combination, the best first: most runs that met all, then by the attitude at entry."""
    names = _shown(found)
    units = {row.quantity.name: row.quantity.unit for row in found[0].rows}
    medians = {every[0].letter: {row.quantity.name: row.a for row in found[0].rows}}
    medians |= {one.b.letter: {row.quantity.name: row.b for row in one.rows} for one in found}
    rows = []
    for side, own in zip(every, settings, strict=True):
        met, runs = _met(side)
        samples = [medians[side.letter].get(name) for name in names]
        shown = ["-" if sample is None else parts.number(sample.median) for sample in samples]
        last = float("inf") if not samples or samples[-1] is None else samples[-1].median
        rows.append(((-met, last), (side.letter, *own.values(), f"{met} of {runs}", *shown)))
    heads = "", *settings[0], ">all required met", *(f">{name} [{units[name]}]" for name in names)
    lines = ("Medians of the runs; the best combination stands first, by requirements met and attitude.",)
    return Part("Combinations", heads, tuple(row for _, row in sorted(rows, key=lambda one: one[0])), lines)


def _pairs(found, every):
    """Each combination against the first, in pairs of one seed."""
    rows, names = [], _shown(found)
    for one in found:
        for row in (row for row in one.rows if row.quantity.name in names and row.difference is not None):
            low, high = row.difference.low, row.difference.high
            bounds = "-" if low is None else f"{low:+.3g} to {high:+.3g}"
            rows.append(
                (one.b.letter, f"{row.quantity.name} [{row.quantity.unit}]", f"{row.difference.mean:+.3g}",
                 bounds, parts.verdict(row.difference, one))
            )  # fmt: skip
    heads = "", "against A", ">mean difference", f">{100.0 * paired.CONFIDENCE:.0f} % interval", "verdict"
    folders = [f"{side.letter}: {side.where}" for side in every]
    lines = (
        "Runs of one seed in pairs; all figures of two: `shefex-nav compare` with their folders.",
        *folders,
    )
    return Part(f"Against A ({every[0].label})", heads, tuple(rows), lines)
