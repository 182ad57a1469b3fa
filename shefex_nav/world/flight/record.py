"""The rows that the integration writes, as columns of the record: in one pass, for they fill no cache."""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.world.flight.dynamics import STATE


class Record(NamedTuple):
    """Arrays over N samples, named as in `records.Trajectory`."""

    r_i: np.ndarray  # (N, 3), as the next ones but q_ib
    v_i: np.ndarray
    q_ib: np.ndarray  # (N, 4)
    omega_ib_b: np.ndarray
    f_b: np.ndarray
    dtheta_b: np.ndarray
    dv_b: np.ndarray
    air: np.ndarray  # (6, N), the last numbers of a row: mass, Mach number, dynamic pressure, thrust, height,
    # total angle of attack


@kernel
def split(rows):
    """Record of rows (N, `dynamics.ROW`)."""
    n = rows.shape[0]
    r_i, v_i, q_ib, omega_b = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 4)), np.empty((n, 3))
    f_b, dtheta_b, dv_b, air = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((6, n))
    for k in range(n):
        for j in range(3):
            r_i[k, j], v_i[k, j], omega_b[k, j] = rows[k, j], rows[k, 3 + j], rows[k, 10 + j]
            dtheta_b[k, j], dv_b[k, j], f_b[k, j] = rows[k, 13 + j], rows[k, 16 + j], rows[k, STATE + j]
        for j in range(4):
            q_ib[k, j] = rows[k, 6 + j]
        for j in range(6):
            air[j, k] = rows[k, STATE + 3 + j]
    return Record(r_i, v_i, q_ib, omega_b, f_b, dtheta_b, dv_b, air)
