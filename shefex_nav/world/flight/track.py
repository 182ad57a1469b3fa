"""Rows of a trajectory -> the motion between them: smooth curves of position and of attitude.

Velocity is a curve through its rows: a cubic spline, or, where the rows have accelerations, the cubic through
velocity and acceleration at both ends. Its integral is the position but for what the rows say otherwise; that
rest is a curve of its own, of the fifth degree, with no slope at the rows. So both go through their rows, and
position, velocity and acceleration at any instant are one motion.

Numbers of a file are rounded. Rows that are so close together that their rounding would be an acceleration,
or a rate, of some size are passed by (`spread`), as long as the curve comes near them all the same.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly, make_interp_spline
from scipy.linalg import solve_banded
from scipy.spatial.transform import Rotation, RotationSpline

from shefex_nav.geometry import frames
from shefex_nav.geometry.elementary import arccos
from shefex_nav.geometry.rotation import xyzw

NOISE_BY_POSITION = 1e-3  # m/s^2, of the rest of the positions, by their rounding
NOISE_BY_VELOCITY = 1e-2  # m/s^2, of velocities
NOISE_ALONE = 0.2  # m/s^2, where positions alone say how it moves
NOISE_OF_RATE = 2e-4  # rad/s, by the rounding of an attitude
LARGEST_TURN = 0.3  # rad between rows of an attitude that are used, if there are rows between them
MISSED, TINY = 4.0, 1e-9  # roundings, and m, m/s or rad, by which a row may be missed
CURVED = 12.0  # second derivative of a spline whose rows alternate by one, times their distance squared


class Motion(NamedTuple):
    """Where something is and how it moves, at n instants, in inertial axes."""

    r_i: np.ndarray  # (n, 3) m
    v_i: np.ndarray  # (n, 3) m/s
    a_i: np.ndarray  # (n, 3) m/s^2
    attitude: Rotation  # n, q_ib
    omega_ib_b: np.ndarray  # (n, 3) rad/s


def spread(t_s, closest_s):
    """Rows at least so far apart, the first and the last of all: indices of times (N,) s."""
    if closest_s <= np.diff(t_s).min(initial=np.inf):
        return np.arange(len(t_s))
    kept, last = [0], t_s[0]
    for k in range(1, len(t_s) - 1):
        if t_s[k] - last >= closest_s and t_s[-1] - t_s[k] >= closest_s:
            kept.append(k)
            last = t_s[k]
    return np.array([*kept, len(t_s) - 1])


def velocity(t_s, r, rounding):
    """Velocities (N, 3) m/s of positions (N, 3) m, whose axes do not turn, at times (N,) s.

    rounding : m, of the positions
    """

    def through(rows):
        degree = min(5, 2 * ((len(rows) - 1) // 2) + 1, len(rows) - 1)
        return make_interp_spline(t_s[rows], r[rows], k=degree)

    rows = spread(t_s, np.sqrt(CURVED * rounding / NOISE_ALONE))
    return _near(t_s, r, rows, rounding, through).derivative()(t_s)


class Track:
    """Position through rows: t_s (N,) s, r_i (N, 3) m, v_i (N, 3) m/s and, if known, a_i (N, 3) m/s^2.

    rounding_m, rounding_m_s : of positions and velocities
    first_a_i : (3,) m/s^2 at the first row, if that much is known
    """

    def __init__(self, t_s, r_i, v_i, a_i, rounding_m, rounding_m_s, first_a_i=None):
        begin = "not-a-knot" if first_a_i is None else (1, first_a_i)

        def through(rows):
            if a_i is None:
                return CubicSpline(t_s[rows], v_i[rows], bc_type=(begin, "not-a-knot"))
            return CubicHermiteSpline(t_s[rows], v_i[rows], a_i[rows])

        rows = spread(t_s, rounding_m_s / NOISE_BY_VELOCITY)
        self._v = _near(t_s, v_i, rows, rounding_m_s, through)
        self._way, self._r_0 = self._v.antiderivative(), r_i[0]
        self._rest = _rest(t_s, r_i - self._r_0 - self._way(t_s), rounding_m)

    def at(self, t_s):
        """r_i, v_i, a_i at times (n,) s: three (n, 3)."""
        rest = [self._rest(t_s, order) for order in range(3)]
        return self._r_0 + self._way(t_s) + rest[0], self._v(t_s) + rest[1], self._v(t_s, 1) + rest[2]

    def pushes(self, t_s):
        """Part (n, 3) m/s^2 of the acceleration that positions have on top of what the velocities say."""
        return self._rest(t_s, 2)


def _rest(t_s, values, rounding):
    """Curve near values (N, 3) m at times (N,) s, by as few as their rounding, m, allows: PPoly."""
    rows = spread(t_s, np.sqrt(CURVED * rounding / NOISE_BY_POSITION))
    return _near(t_s, values, rows, rounding, lambda rows: _steps(t_s[rows], values[rows]))


def _near(t_s, values, rows, rounding, through):
    """Curve through some rows and those that it would miss, see `_through`. values : (N, 3), times (N,) s"""
    return _through(rows, rounding, through, lambda curve: np.abs(curve(t_s) - values).max(axis=1))


def _through(rows, rounding, through, off):
    """Curve through some rows, and through more where it would miss others by more than their rounding.

    rows : numbers of those to begin with;  through : function of rows that gives a curve
    off : function of a curve that gives by how much it misses each row, (N,)
    """
    while True:
        curve = through(rows)
        misses = off(curve)
        misses[rows] = 0.0
        missed = np.flatnonzero(misses > MISSED * rounding + TINY)
        if not len(missed):
            return curve
        between = np.searchsorted(rows, missed)  # which two rows; the worst there is taken
        order = np.lexsort((-misses[missed], between))
        worst = np.unique(between[order], return_index=True)[1]
        rows = np.union1d(rows, missed[order][worst])


def _steps(t_s, values):
    """Curve of the fifth degree through values (N, 3) at times (N,), without slope there: scipy PPoly.

    Its second derivatives at the rows are those by which the third has no jumps; at both ends zero.
    """
    h, step = np.diff(t_s)[:, None], np.diff(values, axis=0)
    bent = np.zeros_like(values)
    if len(t_s) > 2:
        band = np.zeros((3, len(t_s) - 2))
        band[0, 1:] = band[2, :-1] = -3.0 / h[1:-1, 0]
        band[1] = 9.0 / h[:-1, 0] + 9.0 / h[1:, 0]
        bent[1:-1] = solve_banded((1, 1), band, 60.0 * np.diff(step / h**3, axis=0))
    a_0, a_1 = bent[:-1], bent[1:]
    return PPoly(
        [
            (6.0 * step / h**2 - 0.5 * a_0 + 0.5 * a_1) / h**3,
            (-15.0 * step / h**2 + 1.5 * a_0 - a_1) / h**2,
            (10.0 * step / h**2 - 1.5 * a_0 + 0.5 * a_1) / h,
            0.5 * a_0,
            np.zeros_like(step),
            values[:-1],
        ],
        t_s,
    )


class Turning:
    """Attitude through rows: t_s (N,) s, q_ib (N, 4), with a rate that has no kinks.

    rounding : rad, of the attitudes
    """

    def __init__(self, t_s, q_ib, rounding):
        rows = np.arange(len(t_s))
        if rounding > 0.0:
            fastest = float(np.max(turns(q_ib) / np.diff(t_s)))
            rows = spread(t_s, min(rounding / NOISE_OF_RATE, LARGEST_TURN / max(fastest, 1e-9)))
        told = Rotation.from_quat(xyzw(q_ib))
        self._curve = _through(
            rows,
            rounding,
            lambda rows: RotationSpline(t_s[rows], told[rows]),
            lambda curve: (told.inv() * curve(t_s)).magnitude(),
        )

    def at(self, t_s):
        """Attitude and rate at times (n,) s: Rotation, (n, 3) rad/s in body axes."""
        return self._curve(t_s), self._curve(t_s, 1)


def turns(q):
    """Angles between attitudes and the next ones: (N, 4) -> (N - 1,) rad."""
    cosine = np.abs(np.einsum("ki,ki->k", q[1:], q[:-1]))
    return 2.0 * arccos(np.clip(cosine, 0.0, 1.0))


class Given:
    """The whole motion: Track and Turning, before their first row, if it is on the Earth, at rest there."""

    def __init__(self, track, turning, earth, begin_s):
        self._track, self._turning, self._earth, self._begin_s = track, turning, earth, begin_s
        C_ei = frames.dcms_ie(earth, [begin_s])[0].T
        self._r_e = C_ei @ track.at(np.array([begin_s]))[0][0]
        attitude, _ = turning.at(np.array([begin_s]))
        self._C_eb = C_ei @ attitude.as_matrix()[0]

    def at(self, t_s):
        """Motion at times (n,) s, ascending."""
        n = int(np.searchsorted(t_s, self._begin_s))
        later = t_s[n:]
        moving = Motion(*self._track.at(later), *self._turning.at(later)) if len(later) else None
        if n == 0:
            return moving
        standing = self._standing(t_s[:n])
        if moving is None:
            return standing
        attitude = Rotation.concatenate([standing.attitude, moving.attitude])
        joined = [np.concatenate(pair) for pair in zip(standing[:3], moving[:3], strict=True)]
        rate = np.concatenate([standing.omega_ib_b, moving.omega_ib_b])
        return Motion(*joined, attitude, rate)

    def _standing(self, t_s):
        C_ie, omega_i = frames.dcms_ie(self._earth, t_s), frames.omega_ie_i(self._earth)
        r_i = C_ie @ self._r_e
        v_i = np.cross(omega_i, r_i)
        C_ib = C_ie @ self._C_eb
        omega_b = np.einsum("kji,j->ki", C_ib, omega_i)
        return Motion(r_i, v_i, np.cross(omega_i, v_i), Rotation.from_matrix(C_ib), omega_b)
