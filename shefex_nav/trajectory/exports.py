"""Exports of other programs, whose columns are known by their names.

RocketPy     Flight data exporter: "# Time (s),X (m),Y (m),Z (m),Vx (m/s), ... ,e0,e1,e2,e3". X east, Y north,
             Z above the sea; e0 to e3 take the components of the body, whose z points to the nose, to these.
OpenRocket   "# Time (s),Altitude (m), ... ,Position East of launch (m),Position North of launch (m)".
RASAero II   "Time (sec),Stage, ... ,Vel-V (ft/sec),Vel-H (ft/sec), ... ,Altitude (ft),Distance (ft)".

Flat coordinates are laid on the plane that is level at the origin. The unit of a column is that in its name.
"""

import numpy as np

from shefex_nav.scenario.data_table import DataError, read_export
from shefex_nav.trajectory import placing
from shefex_nav.trajectory.rows import (
    Attitudes,
    Rows,
    ascending,
    clock_rounding,
    moved,
    rounding,
    unit_quaternions,
)
from shefex_nav.world.flight import track

FOOT, MILE = 0.3048, 1609.344
UNITS = {
    "": 1.0, "s": 1.0, "sec": 1.0, "m": 1.0, "km": 1e3, "ft": FOOT, "m/s": 1.0, "km/h": 1.0 / 3.6,
    "ft/s": FOOT, "ft/sec": FOOT, "mph": MILE / 3600.0, "mi": MILE,
}  # fmt: skip
NOSE_UP = ("z", "x", "y")  # axes of RocketPy's body that point forward, right, down
E_NAMES = ("e0", "e1", "e2", "e3")


def read(given, earth):
    """Rows of a scenario.trajectory.Rocketpy, Openrocket or Rasaero."""
    return {"rocketpy": _rocketpy, "openrocket": _openrocket, "rasaero": _rasaero}[given.format](given, earth)


class _Columns:
    """Columns of an export by the words before their units, in SI."""

    def __init__(self, path, wanted, optional=()):
        export = read_export(path, "time")
        self._known = [_parted(name) for name in export.names]
        self._file, self._number = path, export.number
        found = {name: self._index(name) for name in ("Time", *wanted)}
        found |= {name: k for name in optional if (k := self._index(name, must=False)) is not None}
        self.table = export.table(tuple(found), list(found.values()))
        self._unit = {name: self._factor(k) for name, k in found.items()}

    def _index(self, name, must=True):
        for k, (words, _) in enumerate(self._known):
            if words.lower() == name.lower():
                return k
        if must:
            have = ", ".join(words for words, _ in self._known)
            raise DataError(f"{self._file}:{self._number}: column '{name}' is missing; there are: {have}")
        return None

    def _factor(self, k):
        words, unit = self._known[k]
        if unit not in UNITS:
            known = ", ".join(filter(None, UNITS))
            raise DataError(
                f"{self._file}:{self._number}: {words}: unit '{unit}' is not known; one of: {known}"
            )
        return UNITS[unit]

    def has(self, *names):
        return all(name in self._unit for name in names)

    def __getitem__(self, name):
        """(N,) in SI."""
        return self.table.columns[name] * self._unit[name]

    def stack(self, *names):
        """(N, k) in SI, and their rounding: that of the finest column of each unit, of these the coarsest."""
        of_unit = {}
        for name in names:
            of_unit.setdefault(self._unit[name], []).append(name)
        digits = [unit * rounding(self.table.stack(alike)) for unit, alike in of_unit.items()]
        return np.column_stack([self[name] for name in names]), max(digits)

    def time(self, given):
        """Mission times (N,) s."""
        t_s = self["Time"] - given.lift_off
        ascending(self.table, t_s)
        return t_s


def _parted(name):
    """`Altitude (m)` -> `Altitude`, `m`."""
    words, bracket, unit = name.rpartition(" (")
    return (words.strip(), unit.rstrip(") ")) if bracket else (name.strip(), "")


def _rows(given, earth, columns, t_s, level):
    """Rows of level coordinates. level : positions, velocities (N, 3), and the rounding of each"""
    r_l, v_l, rounding_m, rounding_m_s = level
    rounding_m += moved(v_l, clock_rounding(columns.table.columns["Time"]))
    here = placing.place(earth, t_s, given.origin)
    r_e = placing.ecef(here, r_l, "launch_enu")
    r_i = placing.rotated(here.C_ie, r_e)
    v_i = placing.velocities(here, r_i, v_l, "launch_enu")
    return Rows(columns.table, t_s, r_i, v_i, None, rounding_m, rounding_m_s, None), here, r_e


def _rocketpy(given, earth):
    of_velocity, own = ("Vx", "Vy", "Vz"), given.attitude is None
    columns = _Columns(given.file, ("X", "Y", "Z", *(E_NAMES if own else ())), of_velocity)
    t_s = columns.time(given)
    r_l, rounding_m = columns.stack("X", "Y", "Z")
    if columns.has(*of_velocity):
        v_l, rounding_m_s = columns.stack(*of_velocity)
    else:
        v_l, rounding_m_s = track.velocity(t_s, r_l, rounding_m), 0.0
    rows, here, r_e = _rows(given, earth, columns, t_s, (r_l, v_l, rounding_m, rounding_m_s))
    if not own:
        return rows
    q, digit = columns.stack(*E_NAMES)
    C_fb = placing.body_axes(placing.of_quaternions(unit_quaternions(columns.table, q)), NOSE_UP)
    q_ib = placing.attitudes(here, r_e, C_fb, "launch_enu")
    return rows._replace(attitudes=Attitudes(columns.table, t_s, q_ib, 2.0 * digit))


def _openrocket(given, earth):
    east, north, up = "Position East of launch", "Position North of launch", "Altitude"
    climbs = "Vertical velocity"
    columns = _Columns(given.file, (east, north, up), (climbs,))
    t_s = columns.time(given)
    r_l, rounding_m = columns.stack(east, north, up)
    v_l, rounding_m_s = track.velocity(t_s, r_l, rounding_m), 0.0
    if columns.has(climbs):
        climb, rounding_m_s = columns.stack(climbs)
        v_l[:, 2] = climb[:, 0]
    return _rows(given, earth, columns, t_s, (r_l, v_l, rounding_m, rounding_m_s))[0]


def _rasaero(given, earth):
    columns = _Columns(given.file, ("Altitude", "Distance", "Vel-V", "Vel-H"))
    t_s = columns.time(given)
    (r, rounding_m), (v, rounding_m_s) = (
        columns.stack("Distance", "Altitude"),
        columns.stack("Vel-H", "Vel-V"),
    )
    along = np.array([[np.sin(given.azimuth), np.cos(given.azimuth), 0.0], [0.0, 0.0, 1.0]])
    return _rows(given, earth, columns, t_s, (r @ along, v @ along, rounding_m, rounding_m_s))[0]
