"""Prediction: nominal state and covariance over ticks and parts of them, each in one compiled call.

    x <- strapdown(x),   P <- Phi P Phi^T + Q

Of Phi only the rows of position, velocity and attitude, the clock and what fades (`laws`)
differ from the identity, and only the errors of the IMU drive the first nine: the products run over those.
Blocks from outside (`blocks.Block`) may have a law of their own, and may drive the first nine: then the
products run over all errors.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel, lent
from shefex_nav.geometry import frames
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation import (
    calibration,
    error_model,
    laws,
    momentary,
    process_noise,
    strapdown,
    unknown_attitude,
)
from shefex_nav.onboard.navigation.blocks import WEIGHTS
from shefex_nav.onboard.navigation.laws import SIZES
from shefex_nav.onboard.navigation.state import (
    BA,
    BG,
    CLOCK,
    GRAVITY,
    N_CORE,
    PVA,
    X_GRAVITY,
    X_Q,
    X_R,
    X_V,
    pack,
)
from shefex_nav.onboard.navigation.strapdown import BEFORE, ImuWindow, gravity_i

TOP = PVA.stop  # rows of Phi that the strapdown makes
RATE_NOISE = slice(4, 7)  # columns of the numbers of a tick, the last of them


class Constants(NamedTuple):
    """What a prediction needs of a filter, the same in all ticks."""

    at: np.ndarray  # of Layout
    model: np.ndarray  # `error_model.record`
    walks: np.ndarray  # (m,) variance a second of the last errors, those from outside
    F: np.ndarray  # (m, m) 1/s, their law; (0, 0): they are constant but for the walks
    driving: int  # m if one of them drives increments, else 0
    earth: frames.EarthRotation
    momentary: np.ndarray  # (2, 3) of `momentary`


def constants(layout, model, earth, blocks=(), errors=momentary.NONE):
    """Constants. Layout, `error_model.record`, EarthRotation, blocks.Block from outside, of `momentary`"""
    blocks = [block for block in blocks if block.name in layout.names]
    walks = np.concatenate([np.empty(0), *(block.walk**2 for block in blocks)])
    F, k = np.zeros((0, 0)), 0
    if any(block.F is not None for block in blocks):
        F = np.zeros((len(walks), len(walks)))
    for block in blocks:
        if block.F is not None:
            F[k : k + block.size, k : k + block.size] = block.F
        k += block.size
    driving = len(walks) if any(block.drives is not None for block in blocks) else 0
    return Constants(layout.at, model, walks, F, driving, earth, errors)


class Memory(NamedTuple):
    """The arrays of a `History`, which holds tick k in place k modulo its size."""

    numbers: np.ndarray  # (size, 7)
    increments: np.ndarray  # (size, 2 + samples, 6)
    extra: np.ndarray  # (size, 3, 3)
    xs: np.ndarray  # (size, X)
    Ps: np.ndarray  # (size, n, n)
    x: np.ndarray  # (X,) of the instant that has been reached
    P: np.ndarray  # (n, n) likewise
    drives: np.ndarray  # (size, 6, m) of ImuWindow


class Workspace(NamedTuple):
    """Arrays that an interval is worked out in."""

    responses: error_model.Responses
    top: np.ndarray  # (9, n) first rows of Phi
    Q: np.ndarray  # (9, 9) of the first errors
    product: np.ndarray  # (9, n)


class Growth(NamedTuple):
    """How the errors went over an interval."""

    Phi: np.ndarray  # (n, n)
    Q: np.ndarray  # (n, n)


def growth(constants, layout, state, imu, begin_s, end_s):
    """Transition matrix and process noise of the part begin_s ... end_s of a tick.

    Parameters
    ----------
    constants : Constants
    layout : Layout
    state : NavState at begin_s
    imu : ImuWindow
    begin_s, end_s : s from the start of the window

    Returns
    -------
    Growth
    """
    imu = imu._replace(t_end_s=state.t_s - begin_s + imu.length_s)
    return Growth(*_growth(constants, layout.n, pack(state), imu, begin_s, end_s))


def advance(constants, x, t_s, P, imu, begin_s, end_s):
    """State and covariance after the part begin_s ... end_s of a tick.

    As `growth`, with the packed nominal state x at begin_s, mission time t_s, and its covariance P (n, n)
    -> x, P (n, n)
    """
    x, P = x.copy(), P.copy()
    of_tick = t_s - begin_s + imu.length_s, imu.dt_s, imu.n, imu.vibration
    numbers = np.array([[*of_tick, *imu.rate_noise]])
    increments, extra = imu.increments[None], imu.extra[None]
    memory = Memory(numbers, increments, extra, x[None].copy(), P[None].copy(), x, P, imu.drive[None])
    propagate(constants, memory, 0, begin_s, 0, end_s)
    return x, P


@kernel
def propagate(constants, memory, first, begin_s, last, end_s):
    """State and covariance from an instant within one tick to one within the same or a later tick.

    Parameters
    ----------
    constants : Constants
    memory : Memory; x and P are carried along, xs and Ps written wherever the end of a tick is reached
    first, begin_s : number of the tick in which the way begins, s from its start
    last, end_s : in which it ends; np.inf: at its end
    """
    _propagate_ticks(constants, memory, first, begin_s, last, end_s, workspace(memory.P.shape[0]))


@inner(forceinline=True)
def _propagate_ticks(constants, memory, first, begin_s, last, end_s, work):
    """`propagate` with a `workspace` that is there already."""
    constants, memory, work = lent((constants, memory, work))
    numbers, x, P, model = memory.numbers, memory.x, memory.P, constants.model
    for number in range(first, last + 1):
        k = number % numbers.shape[0]
        h, n = numbers[k, 1], int(numbers[k, 2])
        length_s = n * h
        until_s = end_s if number == last and end_s < length_s else length_s
        if until_s > begin_s:
            extra = memory.extra[k]
            own, drive = memory.increments[k, : BEFORE + n], memory.drives[k]
            imu = ImuWindow(numbers[k, 0], h, own, numbers[k, 3], extra, drive, numbers[k, RATE_NOISE])
            row = error_model.valid(model, numbers[k, 0])
            bias_walk, angle, speed = interval(constants, model[row], x, imu, begin_s, until_s, work)
            carry_covariance(constants, model[row], P, work, bias_walk, until_s - begin_s)
            q_ib = t3.quaternion(x, X_Q.start)
            unknown_attitude.widen(P, angle, speed, extra, until_s - begin_s, q_ib)
        if until_s == length_s:
            _keep(x, P, memory.xs[k], memory.Ps[k])
        begin_s = 0.0


@inner(forceinline=True)
def _keep(x, P, x_kept, P_kept):
    """Copy packed values and covariance, in loops: an assignment of arrays takes more than twice as long."""
    for i in range(x.shape[0]):
        x_kept[i] = x[i]
    for i in range(P.shape[0]):
        for j in range(P.shape[1]):
            P_kept[i, j] = P[i, j]


@kernel(forceinline=True)
def enter(constants, memory, number, motors, t_end_s, dt_s, n, work=None):
    """A tick on: complete the place of a new tick in a `History`, and `propagate` through it.

    number : of the tick, whose n samples of dt_s that end at t_end_s are in its place already
    motors : of NavParams
    work : a `workspace` that is there already, as a run of ticks has it
    """
    numbers, increments, model = memory.numbers, memory.increments, constants.model
    k, before = number % numbers.shape[0], (number - 1) % numbers.shape[0]
    n_before, stretch = int(numbers[before, 2]), dt_s / numbers[before, 1]
    for i in range(BEFORE):
        for j in range(6):  # samples of another duration are taken to have gone on at their rate
            if n_before > 0:
                increments[k, i, j] = stretch * increments[before, n_before + i, j]
            else:
                increments[k, i, j] = increments[k, BEFORE, j]
    gained = 0.0
    for i in range(BEFORE, BEFORE + n):
        gained += increments[k, i, 3]
    shake = error_model.shake(increments[k, BEFORE : BEFORE + n, 3:])
    limits = model[0].thrust_threshold, model[0].shake_threshold
    vibration = error_model.vibration_level(motors, limits[0], limits[1], t_end_s, gained / (n * dt_s), shake)
    numbers[k, 0], numbers[k, 1], numbers[k, 2], numbers[k, 3] = t_end_s, dt_s, n, vibration
    _tell_noise(constants, memory, k, before)
    room = workspace(memory.P.shape[0]) if work is None else work
    _propagate_ticks(constants, memory, number, 0.0, number, np.inf, room)


@inner(forceinline=True)
def _tell_noise(constants, memory, k, before):
    """Complete the numbers of a tick by what of its rate is noise; k, before: its place, that of the last."""
    numbers, increments = memory.numbers, memory.increments
    row = constants.model[error_model.valid(constants.model, numbers[k, 0])]
    n, n_before = int(numbers[k, 2]), int(numbers[before, 2])
    T, T_before = n * numbers[k, 1], n_before * numbers[before, 1]
    for i in range(3):
        now = w = process_noise.measured_rate(increments[k], BEFORE, n, i, T)
        column = RATE_NOISE.start + i
        if n_before > 0:
            w = process_noise.measured_rate(increments[before], BEFORE, n_before, i, T_before)
            w -= numbers[before, column]
        extra = memory.extra[k, 0, i]
        numbers[k, column] = process_noise.noise_of_rate(row, constants.momentary, extra, w, now, T)


@inner
def workspace(n):
    """Workspace for n errors. Responses that are not wanted are multiplied by zero: they must be numbers."""
    responses = error_model.Responses(
        np.empty(WEIGHTS, np.bool_), np.empty(WEIGHTS, np.bool_),
        np.zeros((WEIGHTS, 3, 3, 3)), np.zeros((WEIGHTS, 2, 3, 3)),
    )  # fmt: skip
    return Workspace(responses, np.empty((TOP, n)), np.empty((TOP, TOP)), np.empty((TOP, n)))


@kernel
def _growth(constants, n, x, imu, begin_s, end_s):
    """Phi and Q in full: the rows of the strapdown, and a covariance of zero carried on."""
    Phi, Q, work, T = np.eye(n), np.zeros((n, n)), workspace(n), end_s - begin_s
    at, model = constants.at, constants.model
    row = error_model.valid(model, imu.t_end_s)
    bias_walk, _, _ = interval(constants, model[row], x, imu, begin_s, end_s, work)
    Phi[:TOP] = work.top
    if at[CLOCK] >= 0:
        Phi[at[CLOCK], at[CLOCK] + 1] = T
    for block, time_s, _ in laws.fading(model[0]):
        if at[block] >= 0:
            for i in range(at[block], at[block] + SIZES[block]):
                Phi[i, i] = np.exp(-T / time_s)
    m = constants.F.shape[0]
    if m > 0:
        Phi[n - m :, n - m :] = laws.transition(constants.F, T)
    carry_covariance(constants, model[row], Q, work, bias_walk, T)
    return Phi, Q


@inner
def interval(constants, noise, x, imu, begin_s, end_s, work):
    """Strapdown and error model of the part begin_s ... end_s of a tick.

    noise : row of `Constants.model`;  imu : ImuWindow.  x (X,) at begin_s is carried on in place. Of the
    Workspace `top` and `Q` are written.

    -> m^2/s^5, random walk of the accelerometer bias; rad, m/s, sums of the corrected increments
    """
    (responses, top, Q, _), at, earth, h = work, constants.at, constants.earth, imu.dt_s
    length_s = h * (imu.increments.shape[0] - BEFORE)
    t_s = imu.t_end_s - length_s + begin_s
    r, v, T = t3.vector(x, X_R.start), t3.vector(x, X_V.start), end_s - begin_s
    C = t3.dcm_from_quat(t3.quaternion(x, X_Q.start))
    angle_0, rate = earth.angle_0, earth.rate
    g = gravity_i(t3.plus(r, 0.5 * T, v), angle_0 + rate * (t_s + 0.5 * T), earth.C_iq, earth.C_re)
    g = t3.plus(g, 1.0, t3.vector(x, X_GRAVITY))
    M, A, G = calibration.triads(x)
    error_model.begin(responses, at, G)
    u, u_r, angle, speed = strapdown.propagate(x, imu, begin_s, end_s, g, responses)
    laws.drift(x, noise, constants.F, T)
    C_bi = t3.transposed(t3.dcm_from_quat(t3.quaternion(x, X_Q.start)))
    for k in range(WEIGHTS):
        if responses.by_gyro[k]:
            t3.store(responses.gyro[k, 2], t3.product(C_bi, t3.matrix(responses.gyro[k, 2])))
    top[:] = 0.0
    error_model.put_motion(top, r, u, u_r, C, C_bi, T)
    error_model.put_gravity(top, at, T)
    inverses = np.empty((3, 3, 3))
    t3.store(inverses[0], M)
    t3.store(inverses[1], A)
    t3.store(inverses[2], t3.product(M, t3.product(G, A)))
    error_model.put_imu(top, at, responses, inverses, imu.vibration, imu.drive)
    share = T / length_s
    sensed = _across(imu.increments, h)
    along, across, bias_walk = process_noise.densities(
        noise, imu.vibration, share, h, T, angle, speed, sensed
    )
    process_noise.of_interval(top, along, across, imu.extra, C, T, Q)
    return bias_walk, angle, speed


@inner(forceinline=True)
def _across(increments, sample_s):
    """Mean of what gyros and accelerometers of a window read across the roll axis: rad/s, m/s^2."""
    sums, n = np.zeros(4), increments.shape[0] - BEFORE
    for k in range(BEFORE, increments.shape[0]):
        sums[0] += increments[k, 1]
        sums[1] += increments[k, 2]
        sums[2] += increments[k, 4]
        sums[3] += increments[k, 5]
    span_s = n * sample_s
    return np.sqrt(sums[0] ** 2 + sums[1] ** 2) / span_s, np.sqrt(sums[2] ** 2 + sums[3] ** 2) / span_s


@inner
def carry_covariance(constants, noise, P, work, bias_walk, T):
    """P <- Phi P Phi^T + Q, in place, exactly symmetric; noise, work: as of `interval`."""
    top, Q, A, at, n = work.top, work.Q, work.product, constants.at, P.shape[0]
    drivers = N_CORE
    for k in range(GRAVITY + 1):
        if at[k] >= 0:
            drivers += SIZES[k]
    if constants.driving > 0:
        drivers = n
    for i in range(TOP):
        A[i] = 0.0
        for k in range(drivers):
            factor = top[i, k]
            if factor != 0.0:
                for j in range(n):
                    A[i, j] += factor * P[k, j]
    for i in range(0, TOP, 3):
        for j in range(0, i + 1, 3):
            nine = _nine_sums(A, top, Q, i, j, drivers)
            for a in range(3):
                for b in range(3):  # of a block on the diagonal, what lies below it comes last and stays
                    P[i + a, j + b] = P[j + b, i + a] = nine[3 * a + b]
    for i in range(TOP):
        for j in range(TOP, n):
            P[i, j] = P[j, i] = A[i, j]
    for i in range(3):
        P[BG.start + i, BG.start + i] += noise.gyro_bias_walk**2 * T
        P[BA.start + i, BA.start + i] += bias_walk * T
    if at[CLOCK] >= 0:
        laws.clock(P, at[CLOCK], noise.clock_white**2, noise.clock_walk**2, T)
    for block, time_s, sigma in laws.fading(noise):
        if at[block] >= 0:
            laws.wander(P, at[block], SIZES[block], np.exp(-T / time_s), sigma)
    laws.grow(P, constants.walks, constants.F, T)


@inner(forceinline=True)
def _nine_sums(A, top, Q, i, j, drivers):
    """Block (3, 3) of A top^T + Q at row i, column j: sums side by side, none of which waits for another."""
    a, b, c = Q[i, j], Q[i, j + 1], Q[i, j + 2]
    d, e, f = Q[i + 1, j], Q[i + 1, j + 1], Q[i + 1, j + 2]
    g, h, m = Q[i + 2, j], Q[i + 2, j + 1], Q[i + 2, j + 2]
    for k in range(drivers):
        x, y, z = A[i, k], A[i + 1, k], A[i + 2, k]
        u, v, w = top[j, k], top[j + 1, k], top[j + 2, k]
        a, b, c = a + x * u, b + x * v, c + x * w
        d, e, f = d + y * u, e + y * v, f + y * w
        g, h, m = g + z * u, h + z * v, m + z * w
    return a, b, c, d, e, f, g, h, m
