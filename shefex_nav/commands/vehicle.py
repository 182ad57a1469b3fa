"""`shefex-nav vehicle`: the rocket of a scenario, drawn to scale and judged in its flight."""

from pathlib import Path

from shefex_nav.commands.flights import about, warn
from shefex_nav.commands.options import Json, Overrides, Scenario, bad, option
from shefex_nav.commands.output_files import check_file
from shefex_nav.commands.printing import print_json, say, stdout

ENDINGS = (".html", ".png")


def vehicle(
    scenario: Scenario,
    output: option(
        Path | None, "Write a page (.html), or figures (.png).", "--output", metavar="FILE"
    ) = None,
    force: option(bool, "Overwrite the file given with --output.", "--force") = False,
    overrides: Overrides = None,
    json: Json = False,
):
    """Show a rocket: drawing to scale, masses, stability, thrust and drag, and what to look at.

    It is flown once, without sensors. Warnings go to stderr: static margin below 1 calibre, a rail exit too
    slow for the wind, spin through the resonance with the pitch motion or beyond the range of the gyros.
    """
    from shefex_nav.report import vehicle as look
    from shefex_nav.report import vehicle_page
    from shefex_nav.scenario import load

    if output is not None:
        if output.suffix not in ENDINGS:
            raise bad("--output", f"{output} has to end in {' or '.join(ENDINGS)}")
    loaded = load.load(scenario, overrides or ())
    if output is not None:
        check_file(output, "--output", force=force, given=[name for name, _ in loaded.files])
    with about(scenario, loaded):
        looked = look.look(loaded)
    found = look.summary(looked)
    warn(loaded, look.warnings(looked))
    if json:
        print_json(found)
    else:
        stdout(120).print(vehicle_page.table(found))
    if output is not None:
        vehicle_page.write(output, looked, found)
        say(f"wrote {output}")
