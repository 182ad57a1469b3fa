"""Everything that is said of two sides: their runs in pairs, figure by figure."""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign.compare import paired
from shefex_nav.campaign.compare.given import LOG, CompareError
from shefex_nav.campaign.compare.quantities import LARGER, NEITHER, QUANTITIES, SOLUTION_SHARE, of_sensor
from shefex_nav.clock import SAME_S
from shefex_nav.report import innovations
from shefex_nav.scenario import differences, software

MOST_SEEDS = 3  # that are named
IN_TURN = "flown one after the other"
BY_ITSELF = "neither good nor bad by itself"
SAME_SHARE = 1e-3  # of the ticks with a solution, by which two sides of a seed may differ


class Row(NamedTuple):
    """One figure of both."""

    quantity: object  # Quantity
    a: object  # paired.Sample, None where the side does not have the figure
    b: object
    difference: object  # paired.Difference; None without a pair that has it
    seeds: tuple  # of the pairs that have it
    each: np.ndarray  # (n,) difference of each of them
    why: str = ""  # there is no verdict


class Happened(NamedTuple):
    """How often something happened to both: a requirement was met, a run failed."""

    name: str
    a: paired.Share
    b: paired.Share
    difference: object  # paired.ShareDifference; None without a pair that was judged
    good: bool  # whether it is good that it happens
    why: str = ""


class Comparison(NamedTuple):
    """Side B against side A."""

    a: object  # sides.Side
    b: object
    seeds: tuple  # of the pairs, in order
    rows: tuple  # of Row
    shares: tuple  # of Happened
    different: tuple  # (path, value of A, value of B) of the scenarios, software aside
    notes: tuple  # texts


def compare(a, b):
    """Comparison of two sides; CompareError if they have no seed in common."""
    seeds = in_common(a, b)
    whole = [seed for seed in seeds if not a.runs[seed].failed and not b.runs[seed].failed]
    one_flight = a.kind == b.kind == LOG and a.where == b.where  # of which two filters say something
    compared = [one for one in QUANTITIES if not one.timed or (a.kind == b.kind and not one_flight)]
    lasting = {*innovations.fixes_last(a.source), *innovations.fixes_last(b.source)}
    for sensor in sorted({*a.sensors, *b.sensors}):
        compared += of_sensor(sensor, lasting)
    rows = tuple(_row(quantity, a, b, whole) for quantity in compared)
    rows = tuple(row for row in rows if row.a is not None or row.b is not None)
    shares = (_failed(a, b, seeds), *_met(a, b, whole))
    different = _different(a, b)
    return Comparison(a, b, seeds, rows, shares, different, _notes(a, b, seeds, whole))


def in_common(a, b):
    """Seeds that two sides have, in the order of the first: tuple; CompareError without any.

    a, b : sides.Side, or sides.Planned of what has not flown yet
    """
    found = tuple(seed for seed in a.runs if seed in b.runs)
    if found:
        return found
    each = ", ".join(f"{side.letter} ({side.label}) has {_some(list(side.runs))}" for side in (a, b))
    advice = "fly both with the same --seed"
    if a.kind != b.kind:
        advice = (
            "a campaign draws the seeds of its runs from its own; `shefex-nav repeat DIR RUN --log FILE` "
            "makes the log of one"
        )
    raise CompareError(f"no seed in common: {each}; runs are compared in pairs of one seed: {advice}")


def _some(seeds):
    """Words for the first of a list of seeds."""
    some = ", ".join(map(str, seeds[:MOST_SEEDS]))
    return f"seed{'' if len(seeds) == 1 else 's'} {some}{', ...' if len(seeds) > MOST_SEEDS else ''}"


def _row(quantity, a, b, seeds):
    """Row of a quantity over pairs that flew to their end."""
    figures = [[quantity.figure(side.runs[seed].get) for seed in seeds] for side in (a, b)]
    known = [[value for value in side if value is not None] for side in figures]
    both = [(seed, x, y) for seed, x, y in zip(seeds, *figures, strict=True) if None not in (x, y)]
    samples = [paired.sample(side) if side else None for side in known]
    if not both:
        absent = [side.letter for side, one in zip((a, b), samples, strict=True) if one is None]
        why = f"{absent[0]} does not give it" if absent else "no pair has it"
        return Row(quantity, *samples, None, (), np.zeros(0), why)
    named, of_a, of_b = zip(*both, strict=True)
    x, y = ([quantity.compared(value) for value in side] for side in (of_a, of_b))
    found = paired.difference(x, y, larger_is_better=quantity.better == LARGER)
    if quantity.better == NEITHER:
        found = _only_told(found)
    elif why := _unfair(quantity, a, b, named) or _alone(a, b, figures):
        found = found._replace(verdict=paired.NOT_JUDGED, why=why)
    return Row(quantity, *samples, found, named, np.array(y) - np.array(x), found.why)


def _only_told(found):
    """A Difference of what is not better for being more or less."""
    found = found._replace(better=0, worse=0)
    is_same = found.verdict == paired.NOT_SEEN and found.low is None
    return found if is_same else found._replace(verdict=paired.NOT_JUDGED, why=BY_ITSELF)


def _unfair(quantity, a, b, seeds):
    """Why a difference of a quantity over pairs is not that of the sides alone; '' if it may be judged."""
    if quantity.wall:
        return IN_TURN
    if why := _of_parts(a, b):
        return why
    if not quantity.spoken:
        return ""
    shares = [[side.runs[seed].get(SOLUTION_SHARE) for side in (a, b)] for seed in seeds]
    apart = [one for one in shares if None not in one and abs(one[1] - one[0]) > SAME_SHARE]
    if not apart:
        return ""
    of_a, of_b = max(apart, key=lambda one: abs(one[1] - one[0]))
    return (
        f"{a.letter} has a solution at {100.0 * of_a:.4g} % of the ticks, {b.letter} at {100.0 * of_b:.4g} %"
    )


def _of_parts(a, b):
    """Which of two logs ends before its mission does, and when; '' if they are seen alike."""
    cuts = [math.nan if side.data is None else side.data.cut_s for side in (a, b)]
    if np.isnan(cuts).all() or abs(cuts[1] - cuts[0]) <= SAME_S:
        return ""
    ends = zip((a, b), cuts, strict=True)
    return ", ".join(f"{side.letter} ends at T{cut_s:+.1f} s" for side, cut_s in ends if math.isfinite(cut_s))


def _alone(a, b, figures):
    """Why pairs that both have a figure are not all pairs; '' if they are. figures : of a, of b, or None

    Who has no solution at entry in the worst flights would win by those that are left.
    """
    here = [[value is not None for value in side] for side in figures]
    of_one = [(side, sum(x and not y for x, y in zip(*both, strict=True)))
              for side, both in ((a, here), (b, here[::-1]))]  # fmt: skip
    pairs = sum(x or y for x, y in zip(*here, strict=True))
    return ", ".join(f"{side.letter} alone has it in {n} of {pairs} pairs" for side, n in of_one if n)


def _failed(a, b, seeds):
    happened = [[bool(side.runs[seed].failed) for seed in seeds] for side in (a, b)]
    found = paired.share_difference(*happened, good=False)
    return Happened("failed runs", *map(paired.share, happened), found, False, found.why)


def _met(a, b, seeds):
    """Happened of each requirement that one of the two has."""
    judged = [{seed: {one.name: one for one in side.runs[seed].judged} for seed in seeds} for side in (a, b)]
    names = dict.fromkeys(name for side in judged for of_run in side.values() for name in of_run)
    for name in names:
        of = [{s: j[name] for s, j in side.items() if name in j and j[name].judgeable} for side in judged]
        both = [seed for seed in of[0] if seed in of[1]]
        shares = [paired.share([one.passed for one in side.values()]) for side in of]
        absent = [side.letter for side, found in zip((a, b), of, strict=True) if not found]
        why, found = f"cannot be judged of {' and '.join(absent)}" if absent else "no pair has it", None
        if both:
            found = paired.share_difference(*([side[seed].passed for seed in both] for side in of), good=True)
            why = found.why
        yield Happened(f"{name.replace('_', ' ')} met", *shares, found, True, why)


def _different(a, b):
    """Values that the two scenarios do not have in common, but for software of a user's own."""
    found = differences.of_texts(a.source, b.source, (a.label, b.label))
    return tuple(one for one in found if one[0][:2] not in software.PATHS)


def _flight(run):
    """What tells a sides.Flown's true flight from another."""
    return tuple(run.get(f"flight.{name}") for name in ("apogee_km", "max_speed_m_s"))


def _notes(a, b, seeds, whole):
    notes = [*a.notes, *b.notes]
    for one, other in ((a, b), (b, a)):
        if alone := len(one.runs) - len(seeds):
            runs = f"{alone} run of {one.letter} has" if alone == 1 else f"{alone} runs of {one.letter} have"
            notes.append(f"{runs} no seed in {other.letter}: left out")
    if fewer := len(seeds) - len(whole):
        have = "has" if fewer == 1 else "have"
        notes.append(f"{fewer} of {len(seeds)} pairs {have} a failed run: figures are of the others")
    other_draws = sum(a.runs[seed].draws != b.runs[seed].draws for seed in seeds)
    if other_draws and a.kind == b.kind:
        pairs = "1 pair has" if other_draws == 1 else f"{other_draws} pairs have"
        notes.append(f"{pairs} one seed but other draws: not one flight, only one noise")
    others = sum(_flight(a.runs[seed]) != _flight(b.runs[seed]) for seed in whole)
    if others and a.kind == b.kind and not _of_parts(a, b):
        which = "1 pair is" if others == 1 else f"{others} pairs are"
        notes.append(f"{which} not one flight: true apogee or highest speed differ")
    changed = [name for name in a.versions if name in b.versions and a.versions[name] != b.versions[name]]
    if changed:
        notes.append(f"flown with different versions: {', '.join(changed)}")
    if a.kind != b.kind:
        notes.append("figures of logs are of all their samples, those of campaigns of 10 a second")
    return tuple(notes)
