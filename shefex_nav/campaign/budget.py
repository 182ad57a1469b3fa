"""Where the errors of a filter come from: the same flights once more without each error of the world.

A flight without one error (`without` of a scenario, `world.absent`) is told the same, and draws the same for
all others. So the difference of its errors to those of the whole flight, of one seed, is what that error
does. Of a filter whose gains do not depend on the data the differences of all sources add up to the whole
error; what they do not add up to is told as not explained.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import plan as planning
from shefex_nav.campaign import results
from shefex_nav.campaign.compare import sides
from shefex_nav.campaign.compare.flying import DIGITS, Flight
from shefex_nav.campaign.compare.given import CAMPAIGN, override
from shefex_nav.campaign.tables import Bold, Part
from shefex_nav.errors import UserError
from shefex_nav.report import intervals, sensor_use
from shefex_nav.scenario import load, software
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.overriding import Option
from shefex_nav.world import absent

GRAVITY = "gravity"  # what the world has beyond J2: another flight, but nearly
NAMES = (*absent.NAMES, GRAVITY)
STATISTICAL = Option("star_tracker.frames=statistical", "budget, star_tracker.frames=statistical")
ENTRY, END = "entry", "end"
QUANTITIES = {  # series of a run, unit for people, factor
    "position": ("position_error_i", "m", 1.0),
    "velocity": ("velocity_error_i", "m/s", 1.0),
    "attitude": ("attitude_error_b", "deg", float(np.degrees(1.0))),
}
LEAST = 1e-3  # share of a source that has a row of its own
FEW = 6
TITLES = {ENTRY: "At entry", END: "At the end"}
REST = "not explained"


class BudgetError(UserError):
    """A budget that cannot be made; the message says why."""


class Source(NamedTuple):
    """An error of the world."""

    name: str
    overrides: tuple  # without it


class Given(NamedTuple):
    """What one source contributes to one quantity at one instant, in the unit for people."""

    n: int  # pairs
    rms: float  # of what it does
    share: float  # of the mean square of the whole error
    low: float | None  # 95 % interval of the share; None of one pair
    high: float | None
    rms_without: float  # error of the flights without it


class Budget(NamedTuple):
    """Everything that is said."""

    runs: int  # of the whole flights that came to their end
    whole: dict  # instant -> {quantity: rms}
    sources: dict  # name -> {instant: {quantity: Given}}
    rest: dict  # instant -> {quantity: Given}, what the sources do not add up to; empty without a common seed
    notes: tuple
    refused: dict  # sensor -> share of its measurements, of sensors of which the filter refused most


def sources(scenario, wanted=()):
    """list of Source that a Scenario has; BudgetError if one that is wanted is not there.

    wanted : names; without any, all
    """
    if unknown := [name for name in wanted if name not in NAMES]:
        raise BudgetError(f"--source {unknown[0]}: is no source; expected one of: {', '.join(NAMES)}")
    there = [name for name in NAMES if _has(scenario, name)]
    if missing := [name for name in wanted if name not in there]:
        raise BudgetError(f"--source {missing[0]}: is zero in this scenario; it has: {', '.join(there)}")
    return [Source(name, _overrides(scenario, name)) for name in there if not wanted or name in wanted]


def _has(scenario, name):
    """Whether an error is there that would be away without it."""
    if name in scenario.without:
        return False
    tracker = scenario.star_tracker.enabled
    if name in absent.IMU:
        unit = settings(scenario.imu)
        return absent.of_imu(unit, {name}) != unit
    if name in absent.CAMERA:
        camera = settings(scenario.star_camera)
        return tracker and absent.of_camera(camera, {name}) != camera
    if name == absent.VIBRATION:
        shaking = scenario.imu.vibration
        return any((*shaking.boost, shaking.coast))
    if name == absent.GPS_LASTING:
        return bool(settings(scenario.gps.errors))
    if name == GRAVITY:
        return scenario.earth.gravity not in ("j2", "point")
    return tracker if name == absent.STAR_NOISE else True


def _overrides(scenario, name):
    if name == GRAVITY:
        return ("earth.gravity=j2",)
    return (f"without=[{', '.join((*scenario.without, name))}]",)


def planned(how, own, wanted=()):
    """(Flight of the whole, {name: Flight without it}); ScenarioError, BudgetError; nothing is written.

    how : compare.flying.How;  own : software as `compare` takes it, None for that of the scenario
    """
    given = (*how.overrides, *(() if own is None else (override(own),)))
    whole = load.load(how.scenario, given)
    if whole.star_tracker.enabled and whole.star_tracker.frames != "statistical":
        given = (*given, STATISTICAL)
        whole = load.load(how.scenario, given)
    software.refuse_reached(whole)
    out = how.out or Path("logs/budgets") / f"{whole.mission.name}-seed{how.seed}"
    flights = {}
    for source in sources(whole, wanted):
        less = load.load(how.scenario, (*given, *source.overrides))
        flights[source.name] = Flight(less, f"without {source.name}", _folder(less, source.name, out))
    return Flight(whole, "the whole", _folder(whole, "whole", out)), flights


def _folder(scenario, name, out):
    return out / f"{re.sub(r'[^a-z_]', '-', name)}-{planning.digest(scenario.source)[:DIGITS]}"


def budget(whole, flights):
    """Budget of Flights that have flown, as `planned` gives them; BudgetError if nothing can be said."""
    base, notes = errors_of(whole), []
    if not base:
        raise BudgetError(
            f"{whole.folder}: no run of it has errors over time; `shefex-nav report {whole.folder}` says why"
        )
    less = {name: errors_of(one) for name, one in flights.items()}
    for name, one in less.items():
        if absent_runs := len(base.keys() - one.keys()):
            notes.append(f"without {name}: {absent_runs} of {len(base)} runs failed or give no errors")
    notes += _without_entry(base, less)
    at, of_sources = _instants(base), {}
    for name, one in less.items():
        of_sources[name] = {
            instant: {quantity: _given(base, one, instant, quantity) for quantity in QUANTITIES}
            for instant in at
        }
    every = {instant: {q: _rest(base, less, instant, q) for q in QUANTITIES} for instant in at}
    rms = {
        instant: {
            q: _rms(np.array([one[instant][q] for one in base.values() if instant in one]))
            for q in QUANTITIES
        }
        for instant in at
    }
    return Budget(len(base), rms, of_sources, every, tuple(notes), dict(mostly_refused(whole)))


def mostly_refused(flight):
    """(sensor, share) of sensors of which more was refused than used, in all runs of a Flight together."""
    side = sides.of(CAMPAIGN, flight.folder, "A")
    runs = [one.get for one in side.runs.values() if not one.failed]
    for sensor in side.sensors:
        known = [fate for get in runs if None not in (fate := sensor_use.fate(get, sensor))]
        used, refused = (sum(counts) for counts in zip((0, 0), *known, strict=True))
        if refused > used:
            yield sensor, refused / (used + refused)


def errors_of(flight):
    """Errors of the runs of a Flight: {seed: {instant: {quantity: (3,) in its unit}}}."""
    campaign, found = results.open_campaign(flight.folder), {}
    entries = campaign.numbers("summary.navigation.at_entry.t_s")
    rows = zip(campaign.runs.tolist(), campaign["seed"].tolist(), campaign.succeeded, entries, strict=True)
    for run, seed, succeeded, entry_s in rows:
        if not succeeded:
            continue
        try:
            kept = campaign.series(run)
        except KeyError:  # they were deleted
            continue
        if not len(kept["t_s"]):
            continue
        at = {END: -1}
        if np.isfinite(entry_s):
            at = {ENTRY: int(np.abs(kept["t_s"] - entry_s).argmin()), END: -1}
        found[seed] = {
            instant: {q: factor * kept[key][k] for q, (key, _, factor) in QUANTITIES.items()}
            for instant, k in at.items()
        }
    return found


def _instants(base):
    """Instants that all runs have, in order of time."""
    return [instant for instant in (ENTRY, END) if all(instant in one for one in base.values())]


def _without_entry(base, less):
    """Why entry is told of none or of some of the flights: iterator of notes."""
    entered = [seed for seed, one in base.items() if ENTRY in one]
    if entered and len(entered) < len(base):
        away = len(base) - len(entered)
        yield f"At entry nothing is told: {away} of {len(base)} whole flights came to none"
    elif entered:
        for name, one in less.items():
            if away := sum(seed in one and ENTRY not in one[seed] for seed in entered):
                yield f"without {name}: {away} of {len(base)} came to no entry: not in its row there"


def _rms(vectors):
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def _pairs(base, less, instant, quantity):
    """Errors (n, 3), (n, 3) of the seeds that both have."""
    seeds = [seed for seed in base if seed in less and instant in less[seed]]
    return tuple(
        np.array([one[seed][instant][quantity] for seed in seeds]).reshape(-1, 3) for one in (base, less)
    )


def _given(base, less, instant, quantity):
    """Given of a source; None without a pair."""
    whole, without = _pairs(base, less, instant, quantity)
    return contribution(whole, whole - without) if len(whole) else None


def _rest(base, less, instant, quantity):
    """Given of what the sources do not add up to; None without a seed that all have."""
    seeds = [seed for seed in base if all(seed in one and instant in one[seed] for one in less.values())]
    if not seeds:
        return None
    whole = np.array([base[seed][instant][quantity] for seed in seeds])
    explained = sum(
        whole - np.array([one[seed][instant][quantity] for seed in seeds]) for one in less.values()
    )
    return contribution(whole, whole - explained)


def contribution(whole, part):
    """Given of a part of the errors: (n, 3), (n, 3), row k of one seed.

    The share is a ratio of two means of the same seeds: its interval is Student's of part^2 - share whole^2.
    """
    of_whole, of_part = (np.sum(np.asarray(one, dtype=float) ** 2, axis=1) for one in (whole, part))
    share = float(of_part.mean() / of_whole.mean()) if of_whole.any() else 0.0
    low = high = None
    if len(of_whole) > 1 and of_whole.any():
        low, high = (share + end for end in intervals.mean((of_part - share * of_whole) / of_whole.mean()))
        low = max(low, 0.0)
    without = _rms(np.asarray(whole) - np.asarray(part))
    return Given(len(of_whole), float(np.sqrt(of_part.mean())), share, low, high, without)


def parts(found, scenario):
    """list of campaign.parts.Part. budget.Budget, Scenario of the whole flights"""
    made = [_instant(found, instant) for instant in found.whole]
    return [*made, Part("How to read it", lines=tuple(_lines(found, scenario)))]


def ranked(found, instant):
    """Names of the sources, the largest share of any quantity first: list of (name, {quantity: Given})."""

    def largest(one):
        return max((given.share for given in one[1].values() if given is not None), default=0.0)

    return sorted(((name, one[instant]) for name, one in found.sources.items()), key=largest, reverse=True)


def _instant(found, instant):
    rows, small = [], []
    for name, of_source in ranked(found, instant):
        if any(one is None or one.share >= LEAST for one in of_source.values()):
            rows.append((name.replace("_", " "), *_cells(of_source)))
        else:
            small.append(name.replace("_", " "))
    rows.append((Bold(REST), *_cells(found.rest[instant])))
    heads = ["error of the world"]
    for quantity, (_, unit, _) in QUANTITIES.items():
        heads += [f">{quantity} [{unit}]", ">share (95 %)", ">without"]
    whole = ", ".join(
        f"{quantity} {found.whole[instant][quantity]:.3g} {unit}"
        for quantity, (_, unit, _) in QUANTITIES.items()
    )
    lines = [f"The whole error, rms over {found.runs} runs: {whole}."]
    if small:
        lines.append(f"Less than {100.0 * LEAST:g} % of each: {', '.join(small)}.")
    return Part(TITLES[instant], tuple(heads), tuple(rows), tuple(lines))


def _cells(of_source):
    for one in of_source.values():
        if one is None:
            yield from ("-", "-", "-")
            continue
        bounds = "" if one.low is None else f" ({_percent(one.low)} to {_percent(one.high)})"
        yield from (f"{one.rms:.3g}", f"{_percent(one.share)} %{bounds}", f"{one.rms_without:.3g}")


def _percent(share):
    """A share in per cent, without more digits than mean anything."""
    value = 100.0 * share
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}" if value >= 0.05 else "0"


def _lines(found, scenario):
    for sensor, share in found.refused.items():
        yield Bold(
            f"{sensor_use.named(sensor)}: the filter refused {_percent(share)} % of them. The shares mean "
            "little until it uses them."
        )
    yield (
        "Each row is flown without this error alone; the computer counts with it as before. "
        "First comes the rms of what the error does: the difference between the two flights of a seed. Then "
        "its share of the mean square of the whole, and the rms error of the flights without it."
    )
    yield (
        "Shares of errors that have nothing to do with each other add up to 100 % but for chance. "
        f"{REST.capitalize()}: what is left of each flight's error when all rows are taken away: errors that "
        "have no row (instruments, wrong values of navigation.told, integration), and what is not linear."
    )
    if GRAVITY in found.sources:
        yield (
            "Gravity: the world's field beyond J2, which the built-in filter does not have; without it the "
            "vehicle flies a little differently."
        )
    if found.runs < FEW:
        yield Bold(f"Of {found.runs} runs the intervals mean little: fly more.")
    yield from found.notes


def as_numbers(found, scenario, seed):
    """Plain dict for JSON."""
    return {
        "scenario": scenario.mission.name,
        "seed": seed,
        "runs": found.runs,
        "units": {quantity: unit for quantity, (_, unit, _) in QUANTITIES.items()},
        "whole_rms": found.whole,
        "sources": {
            name: {instant: _numbers(one[instant]) for instant in one} for name, one in found.sources.items()
        },
        "not_explained": {instant: _numbers(one) for instant, one in found.rest.items()},
        "notes": list(found.notes),
        "mostly_refused": found.refused,
    }


def _numbers(of_source):
    return {quantity: None if one is None else one._asdict() for quantity, one in of_source.items()}
