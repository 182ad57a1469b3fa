"""Fly the same scenario with many seeds on all cores; shared by the studies in this folder."""

import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

SCENARIOS = Path(__file__).parent.parent / "scenarios"


def flown(job):
    """(scenario path, overrides, seed) -> RunData; no log is written."""
    path, overrides, seed = job
    from shefex_nav import prepare, simulate
    from shefex_nav.log.run_data import RunDataBuilder
    from shefex_nav.log.thinning import thinned
    from shefex_nav.scenario import load

    scenario = load.load(path, overrides)
    world = prepare.build_world(scenario, seed)
    mission = prepare.mission(scenario, seed, world.flight.trajectory)
    kept = RunDataBuilder(mission)
    for record in thinned(simulate.route(world, scenario, seed), scenario.log.rate, mission.start_s):
        kept.add(record)
    return kept.build()


def fly(job):
    """(scenario path, overrides, seed) -> summary of `report.metrics`, and errors of the window's fixes."""
    from shefex_nav.report import metrics, star_metrics

    data = flown(job)
    summary = metrics.summarise(data)
    fixes = star_metrics.star_errors(data)
    window, _ = star_metrics.window_frames(data)
    summary["fix_errors_c"] = fixes.rotation_c[[n in window for n in fixes.number]]
    summary["fix_sigmas_c"] = fixes.sigma_c[[n in window for n in fixes.number]]
    return summary


def fly_all(jobs):
    """Summaries of all jobs, in their order; a bar of progress on stderr."""
    from rich.console import Console
    from rich.progress import Progress

    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    summaries = [fly(jobs[0])]  # compiles before the workers start
    with (
        Progress(console=Console(stderr=True)) as progress,
        ProcessPoolExecutor(max_workers=os.cpu_count(), mp_context=get_context("spawn")) as workers,
    ):
        task = progress.add_task("missions", total=len(jobs), completed=1)
        futures = [workers.submit(fly, job) for job in jobs[1:]]
        for _ in as_completed(futures):
            progress.advance(task)
        return summaries + [future.result() for future in futures]
