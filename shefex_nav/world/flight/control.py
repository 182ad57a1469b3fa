"""The cold-gas attitude control: what it wants, what it believes, which valves it opens.

In: the `RateLaw` of the task that is flown and the true state at each tick. Out: the torque until the next
tick, the gas that it costs, and a history.

The law. A body spins with p about x, I_t is its inertia across and sigma = I_x p / I_t. By how much its roll
axis leans away from the wanted direction, a complex number delta, obeys delta'' - i sigma delta' = u under
the torque I_t u. With
    u = -2 a delta' - a (a - i sigma) delta
both motions, the creeping of the axis and the nutation, decay alike: s = -a and s = i sigma - a. In words:
twice the bandwidth a times I_t times (rate error + a/2 angle error), and a times the angular momentum that
the spin has across the wanted direction because it leans. Without spin that is a critically damped double
pole, and as such it is used about the roll axis too. What the wanted motion itself takes, the precession
torque of a spinning body above all, is fed forward.

The valves are open or shut for a whole period. Sums of what was asked for and has not been given yet decide
(sigma-delta modulation); those of the transverse axes are kept in axes that do not spin, and so is the
direction of the torque in the middle of a period. Inside the dead bands nothing is asked for.

The attitude it believes is its own, not the navigation's: the truth, off by a constant misalignment and by
what a drifting reference with a roll scale factor has gathered since the start of the mission. A body that
spins does so about its principal axis; against that the axis it believes to be its own wobbles with every
turn, and no torque can stop it. What is steered is therefore the axis about which it spins in the mean.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.geometry import rotation
from shefex_nav.world.flight import attitude_program
from shefex_nav.world.flight.attitude_program import RateLaw, body_rate

RATES, AXIS, AXIS_AND_SPIN, ATTITUDE = 0, 1, 2, 3  # what is followed
SPINNING = 0.2  # rad/s; what turns faster about its roll axis has that axis steered, the spin left alone
REVOLUTIONS = 10.0  # over which the mean rate is taken
HISTORY = 8  # t_s, pointing error 1:4, torque 4:7, gas used so far


class Control(NamedTuple):
    """Attitude control in one section of the flight. Arrays are its memory and live through the flight."""

    period: float  # s
    next_s: np.ndarray  # (1,) s, next tick
    torque: np.ndarray  # (3,) N m, now
    propellant: np.ndarray  # (2,) kg used, left
    stop_height: float  # m, a section ends when this is passed on the way down; -inf: never
    torque_open: np.ndarray  # (3,) N m while the valves of an axis are open
    flow: np.ndarray  # (3,) kg/s then
    dead_angle: np.ndarray  # (3,) rad
    dead_rate: np.ndarray  # (3,) rad/s
    bandwidth: float  # rad/s
    follow: int  # RATES, AXIS, AXIS_AND_SPIN or ATTITUDE
    law: RateLaw  # of the wanted attitude; its spin counts in AXIS_AND_SPIN alone
    q_wanted: np.ndarray  # (4,) wanted axes -> i
    clock: np.ndarray  # (1,) s, up to which wanted attitude and reference error have been followed
    owed: np.ndarray  # (3,) N m, asked for and not given yet, for one period; y, z as of the last tick
    misalignment: np.ndarray  # (3,) rad, body axes
    drift: np.ndarray  # (3,) rad/s, body axes
    roll_scale: float
    tilt_i: np.ndarray  # (3,) rad, by which the reference has drifted so far
    awake: np.ndarray  # (1,) bool, correcting what spins
    mean_rate: np.ndarray  # (2,) rad/s about y and z, of a body that spins, as it believes
    history: np.ndarray  # (M, 8) see HISTORY
    count: np.ndarray  # (1,) int, rows of the history so far


def none():
    """No attitude control: for sections in which nothing steers."""
    three = [np.zeros(3) for _ in range(8)]
    return Control(
        period=np.inf,
        next_s=np.array([np.inf]),
        torque=three[0],
        propellant=np.zeros(2),
        stop_height=-np.inf,
        torque_open=three[1],
        flow=three[2],
        dead_angle=three[3],
        dead_rate=three[4],
        bandwidth=0.0,
        follow=RATES,
        law=attitude_program.hold(0.0, 1.0, 0.0),
        q_wanted=np.array([1.0, 0.0, 0.0, 0.0]),
        clock=np.zeros(1),
        owed=np.zeros(3),
        misalignment=three[5],
        drift=three[6],
        roll_scale=0.0,
        tilt_i=three[7],
        awake=np.zeros(1, dtype=np.bool_),
        mean_rate=np.zeros(2),
        history=np.zeros((0, HISTORY)),
        count=np.zeros(1, dtype=np.int64),
    )


def start(cold_gas, rng, n_ticks):
    """The control of a flight from `params.ColdGas`, with room for n_ticks in its history.

    rng draws the errors of the attitude reference, always seven numbers; None: it has no errors.
    """
    draw = np.zeros(7) if rng is None else rng.standard_normal(7)
    gas, error = cold_gas, cold_gas.reference
    torque_open = np.array(gas.torque, dtype=float)
    return none()._replace(
        period=float(gas.period_s),
        propellant=np.array([0.0, gas.propellant_kg]),
        torque_open=torque_open,
        flow=torque_open / (np.asarray(gas.arm_m, dtype=float) * gas.isp_s * STANDARD_GRAVITY),
        dead_angle=np.array(gas.dead_band_angle, dtype=float),
        dead_rate=np.array(gas.dead_band_rate, dtype=float),
        bandwidth=float(gas.bandwidth),
        misalignment=draw[0:3] * error.misalignment,
        drift=draw[3:6] * error.drift,
        roll_scale=float(draw[6] * error.roll_scale_factor),
        history=np.zeros((n_ticks, HISTORY)),
    )


@njit(cache=True)
def drift_over(q_ib, dtheta_b, dt, drift, roll_scale):
    """Drift of the reference over n samples: (n, 4), (n, 3) rad turned in each, s -> (3,) rad, frame i."""
    tx, ty, tz = 0.0, 0.0, 0.0
    for k in range(q_ib.shape[0]):
        error_b = drift[0] * dt + roll_scale * dtheta_b[k, 0], drift[1] * dt, drift[2] * dt
        x, y, z = rotation.rotated((q_ib[k, 0], q_ib[k, 1], q_ib[k, 2], q_ib[k, 3]), error_b)
        tx, ty, tz = tx + x, ty + y, tz + z
    return np.array([tx, ty, tz])


@njit(cache=True)
def believed(control, q_ib):
    """The attitude that the control believes, for the true one. (4,) -> (4,)."""
    turned = rotation.quat_multiply(rotation.quat_from_rotvec(control.tilt_i), q_ib)
    return rotation.quat_multiply(turned, rotation.quat_from_rotvec(control.misalignment))


@njit(cache=True)
def _believed_rate(control, omega_b):
    """The rate that the control believes, in what it believes to be the body axes. (3,) -> (3,) rad/s."""
    rate = omega_b + control.drift
    rate[0] += control.roll_scale * omega_b[0]
    return rotation.quat_rotate(rotation.quat_from_rotvec(-control.misalignment), rate)


def settle(control, omega_b):
    """Take the mean rate over the last revolutions: omega_b (n, 3) rad/s, true, equally spaced in time."""
    mean = _believed_rate(control, omega_b.mean(axis=0)) if len(omega_b) else np.zeros(3)
    control.mean_rate[:] = mean[1:]


@njit(cache=True)
def _steer_spin_axis(control, omega_b, error, rate):
    """Make of angle error and rate (3,) of the body axis those of the axis about which the body spins."""
    spin, mean = omega_b[0], control.mean_rate
    if abs(spin) > SPINNING:
        share = control.period * abs(spin) / (2.0 * np.pi * REVOLUTIONS)
        mean[0] += share * (omega_b[1] - mean[0])
        mean[1] += share * (omega_b[2] - mean[1])
        rate[1], rate[2] = rate[1] - mean[0], rate[2] - mean[1]
        if control.follow != RATES:
            error[1], error[2] = error[1] + mean[1] / spin, error[2] - mean[0] / spin


@njit(cache=True)
def _angle_error(follow, q_ib, q_wanted):
    """Rotation from the body to what is wanted, body axes: (3,) rad; zero about x if only the axis counts."""
    between = rotation.quat_multiply(rotation.quat_conjugate(q_ib), q_wanted)
    if follow == ATTITUDE:
        return rotation.rotvec_from_quat(between)
    error = np.zeros(3)
    if follow != RATES:
        d = rotation.quat_rotate(between, np.array([1.0, 0.0, 0.0]))
        across = np.sqrt(d[1] ** 2 + d[2] ** 2)
        if across > 1e-12:
            angle = np.arctan2(across, d[0])
            error[1], error[2] = -d[2] * angle / across, d[1] * angle / across
    return error


@njit(cache=True)
def _advance(control, t_s, x, omega_error):
    """Carry the wanted attitude and the drift of the reference on to t_s."""
    step = t_s - control.clock[0]
    if step > 0.0:
        middle = body_rate(control.law, control.clock[0] + 0.5 * step)
        turn = np.array([middle[0] * step, middle[1] * step, middle[2] * step])
        q = rotation.quat_multiply(control.q_wanted, rotation.quat_from_rotvec(turn))
        control.q_wanted[:] = rotation.quat_normalise(q)
        control.tilt_i[:] += rotation.quat_rotate(x[6:10].copy(), omega_error * step)
        control.clock[0] = t_s


@njit(cache=True)
def _wanted_rate(control, t_s, q_ib):
    """Wanted rate and angular acceleration in the axes of the body q_ib (4,): (3,) rad/s, (3,) rad/s^2.

    Where only the axis is followed they lie across it, but for the wanted spin in the rate's x.
    """
    p, q, r, dp, dq, dr = body_rate(control.law, t_s)
    between = rotation.quat_multiply(rotation.quat_conjugate(q_ib), control.q_wanted)
    if control.follow == ATTITUDE:
        omega = rotation.quat_rotate(between, np.array([p, q, r]))
        return omega, rotation.quat_rotate(between, np.array([dp, dq, dr]))
    # the law is one without transverse motion, or without spin: then d(q, r)/dt holds in space as well
    omega = rotation.quat_rotate(between, np.array([0.0, q, r]))
    alpha = rotation.quat_rotate(between, np.array([0.0, dq, dr]))
    omega[0], alpha[0] = p, dp
    return omega, alpha


@njit(cache=True)
def _approach(control, size, inertia, j):
    """Rate [rad/s] at which an angle error [rad] about axis j is taken back: half the torque can brake it."""
    return min(0.5 * control.bandwidth * size, np.sqrt(control.torque_open[j] / inertia * size))


@njit(cache=True)
def _about_axis(control, j, inertia, error, rate):
    """Torque about one axis that does not feel the others' spin: (N m, whether there is something to do).

    error: rad, from the body to what is wanted; rate: rad/s of the body against it. Outside the dead band of
    the angle the body has to come back, inside that of the rate at any speed: asking for one speed would set
    the valves against each other.
    """
    beyond = abs(error) - control.dead_angle[j]
    toward = rate if error > 0.0 else -rate
    approach, slow, fast = 0.0, -control.dead_rate[j], control.dead_rate[j]
    if beyond > 0.0:
        approach = _approach(control, beyond, inertia, j)
        slow, fast = approach, max(approach, fast)
    if slow <= toward <= fast:
        return 0.0, False
    missing = approach - toward
    return 2.0 * control.bandwidth * inertia * (missing if error > 0.0 else -missing), True


@njit(cache=True)
def _across_spin(control, inertia, momentum, error, rate):
    """Torque about y and z of a body that spins: (N m, N m, whether there is something to do).

    inertia: kg m^2 about y; momentum: N m s of the spin; error, rate: (3,) as above, of which y and z count.
    Wakes outside the dead bands and works until half of them: every pulse turns the angular momentum, and
    at the edge of a band one pulse would ask for the next.
    """
    size = np.sqrt(error[1] ** 2 + error[2] ** 2)
    speed = np.sqrt(rate[1] ** 2 + rate[2] ** 2)
    band = 0.5 if control.awake[0] else 1.0
    control.awake[0] = size > band * control.dead_angle[1] or speed > band * control.dead_rate[1]
    if not control.awake[0]:
        return 0.0, 0.0, False
    gain, lean, share = 2.0 * control.bandwidth * inertia, control.bandwidth * momentum, 0.0
    if size > 0.0:
        share = _approach(control, size, inertia, 1) / size
    return (
        gain * (share * error[1] - rate[1]) + lean * error[2],
        gain * (share * error[2] - rate[2]) - lean * error[1],
        True,
    )


@njit(cache=True)
def demand(control, t_s, q_ib, omega_b, inertia):
    """Torque [N m] that the law asks for, and the axes about which there is something to do.

    Parameters
    ----------
    q_ib, omega_b : (4,), (3,) rad/s, as the control believes them
    inertia : (3,) kg m^2
    """
    follow = control.follow
    momentum = inertia[0] * omega_b[0]
    wanted, alpha = _wanted_rate(control, t_s, q_ib)
    if follow == RATES or follow == AXIS:
        wanted[0], alpha[0] = omega_b[0], 0.0
    error = _angle_error(follow, q_ib, control.q_wanted)
    rate = omega_b - wanted
    torque = inertia * alpha
    if follow == ATTITUDE:
        torque += rotation.cross(wanted, inertia * wanted)
    elif follow != RATES:  # what precession takes
        torque[1] += momentum * wanted[2]
        torque[2] -= momentum * wanted[1]
    busy = torque != 0.0
    back = np.zeros(3)
    if follow != ATTITUDE:
        _steer_spin_axis(control, omega_b, error, rate)
        lean = 0.0 if follow == RATES else momentum
        back[1], back[2], moving = _across_spin(control, inertia[1], lean, error, rate)
        busy[1] |= moving
        busy[2] |= moving
    for j in range(3):
        if follow == ATTITUDE or j == 0:
            back[j], moving = _about_axis(control, j, inertia[j], error[j], rate[j])
            busy[j] |= moving
    return torque + back, busy


@njit(cache=True)
def _open_valves(control, torque, busy, turn):
    """Open or shut the valves for one period in which the body turns by `turn` rad about x."""
    owed, period = control.owed, control.period
    c, s = np.cos(turn), np.sin(turn)  # what is owed stays where it was in space
    owed[1], owed[2] = c * owed[1] + s * owed[2], c * owed[2] - s * owed[1]
    c, s = np.cos(0.5 * turn), np.sin(0.5 * turn)  # in the middle of the period the body will have turned
    ahead_y, ahead_z = c * torque[1] + s * torque[2], c * torque[2] - s * torque[1]
    torque[1], torque[2] = ahead_y, ahead_z
    for j in range(3):
        limit = control.torque_open[j]
        control.torque[j] = 0.0
        if not busy[j]:
            owed[j] = 0.0
            continue
        owed[j] += min(limit, max(-limit, torque[j]))
        if control.propellant[1] > 0.0 and 2.0 * abs(owed[j]) > limit:
            control.torque[j] = limit if owed[j] > 0.0 else -limit
            owed[j] -= control.torque[j]
            gas = min(control.flow[j] * period, control.propellant[1])
            control.propellant[0] += gas
            control.propellant[1] -= gas
        owed[j] = min(limit, max(-limit, owed[j]))


@njit(cache=True)
def _remember(control, t_s, error):
    """Write a row of the history; error: (3,) rad from the truth to what is wanted."""
    n = control.count[0]
    row = control.history[n]
    row[0] = t_s
    for j in range(3):
        known = control.follow != RATES and (j > 0 or control.follow == ATTITUDE)
        row[1 + j] = -error[j] if known else np.nan
        row[4 + j] = control.torque[j]
    control.count[0] = n + 1


@njit(cache=True)
def command(control, t_s, x, i_x, i_y, i_z):
    """One tick: set control.torque until the next one. x (19,) true state, i: kg m^2 about the body axes."""
    error_rate = control.drift.copy()
    error_rate[0] += control.roll_scale * x[10]
    _advance(control, t_s, x, error_rate)
    q_true = x[6:10].copy()
    q_ib = believed(control, q_true)
    inertia = np.array([i_x, i_y, i_z])
    torque, busy = demand(control, t_s, q_ib, _believed_rate(control, x[10:13].copy()), inertia)
    used = control.propellant[0]
    _open_valves(control, torque, busy, x[10] * control.period)
    _remember(control, t_s, _angle_error(control.follow, q_true, control.q_wanted))
    control.history[control.count[0] - 1, 7] = used
    # on whole nanoseconds: ticks that drift would leave slivers before the end of a task
    control.next_s[0] = np.round((control.next_s[0] + control.period) * 1e9) / 1e9
