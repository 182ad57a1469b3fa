"""Integration of the equations of motion with error control, exact to the instant, with samples in between.

In: state, section of the flight, surroundings. Out: state at the end of the section, rows at the IMU samples.

The step size is that of the PI controller of Hairer, Norsett & Wanner, Solving Ordinary Differential
Equations I, 2nd ed., section II.4. Samples lie on the continuous extension of the steps; their increments are
differences of that of the integrals, and so sum up to the integrals over the steps, without a remainder.

Steps end exactly at the corners of the vehicle's histories, at the ticks of the attitude control and at the
end of the section; each sees the histories as they are between its ends. Ends that depend on the state are
found by bisection of the last step.

Samples may be taken away while the integration goes on: it pauses when a piece is full, and the steps are the
same as without a pause.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel, lent
from shefex_nav.errors import UserError
from shefex_nav.world.flight import control as attitude_control
from shefex_nav.world.flight import vehicle
from shefex_nav.world.flight.attitude_program import RateLaw
from shefex_nav.world.flight.dynamics import CONTROLLED, ON_RAIL, PROGRAMMED, STATE, Section, derivative
from shefex_nav.world.flight.runge_kutta import (
    MOVING,
    Work,
    begin,
    dense_output,
    make_step,
    read,
    remainder,
    workspace,
)
from shefex_nav.world.flight.scene import prepare
from shefex_nav.world.flight.surroundings import earth_angle, level, position_e

TOLERANCE = 1e-10  # m, m/s, rad, rad/s: largest estimated error of a component in a step
LARGEST_STEP = 0.05  # s
SMALLEST_STEP = 1e-6  # s; a step is accepted by then: what is left is a jump in the forces
FIRST_STEP = 0.01  # s, tried at the start of a section
TIME_EPS = 1e-9  # s, instants closer than this are one sample
EVENT_EPS = 1e-12  # s, to which an end that depends on the state is found
FREE_STEPS, STEPS_PER_S = 100_000, 7000.0  # of a section at most; a spin of 250 rad/s (40 rev/s) needs 5700
T_END, EVENT, STOP, TOO_FAST, PAUSED = 0, 1, 2, 3, 4  # how a section ends; or does not yet

_SAFETY, _SHRINK, _GROW, _BETA = 0.9, 0.2, 10.0, 0.04  # of the step size control


class MotionError(UserError, ArithmeticError):
    """The motion cannot be integrated; the message says when and why."""


class Samples(NamedTuple):
    """The samples of a flight: number k is at t_start + k dt."""

    t_start: float  # s
    dt: float  # s
    rows: np.ndarray  # (n, dynamics.ROW) state and aux of each, written; sample k stands in row k
    # of samples that are taken away as they come: called when the rows are full, and at the end of a section,
    # with the number of the first sample and rows (m, ROW), which are used again afterwards
    take: Callable | None = None
    count: int = 0  # of samples in all, if they are taken away


class _Piece(NamedTuple):
    """Where samples are written, for the kernel."""

    t_start: float  # s, as of Samples
    dt: float  # s
    rows: np.ndarray  # (n, dynamics.ROW)
    first: int  # number of the sample in row 0
    pause: int  # number of the sample from which on the integration pauses
    count: int  # of samples in all


class _Progress(NamedTuple):
    """A section on its way."""

    x: np.ndarray  # (19,) state
    work: Work  # of `runge_kutta`
    # (5,) size and error of the Pace, end [s] of the step's smooth stretch, whether the last stage of the
    # step before is the first one of the next (0 or 1), steps made
    numbers: np.ndarray


class Vehicle(NamedTuple):
    """The vehicle in a section of the flight, and how its attitude comes about."""

    configuration: vehicle.Configuration
    mode: int  # ON_RAIL, FREE, PROGRAMMED or CONTROLLED
    law: RateLaw  # followed in the mode PROGRAMMED
    control: attitude_control.Control  # in the mode CONTROLLED it is asked for its torque at its ticks


class Pace(NamedTuple):
    """Control of the step size."""

    size: float  # s, that the next step may have
    last_error: float  # of the step before, in tolerances


@inner(error_model="numpy", forceinline=True)
def _write_samples(t_s, t_new, x, k, samples, section, work):
    """Write the samples of [t_s, t_new), from number k on. Returns the number of the next one."""
    y, taken, h = work.y, work.taken, t_new - t_s
    t_start, dt, rows, first, _, count = samples
    for j in range(6):
        taken[j] = 0.0
    bent = False
    while k < count and t_start + k * dt < t_new - TIME_EPS:
        if not bent:
            dense_output(h, work)
            bent = True
        t_k = max(t_start + k * dt, t_s)
        part = (t_k - t_s) / h if t_k - t_s > TIME_EPS else 0.0
        read(x, part, work)
        row = rows[k - first]
        derivative(t_k, y, section, remainder(work.fine, part), row[:STATE], row[STATE:])
        for j in range(MOVING):
            row[j] = y[j]
        for j in range(6):
            row[MOVING + j] = y[MOVING + j] - taken[j]
            taken[j] = y[MOVING + j]
        k += 1
    return k


@inner(error_model="numpy", forceinline=True)
def _height(t_s, x, s):
    """Height of a state above the ellipsoid, m."""
    ex, ey, ez = position_e(s, earth_angle(s, t_s), x[0], x[1], x[2])
    height, _, _ = level(s.a, s.e2, ex, ey, ez)
    return height


@inner(error_model="numpy", forceinline=True)
def _ended(t_s, x, height_before, mode, s, stop_height):
    """How the section has ended by the state x at t_s: T_END (it has not), EVENT or STOP."""
    if mode == PROGRAMMED:
        return T_END
    if mode == ON_RAIL:
        ex, ey, ez = position_e(s, earth_angle(s, t_s), x[0], x[1], x[2])
        travel = (ex - s.rail_r_e[0]) * s.rail_direction_e[0] + (ey - s.rail_r_e[1]) * s.rail_direction_e[1]
        travel += (ez - s.rail_r_e[2]) * s.rail_direction_e[2]
        return EVENT if travel > s.rail_length else T_END
    height = _height(t_s, x, s)
    if height < 0.0 and height < height_before:
        return EVENT
    return STOP if height <= stop_height < height_before else T_END


@inner(error_model="numpy")
def _bisect(t_s, t_new, x, height, stop_height, section, gravity, work):
    """Make the step that ends where the section does, not later than t_new: (time, how it ends)."""
    low, high, how = t_s, t_new, T_END
    while True:
        middle = 0.5 * (low + high)
        last = high - low < EVENT_EPS or not low < middle < high
        t = high if last else middle
        make_step(t_s, t, x, section, gravity, work)
        how = _ended(t, work.new, height, section.mode, section.s, stop_height)
        if last:
            return high, how
        if how == T_END:
            low = middle
        else:
            high = middle


@inner(forceinline=True)
def _steer(t_s, x, s, tables, control):
    """Let the attitude control decide on its torque."""
    _, left = vehicle.thrust(s, tables, t_s)
    body = vehicle.mass_properties(s, tables, left)
    attitude_control.command(control, t_s, x, body.i_x, body.i_y, body.i_z)
    if control.next_s[0] <= t_s:  # ticks that have been missed stay missed
        control.next_s[0] = t_s + control.period
    for j in range(3):
        s.torque[j] = control.torque[j]


@inner(error_model="numpy", forceinline=True)
def _advance(x, work):
    """Take over the step just made, with its last stage as the first one of the next."""
    for j in range(STATE):
        x[j] = work.new[j]
        work.slopes[0, j] = work.slopes[6, j]
    for j in range(6):
        x[MOVING + j] -= work.taken[j]
    for j in range(3):
        work.slopes[0, 6 + j], work.fine[0, j] = x[10 + j], work.fine[1, j]


@inner(forceinline=True)
def _next_corner(t_s, t_end, breaks):
    """The next instant at which something jumps, or the end."""
    k = np.searchsorted(breaks, t_s, side="right")
    return min(t_end, breaks[k]) if k < breaks.size else t_end


@inner(forceinline=True)
def _controlled_step(t_s, t_new, x, pace, tolerance, section, gravity, work):
    """Step towards t_new, shortened until its error is below the tolerance.

    Returns the time reached and the Pace of the next step.
    """
    rejected, size = False, pace.size
    while True:
        h = t_new - t_s
        error = make_step(t_s, t_new, x, section, gravity, work) / max(tolerance, 1e-300)
        if tolerance <= 0.0:
            return t_new, pace
        factor = _SHRINK
        if 0.0 < error < np.inf:
            factor = _SAFETY * error ** (0.75 * _BETA - 0.2)
        if error > 1.0 and h > SMALLEST_STEP + TIME_EPS:  # the sum t_s + SMALLEST_STEP may be rounded up
            t_new, rejected = t_s + max(max(_SHRINK, factor) * h, SMALLEST_STEP), True
            continue
        if error == np.inf:
            raise ArithmeticError("the equations of motion have no finite solution from here on")
        factor = _GROW if error == 0.0 else min(_GROW, max(_SHRINK, factor * pace.last_error**_BETA))
        if rejected:
            factor = min(1.0, factor)
        # a step that was cut short says little about what is possible
        size = max(h * factor, size) if h < 0.99 * size and not rejected else h * factor
        return t_new, Pace(min(max(size, SMALLEST_STEP), LARGEST_STEP), max(error, 1e-4))


@kernel
def _integrate(progress, span, k, samples, steered, scene, gravity, tolerance):
    """As `integrate`, for a Scene; or until the samples are to be taken away: PAUSED.

    progress : _Progress, with which it goes on;  samples : _Piece
    span : s, where the section begins, what has been reached, t_end and the instants (n,) at which steps
        have to end;  steered : mode, law, control
    """
    (x, work, numbers), samples, scene, gravity = lent((progress, samples, scene, gravity))
    (t_begin, t_s, t_end, breaks), (mode, law, control) = lent((span, steered))
    s, tables = scene.record[0], scene.tables
    section = Section(mode, law, s, tables)
    pace, t_break, follows, steps = Pace(numbers[0], numbers[1]), numbers[2], numbers[3] > 0.0, numbers[4]
    height = _height(t_s, x, s)
    if mode == CONTROLLED:
        for j in range(3):
            s.torque[j] = control.torque[j]
    while t_s < t_end:
        if k >= samples.pause and k < samples.count:
            numbers[0], numbers[1], numbers[2] = pace.size, pace.last_error, t_break
            numbers[3], numbers[4] = 1.0 if follows else 0.0, steps
            return t_s, k, PAUSED
        if not follows:
            t_break = _next_corner(t_s, t_end, breaks)
            vehicle.choose_rows(s, tables, 0.5 * (t_s + t_break))
            if mode == CONTROLLED:
                if t_s >= control.next_s[0] - TIME_EPS:
                    _steer(t_s, x, s, tables, control)
                t_break = min(t_break, control.next_s[0])
            begin(t_s, x, section, gravity, work)
        n = np.ceil((t_break - t_s) / pace.size - 1e-6)  # equal steps rather than a short last one
        t_new = t_break if n <= 1.0 else t_s + (t_break - t_s) / n
        t_new, pace = _controlled_step(t_s, t_new, x, pace, tolerance, section, gravity, work)
        how = _ended(t_new, work.new, height, mode, s, control.stop_height)
        if how != T_END:
            t_new, how = _bisect(t_s, t_new, x, height, control.stop_height, section, gravity, work)
        k = _write_samples(t_s, t_new, x, k, samples, section, work)
        _advance(x, work)
        follows, t_s = t_new < t_break, t_new
        if how != T_END:
            return t_s, k, how
        height = _height(t_s, x, s)
        steps += 1.0
        if tolerance > 0.0 and steps > FREE_STEPS + STEPS_PER_S * (t_s - t_begin):
            return t_s, k, TOO_FAST
    return t_s, k, T_END


def _in_pieces(x, span, k, samples, steered, scene, world, tolerance):
    """`_integrate` to the end of the section, its samples handed over: (time, number of the next, how)."""
    t_begin, t_end, breaks = span
    first_step = FIRST_STEP if tolerance > 0.0 else -tolerance
    progress = _Progress(x, workspace(), np.array([first_step, 1e-4, t_begin, 0.0, 0.0]))
    t_start, dt, rows, take, count = samples
    piece = _Piece(float(t_start), float(dt), rows, 0, len(rows), len(rows))
    most = len(rows) - int(max(LARGEST_STEP, first_step) / dt) - 2  # beside those of one more step
    if take is not None and most < 1:
        raise ValueError(f"{len(rows)} rows are not enough for the samples of a step")
    t_s, k, how = t_begin, int(k), PAUSED
    while how == PAUSED:
        if take is not None:
            piece = piece._replace(first=k, pause=k + most, count=count)
        at = t_begin, t_s, t_end, breaks
        t_s, k, how = _integrate(progress, at, k, piece, steered, scene, world.gravity, tolerance)
        if take is not None:
            take(piece.first, rows[: k - piece.first])
    return t_s, k, how


def integrate(x, t_s, t_end, k, samples, flown, world, tolerance):
    """Integrate one section from t_s until t_end or until its event: (time, next sample, how it ended).

    Parameters
    ----------
    x : (19,) state, advanced in place
    k : number of the next sample
    samples : Samples; they are written with the values that hold just after them where they jump; one at
        t_end is left to the section that follows
    flown : Vehicle
    world : surroundings.World
    tolerance : error of a step, m, m/s, rad, rad/s; not above zero: steps of -tolerance s, errors ignored

    The section ends with T_END at t_end, with EVENT at the end of the rail or on the ground, with STOP when
    control.stop_height is passed on the way down. Where the attitude is programmed it ends at t_end only.
    MotionError where there is no finite solution, or one that takes more than STEPS_PER_S to follow.
    """
    configuration, *steered = flown
    span = float(t_s), float(t_end), vehicle.corners(configuration)
    scene = prepare(configuration, world)
    try:
        reached_s, k, how = _in_pieces(x, span, k, samples, tuple(steered), scene, world, float(tolerance))
    except ArithmeticError:
        raise MotionError(
            f"the motion grows without bound between T{t_s:+.1f} s and T{t_end:+.1f} s"
        ) from None
    if how == TOO_FAST:
        raise MotionError(
            f"the motion from T{t_s:+.1f} s to T{reached_s:+.1f} s takes more than {STEPS_PER_S:g} steps a "
            "second to follow: it turns, swings or is slowed down too fast"
        )
    return reached_s, k, how
