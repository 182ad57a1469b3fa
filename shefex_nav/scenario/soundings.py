"""Winds of the day from files as weather services give them -> the table of wind of a scenario.

Read are soundings of the University of Wyoming, its text list and its CSV, or any CSV whose columns are named
likewise, and answers of Open-Meteo with winds at pressure levels (JSON). Units are those that the file names;
what has none, or one that is not known, is refused. Heights are above mean sea level, directions those from
which the wind comes; headings that say otherwise are refused. Heights that are called geopotential, or HGHT,
or are in gpm, become geometric, z = R h / (R - h) with R = 6356.766 km (US Standard Atmosphere 1976). They
count as heights above the ellipsoid: the geoid, up to 110 m off, is not known.
"""

import csv
import math
import re
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from shefex_nav.errors import UserError
from shefex_nav.files import from_json
from shefex_nav.numerals import is_number, number
from shefex_nav.scenario import sounding_checks
from shefex_nav.scenario.files import LARGEST_DATA, Unreadable, read_text

RADIUS = 6356766.0  # m
APART = 50.0  # m; rows that are closer to the one before are left out
FARTHEST_ZONE_S = 18 * 3600.0  # of any place from UTC
LARGEST = 1e9  # of any number of a level, whatever its unit
MISSING = {"", "nan", "na", "n/a", "null", "none", "m", "mm", "missing"}  # of a value that was not measured
NEAREST = timedelta(minutes=90)  # of an hour of a forecast to lift-off
LOWEST, HIGHEST = -1e3, 100e3  # m, of what is a height of a wind that was measured or forecast
WANTED = {
    "height": ("height", "hght"),
    "direction": ("direction", "drct"),
    "speed": ("wind speed", "sknt", "sped"),
}
UNITS = {  # in m, deg, m/s
    "height": {"m": 1.0, "gpm": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0}
    | {"km": 1e3, "dam": 10.0, "ft": 0.3048, "feet": 0.3048, "foot": 0.3048},
    "direction": {"deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "rad": math.degrees(1.0)},
    "speed": {"m/s": 1.0, "ms": 1.0, "kt": 1852 / 3600, "kn": 1852 / 3600, "knot": 1852 / 3600}
    | {"knots": 1852 / 3600, "kts": 1852 / 3600, "km/h": 1 / 3.6, "mph": 0.44704, "mp/h": 0.44704},
}
FORECAST = "geopotential_height", "wind_direction", "wind_speed"  # of height, direction, speed
BESIDE = {  # what is looked at if a file tells it in a unit that is known: names, and units in hPa, C, deg
    "pressure": (("pressure", "pres"), {"hpa": 1.0, "mb": 1.0, "mbar": 1.0, "pa": 0.01, "kpa": 10.0}),
    "temperature": (("temperature", "temp"), {"c": 1.0, "degc": 1.0, "°c": 1.0, "celsius": 1.0}),
    "latitude": (("latitude", "lat"), {"": 1.0, "deg": 1.0, "degrees": 1.0, "°": 1.0}),
    "longitude": (("longitude", "lon"), {"": 1.0, "deg": 1.0, "degrees": 1.0, "°": 1.0}),
}
STATION = re.compile(r"Station (latitude|longitude):\s*(\S+)", re.ASCII)  # below a list of Wyoming
NEGATIVE = -9999.0, -8888.0, -999.0  # marks of a value that was not measured
NOT_TOLD = *NEGATIVE, 9999.0, 99999.0  # of what is only looked at
BEGINS = re.compile(r"\s*-?[0-9]")  # of a row of a list
LIKE_ROW = re.compile(r"\s*-?[0-9.]+(?:\s+-?[0-9.]+){2}")  # three numbers at least
BARE = {"hght": "m", "drct": "deg", "sknt": "knot"}  # columns of Wyoming, whose name tells the unit
HEAD = re.compile(
    r"(?P<name>.*[^\s_(\[])[\s_]*(?:[(\[](?P<inside>[^)\]]*)[)\]]|(?<=[\s_])(?P<last>[^\s_()\[\]]+))$"
)
JSON = re.compile(r"\s*(\{|\[\s*[{\]])")  # an answer, or a list of some
LEVEL = re.compile(r"wind_speed_([0-9]{1,5})hPa$")


class SoundingError(UserError):
    """A file of winds cannot be read; the message says what is wrong with it."""


class Winds(NamedTuple):
    """Winds over the height, n rows, heights increasing."""

    height: tuple  # m
    speed: tuple  # m/s
    whence: tuple  # deg, where it blows from
    what: str  # for people
    place: tuple | None = None  # deg, latitude and longitude, if the file tells them

    def override(self):
        """The text of a --set that puts these winds in place of a scenario's."""
        columns = (("height", self.height, "m"), ("speed", self.speed, "m/s"), ("from", self.whence, "deg"))
        told = (f"{name}: [{', '.join(f'{v:.6g} {unit}' for v in values)}]" for name, values, unit in columns)
        return f"wind={{{', '.join(told)}}}"


def read(path, epoch):
    """Winds of a file. epoch : UTC of lift-off, ISO 8601, for which a forecast is looked up"""
    try:
        text = read_text(path, "winds", LARGEST_DATA, errors="replace")
    except Unreadable as error:
        raise SoundingError(f"{path} {error}") from None
    if JSON.match(text):
        rows, what, place = _open_meteo(path, text, epoch)
    elif "PRES" in text and "HGHT" in text and "," not in _line_with(text, "HGHT"):
        (rows, place), what = _wyoming_list(path, text), "sounding"
    else:
        (rows, place), what = _columns(path, text), "sounding"
    return _winds(path, rows, what)._replace(place=place)


class _Row(NamedTuple):
    """A level of a file."""

    height: float  # m, geometric, above mean sea level
    speed: float  # m/s
    whence: float  # deg
    place: str  # in the file, for messages
    pressure: float = math.nan  # hPa
    temperature: float = math.nan  # C

    @property
    def level(self):
        """sounding_checks.Level"""
        return sounding_checks.Level(*self[:3], self.pressure, self.temperature)


def _winds(path, rows, what):
    """Winds of _Rows in any order; those that are not finite are left out."""
    found = []
    whole = [row for row in rows if all(map(math.isfinite, row[:3]))]
    for row in whole:
        if words := sounding_checks.fault(row.level):
            raise SoundingError(f"{path}, {row.place}: {words}")
    whole.sort(key=lambda row: row.height)
    if pair := sounding_checks.twice(whole):
        one, other = pair
        words = f"another wind at {one.height:.6g} m than in {one.place}"
        raise SoundingError(f"{path}, {other.place}: {words}; keep one of them")
    for row in whole:
        if not found or row.height >= found[-1][0] + APART:
            found.append(row[:3])
    if len(found) < 2:
        raise SoundingError(
            f"{path}: {len(found)} rows with height, direction and speed; expected two at least"
        )
    reach = f"{found[0][0]:.0f} m to {found[-1][0] / 1e3:.1f} km, constant beyond"
    return Winds(*zip(*found, strict=True), f"{what}, {len(found)} heights, {reach}")


class _Read(NamedTuple):
    """How the values of a file become those of a _Row."""

    path: object
    units: dict  # {height, direction, speed: as the file tells it}
    geopotential: bool  # the heights

    def row(self, place, height, whence, speed, pressure=math.nan, temperature=math.nan):
        """_Row of values in the units of the file, but for the last two. place : in the file"""
        factors = (UNITS[what][self.units[what]] for what in WANTED)
        height, whence, speed = (k * v for k, v in zip(factors, (height, whence, speed), strict=True))
        if math.isfinite(height) and not LOWEST <= height <= HIGHEST:
            words = f"a height of {height:g} m; expected {LOWEST:g} m to {HIGHEST / 1e3:g} km"
            raise SoundingError(f"{self.path}, {place}: {words}")
        if self.geopotential:
            height = RADIUS * height / (RADIUS - height)
        return _Row(height, speed, whence, place, pressure, temperature)


def _read_as(path, units, geopotential):
    """_Read of units, {what: as told}; those that are not known are refused."""
    units = {what: unit.strip().lower() for what, unit in units.items()}
    for what, unit in units.items():
        if unit not in UNITS[what]:
            told = f"is in {unit!r}" if unit else "has no unit"
            raise SoundingError(f"{path}: the {what} {told}; expected one of {', '.join(UNITS[what])}")
    return _Read(path, units, geopotential or units["height"] == "gpm")


def _line_with(text, word):
    return next(line for line in text.splitlines() if word in line)


def _wyoming_list(path, text):
    """_Rows and place of the text list: columns end where their names do; a unit below the middle of each."""
    lines = text.splitlines()
    k = next(n for n, line in enumerate(lines) if "HGHT" in line)
    heads = list(re.finditer(r"\S+", lines[k]))
    ends = {head.group().lower(): head.end() for head in heads}
    names = {what: next((n for n in names if n in ends), None) for what, names in WANTED.items()}
    _all_there(path, names)
    if k + 1 == len(lines):
        raise SoundingError(f"{path}: ends after line {k + 1}, the names of its columns")
    units = {
        head.group().lower(): unit.group()
        for unit in re.finditer(r"\S+", lines[k + 1])
        for head in heads
        if unit.start() < head.end() and head.start() < unit.end()
    }
    told = {what: units.get(name, "") for what, name in names.items()}
    read, width, rows, over = _read_as(path, told, names["height"] == "hght"), 7, [], 0
    aside = [(what, name) for what, name in (("pressure", "pres"), ("temperature", "temp")) if name in ends]
    for n, line in enumerate(lines[k + 2 :], k + 3):
        if over and LIKE_ROW.match(line):
            words = f"is no row of the list, but rows follow in line {n}; keep one list"
            raise SoundingError(f"{path}, line {over}: {words}")
        if over or not BEGINS.match(line):
            over = over or (n if rows else 0)
            continue
        cell = {name: line[max(0, end - width) : end] for name, end in ends.items()}
        values = [_number(path, n, what, cell[name]) for what, name in names.items()]
        more = {what: _aside(what, units.get(name, ""), cell[name]) for what, name in aside}
        rows.append(read.row(f"line {n}", *values, **more))
    return rows, _place(path, dict(STATION.findall(text)))


def _columns(path, text):
    """_Rows and place of a CSV whose header names height, direction and speed, each with its unit."""
    table = [
        (n, _cells(path, n, line))
        for n, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    heads = [head.strip().lower() for head in table[0][1]] if table else []
    for n, row in table[1:]:
        more = any(cell.strip() for cell in row[len(heads) :])
        if more or len(row) < len(heads):  # which value belongs to which column is not known
            raise SoundingError(f"{path}, line {n}: {len(row)} values, but {len(heads)} names of columns")
    places = {what: _column(path, heads, what) for what in WANTED}
    _all_there(path, places)
    for what, k in places.items():
        if words := sounding_checks.another(what, heads[k]):
            n, told = table[0]
            raise SoundingError(f"{path}, line {n}: column {told[k].strip()!r} has {words}")
    chosen = {what: heads[k] for what, k in places.items()}
    geopotential = "geopotential" in chosen["height"] or "hght" in chosen["height"]
    read = _read_as(path, {what: _unit(head, what) for what, head in chosen.items()}, geopotential)
    aside = {what: next((k for k, head in enumerate(heads) if head.startswith(names)), None)
             for what, (names, _) in BESIDE.items()}  # fmt: skip
    aside = {what: (k, _unit(heads[k], None)) for what, k in aside.items() if k is not None}
    rows, ways = [], [aside.pop(what, None) for what in ("latitude", "longitude")]
    for n, row in table[1:]:
        values = [_number(path, n, what, row[k]) for what, k in places.items()]
        more = {what: _aside(what, unit, row[k]) for what, (k, unit) in aside.items()}
        rows.append(read.row(f"line {n}", *values, **more))
    told = {}
    if all(ways) and len(table) > 1:  # the balloon starts there
        told = {what: table[1][1][k] for what, (k, _) in zip(("latitude", "longitude"), ways, strict=True)}
    return rows, _place(path, told)


def _column(path, heads, what):
    """Number of the column of height, direction or speed; None without one. Gusts are no mean wind.

    One that is something else, such as heights above the ground, is given where there is no other.
    """
    found = [k for k, head in enumerate(heads) if any(n in head for n in WANTED[what]) and "gust" not in head]
    found = [k for k in found if not sounding_checks.another(what, heads[k])] or found
    best = [k for k in found if heads[k].startswith(WANTED[what])] or found
    if len(best) > 1:
        several = ", ".join(heads[k] for k in best)
        raise SoundingError(f"{path}: {len(best)} columns may be the {what}: {several}; keep one of them")
    return best[0] if best else None


def _aside(what, unit, text):
    """hPa, C or deg of a cell that is only looked at; NaN if it is no number, or in a unit not known here."""
    factor = BESIDE[what][1].get(unit.strip().lower())
    if factor is None or not is_number(text) or (value := number(text)) in NOT_TOLD:
        return math.nan
    return factor * value


def _place(path, told):
    """(latitude, longitude), deg, of {'latitude': text or number, 'longitude'}; None without one."""
    found = [_aside(what, "deg", str(told.get(what, ""))) for what in ("latitude", "longitude")]
    return None if any(map(math.isnan, found)) else _on_earth(path, *found)


def _on_earth(path, *found):
    """(latitude, longitude), deg, of numbers."""
    if not sounding_checks.is_place(*found):
        words = "expected a latitude of -90 to 90 deg and a longitude of -360 to 360 deg"
        raise SoundingError(f"{path}: its place is {found[0]:g} deg, {found[1]:g} deg; {words}")
    return tuple(found)


def _cells(path, n, line):
    """Cells of line n of a CSV; a row is one line."""
    try:
        if line.count('"') % 2:
            raise csv.Error("a quotation mark has no partner")
        return next(csv.reader([line], strict=True))
    except csv.Error as error:
        raise SoundingError(f"{path}, line {n}: {error}") from None


def _unit(head, what):
    """The unit that a heading tells, such as height_m, wind speed [m/s]; '' if there is none."""
    if head in BARE:
        return BARE[head]
    match = HEAD.match(head)
    unit = (match["inside"] or match["last"] or "") if match else ""
    return "" if any(unit in name.split() for name in WANTED.get(what, ())) else unit


def _all_there(path, found):
    missing = [what for what, place in found.items() if place is None]
    if missing:
        raise SoundingError(
            f"{path}: no column for {' and '.join(missing)}; expected a sounding of the University of "
            "Wyoming (text or CSV), a CSV with such columns, or JSON of Open-Meteo with winds at "
            "pressure levels"
        )


def _number(path, n, what, text):
    """A number of line n; NaN where nothing was measured."""
    if text.strip("-/*. \t").lower() in MISSING:
        return math.nan
    try:
        value = number(text)
    except ValueError as error:
        raise SoundingError(f"{path}, line {n}: {what}: {error}") from None
    return math.nan if value in NEGATIVE else value


def _open_meteo(path, text, epoch):
    """(_Rows, what, place) of the hour nearest to lift-off."""
    try:
        answer = from_json(text)
    except ValueError as error:
        raise SoundingError(f"{path}: begins as JSON and is none: {error}") from None
    if isinstance(answer, list):
        words = "expected one answer, for the place of the launch"
        raise SoundingError(f"{path}: an answer of Open-Meteo for {len(answer)} places; {words}")
    hourly, units = (_asked(path, answer, key, dict) for key in ("hourly", "hourly_units"))
    offset = answer.get("utc_offset_seconds", 0)
    if not isinstance(offset, int | float) or not abs(offset) <= FARTHEST_ZONE_S:
        raise _unlike(path, f"utc_offset_seconds is {offset!r}")
    times = [_utc(path, one, timedelta(seconds=offset)) for one in _asked(path, hourly, "time", list)]
    levels = [match.group(1) for name in hourly if (match := LEVEL.match(name))]
    if not times or not levels:
        raise _unlike(path, f"{'no time' if levels else 'no wind_speed_...hPa'} in hourly")
    wanted = _utc(path, epoch, timedelta())
    k = min(range(len(times)), key=lambda n: abs(times[n] - wanted))
    if abs(times[k] - wanted) > NEAREST:
        raise SoundingError(f"{path}: the hour nearest to lift-off, {epoch} UTC, is {times[k].isoformat()}")
    rows = [_level(path, hourly, units, level, k) for level in levels]
    what = f"forecast for {times[k].isoformat(timespec='minutes')} UTC"
    return rows, what, _answered_place(path, answer)


def _answered_place(path, answer):
    """(latitude, longitude), deg, of an answer; None if it tells neither."""
    told = {what: answer[what] for what in ("latitude", "longitude") if what in answer}
    for what, value in told.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < LARGEST:
            raise SoundingError(f"{path}: {what} is {value!r:.60}; expected a number of degrees")
    if len(told) == 1:
        raise SoundingError(f"{path}: {next(iter(told))} without the other; expected latitude and longitude")
    return _on_earth(path, *map(float, told.values())) if told else None


def _utc(path, text, offset):
    """datetime without a zone, UTC. offset : of a text that names no zone"""
    try:
        there = datetime.fromisoformat(text)
    except (ValueError, TypeError):
        raise _unlike(path, f"the time {text!r} is not of ISO 8601") from None
    try:
        return there - offset if there.tzinfo is None else there.astimezone(UTC).replace(tzinfo=None)
    except OverflowError:
        raise _unlike(path, f"the time {text!r} is at the end of all dates") from None


def _level(path, hourly, units, level, k):
    """_Row of a pressure level, hPa, at hour k."""
    names = {what: f"{name}_{level}hPa" for what, name in zip(WANTED, FORECAST, strict=True)}
    read = _read_as(path, {what: _asked(path, units, name, str) for what, name in names.items()}, True)
    values = []
    for name in names.values():
        column, times = _asked(path, hourly, name, list), hourly["time"]
        if len(column) != len(times):
            words = f"has {len(column)} values, hourly.time has {len(times)}"
            raise SoundingError(f"{path}: hourly.{name} {words}; expected a value for each time")
        value = column[k]
        if isinstance(value, str | list | dict | bool) or (value is not None and not abs(value) < LARGEST):
            raise _unlike(path, f"hourly.{name} holds {value!r:.60}")
        values.append(math.nan if value is None else float(value))
    return read.row(f"level {level} hPa", *values, pressure=float(level))


def _asked(path, holder, key, kind):
    """A value of a kind that an answer has to hold."""
    if not isinstance(holder.get(key), kind):
        raise _unlike(path, f"{'another' if key in holder else 'no'} {key!r}")
    return holder[key]


def _unlike(path, words):
    return SoundingError(
        f"{path}: no answer of Open-Meteo with hourly winds at pressure levels ({words}); ask for "
        "wind_speed, wind_direction and geopotential_height at levels of hPa"
    )
