"""The truth of a data set at any instant within it, as states in inertial axes.

Where a motor ignites between two rows 0.1 s apart, a straight line between their velocities is off by 2 m/s:
no error of the navigation, but counted as one. `as_felt` lets the increments of the IMU give the shape of the
motion between rows; a constant rate and a constant acceleration are added so that it meets them. So neither
gravity nor an error of the IMU that lasts from row to row is in it.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.replay.series import between

TURN_RAD = 0.02  # [E] by which gyros and truth may disagree from row to row
TURN_SHARE = 0.1  # [E] likewise, of the turn
LEAST_STEPS = 5  # [E] from row to row, of which the median is the bias of a gyro
CALM = 1e-3  # m/s, change of course that the rows would hardly show
LONGEST_STEP_S = 1.5  # between two rows of truth that are interpolated


class States(NamedTuple):
    """States at N instants."""

    t_s: np.ndarray  # (N,)
    r_i: np.ndarray  # (N, 3) m
    v_i: np.ndarray  # (N, 3) m/s
    q_ib: np.ndarray  # (N, 4)


def at(truth, earth, t_s):
    """States of a TruthSeries at the times t_s; those that it does not cover are left out.

    Position: cubic through the positions and velocities of the neighbouring rows; velocity: linear between
    them; attitude: at a constant rate from one row to the next.
    """
    known = covered(truth, t_s)
    out = _resample(earth, truth.t_s, truth.r_e, truth.v_e, truth.angles, t_s[known])
    return States(t_s[known], *out)


def at_rows(truth, earth):
    """States of a TruthSeries at its own rows."""
    return States(truth.t_s, *_resample(earth, truth.t_s, truth.r_e, truth.v_e, truth.angles, truth.t_s))


def covered(truth, t_s):
    """Whether there is truth near each time: (N,) s -> (N,) bool."""
    k = np.clip(np.searchsorted(truth.t_s, t_s), 1, len(truth.t_s) - 1)
    inside = (t_s >= truth.t_s[0] - SAME_S) & (t_s <= truth.t_s[-1] + SAME_S)
    return inside & (truth.t_s[k] - truth.t_s[k - 1] <= LONGEST_STEP_S)


@inner
def attitude_eb(r_e, angles):
    """q_eb of roll, pitch, heading (3,) rad at a position (3,) m, frame e."""
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    C_nb = euler.dcm_from_euler(angles[0], angles[1], angles[2])
    return rotation.quat_from_dcm(wgs84.dcm_en(latitude, longitude) @ C_nb)


@kernel
def _resample(earth, t_row, r_row, v_row, angles, t_s):
    """`at` on arrays."""
    n = t_s.shape[0]
    r_i, v_i, q_ib = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 4))
    for j in range(n):
        k = min(max(np.searchsorted(t_row, t_s[j]), 1), t_row.shape[0] - 1)
        h = t_row[k] - t_row[k - 1]
        x = min(max((t_s[j] - t_row[k - 1]) / h, 0.0), 1.0)
        r_0, r_1, v_0, v_1 = r_row[k - 1], r_row[k], v_row[k - 1], v_row[k]
        across = (1.0 - x) ** 2 * x * h * v_0 - x * x * (1.0 - x) * h * v_1
        r_e = (1.0 + 2.0 * x) * (1.0 - x) ** 2 * r_0 + x * x * (3.0 - 2.0 * x) * r_1 + across
        v_e = (1.0 - x) * v_0 + x * v_1
        q_0, q_1 = attitude_eb(r_0, angles[k - 1]), attitude_eb(r_1, angles[k])
        turn = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q_0), q_1))
        q_eb = rotation.quat_multiply(q_0, rotation.quat_from_rotvec(x * turn))
        r_i[j], v_i[j] = frames.inertial_from_ecef(earth, t_s[j], r_e, v_e)
        q_ie = rotation.quat_from_dcm(frames.dcm_ie(earth, t_s[j]))
        q_ib[j] = rotation.quat_normalise(rotation.quat_multiply(q_ie, q_eb))
    return r_i, v_i, q_ib


class Way(NamedTuple):
    """Where the samples of the IMU lie between rows of truth."""

    t_s: np.ndarray  # (N,) ends of samples
    row_s: np.ndarray  # (L,) of the rows
    k: np.ndarray  # (N,) the row after each, at least 1
    x: np.ndarray  # (N,) share of the time from row k - 1 to row k that has passed


def as_felt(truth, earth, imu, t_s):
    """States of a TruthSeries at ends of samples, those left out that it does not cover: reference.States.

    They stay as `reference.at` has them where a sample is missing between two rows, and where the IMU departs
    from the rows as no motion does: from a line by more velocity than rows near there, or from their turn by
    TURN_RAD and TURN_SHARE of it, when the usual bias of its gyros is taken off.

    truth, earth, imu : series.TruthSeries, EarthRotation, dataset.Increments;  t_s : (N,) s, of imu.t_s
    """
    plain = at(truth, earth, t_s)
    way = _way(truth, imu)
    inside = _between(way)
    if not inside.any():
        return plain
    rows = at_rows(truth, earth)
    q_ib, apart = _attitudes(way, rows, imu)
    middle = q_ib * Rotation.from_rotvec(-0.5 * imu.dtheta_b)
    dv_i = _bent(way, np.cumsum(middle.apply(imu.dv_b), axis=0))
    good = (
        ~apart
        & ~_any(way, imu.bridged)
        & (_most(way, np.where(inside[:, None], dv_i, 0.0)) <= _changes(rows) + CALM)
    )
    good &= (truth.t_s <= imu.t_s[-1]) & (np.append(-np.inf, truth.t_s[:-1]) >= imu.t_s[0])
    good = good[way.k] & inside
    dr_i = _moved(way, np.where(good[:, None], dv_i, 0.0))
    j = np.searchsorted(imu.t_s, plain.t_s - SAME_S)  # the samples that are asked for
    taken = good[j, None]
    return States(
        plain.t_s,
        np.where(taken, plain.r_i + dr_i[j], plain.r_i),
        np.where(taken, plain.v_i + dv_i[j], plain.v_i),
        np.where(taken, rotation.wxyz(q_ib[j].as_quat()), plain.q_ib),
    )


def _way(truth, imu):
    """Way of a TruthSeries and Increments."""
    k = np.clip(np.searchsorted(truth.t_s, imu.t_s - SAME_S), 1, len(truth.t_s) - 1)
    return Way(imu.t_s, truth.t_s, k, (imu.t_s - truth.t_s[k - 1]) / (truth.t_s[k] - truth.t_s[k - 1]))


def _between(way):
    """Whether each sample ends between two rows, at neither of them: (N,) bool."""
    since_s, to_s = way.t_s - way.row_s[way.k - 1], way.row_s[way.k] - way.t_s
    return (since_s > SAME_S) & (to_s > SAME_S) & (since_s + to_s <= LONGEST_STEP_S)


def _attitudes(way, rows, imu):
    """Attitudes at ends of samples, (N,) Rotation; whether gyros and rows disagree before a row: (L,)."""
    true = Rotation.from_quat(rotation.xyzw(rows.q_ib))
    step_s, dtheta_b = np.diff(way.row_s)[:, None], imu.dtheta_b
    _, _, lacks = _lacks(way, true, dtheta_b)
    if len(lacks) >= LEAST_STEPS:
        bias = np.median(lacks / step_s, axis=0)
        dtheta_b = dtheta_b + bias * np.diff(way.t_s, prepend=way.t_s[0])[:, None]
    since, turn, lacks = _lacks(way, true, dtheta_b)
    q_ib = true[way.k - 1] * since * Rotation.from_rotvec(way.x[:, None] * lacks[way.k - 1])
    apart = np.linalg.norm(lacks, axis=1) > TURN_RAD + TURN_SHARE * turn.magnitude()
    return q_ib, np.append(True, apart)


def _lacks(way, true, dtheta_b):
    """What increments (N, 3) rad lack to the turns from row to row.

    -> turn since the row before each sample, (N,) Rotation; from row to row, (L - 1,) Rotation; what that
    lacks to the turn of the attitudes `true` (L,), (L - 1, 3) rad
    """
    last = np.clip(np.searchsorted(way.t_s, way.row_s - SAME_S), 1, len(way.t_s) - 1)  # where a row lies
    part = (way.row_s - way.t_s[last - 1]) / (way.t_s[last] - way.t_s[last - 1])
    turned = Rotation.from_quat(rotation.xyzw(_turned(dtheta_b)))
    at_rows = turned[last - 1] * Rotation.from_rotvec(part[:, None] * dtheta_b[last])
    turn = at_rows[:-1].inv() * at_rows[1:]
    return at_rows[way.k - 1].inv() * turned, turn, (turn.inv() * true[:-1].inv() * true[1:]).as_rotvec()


@kernel
def _turned(dtheta_b):
    """Attitudes after increments (N, 3) rad, relative to before the first: (N, 4)."""
    out, q = np.empty((dtheta_b.shape[0], 4)), np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(dtheta_b.shape[0]):
        q = rotation.quat_normalise(rotation.quat_multiply(q, rotation.quat_from_rotvec(dtheta_b[k])))
        out[k] = q
    return out


def _bent(way, summed):
    """By how much sums (N, 3) depart from a line between what they are at the rows."""
    return summed - between(way.t_s, way.row_s, between(way.row_s, way.t_s, summed))


def _any(way, flags):
    """Whether one of the samples before each row, back to the row before, is flagged: (N,) -> (L,) bool."""
    out = np.zeros(len(way.row_s), dtype=bool)
    np.logical_or.at(out, way.k, flags)
    np.logical_or.at(out, np.clip(way.k[:-1], 1, None), flags[1:])  # it began before the row
    return out


def _most(way, vectors):
    """The longest of vectors (N, 3) before each row, back to the row before: (L,)."""
    out = np.zeros(len(way.row_s))
    np.maximum.at(out, way.k, np.linalg.norm(vectors, axis=1))
    return out


def _changes(rows):
    """Velocity by which the course near each row changes within one step of the rows: (L,) m/s."""
    step_s = np.diff(rows.t_s)
    bends = np.linalg.norm(np.diff(np.diff(rows.v_i, axis=0) / step_s[:, None], axis=0), axis=1)
    near = np.pad(bends, 3)  # bends[k] is at row k + 1; near a row are those at it, and two before and after
    return np.append(0.0, step_s) * np.max([near[i : i + len(rows.t_s)] for i in range(5)], axis=0)


def _moved(way, dv_i):
    """Positions that velocities (N, 3) m/s, none at the rows, lead to, so that the rows are met: (N, 3) m."""
    way_i = cumulative_trapezoid(dv_i, way.t_s, axis=0, initial=0.0)
    at_rows = between(way.row_s, way.t_s, way_i)
    smooth = (way.x**2 * (3.0 - 2.0 * way.x))[:, None]
    return way_i - at_rows[way.k - 1] - smooth * (at_rows[way.k] - at_rows[way.k - 1])
