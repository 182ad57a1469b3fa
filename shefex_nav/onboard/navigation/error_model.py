"""How errors grow: transition matrix of one interval of strapdown. Its noise is in `process_noise`.

In: the parts of samples that the strapdown passes through (`strapdown.cut`). Out: the rows of Phi that are
not trivial, in the order of a `state.Layout`; `prediction` puts them together.

The attitude error is carried in inertial axes, psi = C_ib dtheta_b, in which it moves only by the errors
of the gyros, and turned back into body axes at the end. Over a piece of duration T with increments
dtheta, dv (Groves, 2nd ed., section 14.2.4; Sola, arXiv:1711.02508, section 5 for the body-axes form)::

    psi <- psi + C_ib J d dtheta
    dv  <- dv - (C_ib s) x psi + C_ib (D d dtheta + J d dv)
    dr  <- dr + T dv - (C_ib s_r) x psi + ...,                plus the gradient of a central gravity field

with s, s_r of `strapdown`; J, D in `derivatives`. What an error of calibration does to the increments
(`calibration`) is a fixed direction times a weight: the duration for a bias, an angle for scale factor and
misalignment of the gyros (without its noise, `process_noise`), a gain of velocity for those of the
accelerometers and for the g-sensitivity::

    d dtheta = -(T, dtheta_x, dtheta_y, dtheta_z, dv_x, dv_y, dv_z) e,    d dv = -(T, dv_x, dv_y, dv_z) e

So one response (to every direction e) is accumulated for each weight that is needed, and every column of Phi
is a response times a direction. Which, the table of `blocks` says.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, rows
from shefex_nav.geometry import triples as t3
from shefex_nav.geometry import wgs84
from shefex_nav.onboard.navigation.blocks import DURATION, GYROS, SHAKEN, WEIGHTS
from shefex_nav.onboard.navigation.calibration import DRIVERS
from shefex_nav.onboard.navigation.state import ATT, BA, BG, GRAVITY, POS, VEL

SPARE = 8  # rows of a `record` for noise that is found to be other than told


class Responses(NamedTuple):
    """What errors of the increments have done since the start of an interval, and which of it is wanted."""

    by_gyro: np.ndarray  # (7,) bool, weights whose responses are wanted (`needed`)
    by_accel: np.ndarray  # (7,) bool
    gyro: np.ndarray  # (7, 3, 3, 3) for each weight w: of r, v, psi, to e in d dtheta = -w e
    accel: np.ndarray  # (7, 2, 3, 3) for each weight w: of r, v, to e in d dv = -w e


@inner(forceinline=True)
def derivatives(T, dtheta, dv, B, b):
    """What phi and s of one part do when its increments change, body axes at its start, nine numbers each.

    J = d(phi)/d(dtheta) = d(s)/d(dv), to the third order in dtheta, coning and sculling included;
    D = d(s)/d(dtheta); D_r = d(s_r)/d(dtheta); J_r = d(s_r)/d(dv).
    """
    t2, turn, share = t3.dot(dtheta, dtheta), t3.cross(dtheta, dv), T * T / 12.0
    third = 1.0 / 6.0 - t2 / 120.0
    zero = (0.0, 0.0, 0.0)
    J = t3.composed(
        1.0 - third * t2, t3.scaled(third, dtheta), dtheta,
        t3.plus(t3.scaled(0.5 - t2 / 24.0, dtheta), -share, B),
    )  # fmt: skip
    D = t3.composed(
        t3.dot(dtheta, dv) / 6.0, t3.plus(t3.scaled(-1.0 / 6.0, dv), -1.0 / 12.0, turn), dtheta,
        t3.plus(t3.plus(t3.scaled(t2 / 24.0 - 0.5, dv), -1.0 / 6.0, turn), -share, b),
    )  # fmt: skip
    D_r = t3.composed(0.0, zero, zero, t3.scaled(-T / 6.0, dv))
    J_r = t3.composed(0.5 * T, zero, zero, t3.scaled(T / 6.0, dtheta))
    return J, D, D_r, J_r


@inner(forceinline=True)
def carry_all(responses, m, weights, piece, noise, C, u, u_r):
    """Carry the responses of all weights that are wanted over a part, in place.

    responses : Responses;  m : (4, 3, 3) and weights : (7,) are written
    piece : of `strapdown.cut`;  noise : rad/s, what of its rate is noise
    C : C_ib at its start;  u, u_r : as in `carry`
    """
    T, dtheta, dv, B, b = piece[0], piece[1], piece[2], piece[3], piece[4]
    J, D, D_r, J_r = derivatives(T, dtheta, dv, B, b)
    t3.store(m[0], t3.product(C, J))
    t3.store(m[1], t3.product(C, D))
    t3.store(m[2], t3.product(C, D_r))
    t3.store(m[3], t3.product(C, J_r))
    turned = t3.plus(dtheta, -T, noise)
    weights[0], weights[1], weights[2], weights[3] = T, turned[0], turned[1], turned[2]
    weights[4], weights[5], weights[6] = dv
    by_gyro, by_accel, gyro, accel = responses
    for k in range(WEIGHTS):
        if by_gyro[k]:
            carry(gyro, k, T, u, u_r, weights[k], m)
        if by_accel[k]:
            carry_force(accel, k, T, weights[k], m)


@inner(forceinline=True)
def carry(gyro, k, T, u, u_r, w, m):
    """Carry the response of weight k over a part, in place.

    gyro : of Responses
    u, u_r : velocity and distance gained in the part, inertial axes
    m : (4, 3, 3) J, D, D_r, J_r of the part, their left side turned to inertial axes
    """
    for j in range(3):
        x, y, z = gyro[k, 2, 0, j], gyro[k, 2, 1, j], gyro[k, 2, 2, j]
        gyro[k, 0, 0, j] += T * gyro[k, 1, 0, j] + u_r[2] * y - u_r[1] * z - w * m[2, 0, j]
        gyro[k, 0, 1, j] += T * gyro[k, 1, 1, j] + u_r[0] * z - u_r[2] * x - w * m[2, 1, j]
        gyro[k, 0, 2, j] += T * gyro[k, 1, 2, j] + u_r[1] * x - u_r[0] * y - w * m[2, 2, j]
        gyro[k, 1, 0, j] += u[2] * y - u[1] * z - w * m[1, 0, j]
        gyro[k, 1, 1, j] += u[0] * z - u[2] * x - w * m[1, 1, j]
        gyro[k, 1, 2, j] += u[1] * x - u[0] * y - w * m[1, 2, j]
        for i in range(3):
            gyro[k, 2, i, j] -= w * m[0, i, j]


@inner(forceinline=True)
def carry_force(accel, k, T, w, m):
    """The same for `accel` of Responses."""
    for i in range(3):
        for j in range(3):
            accel[k, 0, i, j] += T * accel[k, 1, i, j] - w * m[3, i, j]
            accel[k, 1, i, j] -= w * m[0, i, j]


@inner(forceinline=True)
def begin(responses, at, G):
    """Mark the weights that have a column, and set their responses to zero.

    responses : Responses, written;  at : of Layout;  G : nine numbers
    """
    by_gyro, by_accel, gyro, accel = responses
    couples = False  # the gyros sense the corrected specific force
    for k in range(9):
        couples = couples or G[k] != 0.0
    for k in range(WEIGHTS):
        by_gyro[k] = by_accel[k] = k == DURATION
    for row in range(DRIVERS.shape[0]):
        block, _, triad, weight, _ = DRIVERS[row]
        if at[block] >= 0:
            by_gyro[weight] = by_gyro[weight] or triad == GYROS or couples
            by_accel[weight] = by_accel[weight] or triad != GYROS
    for k in range(WEIGHTS):
        if by_gyro[k]:
            gyro[k] = 0.0
        if by_accel[k]:
            accel[k] = 0.0


@inner(forceinline=True)
def _put(top, column, response, k, sign, direction, i):
    """Add a response times column i of a matrix (3, 3) to the first rows of a column."""
    a, b, c = sign * direction[0, i], sign * direction[1, i], sign * direction[2, i]
    for block in range(response.shape[1]):
        for row in range(3):
            top[3 * block + row, column] += (
                response[k, block, row, 0] * a
                + response[k, block, row, 1] * b
                + response[k, block, row, 2] * c
            )


@inner
def put_imu(top, at, responses, triads, vibration, drive):
    """Add the columns of all errors of the IMU to the first rows of Phi, in place.

    top : (9, n);  at : of Layout;  responses : Responses of r, v in i, theta in b
    triads : (3, 3, 3) inverses M, A of the triads, and M G A, rate by specific force
    vibration, drive : of the ImuWindow
    """
    gyro, accel = responses.gyro, responses.accel
    M, A, MGA = triads[0], triads[1], triads[2]
    for i in range(3):
        _put(top, BG.start + i, gyro, DURATION, 1.0, M, i)
        _put(top, BA.start + i, accel, DURATION, 1.0, A, i)
        _put(top, BA.start + i, gyro, DURATION, -1.0, MGA, i)
    for row in range(DRIVERS.shape[0]):
        block, number, triad, weight, axis = DRIVERS[row]
        if at[block] < 0:
            continue
        column = at[block] + number
        if triad == GYROS:
            _put(top, column, gyro, weight, 1.0, M, axis)
        elif triad == SHAKEN:
            _add_column(top, column, vibration**2, BA.start + axis)
        else:
            _put(top, column, accel, weight, 1.0, A, axis)
            _put(top, column, gyro, weight, -1.0, MGA, axis)
    m = drive.shape[1]
    for k in range(m):
        for i in range(3):
            _add_column(top, top.shape[1] - m + k, drive[i, k], BG.start + i)
            _add_column(top, top.shape[1] - m + k, drive[3 + i, k], BA.start + i)


@inner(forceinline=True)
def _add_column(top, column, factor, other):
    """Add another column of the first rows of Phi, times a factor, to one of them."""
    for row in range(top.shape[0]):
        top[row, column] += factor * top[row, other]


@inner(forceinline=True)
def put_gravity(top, at, T):
    """Add the columns of what the on-board field leaves out to the first rows of Phi, in place."""
    if at[GRAVITY] >= 0:
        for i in range(3):
            top[POS.start + i, at[GRAVITY] + i] += 0.5 * T * T
            top[VEL.start + i, at[GRAVITY] + i] += T


@inner(forceinline=True)
def put_motion(top, r, u, u_r, C, C_bi, T):
    """Write the columns of position, velocity and attitude into the first rows of Phi.

    top : (9, n);  r : m, at the start;  u, u_r : velocity and distance gained, inertial axes
    C : C_ib at the start, C_bi at the end;  T : s
    """
    d2 = t3.dot(r, r)
    pull = wgs84.GM / (d2 * np.sqrt(d2))
    for i in range(3):
        top[POS.start + i, VEL.start + i] = T
        for j in range(3):
            same = 1.0 if i == j else 0.0
            gradient = pull * (3.0 / d2 * r[i] * r[j] - same)
            top[POS.start + i, POS.start + j] = same + 0.5 * T * T * gradient
            top[VEL.start + i, POS.start + j] = T * gradient
            top[VEL.start + i, VEL.start + j] = same + 0.5 * T * T * gradient
    zero = (0.0, 0.0, 0.0)
    t3.store(top[POS, ATT], t3.product(t3.composed(0.0, zero, zero, t3.scaled(-1.0, u_r)), C))
    t3.store(top[VEL, ATT], t3.product(t3.composed(0.0, zero, zero, t3.scaled(-1.0, u)), C))
    t3.store(top[ATT, ATT], t3.product(C_bi, C))


@inner(forceinline=True)
def vibration_level(motors, thrust_threshold, shake_threshold, t_s, thrust, shake):
    """Vibration relative to that of the strongest motor: 0 unless a motor burns.

    One burns if it pushes the vehicle, or if it shakes it: the last of a burn pushes little.

    Parameters
    ----------
    motors : of NavParams
    thrust_threshold, shake_threshold : of ImuModel
    t_s : mission time
    thrust : m/s^2, specific force towards the nose, mean of a tick
    shake : m/s, of `shake`
    """
    level = 0.0
    if thrust > thrust_threshold or shake > shake_threshold:
        for k in range(motors.shape[0]):
            if motors[k, 0] <= t_s:
                level = motors[k, 1]
    return level


@inner(forceinline=True)
def shake(dv_b):
    """Noise of velocity increments (n, 3), from their changes: m/s rms, 0 for a single sample."""
    total, n = 0.0, dv_b.shape[0] - 1
    for k in range(n):
        for i in range(3):
            total += (dv_b[k + 1, i] - dv_b[k, i]) ** 2
    return np.sqrt(total / (6.0 * n)) if n > 0 else 0.0


@inner(forceinline=True)
def valid(model, t_end_s):
    """Row of a `record` that counts in a tick which ends at t_end_s."""
    k = 0
    while k + 1 < model.shape[0] and model[k + 1].from_s < t_end_s:
        k += 1
    return k


def record(params, more=SPARE):
    """Noise of NavParams for kernels: records, which they take seven times as fast as a tuple.

    The first is what NavParams say; `more` rows have room for what the filter finds out (`adaptation`): a row
    counts in the ticks that end after its `from_s`.
    """
    others = ("clock_white", "clock_walk", "range_bias_sigma", "range_bias_time_s", "gravity_error")
    values = params.imu._asdict() | {name: getattr(params, name) for name in others} | {"from_s": -np.inf}
    one = tuple(values.values())
    model = np.array([one] * (1 + more), dtype=rows([(name, float) for name in values]))
    model["from_s"][1:] = np.inf
    return model
