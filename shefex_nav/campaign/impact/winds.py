"""In which winds a rocket may be launched: a table of go and no-go over the wind's speed and direction.

In: a scenario, speeds, and how far from its place each body may land. The wind is the same at all heights,
what ranges call a ballistic wind: a measured wind counts by the uniform one that carries the rocket as far.
Out: a `Cell` for each speed and direction. It is go if

- the flight can be, and each body comes down that does in still air;
- at the end of the rail the rocket is WIND_SHARE times as fast as the wind;
- each body that is followed lands no farther off its place than is allowed. Its place is where it lands in
  still air, of the body that is aimed the one that is aimed at.

With a place to aim at, the launcher is set anew in each wind (`aim`), as a launch crew does.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign.impact import aim, landing
from shefex_nav.prepare import earth_rotation
from shefex_nav.report import columns, track, vehicle
from shefex_nav.report.figures import style
from shefex_nav.scenario import load, soundings
from shefex_nav.workers import cores, each
from shefex_nav.world.flight.timeline import FlightError

DIRECTIONS = "N", "NE", "E", "SE", "S", "SW", "W", "NW"  # where it blows from, 45 deg apart
GO, NO = "go", "NO"
MOST_FIGURES = 7  # speeds: with more there is no room for figures in the picture
COLOURS = {True: "#9ecae1", False: "#f4a582"}  # go, no-go; told apart in grey, too


class Asked(NamedTuple):
    """What is asked."""

    scenario: str  # name or file
    overrides: tuple
    speeds: tuple  # m/s, increasing
    within: float  # m
    ground: float | None  # m above the ellipsoid; None: the height of the launcher
    place: tuple | None  # rad, latitude and longitude that a body is aimed at
    body: str | None  # which; None: what flies last
    seed: int
    workers: int | None  # None: one a core


class Down(NamedTuple):
    """A launch in one wind."""

    landings: tuple  # of landing.Landing
    azimuth: float  # rad, of the launcher
    elevation: float  # rad
    exit_speed: float  # m/s, at the end of the rail


class Reason(NamedTuple):
    """Why a wind is no go."""

    what: str
    figure: str = ""

    def __str__(self):
        return f"{self.what}: {self.figure}" if self.figure else self.what


class Cell(NamedTuple):
    """What becomes of a launch in one wind."""

    speed: float  # m/s
    whence: str  # of DIRECTIONS
    down: Down | None  # None: it cannot be flown, or not be aimed
    off: dict  # {body: m from its place}
    reasons: tuple  # of Reason; (): it is go


class Table(NamedTuple):
    """All of it."""

    name: str  # of the mission
    seed: int
    ground: float  # m above the ellipsoid
    within: float  # m
    place: tuple | None
    calm: Down
    unknown: tuple  # names of dropped stages whose drag is not described
    cells: tuple  # of Cell, direction by direction


def how_many(speeds):
    """Winds that are flown: int."""
    return len(DIRECTIONS) * len(speeds)


def study(asked, tell=lambda done, words: None):
    """Table of a scenario. ImpactError, FlightError if it cannot be launched in still air.

    tell : function of how many winds are flown, of `how_many`, and of words about it
    """
    own = load.load(asked.scenario, asked.overrides)
    ground = 0.0 if own.launch is None else own.launch.height
    ground = ground if asked.ground is None else asked.ground
    landing.check(own, ground)
    if asked.place is not None:
        aim.check(own, asked.body)
    first = asked.scenario, asked.overrides, asked.seed, ground, asked.place, asked.body
    calm, error = launch(*first, 0.0, DIRECTIONS[0])
    if calm is None:
        raise landing.ImpactError(f"in still air: {error}")
    calls = {
        (k, speed): (*first, speed, whence) for k, whence in enumerate(DIRECTIONS) for speed in asked.speeds
    }
    found = {}
    for key, one in _flown(calls, asked.workers):
        found[key] = one
        tell(len(found), f"{len(found)} of {len(calls)} winds flown")
    names = landing.followed(own)
    unknown = tuple(
        name for name, one in own.vehicle.stages.items() if one.separation is not None and name not in names
    )
    cells = tuple(_cell(asked, calm, DIRECTIONS[k], speed, *found[k, speed]) for k, speed in sorted(found))
    return Table(own.mission.name, asked.seed, ground, asked.within, asked.place, calm, unknown, cells)


def _flown(calls, workers):
    most = workers or min(cores(), len(calls))
    if most == 1:
        return ((key, launch(*call)) for key, call in calls.items())
    return each(launch, calls, most)


def launch(scenario, overrides, seed, ground, place, body, speed, whence):
    """Launch in one wind. -> Down, ''; None and the reason why it cannot be"""
    degrees = 45.0 * DIRECTIONS.index(whence)
    wind = soundings.Winds((0.0,), (speed,), (degrees,), "").override()
    own = load.load(scenario, (*overrides, wind))
    site = own.launch
    try:
        if place is not None:
            found = aim.aim(own, *place, seed, ground, body)
            site = site.model_copy(update={"azimuth": found.azimuth, "elevation": found.elevation})
        flown = own.with_sections(launch=site)
        landed = landing.land(flown, seed, ground, paths=False)
    except (FlightError, landing.ImpactError) as error:
        return None, str(error).splitlines()[0]
    exit_speed = vehicle.rail_exit_speed(landed.flight, earth_rotation(flown))
    return Down(landed.landings, site.azimuth, site.elevation, exit_speed), ""


def _cell(asked, calm, whence, speed, down, error):
    """Cell of a launch."""
    if down is None:
        return Cell(speed, whence, None, {}, (Reason(error),))
    places = {one.body: (one.latitude, one.longitude) for one in calm.landings}
    if asked.place is not None:
        places[asked.body or calm.landings[0].body] = asked.place
    landed = {one.body: (one.latitude, one.longitude) for one in down.landings}
    off = {body: track.ground_distance(*places[body], *landed[body]) for body in places if body in landed}
    reasons = [
        Reason(f"{body} off", f"{far / 1e3:.1f} km") for body, far in off.items() if far > asked.within
    ]
    reasons += [
        Reason(f"{body} lands in this wind, or in still air, alone") for body in {*places} ^ {*landed}
    ]
    if down.exit_speed < vehicle.WIND_SHARE * speed:
        angle = math.degrees(math.atan2(speed, down.exit_speed))
        reasons.append(Reason("angle of attack at the end of the rail", f"{angle:.0f} deg"))
    return Cell(speed, whence, down, off, tuple(reasons))


def most(table, whence):
    """Highest speed up to which every wind from a direction is go, m/s; None: not even the lowest is."""
    speeds = [None]
    for one in table.cells:
        if one.whence == whence:
            if one.reasons:
                break
            speeds.append(one.speed)
    return speeds[-1]


def summary(table):
    """Plain values, for JSON: degrees, metres, seconds."""
    return {
        "scenario": table.name, "seed": table.seed, "ground_m": table.ground, "within_m": table.within,
        "aim": table.place and landing.place(*table.place),
        "not_followed": list(table.unknown),
        "still_air": _down(table.calm),
        "up_to_m_s": {whence: most(table, whence) for whence in DIRECTIONS},
        "winds": [
            {
                "speed_m_s": one.speed, "from_deg": 45.0 * DIRECTIONS.index(one.whence),
                "go": not one.reasons, "reasons": [str(reason) for reason in one.reasons], "off_m": one.off,
                **(_down(one.down) if one.down is not None else {}),
            }
            for one in table.cells
        ],
    }  # fmt: skip


def _down(down):
    return {
        "azimuth_deg": math.degrees(down.azimuth) % 360.0,
        "elevation_deg": math.degrees(down.elevation),
        "rail_exit_speed_m_s": down.exit_speed,
        "landings": [
            {"body": one.body, **landing.place(one.latitude, one.longitude)} for one in down.landings
        ],
    }


def table(found):
    """rich Table of a winds.Table: a row for each speed, the farthest body of each wind."""
    from rich.text import Text

    by_wind = {(one.speed, one.whence): one for one in found.cells}
    speeds = sorted({one.speed for one in found.cells})
    heads = ("wind", *(f">from {whence}" for whence in DIRECTIONS))
    rows = [
        [f"{speed:g} m/s", *(_in_table(by_wind[speed, whence], Text) for whence in DIRECTIONS)]
        for speed in speeds
    ]
    limits = (most(found, whence) for whence in DIRECTIONS)
    rows.append(["go up to", *("-" if limit is None else f"{limit:g} m/s" for limit in limits)])
    title = f"{found.name}, seed {found.seed}: go within {found.within / 1e3:g} km of its place"
    return columns.table(title, heads, rows, no_wrap=True)


def _in_table(one, text):
    far = f" {max(one.off.values()) / 1e3:.1f} km" if one.off else ""
    return text(f"{NO if one.reasons else GO}{far}", style="bold yellow" if one.reasons else "")


def lines(found):
    """What one has to know to read the table."""
    yield (
        "A wind is the same at all heights (a ballistic wind), in place of the scenario's. The figure is how "
        "far off its place the farthest body lands."
    )
    if found.place is not None:
        tilts = [np.degrees(0.5 * np.pi - one.down.elevation) for one in found.cells if one.down is not None]
        if tilts:
            yield (
                f"The launcher is set anew in each wind, {min(tilts):.1f} to {max(tilts):.1f} deg from the "
                "vertical; --json has its azimuth and elevation."
            )
    for what in dict.fromkeys(reason.what for one in found.cells for reason in one.reasons):
        refused = [(one, reason) for one in found.cells for reason in one.reasons if reason.what == what]
        first, reason = min(refused, key=lambda pair: pair[0].speed)
        more = len(refused) - 1
        others = f", and in {more} more wind{'s' * (more > 1)}" if more else ""
        yield f"NO: {reason} ({first.speed:g} m/s from {first.whence}{others})"
    for name in found.unknown:
        yield f"{name} is not followed to the ground: vehicle.stages.{name}.spent gives no drag"


@style.styled
def compass(found):
    """Sectors of a compass, the wind's speed outwards: go or no-go, and how far off [km]. Figure"""
    figure = style.constrained(7.4, 7.6)
    axes = figure.add_subplot(projection="polar", theta_offset=0.5 * np.pi, theta_direction=-1)
    speeds = np.array(sorted({one.speed for one in found.cells}))
    edges = np.concatenate([[0.0], 0.5 * (speeds[1:] + speeds[:-1]), [speeds[-1]]])
    edges[-1] += speeds[-1] - edges[-2]
    for one in found.cells:
        k, angle = np.searchsorted(speeds, one.speed), 0.25 * np.pi * DIRECTIONS.index(one.whence)
        colour = COLOURS[not one.reasons]
        axes.bar(
            angle, edges[k + 1] - edges[k], width=0.25 * np.pi, bottom=edges[k], color=colour, ec="white"
        )
        if len(speeds) <= MOST_FIGURES:
            far = f"{max(one.off.values()) / 1e3:.1f}" if one.off else "not flown"
            axes.text(angle, one.speed, far, ha="center", va="center", fontsize=9)
    axes.set_xticks(0.25 * np.pi * np.arange(8), [f"from {whence}" for whence in DIRECTIONS])
    for speed in speeds[:: 1 + (len(speeds) - 1) // MOST_FIGURES]:
        box = {"fc": "white", "ec": "none", "pad": 1.0}
        axes.text(np.pi / 8.0, speed, f"{speed:g} m/s", ha="center", va="center", fontsize=8, bbox=box)
    axes.set_yticks([])
    axes.set_ylim(0.0, edges[-1])
    axes.tick_params(pad=10)
    axes.grid(False)
    for name, go in (("go", True), ("no-go", False)):
        axes.bar(0.0, 0.0, color=COLOURS[go], label=name)
    axes.legend(loc="upper left", bbox_to_anchor=(-0.12, 1.02), frameon=False)
    style.title(figure, f"{found.name}: how far off its place a body lands [km], by wind")
    return figure
