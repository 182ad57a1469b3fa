"""`shefex-nav verify`: fly check-cases that others have published, and compare; errors over their bound and
over what the filter says of them.
"""

import typer

from shefex_nav.commands.refusal import TRUST_HELP, NumbersGroup
from shefex_nav.commands.verify_bound import bound
from shefex_nav.commands.verify_consistency import consistency
from shefex_nav.commands.verify_nesc import nesc
from shefex_nav.commands.verify_robustness import robustness

app = typer.Typer(
    cls=NumbersGroup,
    help="Compare flights with published check-cases, and navigation with what is possible.",
    no_args_is_help=True,
)
app.command(epilog=TRUST_HELP)(bound)
app.command(epilog=TRUST_HELP)(consistency)
app.command(epilog=TRUST_HELP)(robustness)
app.command()(nesc)


@app.callback()
def verify():
    """Compare flights with published check-cases, and navigation with what is possible."""
