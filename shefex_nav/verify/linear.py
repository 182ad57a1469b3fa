"""Errors as a linear Gaussian process: their covariance, and histories drawn from it.

In: intervals (Phi, Q) and updates (H, R) in the order of their instants, each update with the instant at
which it reaches the computer. Out: at given times the covariance of what is known then, and errors drawn at
random that obey the same matrices and gains::

    e <- Phi e + w,   w ~ N(0, Q)
    e <- e - K z,     z = H e + v,   v ~ N(0, R),   K = P H^T (H P H^T + R)^-1

truth = estimate (+) error. A measurement that is still on its way is left out of what is known, and taken at
its own instant as soon as it is there: two lanes, one up to the last instant that is settled, and from there
one to the time that is asked for. The compiled steps leave out what is zero and give symmetric matrices
whole.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
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


class Interval(NamedTuple):
    """Growth of the errors up to t_s."""

    t_s: float  # end
    Phi: np.ndarray  # (n, n)
    Q: np.ndarray  # (n, n)


class DrivenInterval(NamedTuple):
    """Growth of the errors up to t_s where all but the first a of them depend on themselves alone."""

    t_s: float  # end
    X: np.ndarray  # (a, n) the first rows of Phi
    Q_first: np.ndarray  # (a, a) their noise
    keeps: np.ndarray  # (n - a,) diagonal of Phi of the others
    added: np.ndarray  # (n - a,) diagonal of their noise

    @property
    def Phi(self):
        """(n, n)"""
        Phi = np.diag(np.concatenate([np.zeros(len(self.X)), self.keeps]))
        Phi[: len(self.X)] = self.X
        return Phi

    @property
    def Q(self):
        """(n, n)"""
        Q = np.diag(np.concatenate([np.zeros(len(self.X)), self.added]))
        Q[: len(self.X), : len(self.X)] = self.Q_first
        return Q


class Update(NamedTuple):
    """A measurement valid at t_s."""

    t_s: float
    available_s: float
    sensor: str
    H: np.ndarray  # (m, n)
    R: np.ndarray  # (m, m)


class Output(NamedTuple):
    """What is known at one time, and the errors then."""

    t_s: float
    P: np.ndarray  # (n, n)
    errors: np.ndarray  # (n, number of histories); (n, 0) without them


class Share(NamedTuple):
    """A part of what is drawn: by linearity histories are sums of those of the parts."""

    states: np.ndarray  # (n,) 1: errors of which start and process noise are drawn, 0: others
    measured: bool  # whether the noise of measurements is


class _Drawn(NamedTuple):
    """Random numbers of the steps that are not settled: step -> (., number of histories)."""

    rng: object
    number: int
    kept: dict
    share: Share | None

    def noise(self, k, step, *, last):
        """Noise of step k: the same until it is asked for the last time."""
        if k not in self.kept:
            root = _root(step)
            self.kept[k] = root @ self.rng.standard_normal((root.shape[1], self.number))
        return self.kept.pop(k) if last else self.kept[k]

    def process(self, k, step, *, last):
        """The same, of an interval."""
        noise = self.noise(k, step, last=last)
        return noise if self.share is None else self.share.states[:, None] * noise

    def measured(self, k, step, *, last):
        """The same, of a measurement."""
        noise = self.noise(k, step, last=last)
        return noise if self.share is None or self.share.measured else 0.0 * noise


def outputs(P, steps, times_s, *, rng=None, number=0, share=None, between=(-np.inf, np.inf)):
    """Follow the errors through the steps.

    Parameters
    ----------
    P : (n, n) at the start
    steps : sequence of Interval, DrivenInterval and Update, in order of t_s
    times_s : increasing; each the end of an interval
    rng : Generator, with `number` > 0
    number : of histories
    share : Share that the histories are drawn of; None: all
    between : times from which and until which there are histories; they begin with the covariance of then

    Yields
    ------
    Output, one for each time
    """
    drawn, errors = _Drawn(rng, 0, {}, share), np.zeros((len(P), 0))
    settled = 0
    for t_s in times_s:
        wanted = number if between[0] - SAME_S <= t_s <= between[1] + SAME_S else 0
        if wanted != drawn.number:
            drawn, errors = drawn._replace(number=wanted, kept={}), _begun(P, rng, wanted, share)
        while settled < len(steps) and _known_s(steps[settled]) <= t_s + SAME_S:
            P, errors = _take(P, errors, steps[settled], settled, drawn, last=True)
            settled += 1
        P_now, errors_now, k = P, errors, settled
        while k < len(steps) and steps[k].t_s <= t_s + SAME_S:
            if _known_s(steps[k]) <= t_s + SAME_S:
                P_now, errors_now = _take(P_now, errors_now, steps[k], k, drawn, last=False)
            k += 1
        yield Output(t_s, P_now, errors_now)


def _begun(P, rng, number, share):
    """Errors of a covariance, (n, number)."""
    if not number:
        return np.zeros((len(P), 0))
    errors = square_root(P) @ rng.standard_normal((len(P), number))
    return errors if share is None else share.states[:, None] * errors


def _known_s(step):
    """When a step can be taken."""
    return step.available_s if isinstance(step, Update) else step.t_s


def _take(P, errors, step, k, drawn, *, last):
    """P and errors after a step."""
    if isinstance(step, Update):
        P, K = corrected(P, *map(np.ascontiguousarray, (step.H, step.R)))
        if drawn.number:
            errors = errors - K @ (step.H @ errors + drawn.measured(k, step, last=last))
        return P, errors
    if drawn.number:
        errors = _grown(step, errors) + drawn.process(k, step, last=last)
    if isinstance(step, DrivenInterval):
        return grown(P, *step[1:]), errors
    P = step.Phi @ P @ step.Phi.T + step.Q
    return 0.5 * (P + P.T), errors


def _grown(step, errors):
    """Phi e of an interval. (n, number)"""
    if isinstance(step, DrivenInterval):
        return np.vstack([step.X @ errors, step.keeps[:, None] * errors[len(step.X) :]])
    return step.Phi @ errors


def _root(step):
    """(n, r) matrix A with A A^T = Q of an interval, R of a measurement."""
    if isinstance(step, Update):
        return square_root(step.R)
    if isinstance(step, Interval):
        return square_root(step.Q)
    a, wander = len(step.X), np.flatnonzero(step.added)
    root = np.zeros((a + len(step.added), a + len(wander)))
    root[:a, :a] = square_root(step.Q_first)
    root[a + wander, a + np.arange(len(wander))] = np.sqrt(step.added[wander])
    return root


def square_root(P):
    """A with A A^T = P of a covariance that may be singular. (n, n) -> (n, n)

    Scaled to correlations first: metres and radians in one matrix. What does not vary gets nothing at all:
    the rounding of an eigenvalue, 1e-17, is as large as the square of what is known of a scale factor.
    """
    sigma = np.sqrt(np.diag(P))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(scale, scale))
    if values[0] < -1e-6:
        raise ValueError(f"not a covariance: eigenvalue {values[0]:.1e} of the correlations")
    return sigma[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
