"""Winds of the day from files as weather services give them -> the table of wind of a scenario.

Read are soundings of the University of Wyoming, its text list and its CSV, or any CSV whose columns are named
likewise, and answers of Open-Meteo with winds at pressure levels (JSON). Units are those that the file names.
Heights there are geopotential above mean sea level; they become geometric, z = R h / (R - h) with
R = 6356.766 km (US Standard Atmosphere 1976), and count as heights above the ellipsoid: the geoid, up to
110 m off, is not known.
"""

import csv
import json
import math
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from shefex_nav.errors import UserError

RADIUS = 6356766.0  # m
APART = 50.0  # m; rows that are closer to the one before are left out
NEAREST = timedelta(minutes=90)  # of an hour of a forecast to lift-off
SPEEDS = {"m/s": 1.0, "ms": 1.0, "kt": 1852 / 3600, "kn": 1852 / 3600, "knot": 1852 / 3600, "km/h": 1 / 3.6}
SPEEDS |= {"knots": 1852 / 3600, "kts": 1852 / 3600, "mph": 0.44704, "mp/h": 0.44704}
WANTED = {
    "height": ("height", "hght"),
    "direction": ("direction", "drct"),
    "speed": ("wind speed", "sknt", "sped"),
}
LEVEL = re.compile(r"wind_speed_(\d+)hPa$")


class SoundingError(UserError):
    """A file of winds cannot be read; the message says what is wrong with it."""


class Winds(NamedTuple):
    """Winds over the height, n rows, heights increasing."""

    height: tuple  # m
    speed: tuple  # m/s
    whence: tuple  # deg, where it blows from
    what: str  # for people

    def override(self):
        """The text of a --set that puts these winds in place of a scenario's."""
        columns = (("height", self.height, "m"), ("speed", self.speed, "m/s"), ("from", self.whence, "deg"))
        told = (f"{name}: [{', '.join(f'{v:.6g} {unit}' for v in values)}]" for name, values, unit in columns)
        return f"wind={{{', '.join(told)}}}"


def read(path, epoch):
    """Winds of a file. epoch : UTC of lift-off, ISO 8601, for which a forecast is looked up"""
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise SoundingError(f"{path}: {error.strerror}") from None
    if text.lstrip().startswith("{"):
        rows, what = _open_meteo(path, text, epoch)
    elif "PRES" in text and "HGHT" in text and "," not in _line_with(text, "HGHT"):
        rows, what = _wyoming_list(path, text), "sounding"
    else:
        rows, what = _columns(path, text), "sounding"
    return _winds(path, rows, what)


def _winds(path, rows, what):
    """Winds of rows (geopotential height m, speed m/s, direction deg), those that are not finite left out."""
    found = []
    for height, speed, whence in sorted(rows, key=lambda row: row[0]) if what != "sounding" else rows:
        if not all(map(math.isfinite, (height, speed, whence))):
            continue
        if speed < 0.0 or not -360.0 <= whence <= 360.0:
            raise SoundingError(f"{path}: {speed:g} m/s from {whence:g} deg is no wind")
        height = RADIUS * height / (RADIUS - height)
        if not found or height >= found[-1][0] + APART:
            found.append((height, speed, whence))
    if len(found) < 2:
        raise SoundingError(
            f"{path}: {len(found)} rows with height, direction and speed; expected two at least"
        )
    reach = f"{found[0][0]:.0f} m to {found[-1][0] / 1e3:.1f} km, constant beyond"
    return Winds(*zip(*found, strict=True), f"{what}, {len(found)} heights, {reach}")


def _line_with(text, word):
    return next(line for line in text.splitlines() if word in line)


def _wyoming_list(path, text):
    """Rows of the text list: columns end where their names end; a unit below each."""
    lines = text.splitlines()
    k = next(n for n, line in enumerate(lines) if "HGHT" in line)
    ends = {match.group().lower(): match.end() for match in re.finditer(r"\S+", lines[k])}
    names = {what: next((n for n in names if n in ends), None) for what, names in WANTED.items()}
    _all_there(path, names)
    units = {match.end(): match.group().lower() for match in re.finditer(r"\S+", lines[k + 1])}
    factor = _factor(path, units.get(ends[names["speed"]], "knot" if names["speed"] == "sknt" else ""))
    width, rows = 7, []
    for line in lines[k + 2 :]:
        cells = [line[max(0, ends[names[what]] - width) : ends[names[what]]] for what in WANTED]
        if not re.match(r"\s*-?\d", line):
            if rows:
                break  # the list is over
            continue
        height, whence, speed = map(_number, cells)
        rows.append((height, factor * speed, whence))
    return rows


def _columns(path, text):
    """Rows of a CSV whose header names height, direction and speed, each with its unit behind it."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    table = list(csv.reader(lines))
    heads = [head.strip().lower() for head in table[0]] if table else []
    places = {
        what: next((k for k, head in enumerate(heads) if any(n in head for n in names)), None)
        for what, names in WANTED.items()
    }
    _all_there(path, places)
    unit = re.split(r"[_\[( ]", heads[places["speed"]].rstrip("])"))[-1]
    factor = _factor(path, "knot" if heads[places["speed"]] == "sknt" else unit)
    rows = []
    for row in table[1:]:
        height, whence, speed = (_number(row[k]) if k < len(row) else math.nan for k in places.values())
        rows.append((height, factor * speed, whence))
    return rows


def _all_there(path, found):
    missing = [what for what, place in found.items() if place is None]
    if missing:
        raise SoundingError(
            f"{path}: no column for {' and '.join(missing)}; expected a sounding of the University of "
            "Wyoming (text or CSV), a CSV with such columns, or JSON of Open-Meteo with winds at "
            "pressure levels"
        )


def _factor(path, unit):
    if unit not in SPEEDS:
        known = ", ".join(SPEEDS)
        raise SoundingError(
            f"{path}: the speed of the wind is in {unit or 'no unit'!r}; expected one of {known}"
        )
    return SPEEDS[unit]


def _number(text):
    try:
        return float(text)
    except ValueError:
        return math.nan


def _open_meteo(path, text, epoch):
    """(rows, what) of the hour nearest to lift-off."""
    try:
        answer = json.loads(text)
        hourly, units = answer["hourly"], answer["hourly_units"]
        offset = timedelta(seconds=answer.get("utc_offset_seconds", 0))
        times = [datetime.fromisoformat(one) - offset for one in hourly["time"]]
        levels = [match.group(1) for name in hourly if (match := LEVEL.match(name))]
        wanted = datetime.fromisoformat(epoch)
        k = min(range(len(times)), key=lambda n: abs(times[n] - wanted))
        rows = [_level(path, hourly, units, level, k) for level in levels]
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        words = (
            f"no answer of Open-Meteo with hourly winds at pressure levels ({type(error).__name__}: {error})"
        )
        raise SoundingError(
            f"{path}: {words}; ask for wind_speed, wind_direction and geopotential_height at levels of hPa"
        ) from None
    if abs(times[k] - wanted) > NEAREST:
        raise SoundingError(f"{path}: the hour nearest to lift-off, {epoch} UTC, is {times[k].isoformat()}")
    return rows, f"forecast for {times[k].isoformat(timespec='minutes')} UTC"


def _level(path, hourly, units, level, k):
    name = f"wind_speed_{level}hPa"
    factor = _factor(path, units[name].lower())
    values = (
        hourly[name][k],
        hourly[f"wind_direction_{level}hPa"][k],
        hourly[f"geopotential_height_{level}hPa"][k],
    )
    speed, whence, height = (math.nan if value is None else float(value) for value in values)
    return height, factor * speed, whence
