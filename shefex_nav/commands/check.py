"""`shefex-nav check`: is a scenario file good, and does it fit its flight?"""

from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.commands.flights import about, warn
from shefex_nav.commands.options import Overrides, Scenario
from shefex_nav.commands.printing import say, stdout


def check(
    scenario: Scenario,
    overrides: Overrides = None,
    against: Annotated[
        Path | None,
        typer.Option(help="List each value that differs from a campaign's folder, a log or a scenario."),
    ] = None,
):
    """Check a scenario file; all its errors at once, with line and column.

    A vehicle that is launched is flown, without its sensors: times that do not fit the flight are told, and
    errors of the IMU that last in it but are noise to the filter.
    """
    from shefex_nav.scenario import aboard, load, starlight, surroundings, told

    loaded, differences = load.load(scenario, overrides or ()), []
    if against is not None:
        from shefex_nav.campaign import against as other

        differences = other.lines(loaded, against)
    from shefex_nav import prepare
    from shefex_nav.report import programme

    with about(scenario, loaded):
        aboard.check_own_blocks(loaded)
        surroundings.check(loaded)
        loaded, effects = prepare.settled_with_effects(loaded)
        found = programme.foreseen(loaded)
    warn(loaded, found)
    count = f", with {len(found)} warning{'s' if found[1:] else ''}" if found else ""
    for line in told.lines(loaded):
        say(f"told otherwise: {line}")
    if light := starlight.of_section(loaded.star_camera):
        say(f"star_camera.optics.zero_magnitude_flux: {light.words()}")
    typer.echo(f"{scenario}: good{count}")
    if effects:
        from shefex_nav.report import states

        stdout(130).print(states.table(effects))
    for line in differences:
        typer.echo(line)
