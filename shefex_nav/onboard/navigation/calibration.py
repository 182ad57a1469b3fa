"""What the IMU measures against what happens: its estimated errors taken out, and their Jacobians.

The model is written in `state`. With A = I + diag(scale) + misalignment (+ roll column) of a triad::

    dv = A_a^-1 (dv_m - b_a T),   dtheta = A_g^-1 (dtheta_m - b_g T - G dv)

so that an error of the estimates (truth = estimate (+) error) changes the corrected increments by

    d dv     = -A_a^-1 (db_a T + dA_a dv)
    d dtheta = -A_g^-1 (db_g T + dA_g dtheta + dG dv + G d dv).
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation.state import (
    A_MISALIGN,
    A_RECTIFIED,
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
    X_RECTIFIED,
    X_ROLL,
)

OFF_DIAGONAL = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # order of misalignments


@inner(forceinline=True)
def _response(scale, misalignment, column):
    """I + diag(scale) + misalignment + column e_x^T: what a triad makes of its input, nine numbers."""
    return (
        1.0 + scale[0] + column[0], misalignment[0], misalignment[1],
        misalignment[2] + column[1], 1.0 + scale[1], misalignment[3],
        misalignment[4] + column[2], misalignment[5], 1.0 + scale[2],
    )  # fmt: skip


@inner(forceinline=True)
def gyro_inverse(x):
    """A_g^-1 of packed nominal values, as nine numbers."""
    k = X_GM
    misalignment = x[k], x[k + 1], x[k + 2], x[k + 3], x[k + 4], x[k + 5]
    return t3.inverse(_response(t3.vector(x, X_GS), misalignment, t3.vector(x, X_ROLL)))


@inner(forceinline=True)
def accel_inverse(x):
    """A_a^-1 of packed nominal values, as nine numbers."""
    k = X_AM
    misalignment = x[k], x[k + 1], x[k + 2], x[k + 3], x[k + 4], x[k + 5]
    return t3.inverse(_response(t3.vector(x, X_AS), misalignment, (0.0, 0.0, 0.0)))


@inner(forceinline=True)
def g_sensitivity(x):
    """G of packed nominal values, rad/s per m/s^2, as nine numbers."""
    k = X_GG
    return x[k], x[k + 1], x[k + 2], x[k + 3], x[k + 4], x[k + 5], x[k + 6], x[k + 7], x[k + 8]


@inner(forceinline=True)
def free_increment(x, M, A, G, increments, n, duration_s):
    """Sample n of (N, 6) increments free of the estimated sensor errors; M, A, G as nine numbers.

    -> dtheta_b (3,) rad, dv_b (3,) m/s
    """
    dv = t3.turned(A, t3.plus(t3.vector(increments[n], 3), -duration_s, t3.vector(x, X_BA)))
    w = t3.plus(t3.vector(increments[n], 0), -duration_s, t3.vector(x, X_BG))
    return t3.turned(M, t3.plus(w, -1.0, t3.turned(G, dv))), dv


@kernel
def correct_increments(x, increments, duration_s):
    """Increments free of the estimated sensor errors.

    x : (n,) packed nominal values
    increments : (N, 6) rad, m/s as measured, each over duration_s -> (N, 6)
    """
    M, A, G = gyro_inverse(x), accel_inverse(x), g_sensitivity(x)
    out = np.empty(increments.shape)
    for n in range(increments.shape[0]):
        dtheta, dv = free_increment(x, M, A, G, increments, n, duration_s)
        out[n, 0], out[n, 1], out[n, 2] = dtheta
        out[n, 3], out[n, 4], out[n, 5] = dv
    return out


@kernel
def shaken(x, vibration):
    """The packed values with the accelerometer bias as it is under a level of vibration. (X,), float"""
    out = x.copy()
    for i in range(3):
        out[X_BA + i] += vibration**2 * x[X_RECTIFIED + i]
    return out


def motion(x, increments, duration_s, vibration):
    """Mean rate and specific force of increments summed over a duration, estimated errors taken out.

    (X,) packed nominal values, (6,) rad and m/s, s, level of vibration
    -> omega_ib_b (3,) rad/s, f_b (3,) m/s^2
    """
    free = (
        correct_increments(shaken(x, vibration), np.reshape(increments, (1, 6)), duration_s)[0] / duration_s
    )
    return free[:3], free[3:]


def jacobians(layout, x, omega_b, f_b, vibration):
    """How the corrected rate and specific force move with the errors of the estimates.

    truth = estimate (+) dx:   omega_ib_b(true) - omega_ib_b(estimated) = J_omega dx, likewise f_b

    Parameters
    ----------
    layout : Layout
    x : (X,) packed nominal values
    omega_b, f_b : (3,) rad/s, m/s^2, corrected
    vibration : level at that time

    Returns
    -------
    J_omega, J_f : (3, n)
    """
    omega_b, f_b = np.ascontiguousarray(omega_b), np.ascontiguousarray(f_b)
    return jacobians_packed(layout.at, layout.n, x, omega_b, f_b, vibration)


@kernel
def jacobians_packed(at, n, x, omega_b, f_b, vibration):
    """`jacobians` with the fields of the Layout and the packed nominal values."""
    M, A, G = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    t3.store(M, gyro_inverse(x))
    t3.store(A, accel_inverse(x))
    t3.store(G, g_sensitivity(x))
    J_omega, J_f = np.zeros((3, n)), np.zeros((3, n))
    for i in range(3):
        J_omega[:, BG.start + i] = -M[:, i]
        J_f[:, BA.start + i] = -A[:, i]
        if at[ROLL_COLUMN] >= 0:
            J_omega[:, at[ROLL_COLUMN] + i] = -omega_b[0] * M[:, i]
        if at[G_SCALE] >= 0:
            J_omega[:, at[G_SCALE] + i] = -omega_b[i] * M[:, i]
        if at[A_RECTIFIED] >= 0:
            J_f[:, at[A_RECTIFIED] + i] = -(vibration**2) * A[:, i]
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
