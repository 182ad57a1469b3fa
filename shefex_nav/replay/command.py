"""`shefex-nav replay`: the on-board navigation over what was recorded elsewhere.

Exit codes: 0 done, 2 bad input: a scenario or data that cannot be replayed (the message names file and line).
"""

import json as json_module
import math
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

MCAP_MAGIC = b"\x89MCAP0\r\n"
BRIEF_TICKS = 300  # of a log, by which everything is compiled: the first fixes are among them


def replay(
    source: Annotated[
        str, typer.Argument(help="Replay scenario, a file or the name of a shipped one, or a log.")
    ],
    data: Annotated[Path | None, typer.Option(help="Folder with the data that the scenario names.")] = None,
    from_: Annotated[
        str | None, typer.Option("--from", help="Statistics from this mission time on, e.g. 60s.")
    ] = None,
    log: Annotated[Path | None, typer.Option(help="Write a log (.mcap) for report and view.")] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Override one value, e.g. --set gnss.latency='0.1 s'."
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Run the on-board navigation over external data, or over a log with another configuration."""
    from_s = -math.inf if from_ is None else _seconds(from_)
    if data is not None and not data.is_dir():
        raise typer.BadParameter(f"there is no folder {data}", param_hint="--data")
    if log is not None:
        _writable(log)
    if _is_log(Path(source)):
        if data is not None:
            raise typer.BadParameter(
                "belongs to a replay scenario; a log holds its data", param_hint="--data"
            )
        summary = _again(Path(source), overrides or (), from_s, log)
    else:
        summary = _external(source, data, overrides or (), from_s, log)
    if json:
        typer.echo(json_module.dumps(summary, allow_nan=False))
    else:
        _show(summary)


def _external(source, folder, overrides, from_s, log):
    """Replay external data. -> the summary"""
    from shefex_nav.replay import load

    scenario, files = load.load(source, overrides, folder)
    began = time.perf_counter()
    from shefex_nav import warmup
    from shefex_nav.replay import air, external, said
    from shefex_nav.scenario.choices import choices

    warmup.get_ready({"command=replay", *choices(scenario)})

    ready = external.prepare(scenario, files)
    end_s = float(ready.blocks.t_valid_s[-1])
    _check_within(from_s, end_s)
    external.warm_up(ready)
    setup_s, clock = time.perf_counter() - began, external.Clock()
    mission = external.mission(ready)
    data = _collect(external.run(ready, clock), mission, end_s, setup_s, log)
    summary = _summary(data, log, from_s, clock.filter_s, end_s - mission.start_s)
    summary["warnings"] = [one._asdict() for one in ready.oddities]
    summary["alignment"], summary["clocks"] = ready.start, said.clocks(ready.common, data)
    summary["barometer"] = air.highest(ready.data.readings.get("barometer", ()), ready.alignment, data)
    return summary


def _again(source, overrides, from_s, log):
    """Run the filter again over a log. -> the summary"""
    from shefex_nav.replay import rerun

    recording = rerun.open_log(source, overrides)
    _check_within(from_s, float(recording.data.imu.t_valid_s[-1]))
    began = time.perf_counter()
    from shefex_nav import __version__, warmup

    warmup.get_ready({"command=replay of a log"})

    data = recording.data
    nav = rerun.start(recording)
    for k in range(min(len(data.imu.t_valid_s), BRIEF_TICKS)):
        rerun.tick(recording, nav, k)
    setup_s = time.perf_counter() - began
    name = f"{data.mission.scenario} (replayed)"
    mission = data.mission._replace(scenario=name, scenario_text=recording.scenario_text, version=__version__)
    end_s = float(data.imu.t_valid_s[-1])
    replayed = _collect(rerun.records(recording), mission, end_s, setup_s, log, until_s=data.cut_s)
    return _summary(replayed, log, from_s, None, end_s - mission.start_s)


def _collect(records, mission, end_s, setup_s, log, *, until_s=math.nan):
    """RunData of records, which are written to the log as well, if there is one."""
    from shefex_nav.log.run_data import RunDataBuilder
    from shefex_nav.log.topics import RunSummary

    began = time.perf_counter()
    kept = RunDataBuilder(mission)
    with _writer(log, mission) as write:
        for record in records:
            write(record)
            kept.add(record)
        done = RunSummary(end_s, time.perf_counter() - began, setup_s, until_s)
        write(done)
        kept.add(done)
    return kept.build()


def _summary(data, log, from_s, filter_s, length_s):
    """What `run` gives, and how long the filter itself took."""
    from shefex_nav.report import metrics

    summary = metrics.summarise(data, log=log, from_s=from_s)
    summary["filter_s"] = filter_s
    summary["filter_real_time_factor"] = length_s / filter_s if filter_s else None
    return summary


def _writer(path, mission):
    """Context that gives a function which writes a record, to the log or nowhere."""

    @contextmanager
    def nowhere():
        yield lambda record: None

    @contextmanager
    def to_log():
        from shefex_nav.log.drawings import FramePolicy
        from shefex_nav.log.writer import LogWriter

        with LogWriter(path, mission, FramePolicy(0, "none", 4.0)) as log:
            yield log.write

    return nowhere() if path is None else to_log()


def _is_log(path):
    """Whether a file is an MCAP file, or is called one; whoever reads it says what is wrong."""
    try:
        with path.open("rb") as file:
            return file.read(len(MCAP_MAGIC)) == MCAP_MAGIC or path.suffix == ".mcap"
    except OSError:
        return path.suffix == ".mcap"


def _seconds(text):
    """Seconds from a time with its unit, such as 60s."""
    from pydantic_core import PydanticCustomError

    from shefex_nav.scenario.quantity import QuantitySpec

    try:
        return QuantitySpec("s", "60s").read(text)
    except PydanticCustomError as error:
        raise typer.BadParameter(error.message(), param_hint="--from") from None


def _check_within(from_s, end_s):
    """Refuse statistics that begin where there is nothing left."""
    if from_s >= end_s:
        raise typer.BadParameter(
            f"{from_s:g} s is not before the end of the data, T{end_s:+.1f} s", param_hint="--from"
        )


def _writable(path):
    if path.exists():
        raise typer.BadParameter(f"{path} exists already; choose another name", param_hint="--log")
    if not path.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {path.parent}", param_hint="--log")


def _show(summary):
    from rich.console import Console

    from shefex_nav.report import table

    Console(width=None if sys.stdout.isatty() else 100).print(table.summary_table(summary))
