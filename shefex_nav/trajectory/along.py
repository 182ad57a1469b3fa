"""An attitude along the velocity, where a file has none."""

from itertools import pairwise

import numpy as np

from shefex_nav.geometry import rotation, wgs84
from shefex_nav.geometry.rotation import quat_multiply
from shefex_nav.trajectory import placing

STEP_S = 0.05  # between two attitudes
LARGEST_ROLL = 0.25  # rad between two
STILL = 1.0  # m/s relative to the Earth, below which a velocity has no direction


def velocity(rows, earth, roll_rate):
    """Attitudes along the velocity relative to the Earth: times (M,) s and q_ib (M, 4).

    Forward points along the velocity; before it moves, to where it moves first, and in a stop to where it
    moved last. The other axes are carried along without a turn about forward, but for roll_rate, rad/s, from
    the first motion on.

    rows : (t_s, track.Track)
    """
    (t_rows, curve), step = rows, STEP_S
    if roll_rate:
        step = min(step, LARGEST_ROLL / abs(roll_rate))
    t_s = np.linspace(t_rows[0], t_rows[-1], max(4, int(np.ceil((t_rows[-1] - t_rows[0]) / step)) + 1))
    here = placing.place(earth, t_s)
    r_i, v_i, _ = curve.at(t_s)
    r_e = placing.rotated(here.C_ie.transpose(0, 2, 1), r_i)
    v_e = placing.rotated(here.C_ie.transpose(0, 2, 1), v_i) - np.cross(_rate_e(earth), r_e)
    forward, begin = _directions(v_e, r_e)
    q_eb = _carried(forward)
    roll = roll_rate * np.maximum(t_s - t_s[begin], 0.0)
    q_ie = [rotation.quat_from_dcm(np.ascontiguousarray(one)) for one in here.C_ie]
    rolled = np.column_stack([np.cos(0.5 * roll), np.sin(0.5 * roll), np.zeros((len(roll), 2))])
    return t_s, np.array(
        [quat_multiply(quat_multiply(a, b), c) for a, b, c in zip(q_ie, q_eb, rolled, strict=True)]
    )


def _rate_e(earth):
    return earth.C_re.T @ np.array([0.0, 0.0, earth.rate])


def _directions(v_e, r_e):
    """Where forward points (M, 3), frame e, and the number of the first row that moves."""
    speed = np.linalg.norm(v_e, axis=1)
    moves = speed > STILL
    if not moves.any():
        up = np.array([-wgs84.level_axes(r_e[0])[:, 2]])
        return np.repeat(up, len(v_e), axis=0), 0
    begin = int(np.argmax(moves))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(moves)), begin))
    return v_e[last] / speed[last][:, None], begin


def _carried(forward):
    """q_eb (M, 4): body x along `forward`, each attitude from the one before by the shortest turn."""
    x = forward[0]
    y = wgs84.perpendicular(x)
    q = [rotation.quat_from_dcm(np.column_stack([x, y, np.cross(x, y)]))]
    for before, now in pairwise(forward):
        q.append(rotation.quat_multiply(_shortest(before, now), q[-1]))
    return np.array(q)


def _shortest(a, b):
    """Quaternion of the shortest turn of a unit vector to another."""
    w = 1.0 + a @ b
    if w < 1e-9:
        return np.array([0.0, *wgs84.perpendicular(a)])
    return rotation.quat_normalise(np.array([w, *np.cross(a, b)]))
