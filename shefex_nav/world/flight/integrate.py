"""Integration of the equations of motion with error control, exact to the instant, with samples in between.

In: state, section of the flight, surroundings. Out: state at the end of the section, rows at the IMU samples.

Method: Dormand & Prince, J. Comp. Appl. Math. 6 (1980), order 5 with an embedded order 4; step size by the PI
controller and samples by the continuous extension of order 4 of Hairer, Norsett & Wanner, Solving Ordinary
Differential Equations I, 2nd ed., sections II.4 to II.6. The increments of a sample are differences of the
continuous extension of the integrals: they sum up to the integrals over the steps, without a remainder.

Steps end exactly at the corners of the vehicle's histories, at the ticks of the attitude control and at the
end of the section; each sees the histories as they are between its ends. Ends that depend on the state are
found by bisection of the last step.

Within a step the attitude is the rotation vector since its start (Munthe-Kaas, BIT 38, 1998): steady spin
costs no accuracy, and the quaternion keeps its length. The error of a step is the largest of the estimated
errors of the components, in m, m/s, rad and rad/s alike.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.world.flight import control as attitude_control
from shefex_nav.world.flight import vehicle
from shefex_nav.world.flight.dynamics import AUX, CONTROLLED, ON_RAIL, PROGRAMMED, STATE, cross, derivative
from shefex_nav.world.flight.scene import prepare
from shefex_nav.world.flight.surroundings import fine_gravity_i, level, position_e, turned

TOLERANCE = 1e-10  # m, m/s, rad, rad/s in a step
LARGEST_STEP = 0.05  # s
SMALLEST_STEP = 1e-6  # s; a step is accepted by then: what is left is a jump in the forces
FIRST_STEP = 0.01  # s, tried at the start of a section
TIME_EPS = 1e-9  # s, instants closer than this are one sample
EVENT_EPS = 1e-12  # s, to which an end that depends on the state is found
MOVING = 13  # components of the state on which its derivative depends; the others are integrals

T_END, EVENT, STOP = 0, 1, 2  # how a section ends

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
_SAFETY, _SHRINK, _GROW, _BETA = 0.9, 0.2, 10.0, 0.04  # of the step size control


class _Work(NamedTuple):
    """Memory of the integration."""

    slopes: np.ndarray  # (7, 19) derivatives at the stages
    fine: np.ndarray  # (2, 3) remainder of gravitation where the step begins and where it ends
    y: np.ndarray  # (19,) state at a stage or at a sample
    new: np.ndarray  # (19,) state at the end of the step
    change: np.ndarray  # (19,) over the step
    curve: np.ndarray  # (3, 19) the continuous extension beyond the straight line
    aux: np.ndarray  # (9,)
    taken: np.ndarray  # (6,) increments that samples within the step have taken


@njit(cache=True)
def _workspace():
    seven, three = np.zeros((7, STATE)), np.zeros((3, STATE))
    y, new, change = np.zeros(STATE), np.zeros(STATE), np.zeros(STATE)
    return _Work(seven, np.zeros((2, 3)), y, new, change, three, np.zeros(AUX), np.zeros(6))


@njit(cache=True, error_model="numpy")
def _turn(x, y):
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


@njit(cache=True, error_model="numpy")
def _turning(tx, ty, tz, p, q, r, slope):
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


@njit(cache=True, error_model="numpy")
def _at(fine, part):
    """Remainder of gravitation part of the way through the step: three numbers."""
    rest = 1.0 - part
    return (
        rest * fine[0, 0] + part * fine[1, 0],
        rest * fine[0, 1] + part * fine[1, 1],
        rest * fine[0, 2] + part * fine[1, 2],
    )


@njit(cache=True, error_model="numpy")
def _begin(t_s, x, mode, law, s, tables, gravity, work):
    """First stage of a step that does not follow smoothly from another one."""
    fine = fine_gravity_i(gravity, s, t_s, x[0], x[1], x[2])
    work.fine[0, 0], work.fine[0, 1], work.fine[0, 2] = fine
    derivative(t_s, x, mode, law, s, tables, fine, work.slopes[0], work.aux)
    _turning(0.0, 0.0, 0.0, x[10], x[11], x[12], work.slopes[0])


@njit(cache=True, error_model="numpy")
def _step(t_s, t_new, x, mode, law, s, tables, gravity, work):
    """One step from x at t_s into work.new at t_new; its first stage is there already. Returns the error.

    Stages at the end see the time just before it: what jumps there belongs to the next step.
    """
    h, slopes, fine, y, new, change = t_new - t_s, work.slopes, work.fine, work.y, work.new, work.change
    fall = 0.5 * h * h
    fine[1, 0], fine[1, 1], fine[1, 2] = fine_gravity_i(
        gravity,
        s,
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
        _turn(x, y)
        part = _C[stage]
        t = end if stage >= 5 else t_s + part * h
        derivative(t, y, mode, law, s, tables, _at(fine, part), slopes[stage], work.aux)
        _turning(change[6], change[7], change[8], y[10], y[11], y[12], slopes[stage])
    new[:] = y
    return _error(h, slopes, work.curve[0])


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _weighted(weights, slopes, total):
    """Write the weighted sum of the slopes (7, 19) into total (19,)."""
    for j in range(STATE):
        total[j] = 0.0
    for i in range(7):
        for j in range(STATE):
            total[j] += weights[i] * slopes[i, j]


@njit(cache=True, error_model="numpy")
def _bend(h, work):
    """Coefficients of the continuous extension of the step just made."""
    slopes, curve, change = work.slopes, work.curve, work.change
    _weighted(_D, slopes, curve[2])
    for j in range(STATE):
        curve[0, j] = h * slopes[0, j] - change[j]
        curve[1, j] = change[j] - h * slopes[6, j] - curve[0, j]
        curve[2, j] *= h


@njit(cache=True, error_model="numpy")
def _write_samples(t_s, t_new, x, k, t_start, dt, mode, law, s, tables, work, rows):
    """Write the samples of [t_s, t_new), from number k on. Returns the number of the next one."""
    y, change, curve, taken, h = work.y, work.change, work.curve, work.taken, t_new - t_s
    for j in range(6):
        taken[j] = 0.0
    bent = False
    while k < rows.shape[0] and t_start + k * dt < t_new - TIME_EPS:
        if not bent:
            _bend(h, work)
            bent = True
        t_k = max(t_start + k * dt, t_s)
        part = (t_k - t_s) / h if t_k - t_s > TIME_EPS else 0.0
        rest = 1.0 - part
        for j in range(STATE):
            beyond = curve[0, j] + part * (curve[1, j] + rest * curve[2, j])
            y[j] = part * (change[j] + rest * beyond)
            if not 6 <= j < 9:
                y[j] += x[j]
        _turn(x, y)
        derivative(t_k, y, mode, law, s, tables, _at(work.fine, part), rows[k, :STATE], rows[k, STATE:])
        for j in range(MOVING):
            rows[k, j] = y[j]
        for j in range(6):
            rows[k, MOVING + j] = y[MOVING + j] - taken[j]
            taken[j] = y[MOVING + j]
        k += 1
    return k


@njit(cache=True, error_model="numpy")
def _height(t_s, x, s):
    """Height of a state above the ellipsoid, m."""
    ex, ey, ez = position_e(s, turned(s, t_s), x[0], x[1], x[2])
    height, _, _ = level(s.a, s.e2, ex, ey, ez)
    return height


@njit(cache=True, error_model="numpy")
def _ended(t_s, x, height_before, mode, s, stop_height):
    """How the section has ended by the state x at t_s: T_END (it has not), EVENT or STOP."""
    if mode == PROGRAMMED:
        return T_END
    if mode == ON_RAIL:
        ex, ey, ez = position_e(s, turned(s, t_s), x[0], x[1], x[2])
        travel = (ex - s.rail_r_e[0]) * s.rail_direction_e[0] + (ey - s.rail_r_e[1]) * s.rail_direction_e[1]
        travel += (ez - s.rail_r_e[2]) * s.rail_direction_e[2]
        return EVENT if travel > s.rail_length else T_END
    height = _height(t_s, x, s)
    if height < 0.0 and height < height_before:
        return EVENT
    return STOP if height <= stop_height < height_before else T_END


@njit(cache=True, error_model="numpy")
def _bisect(t_s, t_new, x, height, stop_height, mode, law, s, tables, gravity, work):
    """Make the step that ends where the section does, not later than t_new: (time, how it ends)."""
    low, high, how = t_s, t_new, T_END
    while True:
        middle = 0.5 * (low + high)
        last = high - low < EVENT_EPS or not low < middle < high
        t = high if last else middle
        _step(t_s, t, x, mode, law, s, tables, gravity, work)
        how = _ended(t, work.new, height, mode, s, stop_height)
        if last:
            return high, how
        if how == T_END:
            low = middle
        else:
            high = middle


@njit(cache=True)
def _steer(t_s, x, s, tables, control):
    """Let the attitude control decide on its torque."""
    _, left = vehicle.thrust(s, tables, t_s)
    _, _, i_x, i_y, i_z, _, _, _ = vehicle.mass_properties(s, tables, left)
    attitude_control.command(control, t_s, x, i_x, i_y, i_z)
    if control.next_s[0] <= t_s:  # ticks that have been missed stay missed
        control.next_s[0] = t_s + control.period
    for j in range(3):
        s.torque[j] = control.torque[j]


@njit(cache=True)
def _next_corner(t_s, t_end, breaks):
    """The next instant at which something jumps, or the end."""
    k = np.searchsorted(breaks, t_s, side="right")
    return min(t_end, breaks[k]) if k < breaks.size else t_end


@njit(cache=True)
def _controlled_step(t_s, t_new, x, size, last_error, tolerance, mode, law, s, tables, gravity, work):
    """Step towards t_new, shortened until its error is below the tolerance.

    Returns the time reached, the size that the next step may have and the error for the control.
    """
    rejected = False
    while True:
        h = t_new - t_s
        error = _step(t_s, t_new, x, mode, law, s, tables, gravity, work) / max(tolerance, 1e-300)
        if tolerance <= 0.0:
            return t_new, size, last_error
        factor = _SHRINK
        if 0.0 < error < np.inf:
            factor = _SAFETY * error ** (0.75 * _BETA - 0.2)
        if error > 1.0 and h > SMALLEST_STEP:
            t_new, rejected = t_s + max(max(_SHRINK, factor) * h, SMALLEST_STEP), True
            continue
        if error == np.inf:
            raise ArithmeticError("the equations of motion have no finite solution from here on")
        factor = _GROW if error == 0.0 else min(_GROW, max(_SHRINK, factor * last_error**_BETA))
        if rejected:
            factor = min(1.0, factor)
        # a step that was cut short says little about what is possible
        size = max(h * factor, size) if h < 0.99 * size and not rejected else h * factor
        return t_new, min(max(size, SMALLEST_STEP), LARGEST_STEP), max(error, 1e-4)


@njit(cache=True)
def _integrate(x, t_s, t_end, k, t_start, dt, mode, law, scene, gravity, breaks, control, tolerance, rows):
    """As `integrate`, for a Scene and the instants at which steps have to end."""
    s, tables, work = scene.record[0], scene.tables, _workspace()
    size, last_error = (FIRST_STEP if tolerance > 0.0 else -tolerance), 1e-4
    follows, t_break = False, t_s  # the last stage of the step before is the first one of this step
    height = _height(t_s, x, s)
    if mode == CONTROLLED:
        for j in range(3):
            s.torque[j] = control.torque[j]
    while t_s < t_end:
        if not follows:
            t_break = _next_corner(t_s, t_end, breaks)
            vehicle.choose_rows(s, tables, 0.5 * (t_s + t_break))
            if mode == CONTROLLED:
                if t_s >= control.next_s[0] - TIME_EPS:
                    _steer(t_s, x, s, tables, control)
                t_break = min(t_break, control.next_s[0])
            _begin(t_s, x, mode, law, s, tables, gravity, work)
        n = np.ceil((t_break - t_s) / size - 1e-6)  # equal steps rather than a short last one
        t_new = t_break if n <= 1.0 else t_s + (t_break - t_s) / n
        t_new, size, last_error = _controlled_step(
            t_s, t_new, x, size, last_error, tolerance, mode, law, s, tables, gravity, work
        )
        how = _ended(t_new, work.new, height, mode, s, control.stop_height)
        if how != T_END:
            t_new, how = _bisect(
                t_s, t_new, x, height, control.stop_height, mode, law, s, tables, gravity, work
            )
        k = _write_samples(t_s, t_new, x, k, t_start, dt, mode, law, s, tables, work, rows)
        x[:] = work.new
        x[MOVING:] -= work.taken
        work.slopes[0], work.fine[0] = work.slopes[6], work.fine[1]
        work.slopes[0, 6:9] = x[10:13]
        follows = t_new < t_break
        t_s = t_new
        if how != T_END:
            return t_s, k, how
        height = _height(t_s, x, s)
    return t_s, k, T_END


def integrate(x, t_s, t_end, k, t_start, dt, mode, law, configuration, world, control, tolerance, rows):
    """Integrate one section from t_s until t_end or until its event: (time, next sample, how it ended).

    Parameters
    ----------
    x : (19,) state, advanced in place
    k : index of the next sample; sample k is at t_start + k dt and goes to rows[k] (dynamics.ROW numbers) as
        state and aux, with the values that hold just after it where they jump; one at t_end is left to the
        section that follows
    mode : ON_RAIL, FREE, PROGRAMMED or CONTROLLED
    law : attitude_program.RateLaw, followed in the mode PROGRAMMED
    control : control.Control; in the mode CONTROLLED it is asked for its torque at its ticks
    tolerance : error of a step, m, m/s, rad, rad/s; not above zero: steps of -tolerance s, errors ignored

    The section ends with T_END at t_end, with EVENT at the end of the rail or on the ground, with STOP when
    control.stop_height is passed on the way down. Where the attitude is programmed it ends at t_end only.
    """
    return _integrate(
        x, float(t_s), float(t_end), int(k), float(t_start), float(dt), mode, law,
        prepare(configuration, world), world.gravity, vehicle.corners(configuration), control,
        float(tolerance), rows,
    )  # fmt: skip
