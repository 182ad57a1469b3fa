"""`shefex-nav run`: fly a scenario once."""

import math
import os
import subprocess
from contextlib import suppress
from pathlib import Path

import typer

from shefex_nav import children
from shefex_nav.commands.flights import about, kept, object_of_failed, show_run, warn, watched, written
from shefex_nav.commands.options import (
    Json,
    Overrides,
    OverwriteOut,
    Scenario,
    Seed,
    Until,
    bad,
    mission_time,
    option,
)
from shefex_nav.commands.output_files import OR_FORCE, check_file, not_made_meanwhile
from shefex_nav.commands.printing import say
from shefex_nav.commands.view import THE_INPUT_SAYS


def run(
    scenario: Scenario,
    seed: Seed = 1,
    out: option(Path | None, "Log file. Default: logs/<scenario>-seed<seed>.mcap.") = None,
    overrides: Overrides = None,
    until: Until = None,
    pace: option(
        float | None, "Mission time over real time: 1 is real time. Default: as fast as possible."
    ) = None,
    live: option(bool, "Open the viewer at once and show the flight while it is flown.", "--live") = False,
    force: OverwriteOut = False,
    json: Json = False,
):
    """Fly a scenario: simulate, navigate, log, and print the results."""
    viewer = _viewer() if live else None  # it imports its own while this process does
    from shefex_nav.log import thinning
    from shefex_nav.scenario import load

    until_s = math.inf if until is None else mission_time(until, "--until", "240s")
    _check_pace(pace)
    loaded = load.load(scenario, overrides or ())
    _check_until(until, until_s, loaded.mission.start, thinning.earliest_end(loaded.mission.start))
    path, earlier = (out, None) if out else _free_name(loaded.mission.name, seed)
    check_file(path, "--out", force=force, given=[name for name, _ in loaded.files])
    if viewer is not None:
        _show(viewer, path)
    from shefex_nav import runs

    say(f"{loaded.mission.name}, seed {seed} -> {path}")
    if earlier:
        say(f"{earlier} is of an earlier run and stays as it is")
    once = not_made_meanwhile(path, "--out", OR_FORCE)
    with about(scenario, loaded), kept(path, "flown"), object_of_failed(path, json), once:
        flown = runs.fly(
            loaded,
            seed,
            until_s=until_s,
            log=path,
            overwrite=force,
            pace=pace,
            watch=watched,
            told=lambda warnings: warn(loaded, warnings),
        )
    if until is not None and flown.data.until_s is None:
        say(f"--until {until}: the mission was over before, at T{flown.data.last_t_s:+.2f} s")
    show_run(flown.summary(), json, flown.data, flown.scenario)


def _check_pace(pace):
    """BadParameter for a pace at which nothing can fly; None: as fast as it goes."""
    from shefex_nav.pacing import SLOWEST

    if pace is not None and not SLOWEST <= pace < math.inf:
        words = f"{pace:g} is no pace: mission time over real time, from {SLOWEST:g} on; 1 is real time"
        raise bad("--pace", words)


def _check_until(until, until_s, start_s, earliest_s):
    """Refuse an end before there is something to see. until : as it was written"""
    if not until_s >= earliest_s:
        words = (
            f"{until} is not after the start of the mission, T{start_s:+g} s: "
            f"from {earliest_s:g} s on there is something to see"
        )
        raise bad("--until", words)


def _viewer():
    """A process that is going to show a log while it is written; it stays when the flight is over.

    It opens nothing until `_show` tells it which, and ends if this process does so before.
    """
    command, environment = children.of_module("shefex_nav", "view", THE_INPUT_SAYS, "--follow")
    return subprocess.Popen(command, stdin=subprocess.PIPE, env=environment, start_new_session=True)


def _show(viewer, log):
    """Tell a `_viewer` the path of the log, as `view` reads it."""
    with suppress(BrokenPipeError), viewer.stdin as pipe:  # one that has ended has said why
        pipe.write(b"%d\n%b" % (written(log) or 0, os.fsencode(log)))


def _free_name(name, seed):
    """First unused path logs/<name>-seed<seed>[-<n>].mcap, and the last used one or None."""
    path, n, earlier = Path("logs") / f"{name}-seed{seed}.mcap", 1, None
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise typer.BadParameter(f"cannot make the folder {path.parent}: {error.strerror}") from None
    while path.exists():
        n += 1
        earlier, path = path, path.with_name(f"{name}-seed{seed}-{n}.mcap")
    return path, earlier
