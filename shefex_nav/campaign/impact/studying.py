"""Where a rocket lands, from what is asked to what is written."""

import json
import math
from typing import NamedTuple

from shefex_nav.campaign.impact import aim, ellipses, landing, outputs, scatter
from shefex_nav.files import put
from shefex_nav.scenario import load, sounding_checks, soundings
from shefex_nav.workers import cores

FILES = "impact.json", "impact.kml", "impact.geojson", "landings.json", "map.png", "landings.png"
RUNS_OF_A_WORKER = 10  # for fewer none is started


class Asked(NamedTuple):
    """What is asked."""

    scenario: str  # name or file
    overrides: tuple
    winds: tuple  # of files
    ground: float | None  # m above the ellipsoid; None: the height of the launcher
    runs: int
    seed: int
    workers: int | None  # None: one a core, if there is enough to do
    place: tuple | None  # rad, latitude and longitude of a wished impact
    body: str | None  # that is to land there; None: what flies last


def study(asked, tell=lambda words: None):
    """outputs.Result. tell : function of words about what is done"""
    own = load.load(asked.scenario, asked.overrides)
    ground = asked.ground
    if own.launch is not None and ground is None:
        ground = own.launch.height
    _check(own, asked, 0.0 if ground is None else ground)
    days = [file and soundings.read(file, own.mission.epoch) for file in asked.winds or (None,)]
    cases, aimed = [], []
    for file, winds in zip(asked.winds or (None,), days, strict=True):
        told, name = list(asked.overrides), "as the scenario says"
        if winds is not None:
            told, name = [*told, winds.override()], f"{file.name}: {winds.what}"
        case = load.load(asked.scenario, told)
        if asked.place is not None:
            found = aim.aim(case, *asked.place, asked.seed, ground, asked.body)
            angles = {"azimuth": found.azimuth, "elevation": found.elevation}
            told += [f"launch.{key}={math.degrees(value)!r} deg" for key, value in angles.items()]
            case = load.load(asked.scenario, told)
            aimed.append(found)
        cases.append(scatter.Case(name, case))
    landed = tuple(landing.land(case.scenario, asked.seed, ground) for case in cases)
    points = landing.impact_points(cases[0].scenario, landed[0], ground)
    found, shapes = None, ()
    if asked.runs:
        most = asked.workers or min(cores(), max(1, asked.runs // RUNS_OF_A_WORKER))
        found = scatter.scatter(cases, asked.runs, asked.seed, ground, most, tell)
        shapes = ellipses.of_bodies(found.landings)
    site = own.launch.latitude, own.launch.longitude
    warnings = tuple(
        f"{file.name} {words}"
        for file, winds in zip(asked.winds, days, strict=False)
        if winds.place and (words := sounding_checks.elsewhere(winds.place, tuple(map(math.degrees, site))))
    )
    return outputs.Result(
        own.mission.name, asked.seed, ground, site, tuple(cases), landed, tuple(aimed), points, found,
        shapes, asked.runs, warnings,
    )  # fmt: skip


def _check(scenario, asked, ground):
    """Refuse what cannot be studied, before anything is flown."""
    landing.check(scenario, ground)
    if asked.runs:
        scatter.check(scenario)
    if asked.place is not None:
        aim.check(scenario, asked.body)
    drawn = [name for name in scenario.dispersions if name.split(".")[0] == "wind"]
    if asked.winds and drawn:
        raise landing.ImpactError(
            f"{scenario.mission.name} draws its wind ({', '.join(f'dispersions.{name}' for name in drawn)}), "
            "and --wind puts that of a day in its place, which is not drawn; leave out one of them"
        )


def write(folder, result, found):
    """Write figures, KML, GeoJSON and JSON into a folder, and take away the FILES of another study.

    found : outputs.summary of the Result
    """
    from shefex_nav.campaign.impact import figures
    from shefex_nav.report.figures import style

    put(folder / "impact.json", json.dumps(found, allow_nan=False, indent=1) + "\n")
    put(folder / "impact.kml", outputs.kml(result))
    put(folder / "impact.geojson", outputs.geojson(result))
    if result.scattered is not None:
        put(folder / "landings.json", outputs.samples(result))
    drawn = figures.draw(result)
    for name, figure in drawn.items():
        style.save(figure, folder / f"{name}.png")
    written = {"impact.json", "impact.kml", "impact.geojson", *(f"{name}.png" for name in drawn)}
    written |= {"landings.json"} if result.scattered is not None else set()
    for name in set(FILES) - written:
        (folder / name).unlink(missing_ok=True)
