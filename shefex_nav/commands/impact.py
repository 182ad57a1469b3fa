"""`shefex-nav impact`: where a rocket and its stages land, and how the launcher is set for a wished place.

Exit codes: 0 done, 1 written, but a run of --runs failed or did not land (the table says which and why),
2 bad input, or a flight that cannot be.
"""

import math
from pathlib import Path

import typer

from shefex_nav.campaign import MOST_RUNS
from shefex_nav.commands.flights import about, warn_of_parts
from shefex_nav.commands.options import (
    DispersedScenario,
    Json,
    Overrides,
    RootSeed,
    Workers,
    bad,
    number,
    option,
)
from shefex_nav.commands.output_files import check_folder, make_folder
from shefex_nav.commands.printing import print_json, say, stdout

Runs = option(int, "Flights with the scenario's dispersions; 0: one as it is told.", min=0, max=MOST_RUNS)
Winds = option(
    list[Path] | None,
    "Wind of the day in place of the scenario's: sounding (Wyoming text or CSV) or Open-Meteo JSON. "
    "Several times: each, and the runs take them in turn.",
    metavar="FILE",
)
Ground = option(str | None, "Of the terrain above the ellipsoid; default: launch.height.", metavar="HEIGHT")
Wished = option(str | None, "Wished impact, degrees: find azimuth and elevation for it.", metavar="LAT,LON")
WishedOf = option(str | None, "What is to land there; default: what flies last.", metavar="STAGE")
Folder = option(Path | None, "Folder for figures, KML, GeoJSON and JSON.", metavar="DIR")
Overwrite = option(bool, "Overwrite such files in it, and take away those of another study.", "--force")


def impact(
    scenario: DispersedScenario,
    runs: Runs = 0,
    seed: RootSeed = 1,
    wind: Winds = None,
    ground: Ground = None,
    aim: Wished = None,
    aim_body: WishedOf = None,
    output: Folder = None,
    force: Overwrite = False,
    workers: Workers = None,
    overrides: Overrides = None,
    json: Json = False,
):
    """Follow a rocket and its dropped stages to the ground: places, ellipses, impact points over time.

    A stage is followed where `vehicle.stages.NAME.spent` says how the air brakes it.
    """
    from shefex_nav.campaign.impact import studying

    check_aim(aim, aim_body)
    place = None if aim is None else place_of(aim)
    _check_winds(wind or ())
    if output is not None:
        check_folder(output, studying.FILES, "--output", force=force, given=[scenario, *(wind or ())])
    asked = studying.Asked(
        scenario,
        tuple(overrides or ()),
        tuple(wind or ()),
        height(ground),
        runs,
        seed,
        workers,
        place,
        aim_body,
    )
    warn_of_parts(scenario, asked.overrides)
    with about(scenario):
        result = studying.study(asked, say)
    found = studying.outputs.summary(result)
    _show(found, json)
    if output is not None:
        make_folder(output, "--output")
        studying.write(output, result, found)
        say(f"wrote {output}")
    if found["failed"]:
        raise typer.Exit(1)


def _show(found, as_json):
    """The summary on stdout; stages that were not followed are told on stderr."""
    from shefex_nav.campaign.impact import outputs

    if as_json:
        print_json(found)
    else:
        stdout(130).print(outputs.table(found))
    for words in found["warnings"]:
        say(f"warning: {words}")
    for name in found["not_followed"]:
        say(f"warning: {name} is not followed to the ground: vehicle.stages.{name}.spent gives no drag")


def check_aim(aim, aim_body):
    """Refuse a body to be aimed without a place."""
    if aim_body is not None and aim is None:
        raise bad("--aim-body", "says what is aimed with --aim")


def height(text):
    from shefex_nav.commands.options import quantity

    return None if text is None else quantity(text, "m", "--ground", "360 m")


def place_of(text, option="--aim"):
    """(latitude, longitude), rad."""
    try:
        latitude, longitude = (number(part) for part in text.split(","))
    except ValueError:
        raise bad(option, f"{text!r} is no place; expected such as 68.4,20.9") from None
    if not (abs(latitude) < 90.0 and abs(longitude) <= 360.0):
        raise bad(option, f"{text} is no place on Earth")
    return math.radians(latitude), math.radians(longitude)


def _check_winds(files):
    for one in files:
        if one.is_dir() or not one.exists():
            words = f"{one} is a folder; give a file" if one.is_dir() else f"there is no file {one}"
            raise bad("--wind", words)
