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

from shefex_nav.compiled import inner, kernel
from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.geometry import triples as t3
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
    """The control of a flight from its ColdGas, with room for n_ticks in its history.

    rng draws the errors of the attitude reference, always seven numbers; None: it has no errors.
    """
    draw = np.zeros(7) if rng is None else rng.standard_normal(7)
    gas, error = cold_gas, cold_gas.reference
    torque_open = np.array(gas.torque, dtype=float)
    return none()._replace(
        period=float(gas.period),
        propellant=np.array([0.0, gas.propellant]),
        torque_open=torque_open,
        flow=torque_open / (np.asarray(gas.arm, dtype=float) * gas.specific_impulse * STANDARD_GRAVITY),
        dead_angle=np.array(gas.dead_band_angle, dtype=float),
        dead_rate=np.array(gas.dead_band_rate, dtype=float),
        bandwidth=float(gas.bandwidth),
        misalignment=draw[0:3] * error.misalignment,
        drift=draw[3:6] * error.drift,
        roll_scale=float(draw[6] * error.roll_scale_factor),
        history=np.zeros((n_ticks, HISTORY)),
    )


@kernel
def drift_over(q_ib, dtheta_b, dt, drift, roll_scale):
    """Drift of the reference over n samples: (n, 4), (n, 3) rad turned in each, s -> (3,) rad, frame i."""
    turn_i = 0.0, 0.0, 0.0
    for k in range(q_ib.shape[0]):
        error_b = drift[0] * dt + roll_scale * dtheta_b[k, 0], drift[1] * dt, drift[2] * dt
        turn_i = t3.plus(turn_i, 1.0, t3.quat_rotate(q_ib[k], error_b))
    return np.array(turn_i)


@kernel(forceinline=True)
def estimated_attitude(control, q_ib):
    """The attitude that the control believes, for the true one: four numbers."""
    turned = t3.quat_multiply(t3.quat_from_rotvec(control.tilt_i), q_ib)
    return t3.quat_multiply(turned, t3.quat_from_rotvec(control.misalignment))


@kernel(forceinline=True)
def _estimated_rate(control, omega_b):
    """The rate that the control believes, in what it believes to be the body axes: three numbers, rad/s."""
    drift, p = control.drift, omega_b[0]
    rate = p + drift[0] + control.roll_scale * p, omega_b[1] + drift[1], omega_b[2] + drift[2]
    return t3.quat_rotate(t3.quat_from_rotvec(t3.scaled(-1.0, control.misalignment)), rate)


def settle(control, omega_b):
    """Take the mean rate over the last revolutions: omega_b (n, 3) rad/s, true, equally spaced in time."""
    mean = _estimated_rate(control, omega_b.mean(axis=0)) if len(omega_b) else (0.0, 0.0, 0.0)
    control.mean_rate[:] = mean[1:]


@inner(forceinline=True)
def _of_spin_axis(control, omega_b, error, rate):
    """Angle error and rate of the axis about which the body spins, for those of the body axis."""
    spin, mean = omega_b[0], control.mean_rate
    if abs(spin) > SPINNING:
        share = control.period * abs(spin) / (2.0 * np.pi * REVOLUTIONS)
        mean[0] += share * (omega_b[1] - mean[0])
        mean[1] += share * (omega_b[2] - mean[1])
        rate = rate[0], rate[1] - mean[0], rate[2] - mean[1]
        if control.follow != RATES:
            error = error[0], error[1] + mean[1] / spin, error[2] - mean[0] / spin
    return error, rate


@inner(forceinline=True)
def _angle_error(follow, q_ib, q_wanted):
    """Rotation from the body to what is wanted: three numbers, rad; none about x if only the axis counts."""
    between = t3.quat_multiply(t3.quat_conjugate(q_ib), q_wanted)
    if follow == ATTITUDE:
        return t3.rotvec_from_quat(between)
    if follow != RATES:
        d = t3.quat_rotate(between, (1.0, 0.0, 0.0))
        across = np.sqrt(d[1] ** 2 + d[2] ** 2)
        if across > 1e-12:
            angle = np.arctan2(across, d[0])
            return 0.0, -d[2] * angle / across, d[1] * angle / across
    return 0.0, 0.0, 0.0


@inner(forceinline=True)
def _advance(control, t_s, q_ib, omega_error):
    """Carry the wanted attitude and the drift of the reference on to t_s."""
    step = t_s - control.clock[0]
    if step > 0.0:
        p, q, r, _, _, _ = body_rate(control.law, control.clock[0] + 0.5 * step)
        turn = t3.quat_from_rotvec((p * step, q * step, r * step))
        control.q_wanted[:] = t3.quat_normalise(t3.quat_multiply(control.q_wanted, turn))
        drifted = t3.quat_rotate(q_ib, t3.scaled(step, omega_error))
        for j in range(3):
            control.tilt_i[j] += drifted[j]
        control.clock[0] = t_s


@inner(forceinline=True)
def _wanted_rate(control, t_s, q_ib):
    """Wanted rate and angular acceleration in the axes of the body q_ib: three numbers each, rad/s, rad/s^2.

    Where only the axis is followed they lie across it, but for the wanted spin in the rate's x.
    """
    p, q, r, dp, dq, dr = body_rate(control.law, t_s)
    between = t3.quat_multiply(t3.quat_conjugate(q_ib), control.q_wanted)
    if control.follow == ATTITUDE:
        return t3.quat_rotate(between, (p, q, r)), t3.quat_rotate(between, (dp, dq, dr))
    # the law is one without transverse motion, or without spin: then d(q, r)/dt holds in space as well
    omega, alpha = t3.quat_rotate(between, (0.0, q, r)), t3.quat_rotate(between, (0.0, dq, dr))
    return (p, omega[1], omega[2]), (dp, alpha[1], alpha[2])


@inner(forceinline=True)
def _approach(control, size, inertia, j):
    """Rate [rad/s] at which an angle error [rad] about axis j is taken back: half the torque can brake it."""
    return min(0.5 * control.bandwidth * size, np.sqrt(control.torque_open[j] / inertia * size))


@inner(forceinline=True)
def _about_axis(control, j, inertia, error, rate):
    """Torque about one axis, whatever the others' spin: (N m, whether there is something to do).

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


@inner(forceinline=True)
def _across_spin(control, inertia, momentum, error, rate):
    """Torque about y and z of a body that spins: (N m, N m, whether there is something to do).

    inertia: kg m^2 about y; momentum: N m s of the spin; error, rate: as above, of which y and z count.
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


@inner(forceinline=True)
def demand(control, t_s, q_ib, omega_b, inertia):
    """Torque [N m] that the law asks for, and whether there is something to do: about each axis.

    Parameters
    ----------
    q_ib, omega_b : four numbers; three, rad/s: as the control believes them
    inertia : three numbers, kg m^2
    """
    follow, momentum = control.follow, inertia[0] * omega_b[0]
    wanted, alpha = _wanted_rate(control, t_s, q_ib)
    if follow == RATES or follow == AXIS:
        wanted, alpha = (omega_b[0], wanted[1], wanted[2]), (0.0, alpha[1], alpha[2])
    error = _angle_error(follow, q_ib, control.q_wanted)
    rate = omega_b[0] - wanted[0], omega_b[1] - wanted[1], omega_b[2] - wanted[2]
    ahead = inertia[0] * alpha[0], inertia[1] * alpha[1], inertia[2] * alpha[2]
    if follow == ATTITUDE:
        spun = inertia[0] * wanted[0], inertia[1] * wanted[1], inertia[2] * wanted[2]  # N m s
        ahead = t3.plus(ahead, 1.0, t3.cross(wanted, spun))
    elif follow != RATES:  # what precession takes
        ahead = ahead[0], ahead[1] + momentum * wanted[2], ahead[2] - momentum * wanted[1]
    back_x, busy_x = _about_axis(control, 0, inertia[0], error[0], rate[0])
    if follow == ATTITUDE:
        back_y, busy_y = _about_axis(control, 1, inertia[1], error[1], rate[1])
        back_z, busy_z = _about_axis(control, 2, inertia[2], error[2], rate[2])
    else:
        error, rate = _of_spin_axis(control, omega_b, error, rate)
        lean = 0.0 if follow == RATES else momentum
        back_y, back_z, busy_y = _across_spin(control, inertia[1], lean, error, rate)
        busy_z = busy_y
    return (
        (ahead[0] + back_x, ahead[1] + back_y, ahead[2] + back_z),
        (busy_x or ahead[0] != 0.0, busy_y or ahead[1] != 0.0, busy_z or ahead[2] != 0.0),
    )


@inner(forceinline=True)
def _open_valves(control, torque, busy, turn):
    """Open or shut the valves, as of `demand`, for a period in which the body turns by `turn` rad about x."""
    owed, period = control.owed, control.period
    c, s = np.cos(turn), np.sin(turn)  # what is owed stays where it was in space
    owed[1], owed[2] = c * owed[1] + s * owed[2], c * owed[2] - s * owed[1]
    c, s = np.cos(0.5 * turn), np.sin(0.5 * turn)  # in the middle of the period the body will have turned
    torque = torque[0], c * torque[1] + s * torque[2], c * torque[2] - s * torque[1]
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


@inner(forceinline=True)
def _remember(control, t_s, error):
    """Write a row of the history; error: three numbers, rad, from the truth to what is wanted."""
    n = control.count[0]
    row = control.history[n]
    row[0] = t_s
    for j in range(3):
        known = control.follow != RATES and (j > 0 or control.follow == ATTITUDE)
        row[1 + j] = -error[j] if known else np.nan
        row[4 + j] = control.torque[j]
    control.count[0] = n + 1


@inner(forceinline=True)
def command(control, t_s, x, i_x, i_y, i_z):
    """One tick: set control.torque until the next one. x (19,) true state, i: kg m^2 about the body axes."""
    drift, q_true = control.drift, (x[6], x[7], x[8], x[9])
    _advance(control, t_s, q_true, (drift[0] + control.roll_scale * x[10], drift[1], drift[2]))
    rate = _estimated_rate(control, (x[10], x[11], x[12]))
    torque, busy = demand(control, t_s, estimated_attitude(control, q_true), rate, (i_x, i_y, i_z))
    used = control.propellant[0]
    _open_valves(control, torque, busy, x[10] * control.period)
    _remember(control, t_s, _angle_error(control.follow, q_true, control.q_wanted))
    control.history[control.count[0] - 1, 7] = used
    # on whole nanoseconds: ticks that drift would leave slivers before the end of a task
    control.next_s[0] = np.round((control.next_s[0] + control.period) * 1e9) / 1e9
