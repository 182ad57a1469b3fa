"""Fixed-interval smoother over the nodes of a flight: the modified Bryson-Frazier form, compiled.

`relinear` goes forward; then the adjoint lambda (n,), Lambda (n, n) runs backward from zero and carries what
all later measurements say. With mean m and covariance P of the forward pass at some instant

    e = m - P lambda,    covariance of the smoothed estimate = P - P Lambda P

No covariance is inverted, so states without noise and singular P do no harm. The errors themselves need P
only at the start: from there they are carried forward with the noise that the adjoint tells of them,

    e <- Phi e - d - Q lambda

(Koopman, Biometrika 80 (1993) 117). Where the covariance is wanted, P is kept after measurements and carried
on once more from each to the next: its first rows at all nodes would be a fifth of all memory, and new memory
costs more than the arithmetic.

References: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973), eqs. of
section 3; Bryson & Ho, Applied Optimal Control, section 13.2. The sign of lambda is Bierman's.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.navigation import laws, prediction
from shefex_nav.onboard.navigation.laws import SIZES
from shefex_nav.onboard.navigation.prediction import TOP, Workspace
from shefex_nav.onboard.navigation.state import BG, CLOCK, corrected
from shefex_nav.replay.relinear import carried, copy, fade, other_noise


class Wanted(NamedTuple):
    """Covariances of the smoothed estimate that are wanted, all measurements of a node taken in."""

    ends: np.ndarray  # (m + 1,) bool, nodes at which those of the first nine errors are
    nine: np.ndarray  # (m + 1, 9, 9) these
    rows: np.ndarray  # (m + 1,) row of a node in `whole`, -1: none
    whole: np.ndarray  # (c, n, n) of all errors, at some of the nodes in `ends`


def back(nav, nodes, passed, wanted=None):
    """From the end to the start: errors about the trajectory, and their covariances.

    Parameters
    ----------
    nav : fusion.Filter, of which parameters and layout are used
    nodes : final_pass.Nodes
    passed : relinear.Passed
    wanted : Wanted, whose arrays are written; None: no covariances

    Returns
    -------
    (m + 1, n) error of the trajectory at the nodes, measurements and what they forgot taken in
    """
    m, n, second = len(nodes.ticks), nav.layout.n, wanted is not None
    vector, matrix, lambdas, between = np.zeros(n), np.zeros((n, n)), np.empty((m + 1, n)), {}
    durations, intervals = nodes.parts_s[:, 1] - nodes.parts_s[:, 0], passed.intervals
    given = nav.constants, intervals, durations
    stops = [*sorted(passed.updates, reverse=True), 0]
    if second:
        first_rows = np.empty((-np.diff([m, *stops]).min(), TOP, n))
        _at_the_end(passed.covariances[m], *wanted)
    reached = m
    for node in stops:
        _back(*given, node, reached, vector, lambdas)
        if second:
            P = passed.covariances[node].copy()
            _filtered(*given, (node, reached), P, first_rows, wanted)
            _spread(*given, (node, reached), matrix, first_rows, wanted)
        reached = node
        for k, update in reversed(list(enumerate(passed.updates.get(node, ())))):
            if len(update.z):
                _before_update(vector, matrix, update.z, update.H, update.K, update.S_inverse, second)
            between[node, k] = vector.copy()
            for block in update.cut:
                vector[block], matrix[block], matrix[:, block] = 0.0, 0.0, 0.0
    lambdas[0] = vector
    return _errors(nav, passed, durations, lambdas, between)


def _at_the_end(P, ends, nine, rows, whole):
    """At the last node nothing comes later: the filter's own covariance P (n, n)."""
    if ends[-1]:
        nine[-1] = P[:TOP, :TOP]
        if rows[-1] >= 0:
            whole[rows[-1]] = P


def _errors(nav, passed, durations, lambdas, between):
    """Errors at the nodes, from the start to the end: (m + 1, n), in the memory of the lambdas."""
    e, reached = lambdas, 0
    e[0] = passed.mean - passed.P @ lambdas[0]
    for node in [*sorted(passed.updates), len(durations)]:
        _forth(nav.constants, passed.intervals, durations, reached, node, e)
        reached = node
        for k, update in enumerate(passed.updates.get(node, ())):
            if update.added is None:
                continue
            drawn = update.added @ between[node, k]
            e[node] -= drawn
            for block in update.cut:
                e[node][block] = update.held[block] - drawn[block]
    return e


@kernel
def _forth(constants, intervals, durations, first, last, e):
    """Errors from node `first` to `last`: e (m + 1, n), written over the lambdas, which stand in it."""
    n = e.shape[1]
    vector = np.empty(n)
    for j in range(first, last):
        T = durations[j]
        for i in range(n):
            vector[i] = e[j + 1, i]
        carried(constants, intervals.tops[j], e[j], T, e[j + 1])
        for i in range(n):
            e[j + 1, i] -= intervals.jumps[j, i]
        for i in range(TOP):
            for k in range(TOP):
                e[j + 1, i] -= intervals.noises[j, i, k] * vector[k]
        other_noise(constants, intervals.walks[j], T, vector, e[j + 1])


@kernel
def _back(constants, intervals, durations, first, last, vector, lambdas):
    """lambda <- Phi^T lambda from node `last` to `first`, in place; `lambdas` at the ends of intervals."""
    n, at, m = vector.shape[0], constants.at, constants.F.shape[0]
    before = np.empty(n)
    for j in range(last - 1, first - 1, -1):
        T, top = durations[j], intervals.tops[j]
        for i in range(n):
            lambdas[j + 1, i] = vector[i]
            before[i] = vector[i] if i >= TOP else 0.0
        if at[CLOCK] >= 0:
            before[at[CLOCK] + 1] += T * vector[at[CLOCK]]
        fade(at, constants.model[0], T, before)
        if m > 0:
            before[n - m :] = laws.transition(constants.F, T).T @ before[n - m :]
        for k in range(TOP):
            for i in range(n):
                before[i] += top[k, i] * vector[k]
        for i in range(n):
            vector[i] = before[i]


@kernel
def _filtered(constants, intervals, durations, between, P, first_rows, wanted):
    """P of the forward pass at the nodes from the first of `between` on, in place, and before the last.

    first_rows : (last - first, 9, n) is written, and the whole of `wanted` where it has a row
    """
    first, last = between
    rows, whole, walks, noise = wanted.rows, wanted.whole, intervals.walks, constants.model[0]
    room = prediction.workspace(P.shape[0])
    for j in range(first, last):
        copy(P[:TOP], first_rows[j - first])
        if rows[j] >= 0:
            copy(P, whole[rows[j]])
        if j + 1 == last:
            break
        work = Workspace(room.responses, intervals.tops[j], intervals.noises[j], room.product)
        prediction.carry_covariance(constants, noise, P, work, walks[j, 1], durations[j])
        for i in range(BG.start, BG.stop):  # as it was then, which may be another row of the model
            P[i, i] += (walks[j, 0] - noise.gyro_bias_walk**2) * durations[j]


@kernel
def _spread(constants, intervals, durations, between, matrix, first_rows, wanted):
    """Lambda from the last node of `between` to the first, in place, and P - P Lambda P before the last.

    first_rows : of P, as `_filtered` leaves them, and `wanted`, which becomes that of the smoothed estimate
    """
    n, (first, last), rows, whole = matrix.shape[0], between, wanted.rows, wanted.whole
    M, U, R = np.empty((TOP, n)), np.empty((TOP, n)), np.empty((TOP, n))
    for j in range(last - 1, first - 1, -1):
        _matrix_back(constants, intervals.tops[j], durations[j], matrix, M, U)
        if not wanted.ends[j]:
            continue
        _nine_smoothed(first_rows[j - first], matrix, R, wanted.nine[j])
        if rows[j] >= 0:
            P = whole[rows[j]]
            less = P @ matrix @ P
            for i in range(n):
                for k in range(i + 1):
                    P[i, k] = P[k, i] = P[i, k] - 0.5 * (less[i, k] + less[k, i])


@inner
def _matrix_back(constants, top, T, matrix, M, U):
    """Lambda <- Phi^T Lambda Phi, in place, exactly symmetric.

    Phi is D = diag(I, what clock, fading errors and laws do) and behind it the first rows, I + M: with
    L = D^T Lambda D it is L + U^T M + M^T U, U = L[:9] + L[:9, :9] M/2. Three terms at a time: each time that
    a row of the matrix is gone through it is loaded and stored.
    """
    n, at, F = matrix.shape[0], constants.at, constants.F
    clock, m = at[CLOCK], F.shape[0]
    if clock >= 0:
        for i in range(n):
            matrix[i, clock + 1] += T * matrix[i, clock]
        for j in range(n):
            matrix[clock + 1, j] += T * matrix[clock, j]
    for block, time_s, _ in laws.fading(constants.model[0]):
        if at[block] >= 0:
            _faded(matrix, at[block], SIZES[block], np.exp(-T / time_s))
    if m > 0:
        D = laws.transition(F, T)
        matrix[n - m :] = D.T @ matrix[n - m :]
        matrix[:, n - m :] = np.ascontiguousarray(matrix[:, n - m :]) @ D
    copy(top, M)
    for i in range(TOP):
        M[i, i] -= 1.0
    for i in range(TOP):
        for j in range(n):
            U[i, j] = matrix[i, j]
        for k in range(0, TOP, 3):
            a, b, c = 0.5 * matrix[i, k], 0.5 * matrix[i, k + 1], 0.5 * matrix[i, k + 2]
            for j in range(n):
                U[i, j] += a * M[k, j] + b * M[k + 1, j] + c * M[k + 2, j]
    for i in range(n):
        for k in range(0, TOP, 3):
            a, b, c = U[k, i], U[k + 1, i], U[k + 2, i]
            d, e, f = M[k, i], M[k + 1, i], M[k + 2, i]
            for j in range(i + 1):
                matrix[i, j] += (
                    (a * M[k, j] + d * U[k, j])
                    + (b * M[k + 1, j] + e * U[k + 1, j])
                    + (c * M[k + 2, j] + f * U[k + 2, j])
                )
        for j in range(i):
            matrix[j, i] = matrix[i, j]


@inner
def _faded(matrix, first, size, left):
    """Rows and columns of errors of which a part `left` is left, in place."""
    for i in range(first, first + size):
        for j in range(matrix.shape[0]):
            matrix[i, j] *= left
        for j in range(matrix.shape[0]):
            matrix[j, i] *= left


@inner
def _nine_smoothed(rows, matrix, R, out):
    """First nine rows and columns of P - P Lambda P. rows (9, n) of P, matrix (n, n), R (9, n), out (9, 9)"""
    n = matrix.shape[0]
    for i in range(0, TOP, 3):
        for j in range(n):
            R[i, j], R[i + 1, j], R[i + 2, j] = 0.0, 0.0, 0.0
        for k in range(n):
            a, b, c = rows[i, k], rows[i + 1, k], rows[i + 2, k]
            for j in range(n):
                x = matrix[k, j]
                R[i, j], R[i + 1, j], R[i + 2, j] = R[i, j] - a * x, R[i + 1, j] - b * x, R[i + 2, j] - c * x
    for i in range(0, TOP, 3):
        for j in range(0, i + 1, 3):
            nine = prediction._nine_sums(R, rows, rows, i, j, n)
            for a in range(3):
                for b in range(3):
                    out[i + a, j + b] = out[j + b, i + a] = nine[3 * a + b]


@kernel
def _before_update(vector, matrix, z, H, K, S_inverse, second):
    """Adjoint before a measurement, from that after it, in place; z : about the mean.

    With L = I - K H: lambda <- L^T lambda - H^T S^-1 z, Lambda <- L^T Lambda L + H^T S^-1 H. L is made first:
    where little was known before the measurement it is nearly singular, and multiplied out it would be lost.
    """
    left = np.ascontiguousarray((np.eye(H.shape[1]) - K @ H).T)
    Ht = np.ascontiguousarray(H.T)
    vector[:] = left @ vector - Ht @ (S_inverse @ z)
    if second:
        found = left @ matrix @ left.T + Ht @ (S_inverse @ H)
        for i in range(len(vector)):
            for j in range(i + 1):
                matrix[i, j] = matrix[j, i] = 0.5 * (found[i, j] + found[j, i])


@kernel
def moved(xs, e, nominal):
    """The trajectory that is better by its errors. (m, X), (m, n), Layout.nominal -> (m, X)"""
    out = np.empty_like(xs)
    for k in range(len(xs)):
        out[k] = corrected(xs[k], e[k], nominal)
    return out
