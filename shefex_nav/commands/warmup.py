"""`shefex-nav warmup`: compile kernels before anything is flown, for images and clusters.

Exit codes: 0 done, 2 bad input, or some kernels could not be compiled or kept.
"""

import time
from pathlib import Path

import typer

from shefex_nav.commands.options import Json, argument, option
from shefex_nav.commands.printing import print_json


def warmup(
    scenarios: argument(
        list[Path] | None, "Compile what these need; without any, all kernels.", metavar="[SCENARIO]..."
    ) = None,
    workers: option(int | None, "Processes; default: as many as there are cores.", min=1) = None,
    json: Json = False,
):
    """Compile the kernels of missions now, so that the first run does not have to."""
    from shefex_nav.scenario import load
    from shefex_nav.scenario.block import choices

    jobs = [{"command=run", *choices(load.load(scenario))} for scenario in scenarios or ()]
    from shefex_nav import warmup as ready
    from shefex_nav.compiled import numba_hooks

    began = time.perf_counter()
    needed, compiled = ready.compile_for(jobs, workers)
    wall_s, folder = time.perf_counter() - began, numba_hooks.store().own
    if json:
        print_json({"kernels": needed, "compiled": compiled, "wall_s": wall_s, "folder": folder})
    else:
        typer.echo(f"{needed} kernels are ready, {compiled} of them compiled now in {wall_s:.0f} s")
        typer.echo(f"kept in {folder}")
