"""`shefex-nav warmup`: compile kernels before anything is flown, for images and clusters.

Exit codes: 0 done, 2 bad input, or some kernels could not be compiled or kept.
"""

import json as json_module
import time
from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.errors import UserError


def warmup(
    scenarios: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[SCENARIO]...", help="Compile what these need; without any, all kernels."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; default: as many as there are cores.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Compile the kernels of missions now, so that the first run does not have to."""
    from shefex_nav.scenario import load
    from shefex_nav.scenario.choices import choices

    jobs = [{"command=run", *choices(load.load(scenario))} for scenario in scenarios or ()]
    from shefex_nav import warmup as ready
    from shefex_nav.compiled import ahead, numba_hooks

    began = time.perf_counter()
    wanted = [one for one in ahead.entries() if not jobs or any(map(one.is_needed, jobs))]
    missing = ahead.without_file(wanted)
    try:
        compiled = ready.compile_listed(missing, workers)
    except ahead.CompilerFailed as error:
        raise UserError(f"some kernels could not be compiled:\n{error}") from error
    if compiled < len(missing):
        raise UserError(
            f"{len(missing) - compiled} kernels are missing and cannot be compiled ahead here, or not be kept"
        )
    summary = {
        "kernels": len(wanted),
        "compiled": compiled,
        "wall_s": time.perf_counter() - began,
        "folder": numba_hooks.store().own,
    }
    if json:
        typer.echo(json_module.dumps(summary))
    else:
        typer.echo(
            f"{len(wanted)} kernels are ready, {compiled} of them compiled now in {summary['wall_s']:.0f} s"
        )
        typer.echo(f"kept in {summary['folder']}")
