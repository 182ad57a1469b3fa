"""Is the filter what it says it is? NEES, NIS and containment over seeds, and its error over the bound.

uv run python benchmarks/consistency.py FOLDER [--seeds 100] [--set navigation.states=...] [--jobs 2]

Every seed is flown once with rendered frames; its star fixes are kept in FOLDER, so a second call goes on
from there, and other configurations of the filter (--filter) are run over the same measurements in seconds.
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
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from missions import SCENARIOS

MISTUNED = "star noise halved"
FIELD = 9  # random numbers of their own, beside those of the flight


def scenario_of(job):
    from shefex_nav.scenario import load

    return load.load(job["scenario"], job["overrides"])


def fly(job):
    """Fly one seed with frames unless its fixes are there."""
    from shefex_nav.verify import flown

    path = fixes_path(job)
    if not path.exists():
        flown.save(path, flown.fly(scenario_of(job), job["seed"]), job["head"])


def fixes_path(job):
    return Path(job["folder"]) / f"fixes-{job['seed']:04d}.npz"


def made_for(job):
    """What must have made the fixes: scenario and overrides; another version of the code is only told of."""
    return {key: job["head"][key] for key in ("scenario", "set")}


def follow(job):
    """Every filter over one seed. -> dict of Run, bounds (None unless asked for)"""
    from shefex_nav import prepare
    from shefex_nav.scenario import params_onboard
    from shefex_nav.verify import field, flown, over_bound

    scenario = scenario_of(job)
    world = prepare.build_world(scenario, job["seed"])
    if job["turn_field"]:
        world = field.turned(scenario, world, np.random.default_rng([job["seed"], FIELD]))
    fixes = flown.load(fixes_path(job), made_for(job))
    runs = {}
    for name, (overrides, star_factor) in job["filters"].items():
        other = scenario_of(job | {"overrides": (*job["overrides"], *overrides)})
        computer = world.computer._replace(nav=params_onboard.nav_params(other))
        runs[name] = flown.filter_run(
            scenario, job["seed"], fixes, star_factor=star_factor, world=world._replace(computer=computer)
        )
    return runs, over_bound.bounds(scenario, world, fixes) if job["bound"] else None


def imagine(job):
    """Histories from the matrices of the filters of one seed: dict of consistency.Histories, and how far
    their variances are from the filter's own at most."""
    from shefex_nav.verify import consistency, flown

    found = {}
    for name, (overrides, _) in job["filters"].items():
        if name == MISTUNED:  # is judged by the bounds of the default
            continue
        chosen = scenario_of(job | {"overrides": (*job["overrides"], *overrides)})
        fixes, rng = flown.load(fixes_path(job), made_for(job)), np.random.default_rng(job["seed"])
        options = {"number": job["histories"], "rng": rng, "one_field": name == "default"}
        run, one = consistency.of_run(chosen, job["seed"], fixes, **options)
        ratio = np.diagonal(one.P, axis1=1, axis2=2) / np.diagonal(run.P, axis1=1, axis2=2)
        found[name] = one, float(np.abs(ratio - 1.0).max())
    return found


def work(job):
    return job["do"](job)


def in_parallel(function, jobs, workers, what):
    """Results in the order of the jobs."""
    from rich.console import Console
    from rich.progress import Progress

    if not jobs:
        return []
    results = [function(jobs[0])]  # compiles before the workers start
    with (
        Progress(console=Console(stderr=True)) as progress,
        ProcessPoolExecutor(max_workers=workers, mp_context=get_context("spawn")) as pool,
    ):
        task = progress.add_task(what, total=len(jobs), completed=1)
        futures = [pool.submit(function, job) for job in jobs[1:]]
        for _ in as_completed(futures):
            progress.advance(task)
        return results + [future.result() for future in futures]


def print_verdicts(title, verdicts):
    print(f"\n{title}")
    for one in verdicts:
        mark = " " if one.good else "<" if one.value < one.low else ">"
        bounds = f"{one.low:7.4f} ... {one.high:7.4f}"
        print(f"  {one.what:52s} {one.value:8.4f}   {bounds}  n {one.samples:6d}  {mark}")


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
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    options.folder.mkdir(parents=True, exist_ok=True)
    base = {
        "scenario": options.scenario,
        "overrides": tuple(options.set),
        "folder": str(options.folder),
        "head": {"code": commit(), "scenario": Path(options.scenario).name, "set": list(options.set)},
        "filters": filters_of(options),
        "turn_field": options.turn_field,
    }
    seeds = range(options.first, options.first + options.seeds)
    jobs = [base | {"seed": seed, "bound": k < options.bounds} for k, seed in enumerate(seeds)]
    if options.flown:
        jobs = [job for job in jobs if fixes_path(job).exists()]
        jobs = [job | {"bound": k < options.bounds} for k, job in enumerate(jobs)]
    in_parallel(fly, [job for job in jobs if not fixes_path(job).exists()], options.jobs, "flown")
    if options.fly_only:
        return 0
    return judge(options, jobs)


def judge(options, jobs):
    from shefex_nav.verify import consistency, consistency_figures, flown, over_bound

    filters = jobs[0]["filters"]
    chosen = jobs[0] | {"seed": options.representative, "histories": options.histories, "do": imagine}
    alone = [chosen | {"filters": {name: one}} for name, one in filters.items()]  # the longest jobs
    seeds = [job | {"do": follow} for job in jobs]
    done = in_parallel(work, [seeds[0], *alone, *seeds[1:]], options.jobs, "filters and bounds")
    histories = {name: one for found in done[1 : 1 + len(alone)] for name, one in found.items()}
    results = [done[0], *done[1 + len(alone) :]]
    pairs = [pair for _, pair in results if pair is not None]
    print(f"{Path(options.scenario).name}, code {commit()}, {len(jobs)} seeds: {[j['seed'] for j in jobs]}")
    if options.turn_field:
        print("what the on-board model leaves out of gravity is turned by another rotation for every seed")
    print(f"frames flown by {flown.told(fixes_path(job) for job in jobs)}")
    rng, found, good = np.random.default_rng(0), {}, True
    for name, (overrides, _) in filters.items():
        runs = [one[name] for one, _ in results]
        imagined, apart = histories.get(name, histories["default"])
        if name != MISTUNED and pairs:
            found[name] = over_bound.curves(runs, pairs)
        verdicts = consistency.judge(runs, imagined, rng)
        rejected = {sensor: sum(run.rejected.get(sensor, 0) for run in runs) for sensor in runs[0].nis}
        print_verdicts(f"{name} {' '.join(overrides)}; refused by the gate: {rejected}", verdicts)
        print(f"  (variances of the histories within {apart:.1%} of the filter's own)")
        if imagined.one_field and name == "default" and not options.turn_field:
            one_field = consistency.judge_in_one_field(runs, imagined.one_field, rng)
            print_verdicts(f"{name}: the same, by histories of which all have one field in common", one_field)
        good &= name != "default" or all(one.good for one in verdicts)
    runs = [one["default"] for one, _ in results]
    consistency_figures.draw_nees(runs, options.folder / "nees.png")
    if not pairs:
        return 0 if good else 1
    for name, one in found.items():
        print_ratios(name, one)
    consistency_figures.draw_bound(found, options.folder / "bound.png", runs=len(runs))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
