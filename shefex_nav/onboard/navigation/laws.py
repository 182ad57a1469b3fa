"""How errors change by themselves: clock of the receiver, what fades, and the laws of blocks from outside.

Each in the nominal values, in the covariance, and as the smoother needs it.
"""

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.onboard.navigation.blocks import STATES
from shefex_nav.onboard.navigation.state import GRAVITY, NOMINAL, RANGE_BIAS, X_CLOCK

# Memory of what J2 leaves out of gravity, along a flight. Over 800 km anywhere on the Earth the rest of EGM96
# (degree 12) changes by as much as a Gauss-Markov process with a correlation length of 4900 km: 3000 s
# at 1.6 km/s over the ground. It is smoother than such a process: over less it changes even less.
FIELD_TIME_S = 3000.0
SIZES = np.array([state.size for state in STATES])
STARTS = np.array([NOMINAL[state.name].start for state in STATES])  # of packed values
TERMS = 8  # of the series of exp(F T): with |F| T below `SLOW` the rest is below 1e-12
SLOW = 0.1 + 1e-9  # rows of |F| T: a tick of 10 ms and the fastest law that a plug-in may have


@inner(forceinline=True)
def fading(model):
    """Blocks of first-order Gauss-Markov processes: index in Layout.at, time [s] and sigma in the long run.

    model : row of a `record`
    """
    return (
        (RANGE_BIAS, model.range_bias_time_s, model.range_bias_sigma),
        (GRAVITY, FIELD_TIME_S, model.gravity_error),
    )


@inner(forceinline=True)
def drift(x, model, F, T):
    """Packed values of what changes by itself, clock, what fades and what has a law, after T, in place."""
    x[X_CLOCK] += T * x[X_CLOCK + 1]
    for block, time_s, _ in fading(model):
        x[STARTS[block] : STARTS[block] + SIZES[block]] *= np.exp(-T / time_s)
    if F.shape[0] > 0:
        last = x.shape[0] - F.shape[0]
        x[last:] = transition(F, T) @ x[last:]


@inner
def clock(P, c, white, walk, T):
    """The rows and columns of the receiver's clock, bias at c and drift behind it, after T, in place.

    White frequency noise of density a^2 = `white` and a random walk of frequency of density b^2 = `walk` give
    its bias a^2 T + b^2 T^3/3, its drift b^2 T, the two together b^2 T^2/2 (Brown & Hwang, Introduction to
    Random Signals and Applied Kalman Filtering, 4th ed., section 9.3).
    """
    n = P.shape[0]
    for j in range(n):
        P[c, j] += T * P[c + 1, j]
    for j in range(n):
        P[j, c] += T * P[j, c + 1]
    P[c, c] += white * T + walk * T**3 / 3.0
    P[c, c + 1] += walk * T**2 / 2.0
    P[c + 1, c] = P[c, c + 1]
    P[c + 1, c + 1] += walk * T


@inner
def wander(P, first, size, left, sigma):
    """Rows and columns of a first-order Gauss-Markov process of which a part `left` is left, in place."""
    for i in range(first, first + size):
        for j in range(P.shape[0]):
            P[i, j] *= left
        for j in range(P.shape[0]):
            P[j, i] *= left
        P[i, i] += sigma**2 * (1.0 - left * left)


@inner(forceinline=True)
def grow(P, walks, F, T):
    """Rows and columns of the last errors, those from outside, after T, in place.

    Their noise by the trapezoidal rule, T/2 (Phi W Phi^T + W), W the densities, over short parts of T.
    """
    m, n = walks.shape[0], P.shape[0]
    if F.shape[0] == 0:
        for k in range(m):
            P[n - m + k, n - m + k] += walks[k] * T
        return
    Phi = transition(F, T)
    rows = Phi @ P[n - m :]
    P[n - m :] = rows
    P[:, n - m :] = rows.T
    own = np.ascontiguousarray(rows[:, n - m :]) @ Phi.T + law_noise(F, walks, T)
    P[n - m :, n - m :] = 0.5 * (own + own.T)


@inner
def law_noise(F, walks, T):
    """Covariance that walks of errors with a law have brought in after T. (m, m) 1/s, (m,), s -> (m, m)"""
    parts, n = _halved(F, T)
    Phi = _series(F, parts)
    Q = 0.5 * parts * ((Phi * walks) @ Phi.T + np.diag(walks))
    for _ in range(n):
        Q = Phi @ Q @ Phi.T + Q
        Phi = Phi @ Phi
    return Q


@inner
def transition(F, T):
    """exp(F T). (m, m) 1/s, s -> (m, m)"""
    parts, n = _halved(F, T)
    Phi = _series(F, parts)
    for _ in range(n):
        Phi = Phi @ Phi
    return Phi


@inner
def _halved(F, T):
    """T halved as often as it takes until the law is slow against it: s, number of times."""
    most, n = SLOW / max(np.abs(F).sum(axis=1).max(), 1e-300), 0
    while T > most:
        T, n = 0.5 * T, n + 1
    return T, n


@inner
def _series(F, T):
    """exp(F T) by its series, for times against which F is slow."""
    m = F.shape[0]
    Phi, term = np.eye(m), np.eye(m)
    for k in range(1, TERMS):
        term = term @ F * (T / k)
        Phi += term
    return Phi
