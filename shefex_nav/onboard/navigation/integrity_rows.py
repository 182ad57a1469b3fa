"""Measurements of several groups of rows, one a satellite or star: which pass, and what the worst may do.

All groups share the errors of the state: where clock or position are hardly known each alone is as far off as
those allow, and a group by itself may be wrong by as much without showing. Against what the others say it is
not. With Y = S^-1 and y = Y z, group g is off by

    Y_gg^-1 y_g = z_g - (what the others say of it),     of the covariance Y_gg^-1,

and without it the normalised innovation squared z^T Y z is less by t_g = y_g^T Y_gg^-1 y_g: of a healthy
group chi-square with as many degrees of freedom as it has rows (Baarda 1968). A measurement passes if t_g of
each group and z^T Y z of all are below their limits; else the group of the largest t_g is left out, until it
passes or half are gone: where half of all satellites contradict the filter, it is not for the filter to say
which half is right.

What a group that passes has done to the state, against what the others alone would have, is K_g Y_gg^-1 y_g
(K_g its columns of the gain), so along axis j at most, T^2 being the limit of t_g,

    w_j = T sqrt((K_g Y_gg^-1 K_g^T)_jj) = T sqrt(P_jj(after, without g) - P_jj(after)),

of one row T |K_jk| / sqrt(Y_kk): the slope of receiver autonomous integrity monitoring.
"""

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.onboard.navigation import protected
from shefex_nav.onboard.navigation.protected import N_FOLLOWED
from shefex_nav.onboard.navigation.state import ATT, POS, VEL


def passed(limits, S, z, size):
    """Which rows pass the gate, in groups of `size`. -> rows, whether most do

    limits : integrity.Limits;  S : (m, m);  z : (m,)
    rows : (m,) bool; None if all pass, or not most of them
    """
    kept = np.isfinite(z + np.diag(S)).reshape(-1, size).all(axis=1)
    while 2 * np.count_nonzero(kept) > len(kept):
        rows = np.repeat(kept, size)
        nis, each = given_others(S[np.ix_(rows, rows)], z[rows], size)
        if nis <= limits[int(rows.sum())] and np.all(each <= limits[size]):
            return (None if kept.all() else rows), True
        kept[np.flatnonzero(kept)[np.argmax(each)]] = False
    return None, False


def given_others(S, z, size):
    """z^T S^-1 z, and what it is less by without each group of `size` rows: float, (groups,)"""
    m = len(z)
    solved = np.linalg.solve(S, np.column_stack([z, np.eye(m)]))
    y, each = solved[:, 0], np.arange(m // size)
    Y_gg = solved[:, 1:].reshape(len(each), size, len(each), size)[each, :, each, :]
    y_g = y.reshape(len(each), size)
    less = np.sum(y_g * np.linalg.solve(Y_gg, y_g[:, :, None])[:, :, 0], axis=1)
    return float(z @ y), less


@inner
def worst_of(P, H, R, limit, size, axes, worst):
    """What the worst group of `size` rows can do along the axes of `protected`: worst (9,) is written.

    P : (n, n) before the rows H (m, n), R (m, m) that are used;  limit : of t_g, chi-square
    """
    g = np.empty((6, 6))
    protected.gradients(axes, g)
    PH = P @ H.T
    S = H @ PH + R
    Y = np.linalg.inv(S)
    seen = np.empty((N_FOLLOWED, H.shape[0]))
    seen[:6] = g @ np.ascontiguousarray(PH[POS.start : VEL.stop])
    seen[6:] = PH[ATT.start : ATT.stop]
    K = np.linalg.solve(S, seen.T.copy()).T  # not by Y: a state that was forgotten is some 1e10 times R
    worst[:] = 0.0
    for first in range(0, H.shape[0], size):
        K_g = np.ascontiguousarray(K[:, first : first + size])
        Y_gg = np.ascontiguousarray(Y[first : first + size, first : first + size])
        X = np.linalg.solve(Y_gg, np.ascontiguousarray(K_g.T))
        for i in range(N_FOLLOWED):
            variance = 0.0
            for k in range(size):
                variance += K_g[i, k] * X[k, i]
            worst[i] = max(worst[i], np.sqrt(limit * max(variance, 0.0)))
