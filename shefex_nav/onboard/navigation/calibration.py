"""What the IMU measures against what happens: its estimated errors taken out, and their Jacobians.

The model is written in `state`. With A = I + diag(scale) + misalignment (+ roll column) of a triad::

    dv = A_a^-1 (dv_m - b_a T),   dtheta = A_g^-1 (dtheta_m - b_g T - G dv)

so that an error of the estimates (truth = estimate (+) error) changes the corrected increments by

    d dv     = -A_a^-1 (db_a T + dA_a dv)
    d dtheta = -A_g^-1 (db_g T + dA_g dtheta + dG dv + G d dv).
"""

import numpy as np
from numba import njit

from shefex_nav.onboard.navigation.state import (
    A_MISALIGN,
    A_SCALE,
    BA,
    BG,
    G_MISALIGN,
    G_SCALE,
    G_SENSE,
    ROLL_COLUMN,
    X_AM,
    X_AS,
    X_BA,
    X_BG,
    X_GG,
    X_GM,
    X_GS,
    X_ROLL,
    pack,
)

OFF_DIAGONAL = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # order of misalignments


@njit(cache=True)
def _inverse(A):
    """Inverse of a (3, 3) matrix by its cofactors; the library's costs several times as much."""
    out = np.empty((3, 3))
    out[0, 0] = A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1]
    out[0, 1] = A[0, 2] * A[2, 1] - A[0, 1] * A[2, 2]
    out[0, 2] = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    out[1, 0] = A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2]
    out[1, 1] = A[0, 0] * A[2, 2] - A[0, 2] * A[2, 0]
    out[1, 2] = A[0, 2] * A[1, 0] - A[0, 0] * A[1, 2]
    out[2, 0] = A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0]
    out[2, 1] = A[0, 1] * A[2, 0] - A[0, 0] * A[2, 1]
    out[2, 2] = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    out /= A[0, 0] * out[0, 0] + A[0, 1] * out[1, 0] + A[0, 2] * out[2, 0]
    return out


@njit(cache=True)
def gyro_inverse(x):
    """A_g^-1 of packed nominal values: (3, 3)."""
    A = np.zeros((3, 3))
    for i in range(3):
        A[i, i] = 1.0 + x[X_GS + i]
    for k, (i, j) in enumerate(OFF_DIAGONAL):
        A[i, j] = x[X_GM + k]
    for i in range(3):
        A[i, 0] += x[X_ROLL + i]
    return _inverse(A)


@njit(cache=True)
def accel_inverse(x):
    """A_a^-1 of packed nominal values: (3, 3)."""
    A = np.zeros((3, 3))
    for i in range(3):
        A[i, i] = 1.0 + x[X_AS + i]
    for k, (i, j) in enumerate(OFF_DIAGONAL):
        A[i, j] = x[X_AM + k]
    return _inverse(A)


@njit(cache=True)
def g_sensitivity(x):
    """G of packed nominal values: (3, 3) rad/s per m/s^2."""
    return x[X_GG : X_GG + 9].copy().reshape(3, 3)


@njit(cache=True)
def correct_increments(x, increments, duration_s):
    """Increments free of the estimated sensor errors.

    x : (87,) packed nominal values
    increments : (N, 6) rad, m/s as measured, each over duration_s -> (N, 6)
    """
    M, A, G = gyro_inverse(x), accel_inverse(x), g_sensitivity(x)
    out = np.empty(increments.shape)
    w = np.empty(6)
    for n in range(increments.shape[0]):
        for j in range(3):
            w[3 + j] = increments[n, 3 + j] - x[X_BA + j] * duration_s
        for i in range(3):
            out[n, 3 + i] = A[i, 0] * w[3] + A[i, 1] * w[4] + A[i, 2] * w[5]
        for i in range(3):
            w[i] = increments[n, i] - x[X_BG + i] * duration_s
            for j in range(3):
                w[i] -= G[i, j] * out[n, 3 + j]
        for i in range(3):
            out[n, i] = M[i, 0] * w[0] + M[i, 1] * w[1] + M[i, 2] * w[2]
    return out


def motion(state, increments, duration_s):
    """Mean rate and specific force of increments summed over a duration, estimated errors taken out.

    NavState, (6,) rad and m/s, s -> omega_ib_b (3,) rad/s, f_b (3,) m/s^2
    """
    free = correct_increments(pack(state), np.reshape(increments, (1, 6)), duration_s)[0] / duration_s
    return free[:3], free[3:]


def jacobians(layout, state, omega_b, f_b):
    """How the corrected rate and specific force move with the errors of the estimates.

    truth = estimate (+) dx:   omega_ib_b(true) - omega_ib_b(estimated) = J_omega dx, likewise f_b

    Parameters
    ----------
    layout : Layout
    state : NavState
    omega_b, f_b : (3,) rad/s, m/s^2, corrected

    Returns
    -------
    J_omega, J_f : (3, n)
    """
    return jacobians_packed(
        layout.at, layout.n, pack(state), np.ascontiguousarray(omega_b), np.ascontiguousarray(f_b)
    )


@njit(cache=True)
def jacobians_packed(at, n, x, omega_b, f_b):
    """`jacobians` with the fields of the Layout and the packed nominal values."""
    M, A, G = gyro_inverse(x), accel_inverse(x), g_sensitivity(x)
    J_omega, J_f = np.zeros((3, n)), np.zeros((3, n))
    for i in range(3):
        J_omega[:, BG.start + i] = -M[:, i]
        J_f[:, BA.start + i] = -A[:, i]
        if at[ROLL_COLUMN] >= 0:
            J_omega[:, at[ROLL_COLUMN] + i] = -omega_b[0] * M[:, i]
        if at[G_SCALE] >= 0:
            J_omega[:, at[G_SCALE] + i] = -omega_b[i] * M[:, i]
        if at[A_SCALE] >= 0:
            J_f[:, at[A_SCALE] + i] = -f_b[i] * A[:, i]
        if at[G_SENSE] >= 0:
            for j in range(3):
                J_omega[:, at[G_SENSE] + 3 * i + j] = -f_b[j] * M[:, i]
    for k, (i, j) in enumerate(OFF_DIAGONAL):
        if at[G_MISALIGN] >= 0:
            J_omega[:, at[G_MISALIGN] + k] = -omega_b[j] * M[:, i]
        if at[A_MISALIGN] >= 0:
            J_f[:, at[A_MISALIGN] + k] = -f_b[j] * A[:, i]
    J_omega -= M @ G @ J_f
    return J_omega, J_f
