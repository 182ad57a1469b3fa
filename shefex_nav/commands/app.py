"""The command line: all commands, and what runs them; a process of it begins in `commands.main`.

Results go to stdout, progress and messages to stderr. Exit codes: 0 done, 2 bad input (one clear message,
nothing written), 3 software of the user's own failed in flight and 1 an internal fault (traceback, and the
log up to that moment stays readable), 130 interrupted.

Commands import late what they need: the command line starts without it.
"""

import os
import sys
import threading

import typer

from shefex_nav.commands import shell
from shefex_nav.commands.budget import budget
from shefex_nav.commands.calibrate import calibrate
from shefex_nav.commands.campaign import campaign
from shefex_nav.commands.characterise import characterise
from shefex_nav.commands.check import check
from shefex_nav.commands.compare import compare
from shefex_nav.commands.export import export
from shefex_nav.commands.impact import impact
from shefex_nav.commands.instruments import instruments
from shefex_nav.commands.new import new
from shefex_nav.commands.options import option
from shefex_nav.commands.printing import Closed, forgiving, tell
from shefex_nav.commands.rare import rare
from shefex_nav.commands.refusal import PROGRAM, TRUST_HELP, PlainGroup
from shefex_nav.commands.repeat import repeat
from shefex_nav.commands.replay import replay
from shefex_nav.commands.report import report
from shefex_nav.commands.reproduce import ListingCommand, reproduce
from shefex_nav.commands.run import run
from shefex_nav.commands.scenarios import scenarios
from shefex_nav.commands.schema import schema
from shefex_nav.commands.show import show
from shefex_nav.commands.smooth import smooth
from shefex_nav.commands.solve import solve
from shefex_nav.commands.trade import trade
from shefex_nav.commands.vehicle import vehicle
from shefex_nav.commands.verify import app as verify_app
from shefex_nav.commands.view import view
from shefex_nav.commands.warmup import warmup
from shefex_nav.commands.winds import winds
from shefex_nav.ending import end_quickly, search_seldom, without_folders_of_astropy

COMMANDS = (  # in the order of the help
    solve, calibrate, characterise, replay, smooth, campaign, trade, compare, budget, repeat, export,
    scenarios, instruments, new, warmup, run, report, view, show, check, vehicle, impact, winds, rare, schema,
)  # fmt: skip
PLAIN = scenarios, instruments, new, schema  # which run no code of a scenario
app = typer.Typer(
    name="shefex-nav",
    cls=PlainGroup,
    help="Hybrid INS/GPS/star-tracker navigation simulator for sounding rockets and small satellites. "
    f"In every command, {TRUST_HELP}",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
app.command(cls=ListingCommand)(reproduce)
for one in COMMANDS:
    app.command(epilog=None if one in PLAIN else TRUST_HELP)(one)
app.add_typer(verify_app, name="verify")


def _version(wanted):
    """Print the version and end."""
    if wanted:
        from shefex_nav import __version__

        typer.echo(f"{PROGRAM} {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: option(
        bool, "Print the version and end.", "--version", callback=_version, is_eager=True
    ) = False,
):
    shell.check()  # typer calls this before a command
    shell.check_memory()


def main():
    """Run the command of `sys.argv`; `refusal.PlainGroup` makes bad input one message and exit code 2."""
    if sys.stderr is None:  # closed by who started this
        sys.stderr = open(os.devnull, "w", encoding="utf-8")
    if sys.stdout is None:
        sys.stdout = Closed()
    sys.stderr = forgiving(sys.stderr)
    search_seldom()
    end_quickly()
    without_folders_of_astropy()
    try:
        app()
    finally:
        _tell_threads()


def _tell_threads():
    """Say which threads Python waits for now: those that code of a user's own has not ended."""
    running = (one for one in threading.enumerate() if one is not threading.main_thread() and not one.daemon)
    if names := ", ".join(one.name for one in running):
        tell(f"done; waiting for threads that own software has not ended: {names}")
