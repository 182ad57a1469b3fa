"""The strapdown written down slowly, straight from its equations, as reference for the kernels."""

import numpy as np
from scipy.spatial.transform import Rotation

from shefex_nav.environment.gravity import gravity_j2_e
from shefex_nav.geometry import frames


def triad(scale, misalignment, column=(0.0, 0.0, 0.0)):
    """I + diag(scale) + misalignment + column e_x^T."""
    A = np.eye(3) + np.diag(scale)
    A[~np.eye(3, dtype=bool)] += misalignment  # xy, xz, yx, yz, zx, zy
    A[:, 0] += column
    return A


def free(state, imu):
    """Corrected increments of a window, the two samples before it too: (2 + n, 3) rad, (2 + n, 3) m/s."""
    A_g = triad(state.gyro_scale, state.gyro_misalignment, state.gyro_roll_column)
    A_a = triad(state.accel_scale, state.accel_misalignment)
    G, h = state.gyro_g_sensitivity.reshape(3, 3), imu.dt_s
    bias = state.accel_bias + imu.vibration**2 * state.accel_rectification
    dv = np.linalg.solve(A_a, (imu.increments[:, 3:] - h * bias).T).T
    turned = imu.increments[:, :3] - h * state.gyro_bias - dv @ G.T
    return np.linalg.solve(A_g, turned.T).T, dv


def propagate(state, imu, begin_s, end_s, earth):
    """Position, velocity and attitude (3, 3) at end_s, from begin_s, under J2 in the middle between them."""
    dtheta, dv = free(state, imu)
    h, r, v = imu.dt_s, state.r_i, state.v_i
    C_ib = Rotation.from_quat(state.q_ib, scalar_first=True).as_matrix()
    C_ie = frames.dcm_ie(earth, state.t_s + 0.5 * (end_s - begin_s))
    g = C_ie @ gravity_j2_e(C_ie.T @ (r + 0.5 * (end_s - begin_s) * v)) + state.gravity
    for k in range(imu.n):
        x0, x1 = np.clip([begin_s / h - k, end_s / h - k], 0.0, 1.0)
        if x1 <= x0:
            continue
        T, middle = (x1 - x0) * h, 0.5 * (x0 + x1 - 1.0) * h
        parts = []
        for samples in (dtheta, dv):
            last, before, now = samples[k : k + 3]
            slope = (1.5 * now - 2.0 * before + 0.5 * last) / h**2  # of the parabola, in the middle of `now`
            parts.append((now / h, slope, T * (now / h + middle * slope)))
        (A, B, angle), (a, b, gain) = parts
        phi = angle + T**3 / 12.0 * np.cross(A, B)
        cross = T**3 / 12.0 * (np.cross(A, b) + np.cross(a, B))
        s = mean_rotation(angle) @ gain + cross
        s_r = 0.5 * T * gain - T**3 / 12.0 * b + T / 6.0 * np.cross(angle, gain)
        r = r + T * v + C_ib @ s_r + 0.5 * T**2 * g
        v = v + C_ib @ s + T * g
        C_ib = C_ib @ Rotation.from_rotvec(phi).as_matrix()
    return r, v, C_ib


def mean_rotation(angle):
    """1/T times the integral of exp(skew(angle t/T)) over T, by quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    turns = Rotation.from_rotvec(np.outer(0.5 + 0.5 * nodes, angle)).as_matrix()
    return np.einsum("k,kij->ij", 0.5 * weights, turns)
