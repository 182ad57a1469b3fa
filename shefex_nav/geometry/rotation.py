"""Quaternions, direction cosine matrices and rotation vectors.

Quaternions are Hamilton's, scalar first: q = [w, x, y, z]; q_ab and C_ab take components in b to
components in a. Everything is compiled and may be called from Python and from other kernels.
"""

import numpy as np
from numba import njit


@njit(cache=True)
def rows(a, b, c):
    """(3, 3) array of three rows, each a tuple of three numbers.

    In compiled code ten times as fast as np.array of nested lists.
    """
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = a
    out[1, 0], out[1, 1], out[1, 2] = b
    out[2, 0], out[2, 1], out[2, 2] = c
    return out


@njit(cache=True)
def skew(v):
    """Cross-product matrix: skew(v) @ u = v x u. (3,) -> (3, 3)."""
    return rows((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0))


@njit(cache=True)
def cross(u, v):
    """u x v for (3,) vectors; np.cross on such small arrays costs ten times as much."""
    return np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


@njit(cache=True)
def quat_multiply(p, q):
    """Hamilton product: q_ac = quat_multiply(q_ab, q_bc). (4,), (4,) -> (4,)."""
    return np.array(
        [
            p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
            p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
            p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
            p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
        ]
    )


@njit(cache=True)
def quat_conjugate(q):
    """Inverse of a unit quaternion: q_ba from q_ab. (4,) -> (4,)."""
    return np.array([q[0], -q[1], -q[2], -q[3]])


@njit(cache=True)
def quat_normalise(q):
    """q divided by its norm. (4,) -> (4,)."""
    n = np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    return np.array([q[0] / n, q[1] / n, q[2] / n, q[3] / n])


@njit(cache=True)
def quat_rotate(q_ab, v_b):
    """Components in a of a vector given in b. (4,), (3,) -> (3,)."""
    return np.array(rotated((q_ab[0], q_ab[1], q_ab[2], q_ab[3]), (v_b[0], v_b[1], v_b[2])))


@njit(cache=True, forceinline=True)
def rotated(q, v):
    """`quat_rotate` of tuples of numbers: v + w t + u x t with t = 2 u x v."""
    w, a, b, c = q
    x, y, z = v
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return x + w * tx + (b * tz - c * ty), y + w * ty + (c * tx - a * tz), z + w * tz + (a * ty - b * tx)


@njit(cache=True)
def quat_from_rotvec(phi):
    """exp: quaternion of the rotation by |phi| about phi. (3,) rad -> (4,)."""
    angle2 = phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2
    if angle2 < 1e-8:  # series: the next terms are below 1e-18
        w = 1.0 - angle2 / 8.0 + angle2**2 / 384.0
        s = 0.5 - angle2 / 48.0 + angle2**2 / 3840.0
    else:
        angle = np.sqrt(angle2)
        w = np.cos(0.5 * angle)
        s = np.sin(0.5 * angle) / angle
    return np.array([w, s * phi[0], s * phi[1], s * phi[2]])


@njit(cache=True)
def rotvec_from_quat(q):
    """log: rotation vector of the shorter of the two rotations q and -q. (4,) -> (3,) rad."""
    sign = 1.0 if q[0] >= 0.0 else -1.0
    w = sign * q[0]
    n = np.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    if n < 1e-6:  # angle/n = 2/w (1 - n^2/(3 w^2)); what is left out is below 1e-24
        k = 2.0 / w * (1.0 - n**2 / (3.0 * w**2))
    else:
        k = 2.0 * np.arctan2(n, w) / n
    return np.array([sign * k * q[1], sign * k * q[2], sign * k * q[3]])


@njit(cache=True)
def dcm_from_quat(q):
    """Direction cosine matrix C_ab of q_ab. (4,) -> (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return rows(
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@njit(cache=True)
def quat_from_dcm(C):
    """Quaternion q_ab of C_ab by the largest of its components (Shepperd 1978). (3, 3) -> (4,)."""
    q2 = np.array(
        [
            1.0 + C[0, 0] + C[1, 1] + C[2, 2],
            1.0 + C[0, 0] - C[1, 1] - C[2, 2],
            1.0 - C[0, 0] + C[1, 1] - C[2, 2],
            1.0 - C[0, 0] - C[1, 1] + C[2, 2],
        ]
    )
    k = np.argmax(q2)
    d = 0.5 / np.sqrt(q2[k])
    if k == 0:
        q = np.array([q2[0], C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]])
    elif k == 1:
        q = np.array([C[2, 1] - C[1, 2], q2[1], C[0, 1] + C[1, 0], C[0, 2] + C[2, 0]])
    elif k == 2:
        q = np.array([C[0, 2] - C[2, 0], C[0, 1] + C[1, 0], q2[2], C[1, 2] + C[2, 1]])
    else:
        q = np.array([C[1, 0] - C[0, 1], C[0, 2] + C[2, 0], C[1, 2] + C[2, 1], q2[3]])
    q = q * d
    if q[0] < 0.0:
        q = -q
    return quat_normalise(q)


@njit(cache=True)
def dcm_from_rotvec(phi):
    """exp(skew(phi)): (3,) rad -> (3, 3)."""
    return dcm_from_quat(quat_from_rotvec(phi))


def xyzw(q):
    """Scalar-last copy for scipy, rerun and Foxglove; the only place where the order changes."""
    q = np.asarray(q)
    return np.concatenate([q[..., 1:], q[..., :1]], axis=-1)


def rotvec_between(q_estimate, q_true):
    """Attitude error with truth = estimate * exp(error), shorter way round.

    (..., 4), (..., 4) -> (..., 3) rad, in the right-hand frame of the quaternions (body for q_ib).
    """
    p, q = np.atleast_2d(q_estimate), np.atleast_2d(q_true)
    w = p[:, 0] * q[:, 0] + np.einsum("ij,ij->i", p[:, 1:], q[:, 1:])
    v = p[:, :1] * q[:, 1:] - q[:, :1] * p[:, 1:] - np.cross(p[:, 1:], q[:, 1:])
    sign = np.where(w < 0.0, -1.0, 1.0)
    norm = np.linalg.norm(v, axis=1)
    angle = 2.0 * np.arctan2(norm, np.abs(w))
    scale = np.where(norm > 1e-12, angle / np.maximum(norm, 1e-300), 2.0)
    error = (sign * scale)[:, None] * v
    return error[0] if np.ndim(q_estimate) == 1 else error
