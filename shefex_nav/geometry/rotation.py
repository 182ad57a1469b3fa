"""Quaternions, direction cosine matrices and rotation vectors.

Quaternions are Hamilton's, scalar first: q = [w, x, y, z]; q_ab and C_ab take components in b to
components in a. Everything is compiled and may be called from Python and from other kernels.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import triples as t3
from shefex_nav.geometry.elementary import arctan2


@kernel
def rows(a, b, c):
    """(3, 3) array of three rows, each a tuple of three numbers.

    In compiled code ten times as fast as np.array of nested lists.
    """
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = a
    out[1, 0], out[1, 1], out[1, 2] = b
    out[2, 0], out[2, 1], out[2, 2] = c
    return out


@kernel
def skew(v):
    """Cross-product matrix: skew(v) @ u = v x u. (3,) -> (3, 3)."""
    return rows((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0))


@kernel
def cross(u, v):
    """u x v for (3,) vectors; np.cross on such small arrays costs ten times as much."""
    return np.array(t3.cross(u, v))


@kernel
def quat_multiply(p, q):
    """Hamilton product: q_ac = quat_multiply(q_ab, q_bc). (4,), (4,) -> (4,)."""
    return np.array(t3.quat_multiply(p, q))


@kernel
def quat_conjugate(q):
    """Inverse of a unit quaternion: q_ba from q_ab. (4,) -> (4,)."""
    return np.array(t3.quat_conjugate(q))


@kernel
def quat_normalise(q):
    """q divided by its norm. (4,) -> (4,)."""
    return np.array(t3.quat_normalise(q))


@kernel
def quat_rotate(q_ab, v_b):
    """Components in a of a vector given in b. (4,), (3,) -> (3,)."""
    return np.array(t3.quat_rotate(q_ab, v_b))


@kernel
def quat_from_rotvec(phi):
    """exp: quaternion of the rotation by |phi| about phi. (3,) rad -> (4,)."""
    return np.array(t3.quat_from_rotvec(phi))


@kernel
def rotvec_from_quat(q):
    """log: rotation vector of the shorter of the two rotations q and -q. (4,) -> (3,) rad."""
    return np.array(t3.rotvec_from_quat(q))


@kernel
def dcm_from_quat(q):
    """Direction cosine matrix C_ab of q_ab. (4,) -> (3, 3)."""
    C = np.empty((3, 3))
    t3.store(C, t3.dcm_from_quat(q))
    return C


@kernel
def dcms_from_quats(q):
    """The same of many. (N, 4) -> (N, 3, 3)."""
    C = np.empty((q.shape[0], 3, 3))
    for k in range(q.shape[0]):
        t3.store(C[k], t3.dcm_from_quat(q[k]))
    return C


@kernel
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


@kernel
def dcm_from_rotvec(phi):
    """exp(skew(phi)): (3,) rad -> (3, 3)."""
    return dcm_from_quat(quat_from_rotvec(phi))


def xyzw(q):
    """Scalar-last copy for scipy, rerun and Foxglove; the order changes here and in `wxyz` alone."""
    q = np.asarray(q)
    return np.concatenate([q[..., 1:], q[..., :1]], axis=-1)


def wxyz(q):
    """Scalar-first copy of what scipy gives: `xyzw` undone."""
    q = np.asarray(q)
    return np.concatenate([q[..., 3:], q[..., :3]], axis=-1)


def rotvec_between(q_estimate, q_true):
    """Attitude error with truth = estimate * exp(error), shorter way round.

    (..., 4), (..., 4) -> (..., 3) rad, in the right-hand frame of the quaternions (body for q_ib).
    """
    p, q = np.atleast_2d(q_estimate), np.atleast_2d(q_true)
    w = p[:, 0] * q[:, 0] + np.einsum("ij,ij->i", p[:, 1:], q[:, 1:])
    v = p[:, :1] * q[:, 1:] - q[:, :1] * p[:, 1:] - np.cross(p[:, 1:], q[:, 1:])
    sign = np.where(w < 0.0, -1.0, 1.0)
    norm = np.linalg.norm(v, axis=1)
    angle = 2.0 * arctan2(norm, np.abs(w))
    scale = np.where(norm > 1e-12, angle / np.maximum(norm, 1e-300), 2.0)
    error = (sign * scale)[:, None] * v
    return error[0] if np.ndim(q_estimate) == 1 else error
