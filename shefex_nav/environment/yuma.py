"""YUMA almanac text -> `gnss.Constellation`.

The form is that of the U.S. Coast Guard Navigation Center's files: a head line for each satellite, then a
line with name and value for each element. Elements, and how positions follow from them: IS-GPS-200, section
20.3.3.5.2.1, with the constants of that document.

Weeks are counted from 6 January 1980. A file gives the week modulo 1024 (or, made by other tools, in full);
of the weeks that it can mean, the one nearest to the epoch of the mission is meant. That goes well as long as
the almanac and the mission are less than 512 weeks, ten years, apart.
"""

import re
from datetime import UTC, datetime
from typing import NamedTuple

import erfa
import numpy as np

from shefex_nav.environment import ephemeris
from shefex_nav.environment.gnss import Constellation
from shefex_nav.numerals import number

GM_GPS = 3.986005e14  # m^3/s^2, of the navigation message
OMEGA_GPS = 7.2921151467e-5  # rad/s
WEEK_S = 604800.0
WEEKS = 1024  # after which the broadcast week starts again
GPS_START = datetime(1980, 1, 6, tzinfo=UTC)
TAI_MINUS_GPS = 19.0  # s

FIELDS = (  # attribute, name in the file, lowest and highest value allowed
    ("prn", "ID", 1, 63),
    ("health", "Health", 0, 255),
    ("eccentricity", "Eccentricity", 0.0, 0.5),
    ("time", "Time of Applicability(s)", 0.0, WEEK_S),
    ("inclination", "Orbital Inclination(rad)", 0.0, np.pi),
    ("node_rate", "Rate of Right Ascen(r/s)", -1e-6, 1e-6),
    ("root_semi_major_axis", "SQRT(A) (m 1/2)", 2600.0, 7000.0),
    ("node", "Right Ascen at Week(rad)", -7.0, 7.0),
    ("perigee", "Argument of Perigee(rad)", -7.0, 7.0),
    ("anomaly", "Mean Anom(rad)", -7.0, 7.0),
    ("clock_s", "Af0(s)", -1.0, 1.0),
    ("clock_rate", "Af1(s/s)", -1e-3, 1e-3),
    ("week", "week", 0, 8191),
)
WHOLE = {"prn", "health", "week"}


class BadYuma(Exception):
    """Text that is no YUMA almanac; `errors` is a list of (line, column, words)."""

    def __init__(self, errors):
        self.errors = errors
        super().__init__("\n".join(f"line {line}: {words}" for line, _, words in errors))


class Item(NamedTuple):
    """A value in the file: as it was written, its number, and where."""

    text: str
    value: float
    line: int
    column: int


class Almanac(NamedTuple):
    """Elements of n satellites, (n,) arrays."""

    prn: np.ndarray  # int
    health: np.ndarray  # int, 0 = good
    eccentricity: np.ndarray
    time: np.ndarray  # s of the week, to which the elements belong
    inclination: np.ndarray  # rad
    node_rate: np.ndarray  # rad/s, inertial
    root_semi_major_axis: np.ndarray  # sqrt(m)
    node: np.ndarray  # rad, longitude of the ascending node at the beginning of the week
    perigee: np.ndarray  # rad
    anomaly: np.ndarray  # rad, mean anomaly at `time`
    week: np.ndarray  # int, as in the file


def items(text):
    """List of {attribute: Item}, one for each satellite of a file; BadYuma with every error."""
    known = {_bare(name): (attribute, name, low, high) for attribute, name, low, high in FIELDS}
    satellites, errors = [], []
    for n, line in enumerate(text.splitlines(), 1):
        name, colon, value = line.partition(":")
        if not line.strip():
            continue
        if line.lstrip().startswith("*"):
            satellites.append(({}, n))
            continue
        column = len(line) - len(line.lstrip()) + 1
        if not colon or _bare(name) not in known:
            words = f"expected a line such as 'Eccentricity: 0.0110', got {_short(line.strip())}"
            errors.append((n, column, words))
            continue
        if not satellites:
            errors.append(
                (n, column, "expected '**** Week 669 almanac for PRN-01 ****' above the first value")
            )
            satellites.append(({}, n))
        attribute, name, low, high = known[_bare(name)]
        value_column = len(line) - len(value.lstrip()) + 1
        try:
            item = _item(value.strip(), attribute, low, high, n, value_column)
        except ValueError as error:
            errors.append((n, value_column, f"{name}: {error}"))
            continue
        if attribute in satellites[-1][0]:
            errors.append((n, column, f"{name}: given twice for one satellite; a head line of * is missing"))
        satellites[-1][0][attribute] = item
    errors += _complete(satellites, errors)
    if errors:
        raise BadYuma(sorted(errors))
    return [found for found, _ in satellites]


def _bare(name):
    """Name of an element without blanks and capitals."""
    return re.sub(r"\s+", "", name).lower()


def _short(text):
    return repr(text) if len(text) <= 50 else f"{text[:47]!r}..."


def _item(text, attribute, low, high, line, column):
    """Item of a value; ValueError with words for people."""
    value = number(text)
    if attribute in WHOLE and value != int(value):
        raise ValueError(f"expected a whole number, got {text}")
    if not low <= value <= high:
        raise ValueError(f"must be between {low:g} and {high:g}, got {text}")
    return Item(text, value, line, column)


def _complete(satellites, errors):
    """Errors about what is missing or there twice, unless a line of the satellite is wrong already."""
    if not satellites:
        yield 1, 1, "there is no satellite in the file; expected a YUMA almanac"
    seen, wrong = {}, [line for line, _, _ in errors]
    for k, (found, line) in enumerate(satellites):
        end = satellites[k + 1][1] if k + 1 < len(satellites) else np.inf
        missing = [name for attribute, name, _, _ in FIELDS if attribute not in found]
        if missing and not any(line <= bad < end for bad in wrong):
            yield line, 1, f"the satellite has no {missing[0]}"
        if "prn" in found:
            prn = int(found["prn"].value)
            if prn in seen:
                yield (
                    found["prn"].line,
                    found["prn"].column,
                    f"ID: PRN {prn} stands in line {seen[prn]} already",
                )
            seen.setdefault(prn, found["prn"].line)


def read(text):
    """Almanac of a YUMA text; BadYuma with every error."""
    found = items(text)
    return almanac({name: [item[name].value for item in found] for name in Almanac._fields})


def almanac(columns):
    """Almanac of {attribute: list of numbers}, satellites in the order of their numbers."""
    order = np.argsort(np.asarray(columns["prn"]), kind="stable")
    arrays = {name: np.asarray(columns[name])[order] for name in Almanac._fields}
    return Almanac(
        **{name: a.astype(np.int64) if name in WHOLE else a.astype(float) for name, a in arrays.items()}
    )


def gps_seconds(epoch_utc):
    """GPS time of an instant in UTC (ISO 8601), s since 6 January 1980, leap seconds counted."""
    epoch = datetime.fromisoformat(epoch_utc)
    if epoch.tzinfo is None:
        epoch = epoch.replace(tzinfo=UTC)
    epoch = epoch.astimezone(UTC)
    with ephemeris.quiet():
        leap_s = float(erfa.dat(epoch.year, epoch.month, epoch.day, 0.0)) - TAI_MINUS_GPS
    return (epoch - GPS_START).total_seconds() + leap_s


def full_week(week, gps_s):
    """The week of GPS, without rollover, that a week in a file means: one modulo 1024 nearest to gps_s.

    A week of 1024 or more is taken as it is. int array, s -> int array
    """
    week = np.asarray(week)
    nearest = week + WEEKS * np.rint((gps_s / WEEK_S - week) / WEEKS).astype(np.int64)
    return np.where(week < WEEKS, np.maximum(nearest, week), week)


def age_s(almanac, epoch_utc):
    """How much later than the almanac's reference times an instant is, (n,) s; negative before them."""
    gps_s = gps_seconds(epoch_utc)
    return gps_s - (full_week(almanac.week, gps_s) * WEEK_S + almanac.time)


def constellation(almanac, epoch_utc):
    """Constellation of the healthy satellites of an Almanac, t = 0 at a UTC instant."""
    elapsed_s = age_s(almanac, epoch_utc)
    node_rate = almanac.node_rate - OMEGA_GPS
    a = almanac.root_semi_major_axis**2
    mean_motion = np.sqrt(GM_GPS / (a * a * a))
    node = almanac.node + node_rate * elapsed_s - OMEGA_GPS * almanac.time
    latitude = almanac.perigee + almanac.anomaly + mean_motion * elapsed_s
    good = almanac.health == 0
    return Constellation(
        (node % (2.0 * np.pi))[good],
        node_rate[good],
        (latitude % (2.0 * np.pi))[good],
        mean_motion[good],
        almanac.inclination[good],
        a[good],
        almanac.eccentricity[good],
        almanac.perigee[good],
        almanac.prn[good],
    )
