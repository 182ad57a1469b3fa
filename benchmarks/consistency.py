"""Is the filter what it says it is, and another one? NEES, NIS, containment over seeds, error over the bound.

uv run python benchmarks/consistency.py FOLDER [--seeds 100] [--set navigation.states=...] [--jobs 2]

As `shefex-nav verify consistency` and `bound` over the same flights, for several configurations of the filter
(--filter) beside each other and for one that is told wrong noise (--mistuned). Every seed is flown once with
rendered frames; its star fixes are kept in FOLDER, so a second call goes on from there.
All seeds fly through one field, so NEES of the accelerometer biases, which are hard to tell from what the
on-board model leaves out of gravity, depend on a single draw of that; --turn-field draws it for each seed.
Without it a second interval is printed beside, of histories that have the field in common as the runs have.
Prints every statistic with the interval it has to keep, the ratio of the error to the posterior Cramer-Rao
bound, and writes nees.png and bound.png into FOLDER. Exit code 1 if a statistic is outside.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from missions import SCENARIOS

MISTUNED = "star noise halved"


def other_filter(study, overrides):
    """The same study, its star fixes included, with another configuration of the filter."""
    from shefex_nav.scenario import load

    return study._replace(source=load.load_text(study.source, study.name, overrides).source)


def follow(study, seed, filters, bound):
    """Every filter over one seed. -> dict of Run, bounds (None unless asked for)"""
    from shefex_nav.scenario import params_onboard
    from shefex_nav.verify import flown, over_bound
    from shefex_nav.verify import study as studies

    fixes, scenario = studies.fixes_of(study, seed), study.scenario
    world, runs = studies.world_of(study, scenario, seed), {}
    for name, (overrides, star_factor) in filters.items():
        nav = params_onboard.nav_params(other_filter(study, overrides).scenario)
        there = world._replace(computer=world.computer._replace(nav=nav))
        runs[name] = flown.filter_run(scenario, seed, fixes, star_factor=star_factor, world=there)
    return runs, over_bound.bounds(scenario, world, fixes) if bound else None


def imagine(study, seed, overrides, number, one_field):
    """`study.imagine` for one of the filters."""
    from shefex_nav.verify import study as studies

    return studies.imagine(
        other_filter(study, overrides), seed, studies.fixes_of(study, seed), number, one_field
    )


def fly(study, seed):
    """Fly one seed with frames unless its fixes are there."""
    from shefex_nav.verify import study as studies

    studies.fixes_of(study, seed)


def in_parallel(calls, workers, what):
    """`study.in_workers` with a bar; the calls are those of a dict."""
    from rich.console import Console
    from rich.progress import Progress

    from shefex_nav.verify import study as studies

    if not calls:
        return {}
    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task(what, total=len(calls))
        return studies.in_workers(calls, workers, lambda key: progress.advance(task))


def show(title, verdicts):
    from rich.console import Console

    from shefex_nav.verify import study

    Console(width=130).print(study.table(title, verdicts))


def print_ratios(title, found):
    from shefex_nav.verify import over_bound

    print(f"\n{title}: rms error over the bound (in brackets: if gravity is known)")
    for phase, values in over_bound.ratios(found).items():
        both = zip(values["ratio"], values["ratio_known"], strict=True)
        ratio = "   ".join(f"{one:6.3f} ({other:6.3f})" for one, other in both)
        error = "  ".join(f"{one:.3g}" for one in values["error"] * [1.0, 1.0, 180.0 / np.pi])
        print(f"  {phase:20s} position, velocity, attitude {ratio}   errors {error} m, m/s, deg")


def commit():
    """The version of the code, as far as it is known."""
    words = ["git", "describe", "--always", "--dirty"]
    found = subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


def filters_of(options):
    """Name -> overrides of the scenario, factor on the sigmas of star fixes."""
    filters = {"default": ((), 1.0)}
    for text in options.filter:
        name, _, overrides = text.partition(":")
        filters[name] = (tuple(overrides.split(";")), 1.0)
    if options.mistuned:
        filters[MISTUNED] = ((), 0.5)
    return filters


def options_of(argv):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scenario", default=str(SCENARIOS / "shefex2_andoya.yaml"))
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="as of shefex-nav run"
    )
    parser.add_argument("--filter", action="append", default=[], metavar="NAME:KEY=VALUE", help="another one")
    parser.add_argument("--representative", type=int, default=0, help="seed whose matrices make the bounds")
    parser.add_argument("--histories", type=int, default=1000, help="simulated, for the bounds of the NEES")
    parser.add_argument(
        "--bounds", type=int, default=10, help="seeds along which the bound is followed; 0: none"
    )
    parser.add_argument("--fly-only", action="store_true", help="judge later")
    parser.add_argument("--flown", action="store_true", help="only seeds that have been flown already")
    parser.add_argument(
        "--turn-field",
        action="store_true",
        help="turn what the on-board model leaves out of gravity by another rotation for every seed",
    )
    parser.add_argument("--mistuned", action="store_true", help="also with half the star noise")
    return parser.parse_args(argv)


def main(argv=None):
    options = options_of(argv)
    options.folder.mkdir(parents=True, exist_ok=True)
    study = study_of(options)
    seeds = list(range(options.first, options.first + options.seeds))
    if options.flown:
        seeds = [seed for seed in seeds if study.path(seed).exists()]
    missing = {seed: (fly, study, seed) for seed in seeds if not study.path(seed).exists()}
    if missing:
        from shefex_nav import simulate

        simulate.warm_up(study.scenario)  # compiles
    in_parallel(missing, options.jobs, "flown")
    return 0 if options.fly_only else judge(options, study, seeds)


def study_of(options):
    """Study of the scenario; files of fixes say its file, its overrides and the version of the code."""
    from shefex_nav.scenario import load
    from shefex_nav.verify import study

    found = study.of_scenario(load.load(options.scenario, options.set), str(options.folder))
    made_for = {"scenario": Path(options.scenario).name, "set": list(options.set)}
    made_by = {"code": commit()} | made_for
    return found._replace(made_by=made_by, made_for=made_for, turn_field=options.turn_field)


def judge(options, study, seeds):
    from shefex_nav.verify import consistency, consistency_figures, flown, over_bound

    filters = filters_of(options)
    calls = {  # the longest first; a filter that is told wrong noise is judged by the bounds of the default
        name: (imagine, study, options.representative, overrides, options.histories, name == "default")
        for name, (overrides, _) in filters.items()
        if name != MISTUNED
    }
    calls |= {seed: (follow, study, seed, filters, k < options.bounds) for k, seed in enumerate(seeds)}
    done = in_parallel(calls, options.jobs, "filters and bounds")
    results = [done[seed] for seed in seeds]
    pairs = [pair for _, pair in results if pair is not None]
    print(f"{Path(options.scenario).name}, code {commit()}, {len(seeds)} seeds: {seeds}")
    if study.turn_field:
        print("what the on-board model leaves out of gravity is turned by another rotation for every seed")
    print(f"frames flown by {flown.provenance(study.path(seed) for seed in seeds)}")
    rng, found, good = np.random.default_rng(0), {}, True
    for name, (overrides, _) in filters.items():
        runs = [one[name] for one, _ in results]
        imagined, apart = done.get(name, done["default"])
        if name != MISTUNED and pairs:
            found[name] = over_bound.curves(runs, pairs)
        verdicts = consistency.judge(runs, imagined._replace(one_field={}), rng)
        rejected = {sensor: sum(run.rejected.get(sensor, 0) for run in runs) for sensor in runs[0].nis}
        show(f"{name} {' '.join(overrides)}; refused by the gate: {rejected}", verdicts)
        print(f"  (variances of the histories within {apart:.1%} of the filter's own)")
        if imagined.one_field and name == "default" and not study.turn_field:
            one_field = consistency.judge_in_one_field(runs, imagined.one_field, rng)
            show(f"{name}: the same, by histories of which all have one field in common", one_field)
        good &= name != "default" or all(one.good for one in verdicts)
    consistency_figures.draw_nees([one["default"] for one, _ in results], options.folder / "nees.png")
    if not pairs:
        return 0 if good else 1
    for name, one in found.items():
        print_ratios(name, one)
    consistency_figures.draw_bound(found, options.folder / "bound.png", runs=len(results))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
