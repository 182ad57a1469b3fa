"""What the IMU measures against what happens: its estimated errors taken out, and their Jacobians.

The model is written in `state`. With A = I + diag(scale) + misalignment (+ roll column) of a triad::

    dv = A_a^-1 (dv_m - b_a T),   dtheta = A_g^-1 (dtheta_m - b_g T - G dv)

so that an error of the estimates (truth = estimate (+) error) changes the corrected increments by

    d dv     = -A_a^-1 (db_a T + dA_a dv)
    d dtheta = -A_g^-1 (db_g T + dA_g dtheta + dG dv + G d dv).

Which column of these an error of a block is, `blocks.Drive` says. Blocks of instruments and plug-ins that
drive increments are biases with coefficients that are constant in a tick: `drive` (6, m), rad/s and m/s^2 per
unit of each of the last m errors; (6, 0) where none drives.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation.blocks import GYROS, SHAKEN, STATES
from shefex_nav.onboard.navigation.state import (
    BA,
    BG,
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

# of each error of `blocks.STATES` that drives increments: block, number in it, triad, weight, axis
DRIVERS = np.array([(k, n, *drive) for k, one in enumerate(STATES) for n, drive in enumerate(one.drives)])
NO_DRIVE = np.zeros((6, 0))


@inner(forceinline=True)
def _response(scale, misalignment, column):
    """I + diag(scale) + misalignment + column e_x^T: what a triad makes of its input, nine numbers."""
    return (
        1.0 + scale[0] + column[0], misalignment[0], misalignment[1],
        misalignment[2] + column[1], 1.0 + scale[1], misalignment[3],
        misalignment[4] + column[2], misalignment[5], 1.0 + scale[2],
    )  # fmt: skip


@inner(forceinline=True)
def triads(x):
    """A_g^-1, A_a^-1 and G [rad/s per m/s^2] of packed nominal values, nine numbers each."""
    A_g = _response(t3.vector(x, X_GS), t3.vector(x, X_GM) + t3.vector(x, X_GM + 3), t3.vector(x, X_ROLL))
    A_a = _response(t3.vector(x, X_AS), t3.vector(x, X_AM) + t3.vector(x, X_AM + 3), (0.0, 0.0, 0.0))
    G = t3.vector(x, X_GG) + t3.vector(x, X_GG + 3) + t3.vector(x, X_GG + 6)
    return t3.inverse(A_g), t3.inverse(A_a), G


@inner(forceinline=True)
def free_increment(x, inverses, increments, n, duration_s):
    """Sample n of (N, 6) increments free of the estimated sensor errors; inverses : of `triads`

    -> dtheta_b (3,) rad, dv_b (3,) m/s
    """
    M, A, G = inverses
    dv = t3.rotated(A, t3.plus(t3.vector(increments[n], 3), -duration_s, t3.vector(x, X_BA)))
    w = t3.plus(t3.vector(increments[n], 0), -duration_s, t3.vector(x, X_BG))
    return t3.rotated(M, t3.plus(w, -1.0, t3.rotated(G, dv))), dv


@inner
def correct_increments(x, increments, duration_s):
    """Increments free of the estimated sensor errors.

    x : (n,) packed nominal values
    increments : (N, 6) rad, m/s as measured, each over duration_s -> (N, 6)
    """
    inverses = triads(x)
    out = np.empty(increments.shape)
    for n in range(increments.shape[0]):
        dtheta, dv = free_increment(x, inverses, increments, n, duration_s)
        t3.put(out[n], dtheta)
        t3.put(out[n, 3:], dv)
    return out


@inner
def acting(x, vibration, drive):
    """The packed values with the biases of gyros and accelerometers as they act in a tick.

    (X,), level of vibration, (6, m) -> (X,)
    """
    out, m = x.copy(), drive.shape[1]
    for i in range(3):
        out[X_BA + i] += vibration**2 * x[X_RECTIFIED + i]
    for k in range(m):
        value = x[x.shape[0] - m + k]
        for i in range(3):
            out[X_BG + i] += drive[i, k] * value
            out[X_BA + i] += drive[3 + i, k] * value
    return out


def jacobians(layout, x, omega_b, f_b, vibration, drive=NO_DRIVE):
    """How the corrected rate and specific force move with the errors of the estimates.

    truth = estimate (+) dx:   omega_ib_b(true) - omega_ib_b(estimated) = J_omega dx, likewise f_b

    Parameters
    ----------
    layout : Layout
    x : (X,) packed nominal values
    omega_b, f_b : (3,) rad/s, m/s^2, corrected
    vibration, drive : of the tick

    Returns
    -------
    J_omega, J_f : (3, n)
    """
    omega_b, f_b = np.ascontiguousarray(omega_b), np.ascontiguousarray(f_b)
    return jacobians_packed(layout.at, layout.n, x, omega_b, f_b, vibration, drive)


@kernel
def jacobians_packed(at, n, x, omega_b, f_b, vibration, drive):
    """`jacobians` with the fields of the Layout and the packed nominal values."""
    M, A, G = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    inverses = triads(x)
    t3.store(M, inverses[0])
    t3.store(A, inverses[1])
    t3.store(G, inverses[2])
    weights = 1.0, omega_b[0], omega_b[1], omega_b[2], f_b[0], f_b[1], f_b[2]
    J_omega, J_f = np.zeros((3, n)), np.zeros((3, n))
    for i in range(3):
        J_omega[:, BG.start + i] = -M[:, i]
        J_f[:, BA.start + i] = -A[:, i]
    for row in range(DRIVERS.shape[0]):
        block, number, triad, weight, axis = DRIVERS[row]
        if at[block] < 0:
            continue
        if triad == GYROS:
            J_omega[:, at[block] + number] = -weights[weight] * M[:, axis]
        else:
            size = vibration**2 if triad == SHAKEN else weights[weight]
            J_f[:, at[block] + number] = -size * A[:, axis]
    m = drive.shape[1]
    for k in range(m):
        for i in range(3):
            J_omega[:, n - m + k] -= drive[i, k] * M[:, i]
            J_f[:, n - m + k] -= drive[3 + i, k] * A[:, i]
    if G.any():
        J_omega -= M @ G @ J_f
    return J_omega, J_f
