"""`shefex-nav view`: logs in the rerun viewer, on screen, in a browser or in a file."""

import os
import sys
from pathlib import Path

from shefex_nav.commands.flights import say_if_cut, say_missing_plugins
from shefex_nav.commands.options import argument, bad, mission_time, option
from shefex_nav.commands.output_files import check_apart, check_file
from shefex_nav.commands.printing import say

THE_INPUT_SAYS = "-"  # in place of a log that is followed: its path comes when it is known

Page = option(
    str, "Page to open first: overview, mission, star-tracker, navigation, sensors.", "--view", metavar="NAME"
)


def view(
    logs: argument(
        list[Path],
        "Logs of runs (MCAP), of killed runs too. The others are drawn over the first one.",
        metavar="LOG...",
    ),
    page: Page = "overview",
    save: option(Path | None, "Write a rerun recording (.rrd). Do not open it.") = None,
    screenshot: option(Path | None, "Write a PNG of the viewer. This needs no screen.") = None,
    at: option(str | None, "Mission time of the screenshot, e.g. 240s.") = None,
    web: option(bool, "Serve the viewer to a browser on this machine.", "--web") = False,
    follow: option(bool, "Show one log while it is written, from its first second on.", "--follow") = False,
    force: option(bool, "Overwrite the files of --save and --screenshot.", "--force") = False,
):
    """Open logs in the rerun viewer, with ready-made pages."""
    at_s = None if at is None else mission_time(at, "--at", "240s")
    if at is not None and screenshot is None:
        raise bad("--at", f"{at} is the time of a picture; name it with --screenshot")
    _check_together(web, follow, save or screenshot, logs)
    check_apart({"--save": save, "--screenshot": screenshot})
    for path, flag, ending in ((save, "--save", ".rrd"), (screenshot, "--screenshot", ".png")):
        if path is not None:
            check_file(path, flag, force=force, given=logs)
            _check_ending(path, flag, ending)
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
        raise bad("--web", "does not go with --save or --screenshot")
    if follow and (written or len(logs) > 1):
        words = "shows one log in a window or a browser; it does not go with --save, --screenshot"
        raise bad("--follow", f"{words} or a second log")


def _check_ending(path, option, ending):
    """Refuse a file whose name says that it is of another kind than what is written."""
    if path.suffix.lower() != ending:
        words = f"{path}: only {ending.removeprefix('.').upper()} is written; end its name in {ending}"
        raise bad(option, words)


def _page(name):
    """The page of `layout.PAGES` that is meant by a name such as star-tracker, upper case or lower."""
    from shefex_nav.report.viewer import layout

    names = {page.lower().replace(" ", "-"): page for page in layout.PAGES}
    if name.lower() not in names:
        raise bad("--view", f"{name!r} is no page; choose from: {', '.join(names)}")
    return names[name.lower()]
