"""One step of a covariance, compiled: over an interval where few states are driven, and over a measurement.

The equations are those of `linear`; here they leave out what is zero. Symmetric matrices are given whole.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel


@kernel
def grown(P, X, Q, keeps, added):
    """Phi P Phi^T + Q where all but the first states depend on themselves alone.

    P : (n, n);  X : (a, n) the first a rows of Phi;  Q : (a, a) their noise
    keeps, added : (n - a,) diagonals of Phi and of Q of the others
    """
    n, a = P.shape[0], X.shape[0]
    Y, out = np.zeros((a, n)), np.empty((n, n))
    for i in range(a):
        for k in range(n):
            _add_multiple(Y[i], X[i, k], P[k])
    for i in range(a):
        for j in range(i + 1):
            total = 0.5 * (Q[i, j] + Q[j, i])
            for k in range(n):
                total += Y[i, k] * X[j, k]
            out[i, j], out[j, i] = total, total
        for j in range(a, n):
            total = Y[i, j] * keeps[j - a]
            out[i, j], out[j, i] = total, total
    for i in range(a, n):
        for j in range(a, n):
            out[i, j] = keeps[i - a] * keeps[j - a] * P[i, j]
        out[i, i] += added[i - a]
    return out


@kernel
def corrected(P, H, R):
    """P after a measurement, and its gain K = P H^T (H P H^T + R)^-1, in the form of Joseph.

    (n, n), (m, n), (m, m) -> (n, n), (n, m). ValueError if H P H^T + R is not positive definite.
    """
    n, m = P.shape[0], H.shape[0]
    HP, S, left, W = np.zeros((m, n)), R.copy(), P.copy(), np.zeros((n, m))
    seen = np.zeros(n, dtype=np.bool_)  # the states that the measurement depends on
    for a in range(m):
        for k in range(n):
            _add_multiple(HP[a], H[a, k], P[k])
            seen[k] = seen[k] or H[a, k] != 0.0
    for a in range(m):
        for b in range(m):
            for k in range(n):
                S[a, b] += HP[a, k] * H[b, k]
    K_T = HP.copy()
    _solve(S, K_T)
    for i in range(n):
        for a in range(m):
            _add_multiple(left[i], -K_T[a, i], HP[a])
    H_T = H.T.copy()
    for i in range(n):  # W = K R - (I - K H) P H^T, nothing but rounding for the best of gains
        for k in range(n):
            if seen[k]:
                _add_multiple(W[i], -left[i, k], H_T[k])
        for a in range(m):
            _add_multiple(W[i], K_T[a, i], R[a])
        for a in range(m):
            _add_multiple(left[i], W[i, a], K_T[a])
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (left[i, j] + left[j, i])
            left[i, j], left[j, i] = mean, mean
    return left, K_T.T.copy()


@inner
def _add_multiple(row, factor, other):
    """row += factor * other, in place; nothing at all if the factor is zero. (n,), float, (n,)"""
    if factor != 0.0:
        for j in range(row.shape[0]):
            row[j] += factor * other[j]


@inner
def _solve(S, B):
    """Write S^-1 B to B by Cholesky's factors, which are written to S. (m, m), (m, n)"""
    m = S.shape[0]
    for a in range(m):
        for b in range(a):
            for c in range(b):
                S[a, b] -= S[a, c] * S[b, c]
            S[a, b] /= S[b, b]
            S[a, a] -= S[a, b] ** 2
        if not S[a, a] > 0.0:
            raise ValueError("the covariance of a measurement is not positive definite")
        S[a, a] = np.sqrt(S[a, a])
    for a in range(m):
        for b in range(a):
            _add_multiple(B[a], -S[a, b], B[b])
        B[a] /= S[a, a]
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            _add_multiple(B[a], -S[b, a], B[b])
        B[a] /= S[a, a]
