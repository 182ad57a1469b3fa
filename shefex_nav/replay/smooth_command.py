"""`shefex-nav smooth`: the best-estimate trajectory of a flight, from its log.

Exit codes: 0 done, 2 a log that cannot be smoothed or bad input.
"""

import json as json_module
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

SUFFIX = ".smoothed.mcap"
DOF = 9  # of the NEES of position, velocity and attitude
TOO_SURE = 2.0  # [E] times as much as is expected: a remark


def smooth(
    log: Annotated[Path, typer.Argument(help="Log of a run (MCAP); logs of killed runs are read too.")],
    out: Annotated[Path | None, typer.Option(help="Log to write; default <log>.smoothed.mcap.")] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Configure the filter otherwise: navigation.<key>=value."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file that is written.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Smooth a flight after it is over: every estimate from all its measurements, later ones too."""
    path = log.with_suffix(SUFFIX) if out is None else out
    _check(log, path, named=out is not None, force=force)
    from shefex_nav.replay import rerun

    recording = rerun.open_log(log, overrides or ())
    data = recording.data
    if data.ended_early:
        typer.echo(
            f"{log}: the run ended early, at T{data.last_t_s:+.2f} s; it is smoothed up to then", err=True
        )
    from shefex_nav import warmup
    from shefex_nav.replay import smooth as smoother
    from shefex_nav.replay import smoothed_log

    warmup.get_ready({"command=smooth"})
    began = time.perf_counter()
    result = _with_bar(lambda progress: smoother.run(recording, progress))
    wall_s = time.perf_counter() - began
    smoothed_log.write(path, recording, result.smoothed, wall_s, overwrite=force)
    summary = summarise(log, path, result, wall_s)
    if json:
        typer.echo(json_module.dumps(summary, allow_nan=False))
    else:
        _show(summary)


def summarise(log, path, result, wall_s):
    """What the command prints, as an object of numbers, texts and None; 'parts' is None without truth."""
    from shefex_nav.replay import compare

    data = result.smoothed
    has_truth = len(data.truth.t_s) > 0
    return {
        "scenario": data.mission.scenario,
        "seed": data.mission.seed,
        "log": str(log),
        "smoothed": str(path),
        "ended_early": data.ended_early,
        "wall_s": wall_s,
        "real_time_factor": float(data.nav.t_s[-1] - data.nav.t_s[0]) / wall_s,
        "parts": compare.compare(result.filtered, data) if has_truth else None,
    }


def _check(log, path, *, named, force):
    """Refuse an output file that would be lost or cannot be written, before anything is computed."""
    hint = "--out" if named else "LOG"
    if path.exists() and log.exists() and path.samefile(log):
        raise typer.BadParameter(f"{path} is the log itself; choose another name with --out", param_hint=hint)
    if path.exists() and not force:
        raise typer.BadParameter(
            f"{path} exists already; choose another name with --out or add --force", param_hint=hint
        )
    if not path.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {path.parent}", param_hint=hint)


def _with_bar(work):
    """Result of a function of a progress function; a bar on stderr while it works."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("filter", total=1.0)

        from shefex_nav.replay.smooth import FILTER_SHARE

        def show(share):
            progress.update(
                task, completed=share, description="filter" if share < FILTER_SHARE else "smoother"
            )

        return work(show)


def _show(summary):
    """The result as people read it."""
    from rich.console import Console

    console = Console(width=None if sys.stdout.isatty() else 100, highlight=False)
    if summary["parts"] is None:
        console.print("There is no truth in the log to compare with.")
    else:
        console.print(_table(summary))
        if sure := _too_sure(summary["parts"]):
            console.print(sure, markup=False, soft_wrap=True)
    factor = f"{summary['wall_s']:.1f} s, {summary['real_time_factor']:.0f} x real time"
    console.print(f"{summary['smoothed']}, smoothed in {factor}", markup=False, soft_wrap=True)


def _too_sure(parts):
    """What to say of parts whose smoothed errors are far larger than their covariance says; '' if of none."""
    names = [row["part"] for row in parts if (row["nees"]["smoothed"] or 0.0) > TOO_SURE * DOF]
    if not names:
        return ""
    limit = f"NEES over {TOO_SURE * DOF:.0f}"
    return (
        f"{', '.join(names)}: smoothed errors are larger than their sigmas say ({limit}); errors that the "
        "filter does not know look like this, and lasting ones that it counts as noise"
    )


def _table(summary):
    """rich Table: filtered and smoothed RMS by part of the flight."""
    from rich.table import Table

    what = "RMS errors in m, m/s and deg, filtered -> smoothed"
    title = f"{summary['scenario']}, seed {summary['seed']}: {what}"
    table = Table(title=title, title_justify="left")
    table.add_column("part", no_wrap=True)
    table.add_column("from T, s", justify="right", no_wrap=True)
    for heading in ("position", "velocity", "attitude", "NEES of 9"):
        table.add_column(heading, justify="right")
    for row in summary["parts"]:
        cells = [f"{row['from_s']:+.1f}"]
        for name, digits in (("position_m", 2), ("velocity_m_s", 3), ("attitude_deg", 4)):
            before, after = row["filtered"][name], row["smoothed"][name]
            cells.append(f"{before:.{digits}f} -> {after:.{digits}f}")
        values = [row["nees"][which] for which in ("filtered", "smoothed")]
        cells.append("-" if None in values else f"{values[0]:.1f} -> {values[1]:.1f}")
        table.add_row(row["part"], *cells)
    return table
