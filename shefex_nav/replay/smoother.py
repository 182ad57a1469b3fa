"""Fixed-interval smoother over the nodes of a flight: the modified Bryson-Frazier form, compiled.

`relinear` goes forward; then the adjoint lambda (n,), Lambda (n, n) runs backward from zero and carries what
all later measurements say. With mean m and covariance P of the forward pass at some instant

    e = m - P lambda,    covariance of the smoothed estimate = P - P Lambda P

No covariance is inverted, so states without noise and singular P do no harm. The errors themselves need P
only at the start: from there they are carried forward with the noise that the adjoint tells of them,

    e <- Phi e - d - Q lambda

(Koopman, Biometrika 80 (1993) 117), so that P is kept only as far as somebody wants to know it afterwards.

References: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973), eqs. of
section 3; Bryson & Ho, Applied Optimal Control, section 13.2. The sign of lambda is Bierman's.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.navigation.error_model import FIELD_TIME_S
from shefex_nav.onboard.navigation.prediction import SIZES, TOP
from shefex_nav.onboard.navigation.state import CLOCK, GRAVITY, RANGE_BIAS, corrected
from shefex_nav.replay.relinear import _carried, other_noise


def back(nav, nodes, passed, kept, ends=None):
    """From the end to the start: errors about the trajectory, and their covariances.

    Parameters
    ----------
    nav : fusion.Filter, of which parameters and layout are used
    nodes : final_pass.Nodes
    passed : relinear.Passed
    kept : relinear.Kept; with rows at every node (`wide`), `whole` becomes that of the smoothed estimate
    ends : (m + 1,) bool, nodes at which the covariance is wanted; None: none

    Returns
    -------
    e : (m + 1, n) error of the trajectory at the nodes, measurements and what they forgot taken in
    P : (m + 1, 9, 9) of it, where it is wanted; None if nowhere
    """
    m, n = len(nodes.ticks), nav.layout.n
    vector, matrix, second = np.zeros(n), np.zeros((n, n)), ends is not None
    lambdas, between = np.empty((m + 1, n)), {}
    P = np.empty((m + 1, TOP, TOP)) if second else np.empty((0, TOP, TOP))
    ends = ends if second else np.zeros(m + 1, dtype=bool)
    durations = nodes.parts_s[:, 1] - nodes.parts_s[:, 0]
    reached = m
    if second and m not in passed.updates:
        _spread(m, matrix, *kept, ends, P)
    for node in [*sorted(passed.updates, reverse=True), 0]:
        _back(
            nav.layout.at, nav.constants[1], passed.intervals.tops, durations, node, reached, vector, matrix,
            lambdas, *kept, ends, P, second,
        )  # fmt: skip
        reached = node
        if second and node:
            _spread(node, matrix, *kept, ends, P)
        for k, update in reversed(list(enumerate(passed.updates.get(node, ())))):
            if len(update.z):
                _before_update(vector, matrix, update.z, update.H, update.K, update.S_inverse, second)
            between[node, k] = vector.copy()
            for block in update.cut:
                vector[block], matrix[block], matrix[:, block] = 0.0, 0.0, 0.0
    lambdas[0] = vector
    return _errors(nav, nodes, passed, durations, lambdas, between), (P if second else None)


def _errors(nav, nodes, passed, durations, lambdas, between):
    """Errors at the nodes, from the start to the end: (m + 1, n)."""
    e = np.empty_like(lambdas)
    e[0] = passed.mean - passed.P @ lambdas[0]
    reached = 0
    for node in [*sorted(passed.updates), len(durations)]:
        what = nav.layout.at, nav.constants[1], *passed.intervals, durations
        _forth(*what, reached, node, lambdas, e)
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
def _forth(at, model, tops, jumps, noises, walks, durations, first, last, lambdas, e):
    """Errors from node `first` to `last`: e (m + 1, n), written."""
    for j in range(first, last):
        T, vector = durations[j], lambdas[j + 1]
        _carried(at, model[0], tops[j], e[j], T, e[j + 1])
        for i in range(e.shape[1]):
            e[j + 1, i] -= jumps[j, i]
        for i in range(TOP):
            for k in range(TOP):
                e[j + 1, i] -= noises[j, i, k] * vector[k]
        other_noise(at, model[0], walks[j], T, vector, e[j + 1])


@kernel
def _back(
    at, model, tops, durations, first, last, vector, matrix, lambdas, wide, whole, rows, ends, P, second
):
    """Adjoint from node `last` to `first`, in place; lambdas at the ends of the intervals are written.

    second : whether the matrix is wanted, and covariances at the nodes between
    """
    n = vector.shape[0]
    before, W, U = np.empty(n), np.empty((n, n)), np.empty((n, TOP))
    for j in range(last - 1, first - 1, -1):
        lambdas[j + 1] = vector
        top, T = tops[j], durations[j]
        _vector_back(at, model[0], top, T, vector, before)
        if second:
            _matrix_back(at, model[0], top, T, matrix, W, U)
            if j > first:
                _spread(j, matrix, wide, whole, rows, ends, P)


@inner
def _vector_back(at, model, top, T, vector, before):
    """lambda <- Phi^T lambda, in place."""
    n = vector.shape[0]
    for j in range(n):
        before[j] = vector[j] if j >= TOP else 0.0
    if at[CLOCK] >= 0:
        before[at[CLOCK] + 1] += T * vector[at[CLOCK]]
    _fade(at, model, T, before)
    for k in range(TOP):
        for j in range(n):
            before[j] += top[k, j] * vector[k]
    for j in range(n):
        vector[j] = before[j]


@inner(forceinline=True)
def _fade(at, model, T, row):
    """What is left of errors that fade, in place."""
    if at[RANGE_BIAS] >= 0:
        left = np.exp(-T / model.range_bias_time_s)
        for k in range(at[RANGE_BIAS], at[RANGE_BIAS] + SIZES[RANGE_BIAS]):
            row[k] *= left
    if at[GRAVITY] >= 0:
        left = np.exp(-T / FIELD_TIME_S)
        for k in range(at[GRAVITY], at[GRAVITY] + 3):
            row[k] *= left


@inner
def _matrix_back(at, model, top, T, matrix, W, U):
    """Lambda <- Phi^T Lambda Phi, in place, exactly symmetric.

    Phi is D = diag(I, what clock, range errors and gravity do) and behind it the first rows, I + M: with
    L = D^T Lambda D it is L + W + W^T, W = (L[:, :9] + M^T L[:9, :9]/2) M.
    """
    n = matrix.shape[0]
    c = at[CLOCK]
    if c >= 0:
        for i in range(n):
            matrix[i, c + 1] += T * matrix[i, c]
        for j in range(n):
            matrix[c + 1, j] += T * matrix[c, j]
    if at[RANGE_BIAS] >= 0 or at[GRAVITY] >= 0:
        for i in range(n):
            _fade(at, model, T, matrix[i])
        for j in range(n):
            _fade(at, model, T, matrix[:, j])
    for i in range(TOP):
        top[i, i] -= 1.0
    for i in range(n):
        for k in range(TOP):
            total = 0.0
            for j in range(TOP):
                total += top[j, i] * matrix[j, k]
            U[i, k] = matrix[i, k] + 0.5 * total
    for i in range(n):
        for j in range(n):
            W[i, j] = 0.0
        for k in range(TOP):
            factor = U[i, k]
            if factor != 0.0:
                for j in range(n):
                    W[i, j] += factor * top[k, j]
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = matrix[i, j] + (W[i, j] + W[j, i])
    for i in range(TOP):
        top[i, i] += 1.0


@kernel
def _spread(node, matrix, wide, whole, rows, ends, P):
    """P - P Lambda P of a node: of its first rows, and in `whole` of all, where they are kept."""
    if not ends[node]:
        return
    n = matrix.shape[0]
    row = np.empty(n)
    for i in range(TOP):
        _times(wide[node, i], matrix, row)
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += row[k] * wide[node, j, k]
            P[node, i, j] = P[node, j, i] = wide[node, i, j] - total
    if rows[node] < 0:
        return
    kept = whole[rows[node]]
    smoothed = np.empty((n, n))
    for i in range(n):
        _times(kept[i], matrix, row)
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += row[k] * kept[j, k]
            smoothed[i, j] = smoothed[j, i] = kept[i, j] - total
    for i in range(n):
        for j in range(n):
            kept[i, j] = smoothed[i, j]


@inner
def _times(vector, matrix, out):
    """vector^T matrix, written to out."""
    n = matrix.shape[0]
    for j in range(n):
        out[j] = 0.0
    for k in range(n):
        factor = vector[k]
        if factor != 0.0:
            for j in range(n):
                out[j] += factor * matrix[k, j]


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
