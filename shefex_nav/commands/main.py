"""The command line: all commands, and the entry point.

Results go to stdout, progress and messages to stderr. Exit codes: 0 done, 2 bad input (one clear message,
nothing written), 3 software of the user's own failed in flight and 1 an internal fault (traceback, and the
log up to that moment stays readable), 130 interrupted.

Commands import late what they need: the command line starts without it.
"""

import sys

import typer

from shefex_nav.commands.campaign import campaign
from shefex_nav.commands.characterise import characterise
from shefex_nav.commands.check import check
from shefex_nav.commands.compare import compare
from shefex_nav.commands.export import export
from shefex_nav.commands.new import new
from shefex_nav.commands.refusal import PlainGroup
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
from shefex_nav.commands.verify import app as verify_app
from shefex_nav.commands.view import view
from shefex_nav.commands.warmup import warmup
from shefex_nav.ending import end_quickly, search_seldom

app = typer.Typer(
    name="shefex-nav",
    cls=PlainGroup,
    help="Hybrid INS/GPS/star-tracker navigation simulator for sounding rockets and small satellites. "
    "--trust, with any command, is consent to run the code that a scenario names.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
app.command(cls=ListingCommand)(reproduce)
app.command()(solve)
app.command()(characterise)
app.command()(replay)
app.command()(smooth)
app.command()(campaign)
app.command()(compare)
app.command()(repeat)
app.command()(export)
app.command()(scenarios)
app.command()(new)
app.command()(warmup)
app.command()(run)
app.command()(report)
app.command()(view)
app.command()(show)
app.command()(check)
app.command()(schema)
app.add_typer(verify_app, name="verify")


def main():
    """Entry point; `refusal.PlainGroup` turns bad input into one message and exit code 2."""
    search_seldom()
    end_quickly()
    try:
        app()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
