"""What a level of a sounding or a forecast cannot say, and how far its place is from another.

Looked at are values that no air has, and pressure against height: if the two do not belong together, one of
them is wrong. What is not told, NaN, cannot be wrong.
"""

import math
import re
from itertools import pairwise
from typing import NamedTuple

import numpy as np

FASTEST = 300.0  # m/s, [E] twice the strongest jets of the polar night; up to HIGH
FASTEST_ABOVE = 2000.0  # m/s, [E] of the thermosphere in a storm
HIGH = 120e3  # m
MOST_TURN = 360.0  # deg
PRESSURES = 1e-4, 1100.0  # hPa, of 105 km and of the Dead Sea under a high
TEMPERATURES = -160.0, 60.0  # C, of the polar mesopause and of deserts
SAME_HEIGHT = 1.0  # m, [E] two levels this close are one, their heights being rounded
OTHER_WIND = 10.0  # m/s, [E] by which two winds of one height may differ
STANDARD = (  # US Standard Atmosphere 1976: hPa, geopotential m
    (1086.2, -600.0), (1013.25, 0.0), (850.0, 1457.0), (700.0, 3012.0), (500.0, 5574.0), (400.0, 7185.0),
    (300.0, 9164.0), (226.321, 11000.0), (54.7489, 20000.0), (8.68019, 32000.0),
    (1.10906, 47000.0), (0.669389, 51000.0), (0.0395642, 71000.0), (0.003734, 84852.0), (1e-4, 105000.0),
)  # fmt: skip
OFF = 1000.0  # m, [E] by which the height of a pressure may differ from the standard
OFF_SHARE = 0.15  # [E] of the standard height, in addition
EARTH_RADIUS = 6371e3  # m, mean
FAR = 300e3  # m, [E] from there on the wind is of another place
GROUND = re.compile(
    r"(?<![a-z])(agl|(above|over|relative[ _-]+to)[ _-]+(the[ _-]+)?(local[ _-]+)?"
    r"(ground|surface|terrain|launch(er)?|pad|site|station)(?![ _-]+of))(?![a-z])"
)  # in the heading of a height that is not above the sea
WHITHER = re.compile(r"(?<![a-z])(?<!relative[ _])(?<!respect[ _])(to|towards?)(?![a-z])")  # of a direction


class Level(NamedTuple):
    """What a file says of one level."""

    height: float  # m
    speed: float  # m/s
    whence: float  # deg
    pressure: float = math.nan  # hPa
    temperature: float = math.nan  # C


def fault(level):
    """What is impossible about a Level, and what would be right; '' if nothing is."""
    height, speed, whence, pressure, temperature = level
    if speed < 0.0 or whence < 0.0 or whence > MOST_TURN:
        return f"{speed:g} m/s from {whence:g} deg is no wind; expected 0 m/s or more from 0 to 360 deg"
    if speed > fastest(height):
        return f"{speed:g} m/s is no wind of the Earth; expected at most {fastest(height):g} m/s"
    for what, value, (least, most), unit in (
        ("pressure", pressure, PRESSURES, "hPa"),
        ("temperature", temperature, TEMPERATURES, "C"),
    ):
        if not math.isnan(value) and not least <= value <= most:
            return f"a {what} of {value:g} {unit}; expected {least:g} to {most:g} {unit}"
    usual = standard_height(pressure)
    if abs(height - usual) > OFF + OFF_SHARE * abs(usual):
        words = f"{pressure:g} hPa at {height:g} m do not belong together"
        return f"{words}; expected about {round(usual, -2):g} m: check both"
    return ""


def another(what, heading):
    """What else a column is than what it seems to be, and what would be right; '' if it is none such.

    what : 'height', 'direction' or 'speed';  heading : of the column, in lower case
    """
    if what == "height" and GROUND.search(heading):
        return "heights above the ground; expected heights above mean sea level: add the height of the place"
    if what == "direction" and WHITHER.search(heading):
        return "directions to which the wind blows; expected those from which it comes: turn them by 180 deg"
    return ""


def fastest(height):
    """m/s, of any wind at a height, m."""
    return FASTEST_ABOVE if height > HIGH else FASTEST


def standard_height(pressure):
    """m, geopotential, of a pressure in hPa; NaN of NaN."""
    if math.isnan(pressure):
        return math.nan
    table = np.array(STANDARD)
    return float(np.interp(-math.log(pressure), -np.log(table[:, 0]), table[:, 1]))


def twice(rows):
    """Two rows that follow each other, of one height and with winds that cannot both be; None: none are.

    rows : with height, speed and whence, by their heights
    """
    for one, other in pairwise(rows):
        gap = _components(one) - _components(other)
        if abs(other.height - one.height) <= SAME_HEIGHT and abs(gap) > OTHER_WIND:
            return one, other
    return None


def _components(row):
    angle = math.radians(row.whence)
    return row.speed * complex(math.cos(angle), math.sin(angle))


def is_place(latitude, longitude):
    """Whether there is such a place, deg."""
    return abs(latitude) <= 90.0 and abs(longitude) <= 360.0


def elsewhere(place, site):
    """Words about a place of winds that is far from a site; '' if it is not. (latitude, longitude), deg"""
    away = distance(place, site)
    if away <= FAR:
        return ""
    there, here = (f"{one[0]:.2f} deg, {one[1]:.2f} deg" for one in (place, site))
    return f"is of {there}, {away / 1e3:.0f} km from the launch site at {here}; is it the right file?"


def distance(place, other):
    """m, along the ground of a sphere. (latitude, longitude), deg"""
    (a, b), (c, d) = np.radians(place), np.radians(other)
    half = math.sin(0.5 * (c - a)) ** 2 + math.cos(a) * math.cos(c) * math.sin(0.5 * (d - b)) ** 2
    return 2.0 * EARTH_RADIUS * math.asin(min(math.sqrt(half), 1.0))
