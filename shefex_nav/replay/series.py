"""What every reader gives: series of one sensor each, in SI, with the clock and the axes of the file."""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import wgs84
from shefex_nav.scenario.data_table import DataError, Table


class ImuSeries(NamedTuple):
    """Inertial sensors, in the axes of the file."""

    table: Table
    t_s: np.ndarray  # (N,)
    gyro: np.ndarray  # (N, 3) rad/s, or rad within the sample that ends at t_s
    accelerometer: np.ndarray  # (N, 3) m/s^2, or m/s likewise
    kind: str  # 'rate' or 'increment'


class GnssSeries(NamedTuple):
    """Fixes of a GNSS antenna."""

    table: Table
    t_s: np.ndarray  # (M,)
    r_e: np.ndarray  # (M, 3) m
    v_e: np.ndarray | None  # (M, 3) m/s relative to the Earth
    sigma_r_n: np.ndarray | None  # (M, 3) m, north, east, down
    sigma_v_n: np.ndarray | None  # (M, 3) m/s
    valid: np.ndarray  # (M,) bool
    horizontal: bool = False  # the height of r_e, and the last of sigma_r_n, mean nothing
    satellites: np.ndarray | None = None  # (M,) number of them; NaN where the file says nonsense


class ReadingSeries(NamedTuple):
    """Readings of an instrument, vectors in the axes of the file."""

    table: Table
    t_s: np.ndarray  # (K,)
    fields: dict  # name of a field of its record -> (K,) or (K, 3)


class TruthSeries(NamedTuple):
    """What really happened to the IMU."""

    table: Table
    t_s: np.ndarray  # (L,)
    r_e: np.ndarray  # (L, 3) m
    v_e: np.ndarray  # (L, 3) m/s relative to the Earth
    angles: np.ndarray  # (L, 3) rad: roll, pitch, heading


FAR_OFF_M = 5e8  # [E] from the centre of the Earth: beyond the Moon
SUNK_M = 3e4  # [E] below the ellipsoid: deeper is no place on the Earth, even by a bad fix
LOW_M = 1e7  # [E] from the centre of the Earth: what a unit is guessed for flies below
DEEP_M = 6.3e6  # [E] likewise, below any place on the Earth or in it; the pole is at 6.357e6 m
FAST = 1e5  # [E] m/s, relative to the Earth: six times what leaves the Sun from there
VAGUE = 1e9  # [E] a sigma that says nothing, m or m/s
TURN = 2.0 * np.pi + 1e-9  # rad
LENGTHS = {"km": 1e3, "cm": 1e-2, "mm": 1e-3}  # m


def gnss(table, t_s, r_e, v_e=None, sigma_r_n=None, sigma_v_n=None, valid=None, horizontal=False):
    """GnssSeries, checked; sigma_r_n of fixes without height has two columns."""
    valid = np.ones(len(t_s), dtype=bool) if valid is None else valid
    for sigma in (sigma_r_n, sigma_v_n):
        bad = [] if sigma is None else np.flatnonzero(valid & ~((sigma > 0.0) & (sigma < VAGUE)).all(axis=1))
        if len(bad):
            got = ", ".join(f"{value:g}" for value in sigma[bad[0]])
            words = f"a sigma must be greater than zero and below {VAGUE:g}, got {got}"
            raise DataError(f"{table.place(bad[0])}: {words}")
    if horizontal and sigma_r_n is not None:
        sigma_r_n = np.column_stack([sigma_r_n[:, :2], np.zeros(len(t_s))])
    return GnssSeries(table, t_s, r_e, v_e, sigma_r_n, sigma_v_n, valid, horizontal)


def positions(table, names, frame, angle=1.0, height=0.0, valid=None):
    """Positions of three columns, (N, 3) m, frame e; DataError where they are none near the Earth.

    frame : 'geodetic' (latitude, longitude, height) or 'ecef';  angle : rad, unit of the angles
    height : m, where latitude and longitude are all that is given
    valid : (N,) bool, the rows that have one; None: all
    """
    valid = np.ones(len(table.columns[names[0]]), dtype=bool) if valid is None else valid
    given = table.stack(names)
    if len(names) == 2:
        given = np.column_stack([given, np.full(len(given), height)])
    if frame == "ecef":
        _near_earth(table, names, given, valid)
        return given
    latitude, longitude = given[:, 0] * angle, given[:, 1] * angle
    height = (given[:, 2] > -SUNK_M) & (given[:, 2] < FAR_OFF_M)
    for k, good, what in (
        (0, np.abs(latitude) <= 0.5 * np.pi, "a latitude of {:g} is beyond the poles"),
        (1, np.abs(longitude) <= TURN, "a longitude of {:g} is more than a turn"),
        (2, height, "a height of {:g} m is nowhere near the Earth"),
    ):
        bad = np.flatnonzero(valid & ~good)
        if len(bad):
            words = f"{what.format(given[bad[0], k])}; check column and unit"
            raise DataError(f"{table.place(bad[0])}: {names[min(k, len(names) - 1)]}: {words}")
    return _ecef_kernel(latitude, longitude, given[:, 2].copy())


def _size(vectors):
    """Norms of (N, 3): (N,); of what is no position and no velocity at all 1e300."""
    with np.errstate(over="ignore"):
        return np.minimum(np.linalg.norm(vectors, axis=1), 1e300)


def _near_earth(table, names, r_e, valid):
    """Refuse positions that lie deep in the Earth, or beyond the Moon. (N, 3) m, frame e"""
    radius = _size(r_e)
    bad = np.flatnonzero(valid & ~((radius > DEEP_M) & (radius < FAR_OFF_M)))
    if not len(bad):
        return
    typical = float(np.median(radius[bad]))
    meant = [unit for unit, factor in LENGTHS.items() if DEEP_M < factor * typical < LOW_M]
    hint = f"they fit in {meant[0]}: give them in m" if meant else "check columns and unit"
    where = "inside the Earth" if radius[bad[0]] <= DEEP_M else "beyond the Moon"
    words = f"a position {radius[bad[0]]:g} m from the Earth's centre is {where}; {hint}"
    raise DataError(f"{table.place(bad[0])}: {', '.join(names)}: {words}")


def velocities(table, names, frame, r_e, valid=None):
    """Velocities of three columns in 'ned', 'enu' or 'ecef' at the positions r_e: (N, 3) m/s, frame e.

    valid : as of `positions`
    """
    given = table.stack(names)
    speed = _size(given)
    bad = np.flatnonzero(~(speed < FAST) if valid is None else valid & ~(speed < FAST))
    if len(bad):
        words = f"a speed of {speed[bad[0]]:g} m/s is faster than any vehicle; check columns and unit"
        raise DataError(f"{table.place(bad[0])}: {', '.join(names)}: {words}")
    if frame == "ecef":
        return given
    if frame == "enu":
        given = ned_or_enu(given)
    return to_ecef(given, r_e)


def ned_or_enu(vectors):
    """Vectors north, east, down as east, north, up, or the other way round: (N, 3)."""
    return np.column_stack([vectors[:, 1], vectors[:, 0], -vectors[:, 2]])


def between(t_s, known_s, vectors):
    """Vectors (N, k) known at some times, at others (m,): linear between. -> (m, k)"""
    return np.column_stack([np.interp(t_s, known_s, column) for column in vectors.T])


@kernel
def to_ecef(v_n, r_e):
    """Vectors north-east-down at positions in frame e. (N, 3), (N, 3) m -> (N, 3), frame e."""
    out = np.empty_like(v_n)
    for k in range(v_n.shape[0]):
        latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e[k])
        C = wgs84.dcm_en(latitude, longitude)
        for i in range(3):
            out[k, i] = C[i, 0] * v_n[k, 0] + C[i, 1] * v_n[k, 1] + C[i, 2] * v_n[k, 2]
    return out


@kernel
def _ecef_kernel(latitude, longitude, height):
    """(N,) rad, rad, m -> (N, 3) m, frame e."""
    out = np.empty((latitude.shape[0], 3))
    for k in range(latitude.shape[0]):
        out[k] = wgs84.ecef_from_geodetic(latitude[k], longitude[k], height[k])
    return out
