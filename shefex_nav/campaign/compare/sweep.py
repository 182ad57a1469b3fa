"""All combinations of some settings, flown with the same seeds: `shefex-nav campaign --sweep KEY=A,B,C`.

The runs of all combinations draw the same, so they are compared in pairs like any two campaigns.
"""

import re
import statistics
from pathlib import Path

from shefex_nav.campaign import plan as planning
from shefex_nav.campaign.compare import comparison, paired, parts, sides
from shefex_nav.campaign.compare.flying import DIGITS, Flight
from shefex_nav.campaign.compare.given import CAMPAIGN, CompareError
from shefex_nav.campaign.compare.quantities import QUANTITIES
from shefex_nav.campaign.tables import Part
from shefex_nav.scenario import load, software, sweeps

SHOWN = tuple(  # of `quantities`: the first that there is
    (
        f"{quantity} at entry{', size' if quantity == 'attitude' else ''}",
        f"{quantity}, rms after two star fixes",
        f"{quantity}, rms of the run",
    )
    for quantity in ("position", "velocity", "attitude")
)


def planned(scenario, axes, overrides, out):
    """(Flight, settings) of each combination: list; ScenarioError, SweepError, CompareError.

    scenario : as `load` takes it;  axes : list of sweeps.Axis;  out : Path of the folder for all
    settings : {key: value}
    """
    found = []
    for settings in sweeps.combinations(axes, sides.MOST):
        with sweeps.about(settings):
            loaded = load.load(scenario, (*overrides, *sweeps.overrides(settings)))
            software.refuse_reached(loaded)
        label = ", ".join(f"{key} {value}" for key, value in settings.items())
        found.append((Flight(loaded, label, out / _folder(loaded, settings)), settings))
    _check_different([one for one, _ in found])
    return found


def _check_different(flights):
    """Refuse combinations that are one scenario: 10 m and 10.0 m."""
    known = {}
    for one in flights:
        if (other := known.setdefault(repr(one.scenario.model_dump()), one)) is not one:
            raise CompareError(f"--sweep: '{other.label}' and '{one.label}' are the same scenario")


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
    return [_combinations(every, settings), _pairs(found, every)]


def result(every, settings):
    """Plain dict of the combinations, for JSON: what `compare` has not."""
    found = []
    for side, own in zip(every, settings, strict=True):
        met = _met(side)
        found.append({"letter": side.letter, "settings": own, "runs": len(side.runs), "met": met})
    return found


def _met(side):
    """Runs of a Side that met all that is required and can be judged; None if nothing is."""
    if not any(one.judgeable for run in side.runs.values() for one in run.judged):
        return None
    return sum(
        not run.failed and all(one.passed for one in run.judged if one.judgeable)
        for run in side.runs.values()
    )


def _shown(every):
    """Quantities that are told: of the entry, after two star fixes or of the run, as a side has them."""
    by_name = {one.name: one for one in QUANTITIES}
    for names in SHOWN:
        there = (name for name in names if any(_median(side, by_name[name]) is not None for side in every))
        yield by_name[next(there, names[-1])]


def _median(side, quantity):
    """Median over the runs of a Side that came to their end, None without any."""
    found = [quantity.figure(one.get) for one in side.runs.values() if not one.failed]
    known = [value for value in found if value is not None]
    return statistics.median(known) if known else None


def _combinations(every, settings):
    """One row a combination, the best first: by the runs that met all, then by the attitude."""
    shown, rows = list(_shown(every)), []
    for side, own in zip(every, settings, strict=True):
        met, medians = _met(side), [_median(side, one) for one in shown]
        flown = sum(not one.failed for one in side.runs.values())
        cells = "-" if met is None else f"{met} of {len(side.runs)}", f"{flown} of {len(side.runs)}"
        numbers = ["-" if value is None else parts.number(value) for value in medians]
        last = float("inf") if medians[-1] is None else medians[-1]
        rows.append(((-(met or 0), last), (side.letter, *own.values(), *cells, *numbers)))
    figures = (f">{one.name} [{one.unit}]" for one in shown)
    heads = "", *settings[0], ">all required met", ">flown to the end", *figures
    required = any(_met(side) is not None for side in every)
    ranks = "the attitude alone, as nothing is required"
    if required:
        ranks = "the runs that met all that is required, then the attitude"
    lines = (
        f"Medians of the runs that flew to their end. The first is the best by {ranks}; of many combinations "
        "that are equally good one stands first by chance.",
    )
    return Part("Combinations", heads, tuple(row for _, row in sorted(rows, key=lambda one: one[0])), lines)


def _pairs(found, every):
    """Each combination against the first, in pairs of one seed."""
    rows, names = [], {one.name for one in _shown(every)}
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
        "Runs of one seed in pairs; of twenty rows without a difference, one shows one by chance.",
        "All figures of two: `shefex-nav compare` with their folders.",
        *folders,
    )
    return Part(f"Against A ({every[0].label})", heads, tuple(rows), lines)
