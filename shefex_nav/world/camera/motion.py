"""How the camera moves during a frame.

In: the trajectory, the mounting, the times of the rows; or a constant rate. Out: attitudes at steps so close
that the image of a star moves by less than `step_px` from one to the next, from the opening of the first row
to the closing of the last, and the vehicle's state at the frame's instant.

A picture is drawn in straight steps. While the rate changes, their chords lie beside the path: with n steps
of an exposure T their mean is alpha T^2 / 12 n^2 from that of the path, which is itself alpha T^2 / 24 from
the instant. So the steps are turned by what is missing, and what is drawn has the mean of the path.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.rotation import (
    dcm_from_quat,
    dcm_from_rotvec,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from shefex_nav.geometry.shutter import RowTimes, duration_s, instant_after_s
from shefex_nav.world.camera.render import Path

POINTS = 8  # of an exposure, at least, from which its mean is taken


class Motion(NamedTuple):
    """Attitude of the camera during a frame and state of the vehicle at its instant."""

    path: Path
    C_ci: np.ndarray  # (3, 3) at the frame's instant, like all below
    r_i: np.ndarray  # (3,) m
    v_i: np.ndarray  # (3,) m/s
    omega_ib_i: np.ndarray  # (3,) rad/s, mean of the samples
    rate: float  # rad/s, the greatest of the samples


def during(camera, trajectory, q_bc, t_valid_s, times, step_px):
    """Motion in a frame.

    Parameters
    ----------
    camera : Pinhole
    trajectory : Trajectory
    q_bc : (4,) mounting
    t_valid_s : float, the frame's instant
    times : RowTimes
    step_px : float
    """
    steps = duration_s(times) / step_px
    C_ci, *rest = moved(camera, states(trajectory), q_bc, samples(trajectory.t_s, t_valid_s, times), steps)
    path = Path(C_ci, -instant_after_s(times), duration_s(times) / (len(C_ci) - 1), times)
    return Motion(path, *rest)


def states(trajectory):
    """What `moved` needs of a Trajectory: q_ib (N, 4), omega_ib_b, r_i, v_i (N, 3)."""
    return trajectory.q_ib, trajectory.omega_ib_b, trajectory.r_i, trajectory.v_i


def samples(t_s, t_valid_s, times):
    """Start, length and instant of a frame as fractional numbers of samples, whose times are t_s."""
    per_s = (len(t_s) - 1) / (t_s[-1] - t_s[0])
    middle = (t_valid_s - t_s[0]) * per_s
    return middle - instant_after_s(times) * per_s, duration_s(times) * per_s, middle


def at_rest(C_ci, times=None):
    """Path of a camera that does not move: attitude (3, 3)."""
    times = RowTimes(1.0, 0.0, 0.0) if times is None else times
    return Path(np.stack([C_ci, C_ci]), -instant_after_s(times), duration_s(times), times)


def turning(camera, C_ic, omega_c, times, step_px):
    """Path of a camera that turns at a constant rate.

    Parameters
    ----------
    camera : Pinhole
    C_ic : (3, 3) attitude at the frame's instant
    omega_c : (3,) rad/s, inertial, in camera axes
    times : RowTimes
    step_px : float
    """
    way_px = duration_s(times) * fastest(camera, omega_c)
    n = max(1, int(np.ceil(way_px / step_px)))
    begin_s, step_s = -instant_after_s(times), duration_s(times) / n
    return Path(_turning_kernel(C_ic, omega_c, begin_s, step_s, n), begin_s, step_s, times)


def refined(path, speed, step_px):
    """Path with each step cut into equal ones for what moves by `speed` px/s more than the stars. -> Path

    Attitudes between two ends are interpolated: the steps of the path itself are short.
    """
    cut = max(1, int(np.ceil(speed * path.step_s / step_px)))
    ends = np.arange(cut * (len(path.C_ci) - 1) + 1) / cut
    k = np.minimum(ends.astype(int), len(path.C_ci) - 2)
    part = (ends - k)[:, None, None]
    C_ci = (1.0 - part) * path.C_ci[k] + part * path.C_ci[k + 1]
    return path._replace(C_ci=C_ci, step_s=path.step_s / cut)


@kernel
def _turning_kernel(C_ic, omega_c, begin_s, step_s, n):
    """C_ci at the ends of n steps (n + 1, 3, 3)."""
    C_ci = np.empty((n + 1, 3, 3))
    for k in range(n + 1):
        C_ci[k] = (C_ic @ dcm_from_rotvec((begin_s + k * step_s) * omega_c)).T
    return C_ci


@kernel
def fastest(camera, omega_c):
    """Speed of the fastest star on the detector, no less: px/s.

    In a corner, at the angle a from the boresight, the image moves by f / cos^2(a) times the rate across
    the boresight plus f tan(a) times the rate about it.
    """
    tan_corner = 0.5 * np.hypot(camera.width_px, camera.height_px) / camera.focal_length_px
    across, about = np.hypot(omega_c[0], omega_c[1]), abs(omega_c[2])
    return camera.focal_length_px * ((1.0 + tan_corner**2) * across + tan_corner * about)


@kernel
def moved(camera, states, q_bc, samples, steps):
    """C_ci (n + 1, 3, 3) of the path and the other fields of Motion.

    states, samples : of `states`, of `samples`;  steps : for 1 px/s
    """
    (q_ib, omega_ib_b, r_i, v_i), (start, length, middle) = states, samples
    C_bc = dcm_from_quat(q_bc)
    first, last = int(start), min(int(np.ceil(start + length)), omega_ib_b.shape[0] - 1)
    mean_b, omega_c, rate, speed = np.zeros(3), np.empty(3), 0.0, 0.0
    for k in range(first, last + 1):
        p, q, r = omega_ib_b[k]
        for j in range(3):
            mean_b[j] += omega_ib_b[k, j] / (last - first + 1)
            omega_c[j] = p * C_bc[0, j] + q * C_bc[1, j] + r * C_bc[2, j]
        rate = max(rate, np.sqrt(p * p + q * q + r * r))
        speed = max(speed, fastest(camera, omega_c))
    n = max(1, int(np.ceil(speed * steps)))
    C_ci, C_ci_mid = np.empty((n + 1, 3, 3)), np.empty((1, 3, 3))
    attitudes_at(q_ib, q_bc, start + length * np.arange(n + 1) / n, C_ci)
    attitudes_at(q_ib, q_bc, np.array([middle]), C_ci_mid)
    C_ci_mid = C_ci_mid[0].copy()
    _give_mean(q_ib, q_bc, start, length, C_ci)
    k = min(int(middle), r_i.shape[0] - 2)
    part = middle - k  # linear interpolation: within 0.1 mm at 100 m/s^2 and 400 Hz
    r_mid_i, v_mid_i = r_i[k] + part * (r_i[k + 1] - r_i[k]), v_i[k] + part * (v_i[k + 1] - v_i[k])
    omega_mid_i = C_ci_mid.T @ (mean_b @ C_bc)
    return C_ci, C_ci_mid, r_mid_i, v_mid_i, omega_mid_i, rate


@inner
def _give_mean(q_ib, q_bc, start, length, C_ci):
    """Turn C_ci (n + 1, 3, 3) of n equal steps so that the mean of their chords is that of the path.

    The mean of the path is Simpson's rule over POINTS parts or more.
    """
    n = C_ci.shape[0] - 1
    parts = n * 2 * ((POINTS - 1) // (2 * n) + 1)
    finer = np.empty((parts + 1, 3, 3))
    attitudes_at(q_ib, q_bc, start + length * np.arange(parts + 1) / parts, finer)
    M = np.zeros((3, 3))  # mean of the path less that of the chords
    for k in range(parts + 1):
        M += (1.0 if k in (0, parts) else 2.0 + 2.0 * (k % 2)) / (3.0 * parts) * finer[k]
    for k in range(n + 1):
        M -= (0.5 if k in (0, n) else 1.0) / n * C_ci[k]
    D = M @ C_ci[n // 2].T  # - skew of the turn that is missing, and of second order a symmetric part
    turn = dcm_from_rotvec(0.5 * np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])).T
    turn = np.ascontiguousarray(turn)
    for k in range(n + 1):
        C_ci[k] = turn @ C_ci[k]


@inner
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
