"""`shefex-nav winds`: in which winds a rocket may be launched.

Exit codes: 0 done, whatever the winds, 2 bad input, or a flight that cannot be in still air.
"""

from pathlib import Path

from shefex_nav.commands.flights import about, warn_of_parts
from shefex_nav.commands.impact import Ground, WishedOf, check_aim, height, place_of
from shefex_nav.commands.options import (
    Json,
    Overrides,
    OverwriteFigure,
    Scenario,
    Seed,
    Workers,
    option,
    quantity,
)
from shefex_nav.commands.output_files import check_picture
from shefex_nav.commands.printing import print_json, say, stdout
from shefex_nav.progress import lines

Within = option(str, "How far off its place a body may land, e.g. '20 km'.", metavar="DISTANCE")
Speeds = option(str, "Winds to try.", metavar="A,B,C")
Wished = option(str | None, "Set the launcher in each wind so that a body lands here.", metavar="LAT,LON")
Picture = option(Path | None, "Draw a compass into a .png or .svg file.")


def winds(
    scenario: Scenario,
    within: Within,
    speeds: Speeds = "2,4,6,8,10 m/s",
    aim: Wished = None,
    aim_body: WishedOf = None,
    ground: Ground = None,
    overrides: Overrides = None,
    seed: Seed = 1,
    workers: Workers = None,
    figure: Picture = None,
    force: OverwriteFigure = False,
    json: Json = False,
):
    """Say in which winds a rocket may be launched: go or no-go over the wind's speed and direction.

    Go is a wind in which each body lands near its place, that of still air or the one of --aim, and in which
    the rocket leaves the rail four times as fast as the wind.
    """
    check_aim(aim, aim_body)
    if figure is not None:
        check_picture(figure, "--figure", force=force)
    far = quantity(within, "m", "--within", "20 km", positive=True)
    tried = _speeds(speeds)
    from shefex_nav.campaign.impact import winds as study

    place = None if aim is None else place_of(aim)
    asked = study.Asked(
        scenario, tuple(overrides or ()), tried, far, height(ground), place, aim_body, seed, workers
    )
    warn_of_parts(scenario, asked.overrides)
    with about(scenario):
        found = study.study(asked, lines(study.how_many(tried), say))
    if json:
        print_json(study.summary(found))
    else:
        stdout(130).print(study.table(found))
        for line in study.lines(found):
            stdout(130).print(f"  {line}")
    if figure is not None:
        from shefex_nav.report.figures import style

        style.save(study.compass(found), figure)
        say(f"wrote {figure}")


def _speeds(text):
    """Speeds of the wind, m/s, increasing; the unit stands once, at the end, or with each."""
    parts = [part.strip() for part in text.split(",")]
    unit = parts[-1].lstrip("0123456789.+-eE ")
    with_units = (part if part[-1:].isalpha() else f"{part} {unit}".strip() for part in parts)
    speeds = sorted({quantity(part, "m/s", "--speeds", "4 m/s", positive=True) for part in with_units})
    return tuple(speeds)
