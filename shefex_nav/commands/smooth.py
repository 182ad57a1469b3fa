"""`shefex-nav smooth`: the best-estimate trajectory of a flight, from its log.

Exit codes: 0 done, 2 a log that cannot be smoothed or bad input.
"""

import time
from pathlib import Path

from shefex_nav.commands import options
from shefex_nav.commands.flights import kept
from shefex_nav.commands.options import Json, Log, bad, option
from shefex_nav.commands.output_files import check_place, is_same
from shefex_nav.commands.printing import print_json, say, stdout
from shefex_nav.progress import bar

SUFFIX = ".smoothed.mcap"


def smooth(
    log: Log,
    out: option(Path | None, "Log to write; default <log>.smoothed.mcap.") = None,
    overrides: options.overrides("Configure the filter otherwise: navigation.<key>=value.") = None,
    force: option(bool, "Overwrite the file that is written.", "--force") = False,
    json: Json = False,
):
    """Smooth a flight after it is over: every estimate from all its measurements, later ones too."""
    path = log.with_suffix(SUFFIX) if out is None else out
    _check(log, path, "LOG" if out is None else "--out", force=force)
    from shefex_nav.replay import rerun

    recording = rerun.open_log(log, overrides or ())
    if recording.own is not None:
        words = f"{log}: was flown by software of your own, the smoother is of the built-in filter"
        raise rerun.LogError(f"{words}; --set navigation.software=built_in smooths that")
    data = recording.data
    if data.ended_early:
        say(f"{log}: the run ended early, at T{data.reached_s:+.2f} s; it is smoothed up to then")
    from shefex_nav import warmup
    from shefex_nav.replay import smooth as smoother
    from shefex_nav.replay import smoothed
    from shefex_nav.report import local_level

    warmup.get_ready({"command=smooth"})
    began = time.perf_counter()
    result = _with_bar(lambda progress: smoother.run(recording, progress))
    wall_s = time.perf_counter() - began
    with kept(path, "smoothed"):
        smoothed.write(path, recording, result.smoothed, wall_s, overwrite=force)
    summary = smoothed.summarise(log, path, result, wall_s)
    if json:
        print_json(summary)
    else:
        _show(summary, local_level.title(data))


def _check(log, path, option, *, force):
    """Refuse an output file that would be lost or cannot be written, before anything is computed."""
    if is_same(path, log):
        raise bad(option, f"{path} is the log itself; choose another name with --out")
    check_place(path, option, force=force, instead="choose another name with --out or add --force")


def _with_bar(work):
    """Result of a function of a progress function; a bar on stderr while it works."""
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

    from shefex_nav.replay.smooth import FILTER_SHARE

    columns = TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with bar(*columns) as progress:
        task = progress.add_task("filter", total=1.0)

        def show(share):
            description = "filter" if share < FILTER_SHARE else "smoother"
            progress.update(task, completed=share, description=description)

        return work(show)


def _show(summary, title):
    """The result as people read it."""
    from shefex_nav.replay import smoothed

    console = stdout(100, highlight=False)
    if summary["parts"] is None:
        console.print("There is no truth in the log to compare with.")
    else:
        console.print(smoothed.table(summary, title))
        if sure := smoothed.too_sure(summary["parts"]):
            console.print(sure, markup=False, soft_wrap=True)
    factor = f"{summary['wall_s']:.1f} s, {summary['real_time_factor']:.0f} x real time"
    console.print(f"{summary['smoothed']}, smoothed in {factor}", markup=False, soft_wrap=True)
