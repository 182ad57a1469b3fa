"""When and how a picture was taken, as its file says: keywords of a FITS header or texts of a PNG.

DATE-OBS (UTC, middle of the exposure), EXPTIME (s) and VELX, VELY, VELZ (m/s, of the camera relative to the
centre of the Earth, axes of the ICRS) are read; what else a file says, such as its true attitude, is not.

How a picture is turned between its file and a screen is the orientation of EXIF 2.32, 4.6.4 (tag 274). A
camera that is held upright stores the rows of its detector as ever and says so by this number; viewers turn
the picture. 1 is as stored, 3 upside down, 6 and 8 a quarter to the right and to the left; 2, 4, 5 and 7 are
mirrored besides. Other numbers mean nothing and are taken for 1, as viewers do.
"""

from datetime import UTC, datetime, timedelta
from math import hypot, isfinite
from typing import NamedTuple

import numpy as np

from shefex_nav import numerals

AS_STORED = 1
ON_ITS_SIDE = 5, 6, 7, 8  # width and height change places
_BACK = {6: 8, 8: 6}  # the others undo themselves
FIRST_YEAR, LAST_YEAR = 1900, 2200  # of pictures and of the sky
DATE, EXPOSURE, VELOCITY = "DATE-OBS", "EXPTIME", ("VELX", "VELY", "VELZ")
MINUTE = 1.0 / (365.25 * 1440.0)  # year
LONGEST = 86400.0  # s, [E] of pictures that are added up, too
FASTEST = 1e6  # m/s, of a camera: five times the fastest probe (Parker, 1.92e5 m/s)


class Taken(NamedTuple):
    """What is known of a picture beside its grey values; None where it is not."""

    julian_year: float | None = None  # middle of the exposure
    exposure_s: float | None = None
    velocity_i: np.ndarray | None = None  # (3,) m/s, relative to the centre of the Earth


def of_header(header):
    """Taken of a dict of keywords; ValueError with the keyword, its value and what would be right."""
    exposure_s = _number(header, EXPOSURE)
    if exposure_s is not None and not 0.0 < exposure_s <= LONGEST:
        words = f"expected a positive number of seconds, at most {LONGEST:g}"
        raise ValueError(f"{EXPOSURE}: {words}, got {header[EXPOSURE]!r}")
    return Taken(year_of(header), exposure_s, velocity_of(header))


def velocity_of(header):
    """Velocity of the camera, (3,) m/s, None without one; ValueError if it cannot be meant."""
    velocity = [_number(header, key) for key in VELOCITY]
    given = [value is not None for value in velocity]
    if any(given) and not all(given):
        missing = VELOCITY[given.index(False)]
        raise ValueError(f"{missing}: is missing; expected all of {', '.join(VELOCITY)}, in m/s, or none")
    if all(given) and not hypot(*velocity) < FASTEST:
        raise ValueError(
            f"{', '.join(VELOCITY)}: expected a speed below {FASTEST:g} m/s, got {hypot(*velocity):g} m/s"
        )
    return np.array(velocity) if all(given) else None


def year_of(header):
    """Julian year of the keyword DATE-OBS, None without it; ValueError if it cannot be read."""
    text = header.get(DATE)
    if text is None:
        return None
    try:
        return year_of_date(str(text))
    except ValueError as error:
        raise ValueError(f"{DATE}: {error}") from None


def year_of_date(text):
    """Julian year of UTC in ISO 8601; ValueError says what would be right."""
    try:
        when = datetime.fromisoformat(text.strip())
        year = julian_year(when if when.tzinfo is None else when.astimezone(UTC).replace(tzinfo=None))
    except (ValueError, OverflowError):  # of a date that is before the year one in UTC
        words = f"expected UTC in ISO 8601, such as 2012-06-22 or 2012-06-22T19:22:00.5, got {text!r}"
        raise ValueError(words) from None
    if not FIRST_YEAR < year < LAST_YEAR:
        raise ValueError(f"expected a year between {FIRST_YEAR} and {LAST_YEAR}, got {text!r}")
    return year if says_day(year) else year + MINUTE


def says_day(year):
    """Whether a Julian year tells a day: 2012 and 2012.5 mean any of a year, or of a tenth of it."""
    return abs(10.0 * year - round(10.0 * year)) > MINUTE


def julian_year(moment):
    """Decimal Julian year of a datetime without time zone: 2000.0 is 2000-01-01 12:00."""
    return 2000.0 + (moment - datetime(2000, 1, 1, 12)).total_seconds() / (365.25 * 86400.0)


def date_of(year):
    """datetime (UTC) of a decimal Julian year."""
    return datetime(2000, 1, 1, 12) + timedelta(days=365.25 * (year - 2000.0))


def this_year():
    """Julian year of now."""
    return julian_year(datetime.now(UTC).replace(tzinfo=None))


def _number(header, key):
    """Number of a keyword, None without it."""
    value = header.get(key)
    if value is None:
        return None
    try:
        if isinstance(value, bool):  # T and F of a FITS header
            raise ValueError(f"expected a number, got {value}")
        found = numerals.number(value) if isinstance(value, str) else float(value)
        if not isfinite(found):
            raise ValueError(f"expected a finite number, got {value}")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{key}: {error}") from None
    return found


def displayed(values, orientation):
    """A stored picture (rows, columns[, channels]) as it is displayed: a view of the same numbers."""
    turn = {
        2: lambda v: v[:, ::-1],
        3: lambda v: v[::-1, ::-1],
        4: lambda v: v[::-1],
        5: lambda v: np.swapaxes(v, 0, 1),
        6: lambda v: np.rot90(v, -1),
        7: lambda v: np.swapaxes(v[::-1, ::-1], 0, 1),
        8: lambda v: np.rot90(v),
    }.get(orientation)
    return values if turn is None else turn(values)


def as_stored(values, orientation):
    """A displayed picture as it is stored: the inverse of `displayed`."""
    return displayed(values, _BACK.get(orientation, orientation))
