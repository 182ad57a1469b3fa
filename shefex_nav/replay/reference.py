"""The truth of a data set at any instant within it, as states in inertial axes."""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import euler, frames, rotation, wgs84

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
