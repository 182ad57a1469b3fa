"""`shefex-nav view`: logs in the rerun viewer, on screen, in a browser or in a file."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.commands.flights import say_if_cut, say_missing_plugins
from shefex_nav.commands.options import mission_time
from shefex_nav.commands.output_files import check_apart, check_file
from shefex_nav.commands.printing import say

THE_INPUT_SAYS = "-"  # in place of a log that is followed: its path comes when it is known

Page = Annotated[
    str,
    typer.Option(
        "--view",
        metavar="NAME",
        help="Page to open first: overview, mission, star-tracker, navigation, sensors.",
    ),
]


def view(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Logs of runs (MCAP), of killed runs too. The others are drawn over the first one.",
        ),
    ],
    page: Page = "overview",
    save: Annotated[Path | None, typer.Option(help="Write a rerun recording (.rrd). Do not open it.")] = None,
    screenshot: Annotated[
        Path | None, typer.Option(help="Write a PNG of the viewer. This needs no screen.")
    ] = None,
    at: Annotated[str | None, typer.Option(help="Mission time of the screenshot, e.g. 240s.")] = None,
    web: Annotated[
        bool, typer.Option("--web", help="Serve the viewer to a browser on this machine.")
    ] = False,
    follow: Annotated[
        bool, typer.Option("--follow", help="Show one log while it is written, from its first second on.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite the files of --save and --screenshot.")
    ] = False,
):
    """Open logs in the rerun viewer, with ready-made pages."""
    at_s = None if at is None else mission_time(at, "--at", "240s")
    if at is not None and screenshot is None:
        raise typer.BadParameter(
            f"{at} is the time of a picture; name it with --screenshot", param_hint="--at"
        )
    _check_together(web, follow, save or screenshot, logs)
    check_apart({"--save": save, "--screenshot": screenshot})
    for path, option, ending in ((save, "--save", ".rrd"), (screenshot, "--screenshot", ".png")):
        if path is not None:
            check_file(path, option, force=force, given=logs)
            _check_ending(path, option, ending)
    chosen = _page(page)
    from shefex_nav.report import viewer

    if follow:
        named = _named_by_the_input if str(logs[0]) == THE_INPUT_SAYS else lambda: (logs[0], 0)
        viewer.follow(named, page=chosen, web=web)
        return
    runs = viewer.view(logs, save=save, screenshot=screenshot, at_s=at_s, page=chosen, web=web)
    for log, data in zip(logs, runs, strict=True):
        say_if_cut(log, data)
        say_missing_plugins(log, data.mission.plugins)
    for written in (save, screenshot):
        if written is not None:
            say(f"wrote {written}")


def _named_by_the_input():
    """Path of the log that `run --live` is going to write, and `tail.Tail.old_ns`; None if it cannot."""
    old_ns, _, name = sys.stdin.buffer.read().partition(b"\n")
    return (Path(os.fsdecode(name)), int(old_ns)) if name else None


def _check_together(web, follow, written, logs):
    """Refuse options that do not go together. written : a file that --save or --screenshot names, or None"""
    if web and written:
        raise typer.BadParameter("does not go with --save or --screenshot", param_hint="--web")
    if follow and (written or len(logs) > 1):
        words = "shows one log in a window or a browser; it does not go with --save, --screenshot"
        raise typer.BadParameter(f"{words} or a second log", param_hint="--follow")


def _check_ending(path, option, ending):
    """Refuse a file whose name says that it is of another kind than what is written."""
    if path.suffix.lower() != ending:
        words = f"{path}: only {ending.removeprefix('.').upper()} is written; end its name in {ending}"
        raise typer.BadParameter(words, param_hint=option)


def _page(name):
    """The page of `layout.PAGES` that is meant by a name such as star-tracker, upper case or lower."""
    from shefex_nav.report.viewer import layout

    names = {page.lower().replace(" ", "-"): page for page in layout.PAGES}
    if name.lower() not in names:
        raise typer.BadParameter(f"{name!r} is no page; choose from: {', '.join(names)}", param_hint="--view")
    return names[name.lower()]
