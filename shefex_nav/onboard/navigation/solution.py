"""What the filter tells the vehicle: NavSolution at every tick, with sigmas by linear propagation of P.

Air-relative velocity is that of an atmosphere which turns with the Earth, without wind. A kernel writes each
solution as a row of numbers, which are read as one record or, many of them, as a record of arrays.
"""

from math import pi
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel, lent
from shefex_nav.geometry import frames
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation import error_model, integrity_protection, mean_rate, momentary, protected
from shefex_nav.onboard.navigation.calibration import (
    acting,
    free_increment,
    jacobians_packed,
    triads,
)
from shefex_nav.onboard.navigation.covariance import as_reported
from shefex_nav.onboard.navigation.state import ATT, POS, VEL, X_Q, X_R, X_V
from shefex_nav.onboard.navigation.strapdown import BEFORE
from shefex_nav.records import QUANTITIES, Doubt, NavSolution

SLOWEST = 1e-3  # m/s, below it the angles of the velocity have no meaning; their sigma is pi


# where the kernel puts each field of NavSolution, from r_i to the protection levels
FIELDS = {
    "r_i": 3, "v_i": 3, "q_ib": 4, "omega_ib_b": 3, "r_e": 3, "v_e": 3,
    "flight_path_angle": 1, "heading": 1, "angle_of_attack": 1, "sideslip": 1,
    "sigma_r_e": 3, "sigma_v_e": 3, "sigma_theta_b": 3, "sigma_omega_b": 3,
    "sigma_flight_path_angle": 1, "sigma_angle_of_attack": 1, "sigma_sideslip": 1,
    "protection_position": 2, "protection_velocity": 2, "protection_attitude": 3,
}  # fmt: skip
ENDS = dict(zip(FIELDS, np.cumsum(list(FIELDS.values())).tolist(), strict=True))
N_OUT = max(ENDS.values())
OMEGA, R_E, V_E, ANGLES = (
    ENDS[name] - FIELDS[name] for name in ("omega_ib_b", "r_e", "v_e", "flight_path_angle")
)
S_R, S_V, S_ATT, S_OMEGA, S_ANGLES = (ENDS[name] - FIELDS[name] for name in list(FIELDS)[10:15])
# behind them the protection levels, the time, whether a star fix has been used, Doubt of each of QUANTITIES
LEVEL, T_S, AIDED, DOUBT = ENDS["sigma_sideslip"], N_OUT, N_OUT + 1, N_OUT + 2
NO_DOUBT = float(Doubt.NONE)
WIDTH = DOUBT + len(QUANTITIES)


class Bounds(NamedTuple):
    """What decides whether a solution is to be used: fields of Level, of Requirement, and what is known."""

    w: np.ndarray  # (3, 9)
    sigma: np.ndarray  # (9,)
    t_s: float
    limits: np.ndarray  # (3,)
    k: np.ndarray  # (7,)
    graver: np.ndarray  # (3,) Doubt that there is in any case, or NONE


def solution(nav):
    """NavSolution of the last tick of a running filter."""
    newest = nav.history.newest
    return solutions(nav, range(newest, newest + 1))[0]


def solutions(nav, ticks, imu_blind=None):
    """NavSolution of each of some ticks, as `fill` takes them: list."""
    rows = np.empty((len(ticks), WIDTH))
    fill(nav, ticks, rows, imu_blind)
    return [_solution(row) for row in rows]


def fill(nav, ticks, rows, imu_blind=None):
    """Write a row for each of some ticks, in one compiled call.

    Parameters
    ----------
    nav : fusion.Filter
    ticks : range of their numbers, as `History` counts them
    rows : (m, WIDTH) is written
    imu_blind : as `Watch.imu_blind`, at all of these ticks; None: as it is now. What else decides whether
        they can be trusted is that of now: nothing may have arrived since the first of them.
    """
    watch, rules = nav.watch, nav.watch.params.imu
    gyros = np.array([rules.range[0], rules.wrong[0], rules.missed[0]])
    graver = watch.graver_doubts(nav.health, imu_blind)
    bounds = Bounds(*watch.protection.level, *watch.params.wanted, graver)
    _fill(nav.constants, nav.history.arrays, ticks.start, ticks.step, gyros, bounds, rows)
    rows[:, AIDED] = nav.health["star_tracker"].used > 0


def _solution(row):
    """NavSolution of a row of `fill`."""
    # by position, in the order of the record: nineteen keywords would cost more than the arithmetic
    t_s, aided, position, velocity, attitude = row[T_S:].tolist()
    return NavSolution(
        *(t_s, row[0:3], row[3:6], row[6:10], row[10:13], row[13:16], row[16:19]),
        *row[ANGLES:S_R].tolist(),
        *(row[S_R:S_V], row[S_V:S_ATT], row[S_ATT:S_OMEGA], row[S_OMEGA:S_ANGLES]),
        *row[S_ANGLES:LEVEL].tolist(),
        *(aided > 0.0, row[LEVEL : LEVEL + 2], row[LEVEL + 2 : LEVEL + 4], row[LEVEL + 4 : T_S]),
        *(position != NO_DOUBT, velocity != NO_DOUBT, attitude != NO_DOUBT),
        *(int(position), int(velocity), int(attitude)),
    )


def columns(rows):
    """NavSolution of arrays over N: of rows (N, WIDTH) of `fill`."""
    fields = {}
    for name, size in FIELDS.items():
        part = rows[:, ENDS[name] - size : ENDS[name]]
        fields[name] = (part if size > 1 else part[:, 0]).copy()
    for k, quantity in enumerate(QUANTITIES):
        doubt = rows[:, DOUBT + k].astype(np.int64)
        fields |= {f"doubt_{quantity}": doubt, f"do_not_use_{quantity}": doubt != Doubt.NONE}
    return NavSolution(t_s=rows[:, T_S].copy(), star_aided=rows[:, AIDED] > 0.0, **fields)


@kernel
def _fill(constants, memory, first, step, gyros, bounds, out):
    """`_derive`, protection levels, time and whether to be trusted of ticks of a History: out (m, WIDTH).

    constants, memory : prediction.Constants, prediction.Memory;  first, step : numbers of the ticks
    gyros : as of `mean_rate.unread`;  bounds : Bounds
    """
    constants, memory, gyros, bounds, out = lent((constants, memory, gyros, bounds, out))
    numbers, Ps, at, earth = memory.numbers, memory.Ps, constants.at, constants.earth
    model = constants.model
    axes, known, sigma = np.empty((4, 3)), np.empty(protected.N_FOLLOWED), np.empty(protected.N_TOLD)
    for j in range(len(out)):
        place = (first + j * step) % len(numbers)
        added = momentary.variances(constants.momentary, numbers[place, 3])
        P = as_reported(Ps[place], added[0], added[1])
        noise = model[error_model.valid(model, numbers[place, 0])], added[1], gyros
        _derive(at, memory, place, P, noise, earth, out[j], axes)
        _sigmas(Ps[place], axes, added, known, sigma)
        dt_s, protection = numbers[place, 0] - bounds.t_s, out[j, LEVEL:T_S]
        integrity_protection.levels(bounds.w, bounds.sigma, dt_s, bounds.k, known, sigma, protection)
        out[j, T_S] = numbers[place, 0]
        integrity_protection.doubts(protection, bounds.limits, bounds.graver, out[j, DOUBT:WIDTH])


@inner
def _sigmas(P, axes, added, known, sigma):
    """Sigmas of a tick: known (9,) of the filter, sigma (7,) of the solution, in the order of `protected`.

    P : (n, n) of the filter;  axes : of `protected.level_axes`;  added : of `momentary.variances`
    """
    both = protected.variances(P, axes, known)
    protected.worst_sigmas(known, both, sigma)
    for i in range(protected.VELOCITY.start, protected.N_TOLD):
        sigma[i] = np.sqrt(sigma[i] ** 2 + (added[0] if i < protected.ATTITUDE.start else added[1]))
    for i in range(protected.N_FOLLOWED):
        known[i] = np.sqrt(known[i])


@inner
def _derive(at, memory, place, P, noise, earth, out, axes):
    """Quantities derived from the state, and their sigmas, in the places of FIELDS.

    The angles are those of the velocity against the air, with sigmas of pi at most. The rate is the mean of
    the last sample, half a sample late; half of its change counts in its sigma, but for what noise changes.

    at : of Layout;  memory, place : prediction.Memory and the tick's place in it;  P : (n, n), as reported
    noise : row of `error_model.record`; rad^2, of an instant; of `mean_rate.unread`
    out, axes : (N_OUT,) and that of `protected.level_axes` are written
    """
    x = memory.xs[place]
    _of_state(x, P, memory.numbers[place, 0], earth, out, axes)
    dt_s, n, vibration = memory.numbers[place, 1], int(memory.numbers[place, 2]), memory.numbers[place, 3]
    drive, increments = memory.drives[place], memory.increments[place, : BEFORE + n]
    sample, before = increments[BEFORE - 1 + n], increments[BEFORE - 2 + n]
    dtheta, dv = free_increment(acting(x, vibration, drive), triads(x), sample.reshape(1, 6), 0, dt_s)
    t3.put(out[OMEGA:R_E], t3.scaled(1.0 / dt_s, dtheta))
    sensed = np.array(dtheta + dv) / dt_s
    J_omega, _ = jacobians_packed(at, P.shape[0], x, sensed[:3], sensed[3:], vibration, drive)
    row, moment2, gyros = noise
    walk2, both_ends2 = row.gyro_random_walk**2 / dt_s, 2.0 * moment2 / dt_s**2
    white = mean_rate.rate_noise(row, sensed[:3], sensed[3:], vibration, dt_s) + both_ends2
    for k in range(3):
        # a mean is that of the middle of its sample; of its change noise has so much
        late2 = (0.5 * (sample[k] - before[k]) / dt_s) ** 2 - 0.5 * walk2 - 0.75 * both_ends2
        missed2 = mean_rate.unread(increments[BEFORE:, k], memory.extra[place, 0, k], dt_s, gyros)
        more = white + max(late2, 0.0) + missed2
        out[S_OMEGA + k] = np.sqrt(_variance(J_omega[k], P, ATT.stop) + more)


@kernel
def derive(x, P, t_s, earth):
    """What follows from position, velocity and attitude alone, in the places of FIELDS; the rest is zero.

    x : (10,) r_i [m], v_i [m/s], q_ib;  P : (9, 9) of them, attitude error in body axes -> (N_OUT,)
    """
    out, axes = np.zeros(N_OUT), np.empty((4, 3))
    _of_state(x, P, t_s, earth, out, axes)
    return out


@inner
def _of_state(x, P, t_s, earth, out, axes):
    """The part of `_derive` that follows from position, velocity and attitude."""
    C_ei = t3.transposed(t3.matrix(frames.dcm_ie(earth, t_s)))
    turn = t3.vector(frames.omega_ie_i(earth), 0)
    C_ib = t3.dcm_from_quat(t3.quaternion(x, X_Q.start))
    r_i = t3.vector(x, X_R.start)
    u_i = t3.plus(t3.vector(x, X_V.start), -1.0, t3.cross(turn, r_i))  # against the air
    out[: X_Q.stop] = x[: X_Q.stop]
    t3.put(out[R_E:V_E], t3.rotated(C_ei, r_i))
    t3.put(out[V_E:ANGLES], t3.rotated(C_ei, u_i))
    C_ni = protected.put_level_axes(C_ei, out[R_E:V_E], turn, axes)
    _angles(out, C_ni, C_ib, u_i, turn, P)
    g = np.zeros(ATT.stop)
    for k in range(3):
        row = t3.vector(C_ei, 3 * k)
        _put(g, (0.0, 0.0, 0.0), row)
        out[S_R + k] = np.sqrt(_variance(g, P, 0))
        _put(g, row, t3.cross(turn, row))
        out[S_V + k] = np.sqrt(_variance(g, P, 0))
        out[S_ATT + k] = np.sqrt(P[ATT.start + k, ATT.start + k])


@inner
def _angles(out, C_ni, C_ib, u_i, turn, P):
    """Angles of the velocity u_i against the air, and sigmas of three of them. C_ni, C_ib : nine numbers"""
    C_bi = t3.transposed(C_ib)
    v_n, v_b = t3.rotated(C_ni, u_i), t3.rotated(C_bi, u_i)
    speed2 = max(np.sqrt(t3.dot(u_i, u_i)), SLOWEST) ** 2
    along, in_plane = np.sqrt(v_n[0] ** 2 + v_n[1] ** 2), np.sqrt(v_b[0] ** 2 + v_b[2] ** 2)
    level, plane, attack = max(along, SLOWEST), max(in_plane, SLOWEST), np.arctan2(v_b[2], v_b[0])
    out[ANGLES], out[ANGLES + 1] = np.arctan2(-v_n[2], along), np.arctan2(v_n[1], v_n[0])
    out[ANGLES + 2], out[ANGLES + 3] = attack, np.arctan2(v_b[1], in_plane)
    # gradients with respect to the velocity in n or b
    path_n = t3.scaled(1.0 / speed2, (v_n[0] * v_n[2] / level, v_n[1] * v_n[2] / level, -level))
    attack_b = t3.scaled(1.0 / plane, (-np.sin(attack), 0.0, np.cos(attack)))
    slip_b = t3.scaled(1.0 / speed2, (-v_b[0] * v_b[1] / plane, plane, -v_b[2] * v_b[1] / plane))
    zero, g = (0.0, 0.0, 0.0), np.empty(ATT.stop)
    path_i = t3.rotated(t3.transposed(C_ni), path_n)
    for k, u_b, dv_i in (
        (0, zero, path_i), (1, attack_b, t3.rotated(C_ib, attack_b)), (2, slip_b, t3.rotated(C_ib, slip_b))
    ):  # fmt: skip
        _put(g, dv_i, t3.cross(turn, dv_i))  # dv_i . (-omega x dr) = (omega x dv_i) . dr
        t3.put(g[ATT], t3.cross(u_b, v_b))  # = u . (v_b x dtheta)
        out[S_ANGLES + k] = min(pi, np.sqrt(_variance(g, P, 0)))


@inner(forceinline=True)
def _put(g, dv, dr):
    """A gradient with respect to velocity and position, none to the attitude."""
    t3.put(g[POS], dr)
    t3.put(g[VEL], dv)
    g[ATT] = 0.0


@inner
def _variance(g, P, first):
    """g^T P g: variance of a scalar with gradient g, which is zero before `first`. (m,), (n, n), m <= n"""
    total = 0.0
    for i in range(first, g.shape[0]):
        if g[i] != 0.0:
            for j in range(first, g.shape[0]):
                if g[j] != 0.0:
                    total += g[i] * P[i, j] * g[j]
    return max(total, 0.0)
