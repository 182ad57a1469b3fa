"""How the camera moves during an exposure.

In: the trajectory, the mounting, the times of the shutter. Out: attitudes at steps so close that the image of
a star moves by less than MAX_STEP_PX from one to the next, and the vehicle's state in the middle.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.geometry.rotation import (
    dcm_from_quat,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)

MAX_STEP_PX = 0.5


class Motion(NamedTuple):
    """Attitude of the camera and state of the vehicle during one exposure."""

    C_ci: np.ndarray  # (n, 3, 3) at the middles of n equal steps
    C_ci_mid: np.ndarray  # (3, 3) in the middle of the exposure, like all below
    r_i: np.ndarray  # (3,) m
    v_i: np.ndarray  # (3,) m/s
    omega_ib_i: np.ndarray  # (3,) rad/s, mean of the samples
    rate: float  # rad/s, the greatest of the samples


def during(camera, trajectory, q_bc, t_start_s, exposure_s):
    """Motion in an exposure. Pinhole, Trajectory, (4,), s, s -> Motion."""
    t_s = trajectory.t_s
    first_s, per_s = t_s[0], (len(t_s) - 1) / (t_s[-1] - t_s[0])
    tan_corner = 0.5 * np.hypot(camera.width_px, camera.height_px) / camera.focal_length_px
    start, length = (t_start_s - first_s) * per_s, exposure_s * per_s
    states = trajectory.q_ib, trajectory.omega_ib_b, trajectory.r_i, trajectory.v_i
    turn_px = camera.focal_length_px * exposure_s  # by which a rate across the boresight moves the middle
    return Motion(*_motion_kernel(*states, q_bc, start, length, turn_px, tan_corner))


@njit(cache=True)
def _motion_kernel(q_ib, omega_ib_b, r_i, v_i, q_bc, start, length, turn_px, tan_corner):
    """Fields of Motion; start and length of the exposure as fractional numbers of samples.

    In a corner, at the angle a from the boresight, the image moves by f / cos^2(a) times the rate across
    the boresight plus f tan(a) times the rate about it.
    """
    C_bc = dcm_from_quat(q_bc)
    first, last = int(start), min(int(np.ceil(start + length)), omega_ib_b.shape[0] - 1)
    mean_b, rate, way_px = np.zeros(3), 0.0, 0.0
    for k in range(first, last + 1):
        omega_b = omega_ib_b[k]
        omega_c = omega_b @ C_bc
        mean_b += omega_b / (last - first + 1)
        rate = max(rate, np.sqrt(omega_b @ omega_b))
        across, about = np.hypot(omega_c[0], omega_c[1]), abs(omega_c[2])
        way_px = max(way_px, turn_px * ((1.0 + tan_corner**2) * across + tan_corner * about))
    n = max(1, int(np.ceil(way_px / MAX_STEP_PX)))
    C_ci, C_ci_mid = np.empty((n, 3, 3)), np.empty((1, 3, 3))
    attitudes_at(q_ib, q_bc, start + length * (np.arange(n) + 0.5) / n, C_ci)
    middle = start + 0.5 * length
    attitudes_at(q_ib, q_bc, np.array([middle]), C_ci_mid)
    C_ci_mid = C_ci_mid[0].copy()
    k = min(int(middle), r_i.shape[0] - 2)
    part = middle - k  # linear interpolation: within 0.1 mm at 100 m/s^2 and 400 Hz
    r_mid_i, v_mid_i = r_i[k] + part * (r_i[k + 1] - r_i[k]), v_i[k] + part * (v_i[k + 1] - v_i[k])
    omega_mid_i = C_ci_mid.T @ (mean_b @ C_bc)
    return C_ci, C_ci_mid, r_mid_i, v_mid_i, omega_mid_i, rate


@njit(cache=True)
def attitudes_at(q_ib, q_bc, samples, C_ci):
    """Write C_ci (n, 3, 3) at fractional numbers of samples (n,), at constant rate between two samples."""
    before = -1
    phi_b = np.zeros(3)
    for k in range(samples.size):
        sample = min(int(samples[k]), q_ib.shape[0] - 2)
        if sample != before:
            before = sample
            phi_b = rotvec_from_quat(quat_multiply(quat_conjugate(q_ib[sample]), q_ib[sample + 1]))
        q_ib_k = quat_multiply(q_ib[sample], quat_from_rotvec((samples[k] - sample) * phi_b))
        C_ic = dcm_from_quat(quat_multiply(q_ib_k, q_bc))
        for row in range(3):  # an array assignment would double the time to compile
            for column in range(3):
                C_ci[k, row, column] = C_ic[column, row]
