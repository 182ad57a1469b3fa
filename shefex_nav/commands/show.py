"""`shefex-nav show`: the star camera's frames on a screen, for a camera on a test bench."""

import tempfile
from contextlib import contextmanager
from pathlib import Path

import typer

from shefex_nav.commands.flights import about, watched
from shefex_nav.commands.options import argument, bad, option, quantity, seed_of_log
from shefex_nav.commands.printing import say, stdout
from shefex_nav.log.mcap_file import is_log

FIRST_SEED = 1  # as of `shefex-nav run`


def show(
    source: argument(
        str, "Log of a run (MCAP), or a scenario, which is flown first.", metavar="LOG|SCENARIO"
    ),
    display: option(bool, "Show them: serve the screen to a browser on this machine.", "--display") = False,
    seed: option(
        int | None, "Seed of a scenario that is flown; default 1.", min=0, callback=seed_of_log
    ) = None,
    collimator: option(
        str | None,
        "Focal length of the collimator, or distance of the screen, e.g. '500 mm'.",
        metavar="LENGTH",
    ) = None,
    dot_pitch: option(
        str | None, "From one dot of the screen to the next, e.g. '0.1 mm'.", metavar="LENGTH"
    ) = None,
    gamma: option(float, "Of the screen: its light goes with the code to this power.") = 2.2,
    white: option(
        float | None, "Grey value shown with all light; default: the largest one.", metavar="DN"
    ) = None,
    pace: option(float, "Mission time over real time.") = 1.0,
    port: option(int, "Of the page; 0: one that is free.", min=0, max=65535) = 0,
):
    """Show the star camera's frames on a screen, true to angle, for a camera on a test bench."""
    if (collimator is None) != (dot_pitch is None):
        raise typer.BadParameter("--collimator and --dot-pitch go together: both give the angle of a dot")
    for flag, value in (("--gamma", gamma), ("--white", white), ("--pace", pace)):
        if value is not None and not 0.0 < value < float("inf"):
            raise bad(flag, f"{value:g} is not above 0")
    lengths = None if collimator is None else _lengths(collimator, dot_pitch)
    of_log = is_log(Path(source))
    if of_log and seed is not None:
        raise bad("--seed", "a log has its own; give the scenario in its place")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(source) if of_log else _flown(source, FIRST_SEED if seed is None else seed, Path(folder))
        with _called(log, source):
            _show(log, lengths, (gamma, white), pace, port if display else None)


@contextmanager
def _called(log, source):
    """What is wrong with a log is told of what the user has given: that of a scenario is gone afterwards."""
    from shefex_nav.log.topics import LogError

    try:
        yield
    except LogError as error:
        raise LogError(str(error).replace(str(log), source)) from None


def _lengths(collimator, dot_pitch):
    """Metres of both options."""
    return (
        quantity(collimator, "m", "--collimator", "500 mm", positive=True),
        quantity(dot_pitch, "m", "--dot-pitch", "0.1 mm", positive=True),
    )


def _flown(scenario, seed, folder):
    """Log of a flight of a scenario."""
    from shefex_nav import runs
    from shefex_nav.scenario import load

    log = folder / "run.mcap"
    with about(scenario):
        runs.fly(load.load(scenario), seed, log=log, watch=watched)
    return log


def _show(log, lengths, light, pace, port):
    """Say what is to be seen, and serve it.

    lengths : of collimator and dots [m], None: a dot a pixel;  light : gamma, white [DN] or None
    port : None: it is not served
    """
    from shefex_nav.log import reader
    from shefex_nav.report.display import server
    from shefex_nav.report.display.player import Display, Player, dots_per_pixel

    data, (gamma, white) = reader.read(log), light
    camera = data.mission.camera
    dots = 1.0 if lengths is None else dots_per_pixel(camera.focal_length_px, *lengths)
    if white is None:
        white = 2.0 ** float(data.frames.bits[0]) - 1.0 if len(data.frames.bits) else 255.0
    player = Player(log, data, Display(dots, gamma, white))
    stdout(100).print(_table(player, camera, dots, gamma, white, lengths is not None))
    if port is None:
        say("--display shows them")
        return
    try:
        page = server.server(player, pace, port)
    except OSError as error:
        raise bad("--port", f"{port} cannot be had: {error.strerror}") from None
    say(f"open http://{page.server_address[0]}:{page.server_address[1]} on the screen; Ctrl-C ends it")
    with page:
        page.serve_forever()


def _table(player, camera, dots, gamma, white, is_true):
    """What is to be seen, a rich Table."""
    from rich.table import Table

    times_s, sizes = player.times_s(), [round(n * dots) for n in (camera.width_px, camera.height_px)]
    table = Table(show_header=False)
    table.add_row("frames", f"{len(times_s)}, T{times_s[0]:+.2f} to T{times_s[-1]:+.2f} s")
    if player.noisy:
        words = f"as read out in {player.noisy}, with the noise of the simulated camera; zero in the others"
        table.add_row("background", words)
    table.add_row("screen wanted", f"{sizes[0]} x {sizes[1]} dots, {dots:.4g} a pixel of the camera")
    angle = (
        "true to angle"
        if is_true
        else "not true to angle: --collimator and --dot-pitch say the angle of a dot"
    )
    table.add_row("angles", angle)
    table.add_row("light", f"(code / 255)^{gamma:g}, all of it at {white:g} DN")
    return table
