"""Vectors, matrices and quaternions as tuples of numbers: the one algebra of flight, filter and geometry.

A tuple lives in registers: in compiled code these cost a fraction of the same on small arrays, each of which
has to be allocated. A matrix is nine numbers, row by row (`matrix` makes them of an array, `store` writes
them into one). Vectors and quaternions may be given as arrays, too; `rotation` gives arrays back.
"""

from math import atan2, cos, sin, sqrt

from shefex_nav.compiled import kernel


@kernel(forceinline=True)
def dot(u, v):
    """u . v"""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@kernel(forceinline=True)
def cross(u, v):
    """u x v"""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@kernel(forceinline=True)
def scaled(a, u):
    """a u"""
    return a * u[0], a * u[1], a * u[2]


@kernel(forceinline=True)
def plus(u, a, v):
    """u + a v"""
    return u[0] + a * v[0], u[1] + a * v[1], u[2] + a * v[2]


@kernel(forceinline=True)
def rotated(C, u):
    """C u"""
    return (
        C[0] * u[0] + C[1] * u[1] + C[2] * u[2],
        C[3] * u[0] + C[4] * u[1] + C[5] * u[2],
        C[6] * u[0] + C[7] * u[1] + C[8] * u[2],
    )


@kernel(forceinline=True)
def product(A, B):
    """A B"""
    return (
        A[0] * B[0] + A[1] * B[3] + A[2] * B[6],
        A[0] * B[1] + A[1] * B[4] + A[2] * B[7],
        A[0] * B[2] + A[1] * B[5] + A[2] * B[8],
        A[3] * B[0] + A[4] * B[3] + A[5] * B[6],
        A[3] * B[1] + A[4] * B[4] + A[5] * B[7],
        A[3] * B[2] + A[4] * B[5] + A[5] * B[8],
        A[6] * B[0] + A[7] * B[3] + A[8] * B[6],
        A[6] * B[1] + A[7] * B[4] + A[8] * B[7],
        A[6] * B[2] + A[7] * B[5] + A[8] * B[8],
    )


@kernel(forceinline=True)
def transposed(A):
    """A^T"""
    return A[0], A[3], A[6], A[1], A[4], A[7], A[2], A[5], A[8]


@kernel(forceinline=True)
def composed(a, u, v, w):
    """a I + u v^T + skew(w), of which the derivatives of rotations are made."""
    return (
        a + u[0] * v[0],
        u[0] * v[1] - w[2],
        u[0] * v[2] + w[1],
        u[1] * v[0] + w[2],
        a + u[1] * v[1],
        u[1] * v[2] - w[0],
        u[2] * v[0] - w[1],
        u[2] * v[1] + w[0],
        a + u[2] * v[2],
    )


@kernel(forceinline=True)
def quat_multiply(p, q):
    """Hamilton product, scalar first."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@kernel(forceinline=True)
def quat_from_rotvec(phi):
    """exp: quaternion of the rotation by |phi| about phi."""
    angle2 = dot(phi, phi)
    if angle2 < 1e-8:  # series: the next terms are below 1e-18
        w = 1.0 - angle2 / 8.0 + angle2 * angle2 / 384.0
        s = 0.5 - angle2 / 48.0 + angle2 * angle2 / 3840.0
    else:
        angle = sqrt(angle2)
        w = cos(0.5 * angle)
        s = sin(0.5 * angle) / angle
    return w, s * phi[0], s * phi[1], s * phi[2]


@kernel(forceinline=True)
def quat_conjugate(q):
    """Inverse of a unit quaternion: q_ba from q_ab."""
    return q[0], -q[1], -q[2], -q[3]


@kernel(forceinline=True)
def quat_rotate(q, v):
    """Components in a of a vector given in b, q_ab: v + w t + u x t with t = 2 u x v."""
    w, a, b, c = q[0], q[1], q[2], q[3]
    x, y, z = v[0], v[1], v[2]
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return x + w * tx + (b * tz - c * ty), y + w * ty + (c * tx - a * tz), z + w * tz + (a * ty - b * tx)


@kernel(forceinline=True)
def rotvec_from_quat(q):
    """log: rotation vector of the shorter of the two rotations q and -q."""
    sign = 1.0 if q[0] >= 0.0 else -1.0
    w = sign * q[0]
    n = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if n < 1e-6:  # angle/n = 2/w (1 - n^2/(3 w^2)); what is left out is below 1e-24
        k = 2.0 / w * (1.0 - n * n / (3.0 * (w * w)))
    else:
        k = 2.0 * atan2(n, w) / n
    return sign * k * q[1], sign * k * q[2], sign * k * q[3]


@kernel(forceinline=True)
def quat_normalise(q):
    """q divided by its norm."""
    norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm


@kernel(forceinline=True)
def dcm_from_quat(q):
    """C_ab of q_ab."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@kernel(forceinline=True)
def vector(a, k):
    """Three numbers of an array from k on."""
    return a[k], a[k + 1], a[k + 2]


@kernel(forceinline=True)
def quaternion(a, k):
    """Four numbers of an array from k on."""
    return a[k], a[k + 1], a[k + 2], a[k + 3]


@kernel(forceinline=True)
def row(a, k):
    """Row k of an (n, 3) array, by elements: a view of it would be counted as a reference."""
    return a[k, 0], a[k, 1], a[k, 2]


@kernel(forceinline=True)
def column(a, k):
    """Column k of a (3, n) array."""
    return a[0, k], a[1, k], a[2, k]


@kernel(forceinline=True)
def put(out, a):
    """Write three numbers into a (3,) array."""
    out[0], out[1], out[2] = a


@kernel(forceinline=True)
def matrix(a):
    """Nine numbers of a (3, 3) array."""
    return a[0, 0], a[0, 1], a[0, 2], a[1, 0], a[1, 1], a[1, 2], a[2, 0], a[2, 1], a[2, 2]


@kernel(forceinline=True)
def store(out, A):
    """Write a matrix into a (3, 3) array."""
    out[0, 0], out[0, 1], out[0, 2] = A[0], A[1], A[2]
    out[1, 0], out[1, 1], out[1, 2] = A[3], A[4], A[5]
    out[2, 0], out[2, 1], out[2, 2] = A[6], A[7], A[8]


@kernel(forceinline=True)
def inverse(A):
    """A^-1 by its cofactors."""
    B = (
        A[4] * A[8] - A[5] * A[7], A[2] * A[7] - A[1] * A[8], A[1] * A[5] - A[2] * A[4],
        A[5] * A[6] - A[3] * A[8], A[0] * A[8] - A[2] * A[6], A[2] * A[3] - A[0] * A[5],
        A[3] * A[7] - A[4] * A[6], A[1] * A[6] - A[0] * A[7], A[0] * A[4] - A[1] * A[3],
    )  # fmt: skip
    d = 1.0 / (A[0] * B[0] + A[1] * B[3] + A[2] * B[6])
    return (
        d * B[0], d * B[1], d * B[2], d * B[3], d * B[4], d * B[5], d * B[6], d * B[7], d * B[8]
    )  # fmt: skip
