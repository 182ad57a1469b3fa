"""One step of the equations of motion by the method of Dormand & Prince, and what lies between its ends.

In: state, derivative. Out: state after the step, its estimated error, the continuous extension.

Dormand & Prince, J. Comp. Appl. Math. 6 (1980): order 5 with an embedded order 4; continuous extension of
order 4 by Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, 2nd ed., section II.6. The
error is the largest of the estimated errors of the components, in m, m/s, rad and rad/s alike.

Within a step the attitude is the rotation vector since its start (Munthe-Kaas, BIT 38, 1998): steady spin
costs no accuracy, and the quaternion keeps its length.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.world.flight.dynamics import AUX, STATE, cross, derivative
from shefex_nav.world.flight.surroundings import fine_gravity_i

MOVING = 13  # components of the state on which its derivative depends; the others are integrals

_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
_D = np.array(
    [
        -12715105075 / 11282082432, 0.0, 87487479700 / 32700410799, -10690763975 / 1880347072,
        701980252875 / 199316789632, -1453857185 / 822651844, 69997945 / 29380423,
    ]
)  # fmt: skip


class Work(NamedTuple):
    """Memory of the integration."""

    slopes: np.ndarray  # (7, 19) derivatives at the stages
    fine: np.ndarray  # (2, 3) remainder of gravitation where the step begins and where it ends
    y: np.ndarray  # (19,) state at a stage or at a sample
    new: np.ndarray  # (19,) state at the end of the step
    change: np.ndarray  # (19,) over the step
    curve: np.ndarray  # (3, 19) the continuous extension beyond the straight line
    aux: np.ndarray  # (9,)
    taken: np.ndarray  # (6,) increments that samples within the step have taken


def workspace():
    """Work for one section."""
    seven, three = np.zeros((7, STATE)), np.zeros((3, STATE))
    y, new, change = np.zeros(STATE), np.zeros(STATE), np.zeros(STATE)
    return Work(seven, np.zeros((2, 3)), y, new, change, three, np.zeros(AUX), np.zeros(6))


@inner(error_model="numpy", forceinline=True)
def turn(x, y):
    """Make y[6:10] the attitude of x turned by the rotation vector that stands in y[6:9]."""
    tx, ty, tz = y[6], y[7], y[8]
    angle = np.sqrt(tx * tx + ty * ty + tz * tz)
    c, k = np.cos(0.5 * angle), 0.5
    if angle > 0.0:
        k = np.sin(0.5 * angle) / angle
    tx, ty, tz = k * tx, k * ty, k * tz
    w, a, b, d = x[6], x[7], x[8], x[9]
    y[6], y[7] = w * c - a * tx - b * ty - d * tz, w * tx + a * c + b * tz - d * ty
    y[8], y[9] = w * ty - a * tz + b * c + d * tx, w * tz + a * ty - b * tx + d * c
    norm = 1.0 / np.sqrt(y[6] ** 2 + y[7] ** 2 + y[8] ** 2 + y[9] ** 2)
    for j in range(6, 10):
        y[j] *= norm


@inner(error_model="numpy", forceinline=True)
def turning(tx, ty, tz, p, q, r, slope):
    """Write the derivative of the rotation vector t since the start of the step, at the rate p, q, r.

    Bortz, IEEE Trans. AES 7 (1971): omega + t x omega / 2 + (1 - |t|/2 cot(|t|/2)) / |t|^2 t x (t x omega).
    """
    angle2 = tx * tx + ty * ty + tz * tz
    if angle2 < 0.1:  # series; what is left out is below 3e-12
        k = 1.0 / 12.0 + angle2 * (1.0 / 720.0 + angle2 * (1.0 / 30240.0 + angle2 / 1209600.0))
    else:
        half = 0.5 * np.sqrt(angle2)
        k = (1.0 - half / np.tan(half)) / angle2
    ax, ay, az = cross(tx, ty, tz, p, q, r)
    bx, by, bz = cross(tx, ty, tz, ax, ay, az)
    slope[6], slope[7], slope[8] = p + 0.5 * ax + k * bx, q + 0.5 * ay + k * by, r + 0.5 * az + k * bz
    slope[9] = 0.0


@inner(error_model="numpy", forceinline=True)
def remainder(fine, part):
    """Remainder of gravitation part of the way through the step: three numbers."""
    rest = 1.0 - part
    return (
        rest * fine[0, 0] + part * fine[1, 0],
        rest * fine[0, 1] + part * fine[1, 1],
        rest * fine[0, 2] + part * fine[1, 2],
    )


@inner(error_model="numpy", forceinline=True)
def begin(t_s, x, section, gravity, work):
    """First stage of a step that does not follow smoothly from another one."""
    fine = fine_gravity_i(gravity, section.s, t_s, x[0], x[1], x[2])
    work.fine[0, 0], work.fine[0, 1], work.fine[0, 2] = fine
    derivative(t_s, x, section, fine, work.slopes[0], work.aux)
    turning(0.0, 0.0, 0.0, x[10], x[11], x[12], work.slopes[0])


@inner(error_model="numpy", forceinline=True)
def make_step(t_s, t_new, x, section, gravity, work):
    """One step from x at t_s into work.new at t_new; its first stage is there already. Returns the error.

    Stages at the end see the time just before it: what jumps there belongs to the next step.
    """
    h, slopes, fine, y, new, change = t_new - t_s, work.slopes, work.fine, work.y, work.new, work.change
    fall = 0.5 * h * h
    fine[1, 0], fine[1, 1], fine[1, 2] = fine_gravity_i(
        gravity,
        section.s,
        t_new,
        x[0] + h * x[3] + fall * slopes[0, 3],
        x[1] + h * x[4] + fall * slopes[0, 4],
        x[2] + h * x[5] + fall * slopes[0, 5],
    )
    end = np.nextafter(t_new, t_s)
    for stage in range(1, 7):
        for j in range(STATE):
            change[j] = 0.0
        for i in range(stage):
            a = h * _A[stage, i]
            for j in range(STATE):
                change[j] += a * slopes[i, j]
        for j in range(STATE):
            y[j] = x[j] + change[j]
        for j in range(6, 9):
            y[j] = change[j]
        turn(x, y)
        part = _C[stage]
        t = end if stage >= 5 else t_s + part * h
        derivative(t, y, section, remainder(fine, part), slopes[stage], work.aux)
        turning(change[6], change[7], change[8], y[10], y[11], y[12], slopes[stage])
    for j in range(STATE):
        new[j] = y[j]
    return _error(h, slopes, work.curve[0])


@inner(error_model="numpy", forceinline=True)
def _error(h, slopes, total):
    """Largest estimated error of a step of h s; infinite where something is not finite.

    total: (19,) to work in.
    """
    _weighted(_E, slopes, total)
    error = 0.0
    for j in range(STATE):
        size = abs(h * total[j])
        if not size < np.inf:
            return np.inf
        error = max(error, size)
    return error


@inner(error_model="numpy", forceinline=True)
def _weighted(weights, slopes, total):
    """Write the weighted sum of the slopes (7, 19) into total (19,)."""
    for j in range(STATE):
        total[j] = 0.0
    for i in range(7):
        for j in range(STATE):
            total[j] += weights[i] * slopes[i, j]


@inner(error_model="numpy", forceinline=True)
def dense_output(h, work):
    """Coefficients of the continuous extension of the step just made."""
    slopes, curve, change = work.slopes, work.curve, work.change
    _weighted(_D, slopes, curve[2])
    for j in range(STATE):
        curve[0, j] = h * slopes[0, j] - change[j]
        curve[1, j] = change[j] - h * slopes[6, j] - curve[0, j]
        curve[2, j] *= h


@inner(error_model="numpy", forceinline=True)
def read(x, part, work):
    """Write the state part of the way through the step from x into work.y, after `dense_output`."""
    y, change, curve, rest = work.y, work.change, work.curve, 1.0 - part
    for j in range(STATE):
        beyond = curve[0, j] + part * (curve[1, j] + rest * curve[2, j])
        y[j] = part * (change[j] + rest * beyond)
        if not 6 <= j < 9:
            y[j] += x[j]
    turn(x, y)
