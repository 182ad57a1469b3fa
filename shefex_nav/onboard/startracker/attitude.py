"""Attitude from identified stars: ESOQ2, a reference solution, and its covariance.

In: directions in the camera and in the inertial frame with one standard deviation per star. Out: q_ic and
the covariance of its error. Mortari, "ESOQ-2: single-point algorithm for fast optimal spacecraft attitude
determination" (1997) and "Second estimator of the optimal quaternion" (2000); coefficients of the
characteristic polynomial as in Shuster and Oh (1981). Where each centroid has a covariance, `likelihood` goes
on from here.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import triples as t3
from shefex_nav.geometry.rotation import (
    dcm_from_quat,
    quat_from_rotvec,
    quat_multiply,
    quat_normalise,
)

NEWTON_STEPS = 20  # bound only: it converges in two or three
POLISH_STEPS = 4  # bound only: one is usual
POLISHED = 1e-9  # rad; the next step is smaller by its square
FAR_OFF = 1e-3  # rad; a first step this long means that the closed form has lost its digits
OPEN = 1e-14  # of the information about the worst axis: nothing left above the rounding


@kernel
def esoq2(u_c, v_i, sigma):
    """Attitude that minimises sum |v_i - C_ic u_c|^2 / sigma^2 (Wahba's problem).

    The optimum belongs to the largest eigenvalue lambda of Davenport's K = [[t, z'], [z, S - t I]] with
    B = sum w v u', S = B + B', t = trace B. ESOQ2 eliminates the scalar part of q: the rotation axis e is
    the null vector of (lambda - t) ((lambda + t) I - S) - z z'. That matrix vanishes for a small rotation,
    so the camera frame is first turned by 180 degrees about the axis that makes t smallest, i.e. the
    remaining rotation largest, and the quaternion is turned back at the end.

    The two largest eigenvalues differ by about the squared size of the field, and the closed form loses
    digits with its fourth power: stars within 1 degree would come out up to 1e-5 rad off. A Newton step on
    B, which loses them with the second power as the other methods do, puts that right; where even its
    starting point is lost, Davenport's q-method gives a new one.

    Parameters
    ----------
    u_c : (n, 3) unit vectors measured in the camera, n >= 2
    v_i : (n, 3) the same in the inertial frame
    sigma : (n,) rad, or anything proportional to it

    Returns
    -------
    q_ic : (4,)
    """
    B = _profile(u_c, v_i, sigma)
    q, first_step = _polish(_closed_form(B), B)
    if first_step > FAR_OFF and np.isfinite(B.sum()):
        q, _ = _polish(_davenport(B), B)
    return q if q[0] >= 0.0 else -q


@kernel
def davenport(u_c, v_i, sigma):
    """As `esoq2`, by the eigenvector of K itself (Davenport 1968): slower, and a reference."""
    q = _davenport(_profile(u_c, v_i, sigma))
    return q if q[0] >= 0.0 else -q


@inner
def _profile(u_c, v_i, sigma):
    """B = sum w v u' with weights that add up to one."""
    B = np.zeros((3, 3))
    total = 0.0
    for k in range(u_c.shape[0]):
        weight = 1.0 / sigma[k] ** 2
        total += weight
        for r in range(3):
            for c in range(3):
                B[r, c] += weight * v_i[k, r] * u_c[k, c]
    B /= total
    return B


@inner
def _davenport(B):
    """Eigenvector of the largest eigenvalue of K."""
    K = np.empty((4, 4))
    trace = B[0, 0] + B[1, 1] + B[2, 2]
    K[1:, 1:] = B + B.T
    for r in range(3):
        K[r + 1, r + 1] -= trace
        K[0, r + 1] = K[r + 1, 0] = B[(r + 2) % 3, (r + 1) % 3] - B[(r + 1) % 3, (r + 2) % 3]
    K[0, 0] = trace
    return quat_normalise(np.linalg.eigh(K)[1][:, 3].copy())


@inner
def _closed_form(B):
    """ESOQ2's quaternion."""
    B = B.copy()
    trace = B[0, 0] + B[1, 1] + B[2, 2]
    turned, t = -1, trace
    for axis in range(3):
        if 2.0 * B[axis, axis] - trace < t:
            turned, t = axis, 2.0 * B[axis, axis] - trace
    if turned >= 0:
        for c in range(3):
            if c != turned:
                B[:, c] = -B[:, c]

    S = B + B.T
    z = np.array([B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]])
    largest = _largest_eigenvalue(S, z, t)
    a, b = largest - t, largest + t
    M = -a * S
    for r in range(3):
        M[r, r] += a * b
        for c in range(3):
            M[r, c] -= z[r] * z[c]
    e = _null_vector(M)
    q = quat_normalise(np.array([t3.dot(z, e), a * e[0], a * e[1], a * e[2]]))
    return _turn_back(q, turned) if turned >= 0 else q


@inner
def _polish(q, B):
    """Newton steps towards the maximum of trace(C' B); the quaternion and the length of the first step.

    With A = C' B and C exp(skew d) in place of C, the trace is trace A + d.w - d'(trace A I - sym A) d / 2,
    w = (A32 - A23, A13 - A31, A21 - A12). Where no step is possible (a saddle, or the stars leave a rotation
    open) the length is infinite.
    """
    first_step = np.inf
    for k in range(POLISH_STEPS):
        A = product(dcm_from_quat(q).T, B)
        xx, yy, zz = A[1, 1] + A[2, 2], A[0, 0] + A[2, 2], A[0, 0] + A[1, 1]
        xy, xz, yz = -0.5 * (A[0, 1] + A[1, 0]), -0.5 * (A[0, 2] + A[2, 0]), -0.5 * (A[1, 2] + A[2, 1])
        wx, wy, wz = A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]
        cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        cyy, cyz, czz = xx * zz - xz * xz, xy * xz - yz * xx, xx * yy - xy * xy
        det = xx * cxx + xy * cxy + xz * cxz
        if not (det > OPEN and czz + cyy + cxx > OPEN and xx + yy + zz > 0.0):
            break
        d = np.array(
            [cxx * wx + cxy * wy + cxz * wz, cxy * wx + cyy * wy + cyz * wz, cxz * wx + cyz * wy + czz * wz]
        )
        d /= det
        step = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
        q = quat_multiply(q, quat_from_rotvec(d))
        if k == 0:
            first_step = step
        if step < POLISHED or step > 1.0:
            break
    return quat_normalise(q), first_step


@inner
def _largest_eigenvalue(S, z, t):
    """Largest root of det(K - lambda I) by Newton from its upper bound 1 (weights add up to one)."""
    kappa = (
        S[0, 0] * S[1, 1] - S[0, 1] ** 2 + S[0, 0] * S[2, 2] - S[0, 2] ** 2 + S[1, 1] * S[2, 2] - S[1, 2] ** 2
    )
    det_S = (
        S[0, 0] * (S[1, 1] * S[2, 2] - S[1, 2] ** 2)
        - S[0, 1] * (S[0, 1] * S[2, 2] - S[1, 2] * S[0, 2])
        + S[0, 2] * (S[0, 1] * S[1, 2] - S[1, 1] * S[0, 2])
    )
    Sz = S @ z
    zz, zSz, zSSz = (z * z).sum(), (z * Sz).sum(), (Sz * Sz).sum()
    a, b, c, d = t * t - kappa, t * t + zz, det_S + zSz, zSSz
    x = 1.0
    for _ in range(NEWTON_STEPS):
        value = ((x * x - (a + b)) * x - c) * x + (a * b + c * t - d)
        slope = (4.0 * x * x - 2.0 * (a + b)) * x - c
        if slope <= 0.0:  # a double root: the stars leave the rotation about one axis open
            break
        step = value / slope
        x -= step
        if abs(step) < 1e-15:
            break
    return x


@inner
def _null_vector(M):
    """Unit vector e with M e = 0 of a symmetric matrix: the longest cross product of two rows."""
    best, length2 = np.zeros(3), -1.0
    for k in range(3):
        p, q = M[k], M[(k + 1) % 3]
        w = np.array(t3.cross(p, q))
        norm2 = (w * w).sum()
        if norm2 > length2:
            best, length2 = w, norm2
    return best / np.sqrt(length2)


@inner
def _turn_back(q, axis):
    """q times the quaternion of 180 degrees about an axis (0, 1, 2). (4,) -> (4,)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    if axis == 0:
        return np.array([-x, w, z, -y])
    if axis == 1:
        return np.array([-y, -z, w, x])
    return np.array([-z, y, -x, w])


@inner
def covariance(u_c, sigma):
    """Covariance of the attitude error, q_ic(true) = q_ic * exp(dtheta_c).

    P_c = [sum (I - u u') / sigma^2]^-1: each star measures the two rotations across its direction.

    Parameters
    ----------
    u_c : (n, 3) unit vectors of at least two different directions
    sigma : (n,) rad, standard deviation of each direction, per axis

    Returns
    -------
    P_c : (3, 3) rad^2
    """
    F = np.zeros((3, 3))
    for k in range(u_c.shape[0]):
        weight = 1.0 / sigma[k] ** 2
        for r in range(3):
            F[r, r] += weight
            for c in range(3):
                F[r, c] -= weight * u_c[k, r] * u_c[k, c]
    return inverse3(F)


@inner
def product(A, B):
    """A B of matrices so small that a library takes longer to be called than to multiply."""
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                out[i, j] += A[i, k] * B[k, j]
    return out


@inner
def times(A, v):
    """A v, as `product`."""
    out = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i] += A[i, j] * v[j]
    return out


@inner
def det3(A):
    """Determinant of a (3, 3) matrix."""
    return (
        A[0, 0] * (A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1])
        - A[0, 1] * (A[1, 0] * A[2, 2] - A[1, 2] * A[2, 0])
        + A[0, 2] * (A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0])
    )


@inner
def inverse3(F):
    """Inverse of a symmetric (3, 3) matrix."""
    adjugate = np.empty((3, 3))
    for r in range(3):
        for c in range(3):
            r1, r2, c1, c2 = (r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3
            adjugate[c, r] = F[r1, c1] * F[r2, c2] - F[r1, c2] * F[r2, c1]
    return adjugate / (F[0, 0] * adjugate[0, 0] + F[0, 1] * adjugate[1, 0] + F[0, 2] * adjugate[2, 0])
