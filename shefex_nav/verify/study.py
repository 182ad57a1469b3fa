"""A study of many seeds: each is flown once, followed by the filter alone, and all are judged together.

The flights take the time, the star camera's pictures above all. Their star fixes may be kept in a folder, one
for each scenario with its overrides; a seed whose fixes are there is not flown again.
"""

import hashlib
from concurrent.futures import BrokenExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__, prepare
from shefex_nav.files import part
from shefex_nav.report import columns
from shefex_nav.scenario import load, software
from shefex_nav.verify import consistency, flown
from shefex_nav.verify.flown import FlownError
from shefex_nav.workers import cores, each

FIELD = 9  # random numbers of their own, beside those of the flight
DRAWN = 0  # seed of the draws that make intervals of histories
CONTAINED, ONE_FIELD = "3 sigma ", ", one field"  # of `nees.Verdict.what`


class Study(NamedTuple):
    """What all seeds have in common."""

    name: str
    source: str  # text of the scenario with everything in it
    made_by: dict  # what makes star fixes, for the files that keep them
    made_for: dict  # what must have made those that are there: some of these keys
    folder: str | None = None  # of these files; None: they are not kept
    turn_field: bool = False  # what the on-board model leaves out of gravity points elsewhere for each seed

    @property
    def scenario(self):
        """Scenario of the text."""
        return load.load_text(self.source, self.name)

    def path(self, seed):
        """File of the star fixes of a seed."""
        return Path(self.folder) / f"fixes-{seed:04d}.npz"


class Found(NamedTuple):
    """What came of a study."""

    runs: list  # flown.Run, in the order of the seeds
    verdicts: list  # nees.Verdict
    apart: float  # by what share the variances of the histories differ from the filter's own at most


def check(scenario):
    """Refuse a Scenario whose filter takes no attitudes, or is not the built-in one. UserError"""
    software.refuse_own(scenario, "verify consistency")
    if scenario.navigation.stars != "attitude":
        raise FlownError(
            f"{scenario.mission.name}: navigation.stars has to be 'attitude', not "
            f"'{scenario.navigation.stars}': the statistics know attitudes of the star tracker alone"
        )


def of_scenario(scenario, folder=None, *, turn_field=False):
    """Study of a Scenario, whose filter has to take attitudes. FlownError"""
    check(scenario)
    scenario = prepare.settled(scenario)
    digest = hashlib.sha256(scenario.source.encode()).hexdigest()[:12]
    made_for = {"scenario": f"{scenario.mission.name} ({digest})"}
    head = {"version": __version__} | made_for
    return Study(scenario.mission.name, scenario.source, head, made_for, folder, turn_field)


def fixes_of(study, seed):
    """Star fixes of a seed: those that are kept, or those of a flight, which then are."""
    if study.folder is not None and study.path(seed).exists():
        return flown.load(study.path(seed), study.made_for)
    found = flown.fly(study.scenario, seed)
    if study.folder is not None:
        flown.save(study.path(seed), found, study.made_by)
    return found


def world_of(study, scenario, seed):
    """World of a seed, in the field of the Earth or in a turned one."""
    from shefex_nav.verify import field

    world = prepare.build_world(scenario, seed)
    return field.rotated(scenario, world, np.random.default_rng([seed, FIELD])) if study.turn_field else world


def follow(study, seed, fixes=None):
    """Fly a seed, if its star fixes are neither given nor kept, and run the filter over it. -> flown.Run"""
    scenario, fixes = study.scenario, fixes_of(study, seed) if fixes is None else fixes
    return flown.filter_run(scenario, seed, fixes, world=world_of(study, scenario, seed))


def imagine(study, seed, fixes, number, one_field=True):
    """Histories from the matrices of the filter of one seed, and how far their variances are from its own.

    number : of histories;  one_field : with those of runs that have the field in common -> Histories, float
    """
    rng = np.random.default_rng(seed)
    run, found = consistency.of_run(study.scenario, seed, fixes, number=number, rng=rng, one_field=one_field)
    ratio = np.diagonal(found.P, axis1=1, axis2=2) / np.diagonal(run.P, axis1=1, axis2=2)
    return found, float(np.abs(ratio - 1.0).max())


def run(study, seeds, *, histories=1000, workers=None, note=lambda words: None):
    """Fly, follow and judge some seeds: the first here, where it compiles, the others in worker processes.

    Parameters
    ----------
    study : Study
    seeds : list of int; the matrices of the first make the intervals of the NEES
    histories : int, made of them
    workers : int, processes; None: one a core
    note : called with words after each seed, and when the histories are there

    Returns
    -------
    Found

    Raises
    ------
    FlownError
    """
    first = fixes_of(study, seeds[0])
    runs = [follow(study, seeds[0], first)]
    note(f"seed {seeds[0]}")
    calls = {"histories": (imagine, study, seeds[0], first, histories, not study.turn_field)}
    calls |= {f"seed {seed}": (follow, study, seed) for seed in seeds[1:]}
    done = in_workers(calls, workers, note)
    imagined, apart = done.pop("histories")
    runs += done.values()
    return Found(runs, consistency.judge(runs, imagined, np.random.default_rng(DRAWN)), apart)


def sweep(study, seeds):
    """Take away what workers that were stopped have left half written."""
    if study.folder is not None:
        for seed in seeds:
            part(study.path(seed)).unlink(missing_ok=True)


def in_workers(calls, workers=None, note=lambda words: None):
    """Results of calls in worker processes, in their order.

    calls : dict, key -> (function, arguments ...);  note : called with each key as it is done -> dict
    """
    found = {}
    try:
        for key, result in each(_call, calls, min(workers or cores(), len(calls))):
            found[key] = result
            note(key)
    except BrokenExecutor:
        raise FlownError(
            "a worker process was killed, perhaps for want of memory; fewer workers need less of it"
        ) from None
    return {key: found[key] for key in calls}


def _call(function, *arguments):
    return function(*arguments)


def as_numbers(asked, chosen, histories, found):
    """Plain dict for JSON. Study, its seeds, number of histories, Found"""
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
        found.add_row(words, *numbers, str(one.samples), "" if one.good else _outside(one))
    return found


def _outside(verdict):
    """What it means to be outside, in words."""
    return "too small" if verdict.value < verdict.low else "too large"
