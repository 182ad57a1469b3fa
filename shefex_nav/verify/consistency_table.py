"""Statistics of a study of many seeds: as an object for other programs, as a table for people."""

from shefex_nav.report import columns
from shefex_nav.verify import flown

CONTAINED, ONE_FIELD = "3 sigma ", ", one field"  # of `nees.Verdict.what`


def as_numbers(asked, chosen, histories, found):
    """Plain dict for JSON. study.Study, its seeds, number of histories, study.Found"""
    return {
        "scenario": asked.name,
        "first_seed": chosen[0],
        "seeds": len(chosen),
        "turned_field": asked.turn_field,
        "histories": histories,
        "histories_apart": found.apart,
        "star_fixes_by": None if asked.folder is None else made_by(asked, chosen),
        "ok": all(one.good for one in found.verdicts),
        "statistics": [one._asdict() | {"inside": one.good} for one in found.verdicts],
        "refused": {name: {"refused": n, "met": met} for name, (n, met) in refused(found.runs).items()},
    }


def made_by(asked, chosen):
    """In words, what made the star fixes that are kept: it may have been another version."""
    return flown.provenance(asked.path(seed) for seed in chosen)


def refused(runs):
    """Measurements that the gate refused, and all that met it: dict sensor -> (int, int)."""
    names = sorted({name for run in runs for name in run.nis})
    return {
        name: (
            sum(run.rejected.get(name, 0) for run in runs),
            sum(len(run.nis.get(name, ())) for run in runs),
        )
        for name in names
    }


def rows(verdicts):
    """Verdicts for a table: of containment each that is outside, and the least share of each phase.

    list of nees.Verdict -> list of (words, nees.Verdict)
    """
    shown, phases = [], {}
    for one in verdicts:
        if not one.what.startswith(CONTAINED):
            shown.append((one.what.removesuffix(ONE_FIELD), one))
        else:
            phases.setdefault(one.what.partition(", ")[2], []).append(one)
    for phase, several in phases.items():
        shown += [(one.what, one) for one in several if not one.good]
        words = f"least share inside 3 sigma of {len(several)} errors, {phase}"
        shown.append((words, min(several, key=lambda one: one.value)))
    return shown


def table(title, verdicts):
    """rich Table of a list of nees.Verdict."""
    heads = ("statistic", ">value", ">low", ">high", ">samples", "")
    found = columns.table(title, heads, no_wrap=True)
    for words, one in rows(verdicts):
        numbers = [f"{value:.4f}" for value in (one.value, one.low, one.high)]
        found.add_row(words, *numbers, str(one.samples), "" if one.good else _mark(one))
    return found


def _mark(verdict):
    """What it means to be outside, in words."""
    return "too small" if verdict.value < verdict.low else "too large"
