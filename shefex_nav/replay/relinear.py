"""A Kalman filter over the nodes of a flight, linear about a given trajectory x, not about its own estimates.

Errors about the trajectory have a mean m and a covariance P. Over an interval from x to y, with f(x) what the
strapdown makes of x and d = y (-) f(x)::

    m <- G (Phi m - d),   P <- G (Phi P Phi^T + Q) G^T,   G = Jr(d) for the attitude

A measurement is linearised at the node's x, z = H e + noise, and corrects m and P; the trajectory stays. What
`smoother` needs of every interval is kept: the first rows of G Phi, of d and of Q.

A smoother that is repeated so, each time about what came out the time before, is a Gauss-Newton method for
the most probable trajectory (Bell, SIAM J. Optim. 4 (1994) 626).
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import error_model, fusion, gate, laws, prediction
from shefex_nav.onboard.navigation.history import Moment
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.laws import FIELD_TIME_S, SIZES
from shefex_nav.onboard.navigation.prediction import RATE_NOISE, TOP
from shefex_nav.onboard.navigation.state import (
    ATT,
    BA,
    BG,
    CLOCK,
    POS,
    VEL,
    X_GRAVITY,
    X_Q,
    X_R,
    X_V,
    right_jacobian,
    used_at_start,
)
from shefex_nav.onboard.navigation.strapdown import BEFORE, ImuWindow


class Trajectory(NamedTuple):
    """What a pass is linear about, at nodes 0 ... m."""

    xs: np.ndarray  # (m + 1, X) packed values
    more: (
        np.ndarray
    )  # (m + 1, 3) m/s^2, inertial axes, gravity that the on-board field leaves out and is known


class Intervals(NamedTuple):
    """The m intervals about a trajectory, G taken in."""

    tops: np.ndarray  # (m, 9, n) first rows of Phi
    jumps: np.ndarray  # (m, n) d, turned by G
    noises: np.ndarray  # (m, 9, 9) of Q
    walks: np.ndarray  # (m, 2) rad^2/s^3, m^2/s^5, random walks of the biases: gyros, accelerometers


class Update(NamedTuple):
    """What a measurement did at a node."""

    added: np.ndarray | None  # (n, n) to the covariance before it, in the blocks of `cut` all; None: nothing
    held: np.ndarray | None  # (n,) error of what the filter held for right when it forgot
    cut: tuple  # slices of the blocks that were forgotten with all their ties to others
    z: np.ndarray  # (m,) innovation, about the mean
    H: np.ndarray  # (m, n)
    K: np.ndarray  # (n, m) gain
    S_inverse: np.ndarray  # (m, m)


class Passed(NamedTuple):
    """A pass from the start to the end."""

    mean: np.ndarray  # (n,) at the start
    P: np.ndarray  # (n, n) likewise
    intervals: Intervals
    updates: dict  # node -> list of Update
    covariances: dict  # node -> P with its measurements: of start, end and `updates`, where wanted


def difference(layout, x, y):
    """Error e of packed nominal values x against y: y = x (+) e. -> (n,)"""
    e = np.empty(layout.n)
    _difference(x, y, layout.nominal, e)
    return e


@kernel
def _difference(x, y, nominal, e):
    """`difference`; e (n,) is written."""
    for i in range(3):
        e[POS.start + i] = y[X_R.start + i] - x[X_R.start + i]
        e[VEL.start + i] = y[X_V.start + i] - x[X_V.start + i]
    turn = rotation.quat_multiply(rotation.quat_conjugate(x[X_Q]), y[X_Q])
    e[ATT] = rotation.rotvec_from_quat(turn)
    for k in range(nominal.shape[0]):
        e[ATT.stop + k] = y[nominal[k]] - x[nominal[k]]


def origin(layout, x_0, P_0, x):
    """Errors about x at the start, of which x_0 and P_0 were assumed: mean (n,), P (n, n)."""
    e = difference(layout, x_0, x)
    G = np.eye(layout.n)
    G[ATT, ATT] = right_jacobian(e[ATT])
    return -G @ e, G @ P_0 @ G.T


def room(m, n):
    """Intervals to be written; new memory for each pass would cost more than the arithmetic."""
    return Intervals(np.empty((m, TOP, n)), np.empty((m, n)), np.empty((m, TOP, TOP)), np.empty((m, 2)))


def forward(nav, whole, nodes, trajectory, start, intervals, second=False):
    """The pass.

    Parameters
    ----------
    nav : fusion.Filter of the same parameters, of which `start` are state and covariance at the start
    whole : final_pass.Whole
    nodes : final_pass.Nodes
    trajectory : Trajectory
    start : history.Tick
    intervals : Intervals, written
    second : whether covariances are wanted

    Returns
    -------
    Passed
    """
    m = len(nodes.ticks)
    mean_0, P_0 = origin(nav.layout, start.x, start.P, trajectory.xs[0])
    mean, P, reached = mean_0.copy(), P_0.copy(), 0
    updates, covariances = {}, {0: P_0}
    nav = nav._replace(history=whole)
    whole.used_s = used_at_start(nav.params, start.t_s)
    samples = Samples(whole.numbers, whole.increments, whole.extra, whole.drives, nodes.ticks, nodes.parts_s)
    about = About(nav.layout.nominal, *trajectory)
    for node in [*sorted(nodes.seen), m]:
        _follow(nav.constants, samples, about, (reached, node), mean, P, intervals)
        reached = node
        if node in nodes.seen:
            whole.x[:] = trajectory.xs[node]
            whole.P[:] = P
            updates[node] = [_correct(nav, seen, mean, P) for seen in nodes.seen[node]]
        if second:
            covariances[node] = P.copy()
    return Passed(mean_0, P_0, intervals, updates, covariances)


def _correct(nav, seen, mean, P):
    """Take a UsedMeasurement into mean and P, in place. -> Update"""
    whole, one = nav.history, seen.measurement
    z, H, R = fusion.linearised(nav, Moment(whole, seen.tick, seen.at_s), one)
    added, held, cut = None, None, ()
    if one.fate != Fate.USED or one.doubts:
        added, held, cut = _forgotten(nav, seen, mean, P, H)
    z, H, R = fusion.rows_used(nav, one, z, H, R)
    z = z - H @ mean
    K, S_inverse = np.zeros((len(mean), len(z))), np.zeros((len(z), len(z)))
    if len(z):
        K, S_inverse = _update(mean, P, z, H, R)
    return Update(added, held, cut, z, H, K, S_inverse)


def _forgotten(nav, seen, mean, P, H):
    """Forget what a reset forgets, or add what is doubted, in place. -> as in Update"""
    one = seen.measurement
    prior, cut = gate.forgotten(nav, P, one, H)
    added, held = prior - P, None
    if cut:
        held = difference(nav.layout, nav.history.x, seen.x_then)
        places = np.concatenate([np.arange(len(P))[block] for block in cut])
        added[places], added[:, places] = 0.0, 0.0
        added[np.ix_(places, places)] = prior[np.ix_(places, places)]
        mean[places] = held[places]
    P[:] = prior
    return added, held, cut


@kernel
def _update(mean, P, z, H, R):
    """Take rows of a measurement into mean and P, in place; z : about the mean. -> K (n, m), S^-1 (m, m)

    Joseph's form.
    """
    m, n = H.shape
    HP = np.zeros((m, n))
    for i in range(m):
        for k in range(n):
            if H[i, k] != 0.0:
                for j in range(n):
                    HP[i, j] += H[i, k] * P[k, j]
    S = np.empty((m, m))
    for i in range(m):
        for j in range(i + 1):
            total = 0.5 * (R[i, j] + R[j, i])
            for k in range(n):
                total += HP[i, k] * H[j, k]
            S[i, j] = S[j, i] = total
    S_inverse = np.linalg.inv(S)
    K = np.ascontiguousarray(HP.T) @ S_inverse
    mean[:] += K @ z
    left = np.eye(n) - K @ H
    found = left @ P @ left.T + K @ R @ K.T
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = P[j, i] = 0.5 * (found[i, j] + found[j, i])
    return K, S_inverse


class Samples(NamedTuple):
    """The ticks of a Final, and the parts of them that lie between nodes."""

    numbers: np.ndarray  # (N + 1, 7)
    increments: np.ndarray  # (N + 1, 2 + samples, 6)
    extra: np.ndarray  # (N + 1, 2, 3)
    drives: np.ndarray  # (N + 1, 6, m)
    ticks: np.ndarray  # (m,) as of Nodes
    parts_s: np.ndarray  # (m, 2)


class About(NamedTuple):
    """A Trajectory, and where its values stand."""

    nominal: np.ndarray  # of Layout
    xs: np.ndarray  # as of Trajectory
    more: np.ndarray


@kernel
def _follow(constants, samples, about, between, mean, P, intervals):
    """Mean and P from one node to another, in place; what there is of intervals and nodes is written.

    constants : of fusion.Filter;  samples : Samples;  about : About;  between : the two nodes
    intervals : Intervals
    """
    n, xs, numbers, model = P.shape[0], about.xs, samples.numbers, constants.model
    work, d, x, moved = prediction.workspace(n), np.empty(n), np.empty(xs.shape[1]), np.empty(n)
    top, Q = work.top, work.Q
    for j in range(between[0], between[1]):
        k, begin_s, end_s = samples.ticks[j], samples.parts_s[j, 0], samples.parts_s[j, 1]
        T, own = end_s - begin_s, samples.increments[k, : BEFORE + int(numbers[k, 2])]
        x[:] = xs[j]
        for i in range(3):
            x[X_GRAVITY + i] += about.more[j, i]
        row = error_model.valid(model, numbers[k, 0])
        extra, drive = samples.extra[k], samples.drives[k]
        imu = ImuWindow(
            numbers[k, 0], numbers[k, 1], own, numbers[k, 3], extra, drive, numbers[k, RATE_NOISE]
        )
        walk, _, _ = prediction.interval(constants, model[row], x, imu, begin_s, end_s, work)
        prediction.carry_covariance(constants, model[row], P, work, walk, T)
        left = np.exp(-T / FIELD_TIME_S)
        for i in range(3):
            x[X_GRAVITY + i] = left * xs[j, X_GRAVITY + i]
        _difference(x, xs[j + 1], about.nominal, d)
        carried(constants, top, mean, T, moved)
        for i in range(n):
            mean[i] = moved[i] - d[i]
        _rotate(d, top, Q, mean, P)
        copy(top, intervals.tops[j])
        copy(Q, intervals.noises[j])
        for i in range(n):
            intervals.jumps[j, i] = d[i]
        intervals.walks[j, 0] = model[row].gyro_bias_walk ** 2
        intervals.walks[j, 1] = walk


@inner(forceinline=True)
def copy(matrix, out):
    """In loops: an assignment of arrays takes more than twice as long."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            out[i, j] = matrix[i, j]


@inner
def carried(constants, top, e, T, out):
    """Phi e: errors after an interval. (n,), written to out (n,)"""
    n, at, m = e.shape[0], constants.at, constants.F.shape[0]
    for i in range(0, TOP, 3):  # sums side by side, none of which waits for another
        a, b, c = 0.0, 0.0, 0.0
        for k in range(n):
            a, b, c = a + top[i, k] * e[k], b + top[i + 1, k] * e[k], c + top[i + 2, k] * e[k]
        out[i], out[i + 1], out[i + 2] = a, b, c
    for k in range(TOP, n):
        out[k] = e[k]
    if at[CLOCK] >= 0:
        out[at[CLOCK]] += T * e[at[CLOCK] + 1]
    fade(at, constants.model[0], T, out)
    if m > 0:
        out[n - m :] = laws.transition(constants.F, T) @ e[n - m :]


@inner(forceinline=True)
def fade(at, model, T, vector):
    """What is left of errors that fade, in place."""
    for block, time_s, _ in laws.fading(model):
        if at[block] >= 0:
            left = np.exp(-T / time_s)
            for k in range(at[block], at[block] + SIZES[block]):
                vector[k] *= left


@inner
def _rotate(d, top, Q, mean, P):
    """G on all that has an attitude, in place; nothing where the trajectory goes as a flight does."""
    a = ATT.start
    if d[a] ** 2 + d[a + 1] ** 2 + d[a + 2] ** 2 < 1e-24:
        return
    G = right_jacobian(d[ATT])
    _rotate_rows(G, top, a)
    _rotate_rows(G, Q, a)
    _rotate_rows(G, P, a)
    for matrix in (Q, P):
        m = matrix.shape[0]
        for i in range(m):
            x, y, z = matrix[i, a], matrix[i, a + 1], matrix[i, a + 2]
            for k in range(3):
                matrix[i, a + k] = G[k, 0] * x + G[k, 1] * y + G[k, 2] * z
        for i in range(m):
            for k in range(a, a + 3):
                matrix[i, k] = matrix[k, i] = 0.5 * (matrix[i, k] + matrix[k, i])
    for e in (mean, d):
        x, y, z = e[a], e[a + 1], e[a + 2]
        for k in range(3):
            e[a + k] = G[k, 0] * x + G[k, 1] * y + G[k, 2] * z


@inner
def _rotate_rows(G, matrix, a):
    """Three rows from a on, turned by G, in place."""
    for j in range(matrix.shape[1]):
        x, y, z = matrix[a, j], matrix[a + 1, j], matrix[a + 2, j]
        for k in range(3):
            matrix[a + k, j] = G[k, 0] * x + G[k, 1] * y + G[k, 2] * z


@inner
def other_noise(constants, walks, T, vector, out):
    """Q times a vector, of all errors but the first nine, subtracted from out (n,); walks: of Intervals."""
    at, model = constants.at, constants.model[0]
    for i in range(3):
        out[BG.start + i] -= walks[0] * T * vector[BG.start + i]
        out[BA.start + i] -= walks[1] * T * vector[BA.start + i]
    c = at[CLOCK]
    if c >= 0:
        white, drift = model.clock_white**2, model.clock_walk**2
        both = drift * T**2 / 2.0
        out[c] -= (white * T + drift * T**3 / 3.0) * vector[c] + both * vector[c + 1]
        out[c + 1] -= both * vector[c] + drift * T * vector[c + 1]
    for block, time_s, sigma in laws.fading(model):
        if at[block] >= 0:
            left = np.exp(-T / time_s)
            for k in range(at[block], at[block] + SIZES[block]):
                out[k] -= sigma**2 * (1.0 - left * left) * vector[k]
    _outer_noise(constants, T, vector, out)


@inner(forceinline=True)
def _outer_noise(constants, T, vector, out):
    """The same of the last errors, those from outside."""
    walks, F = constants.walks, constants.F
    m, last = walks.shape[0], out.shape[0] - walks.shape[0]
    if F.shape[0] > 0:
        Q = laws.law_noise(F, walks, T)
        out[last:] -= Q @ vector[last:]
        return
    for k in range(m):
        out[last + k] -= walks[k] * T * vector[last + k]
