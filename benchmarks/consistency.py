"""Is the filter what it says it is? NEES, NIS and containment over seeds, and its error over the bound.

uv run python benchmarks/consistency.py FOLDER [--seeds 100] [--set navigation.states=...] [--jobs 2]

Every seed is flown once with rendered frames; its star fixes are kept in FOLDER, so a second call goes on
from there, and other configurations of the filter (--filter) are run over the same measurements in seconds.
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

PHASE_STARTS_AFTER_S = 10.0  # of each phase is left out where convergence is asked for


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


def follow(job):
    """The filter alone over one seed. -> Run, its Bounds: field of gravity unknown, known"""
    from shefex_nav import prepare
    from shefex_nav.environment import gravity
    from shefex_nav.scenario import params
    from shefex_nav.verify import bound, bound_model, flown

    scenario = scenario_of(job)
    world = prepare.build_world(scenario, job["seed"])
    fixes = flown.load(fixes_path(job))
    run = flown.filter_run(scenario, job["seed"], fixes, star_factor=job["star_factor"], world=world)
    if not job["bound"]:
        return run, ()
    imu, camera = params.imu_params(scenario), params.camera_params(scenario)
    field = gravity.load(scenario.earth.gravity, scenario.earth.gravity_degree)
    process = bound.gravity_process(field, world.flight.trajectory, world.earth)
    flight = bound.Flight(
        world.flight.trajectory,
        world.earth,
        world.alignment,
        world.gps_fixes,
        fixes,
        imu,
        camera,
        world.computer.nav.l_ba_b,
    )
    layouts = [bound_model.sources(imu, camera, *one) for one in (process, (0.0, np.inf))]
    return run, tuple(bound.follow(flight, layout) for layout in layouts)


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


def sigma_trace(P, block):
    """Root of the trace of a block's covariance, mean over runs of the variance. list of (m, 15, 15)"""
    return np.sqrt(np.mean([np.einsum("kii->k", one[:, block, block]) for one in P], axis=0))


def bound_table(runs, bounds, filters):
    """Ratios per phase: after `PHASE_STARTS_AFTER_S` of each."""
    from shefex_nav.verify import bound as bounds_module
    from shefex_nav.verify import consistency
    from shefex_nav.verify.flown import PHASES

    m = min(len(run.t_s) for run in runs)
    t_s, phase = runs[0].t_s[:m], runs[0].phase[:m]
    known = []
    for which in range(2):
        traces = [np.stack(bounds_module.sigmas(one[which]), axis=1)[:m] for one in bounds]
        known.append(np.sqrt(np.mean(np.square(traces), axis=0)))
    errors = {name: consistency.rms(some)[:m] for name, some in filters.items()}
    print(f"\nrms error over the bound, {len(runs)} runs: position, velocity, attitude")
    for p, name in enumerate(PHASES):
        chosen = (phase == p) & settled(t_s, phase, p)
        for label, error in errors.items():
            ratio = [ratios(error, one, chosen) for one in known]
            print(f"  {name:20s} {label:20s} {ratio[0]}   (gravity field known: {ratio[1]})")
    return t_s, phase, known, errors


def settled(t_s, phase, p):
    """Epochs that come `PHASE_STARTS_AFTER_S` after the begin of their stretch of a phase."""
    inside = phase == p
    begins = np.flatnonzero(inside & ~np.concatenate([[False], inside[:-1]]))
    since = np.full(len(t_s), np.inf)
    for k in begins:
        since[k:] = t_s[k:] - t_s[k]
    return since >= PHASE_STARTS_AFTER_S


def ratios(error, bound, chosen):
    """rms over the chosen epochs of the error over that of the bound, three quantities, as text."""
    value = np.sqrt((error[chosen] ** 2).mean(axis=0) / (bound[chosen] ** 2).mean(axis=0))
    return "  ".join(f"{one:5.3f}" for one in value)


def commit():
    """The version of the code, as far as it is known."""
    words = ["git", "describe", "--always", "--dirty"]
    found = subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


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
    parser.add_argument("--fly-only", action="store_true")
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
        "star_factor": 1.0,
        "bound": True,
    }
    seeds = range(options.first, options.first + options.seeds)
    jobs = [base | {"seed": seed} for seed in seeds]
    in_parallel(fly, [job for job in jobs if not fixes_path(job).exists()], options.jobs, "flown")
    if options.fly_only:
        return 0
    return judge(options, jobs)


def judge(options, jobs):
    from shefex_nav.verify import consistency, consistency_figures, flown

    results = in_parallel(follow, jobs, options.jobs, "filter and bound")
    runs, bounds = [one[0] for one in results], [one[1] for one in results]
    print(f"{Path(options.scenario).name}, seeds {jobs[0]['seed']} to {jobs[-1]['seed']}, code {commit()}")
    rejected = {name: sum(run.rejected.get(name, 0) for run in runs) for name in runs[0].nis}
    print(f"refused by the gate: {rejected}")
    rng = np.random.default_rng(0)
    first = jobs[0] | {"seed": options.representative}
    fixes = flown.load(fixes_path(first))
    one, histories = consistency.of_run(scenario_of(first), first["seed"], fixes, rng=rng)
    apart = np.abs(histories.P / one.P - 1.0)[:, range(15), range(15)].max()
    print(f"variances of the histories against the filter's own: {apart:.1e} apart at most")
    verdicts = consistency.judge(runs, histories, rng)
    print_verdicts("default filter", verdicts)

    filters = {"default": runs}
    for text in options.filter:
        name, _, override = text.partition(":")
        others = [
            job | {"overrides": (*job["overrides"], *override.split(";")), "bound": False} for job in jobs
        ]
        filters[name] = [run for run, _ in in_parallel(follow, others, options.jobs, name)]
        print_verdicts(
            f"filter {name} ({override})",
            consistency.judge_nis(filters[name]) + consistency.judge_nees(filters[name], histories, rng),
        )
    if options.mistuned:
        others = [job | {"star_factor": 0.5, "bound": False} for job in jobs]
        mistuned = [run for run, _ in in_parallel(follow, others, options.jobs, "mistuned")]
        print_verdicts("star noise halved", consistency.judge(mistuned, histories, rng))
    t_s, phase, known, errors = bound_table(runs, bounds, filters)
    m = len(t_s)
    sigmas = np.stack(
        [sigma_trace([run.P[:m] for run in runs], block) for block in (flown.POS, flown.VEL, flown.ATT)],
        axis=1,
    )
    consistency_figures.draw_nees(runs, options.folder / "nees.png")
    consistency_figures.draw_bound(
        t_s, phase, known[0], errors, sigmas, options.folder / "bound.png", runs=len(runs)
    )
    return 0 if all(one.good for one in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
