"""Calibration of the camera from identified frames: focal length, principal point, radial distortion.

In: centroids with their identified stars, frame by frame, and a first camera. Out: the camera that explains
them, with covariance. The attitude of each frame is estimated along and eliminated (Schur complement), so the
work grows with the number of frames, not with its cube. SHEFEX section 4 asks for focal length and principal
point; radial distortion after Brown (1966), x_d = x (1 + k1 r^2 + k2 r^4), x = X/Z.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.pinhole import Pinhole, turn_slopes, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply, quat_normalise
from shefex_nav.onboard.startracker.attitude import esoq2, inverse3

NAMES = ("focal_length_px", "cx_px", "cy_px", "k1", "k2")
HUBER = 2.0  # sigma of the distance: beyond, a centroid pulls with constant force until it is judged
FALSE_REJECTION = 1e-4  # probability that a good centroid is taken for a misidentified one
MAX_STEPS = 100
MAX_ROUNDS = 10  # of judging the centroids
CONVERGED = 1e-10  # of chi2, relative; a standard deviation of a parameter changes it by one
SHARE_BAD = 0.3  # of the centroids: if more do not fit, it is the model that does not fit
# An estimate that is less certain than this was not determined by the frames.
LOOSEST = {"focal_length": 0.02, "principal_point": 0.1, "edge": 0.02}  # of f, of the width, of the radius


class Calibration(NamedTuple):
    """The camera that explains the frames."""

    camera: Pinhole  # focal length and principal point
    distortion: np.ndarray  # (5,) k1, k2, p1, p2, k3 as OpenCV orders them; the last three are zero
    names: tuple  # of the estimated parameters, of NAMES
    covariance: np.ndarray  # (m, m) of the estimated parameters
    q_ic: np.ndarray  # (n_frames, 4) attitudes
    used: list  # (n,) bool a frame: False for a centroid that does not belong to its star
    chi2: float  # of the used centroids
    dof: int

    @property
    def sigma(self):
        """Standard deviation of each estimated parameter: dict."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def calibrate(frames, camera0, *, with_principal_point=True, with_distortion=True):
    """Estimate the camera from frames whose stars are identified.

    Least squares over the camera and the attitudes of all frames (Levenberg-Marquardt). Until it has
    converged, centroids that are far off pull less (Huber); then those whose distance has less than
    FALSE_REJECTION of the chi-square distribution are left out and the rest is fitted again, until nothing
    changes. A shift of the principal point is nearly a rotation of the camera: it takes tens of frames.

    Parameters
    ----------
    frames : sequence of (xy_px, u_i, sigma_px)
        xy_px (n, 2) centroids, u_i (n, 3) unit vectors to their stars as the camera sees them (aberration
        included), sigma_px standard deviation per axis, one number or (n,)
    camera0 : Pinhole, first estimate; nominal values, no distortion
    with_principal_point, with_distortion : bool, else they are kept as in camera0, or zero

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
        if the frames do not determine the camera; it says what is missing
    """
    data = _stack(frames)
    estimated = np.array([True, *2 * [with_principal_point], *2 * [with_distortion]])
    used, theta, q_ic, chi2 = _judged(data, camera0, estimated)
    if used.mean() < 1.0 - SHARE_BAD:
        raise ValueError(
            f"{(~used).sum()} of {len(used)} centroids do not fit any camera: wrong stars, or sigma_px is "
            "too small"
        )
    covariance = _covariance(data, used, theta, q_ic, estimated)
    _refuse_if_loose(camera0, theta, covariance, estimated)
    dof = int(2 * used.sum() - 3 * len(q_ic) - estimated.sum())
    return Calibration(
        camera=Pinhole(camera0.width_px, camera0.height_px, *(float(value) for value in theta[:3])),
        distortion=np.array([theta[3], theta[4], 0.0, 0.0, 0.0]),
        names=tuple(name for name, wanted in zip(NAMES, estimated, strict=True) if wanted),
        covariance=covariance,
        q_ic=q_ic,
        used=np.split(used, data.begin[1:-1]),
        chi2=float(chi2),
        dof=dof,
    )


class _Data(NamedTuple):
    """All n centroids of all frames: rows begin[k] ... begin[k + 1] - 1 are those of frame k."""

    begin: np.ndarray  # (n_frames + 1,) int64
    xy_px: np.ndarray  # (n, 2)
    u_i: np.ndarray  # (n, 3) unit vectors to their stars
    sigma_px: np.ndarray  # (n,) standard deviation per axis


def _stack(frames):
    """Checked frames as _Data."""
    frames = list(frames)
    if not frames:
        raise ValueError("no frames")
    columns = []
    for number, (xy_px, u_i, sigma_px) in enumerate(frames):
        xy_px, u_i = np.array(xy_px, dtype=float), np.array(u_i, dtype=float)
        n = len(xy_px)
        if xy_px.shape != (n, 2) or u_i.shape != (n, 3) or n < 2:
            raise ValueError(
                f"frame {number}: expected centroids (n, 2) and stars (n, 3), n at least 2, got "
                f"{xy_px.shape} and {u_i.shape}"
            )
        sigma_px = np.broadcast_to(np.asarray(sigma_px, dtype=float), (n,))
        if not (np.isfinite(xy_px).all() and np.isfinite(u_i).all() and (sigma_px > 0.0).all()):
            raise ValueError(f"frame {number}: expected finite numbers and positive sigma_px")
        columns.append((xy_px, u_i, sigma_px))
    begin = np.concatenate([[0], np.cumsum([len(xy_px) for xy_px, _, _ in columns])])
    return _Data(begin, *(np.concatenate(column) for column in zip(*columns, strict=True)))


def _split(data):
    """(xy_px, u_i, sigma_px) of each frame."""
    for k in range(len(data.begin) - 1):
        rows = slice(data.begin[k], data.begin[k + 1])
        yield data.xy_px[rows], data.u_i[rows], data.sigma_px[rows]


def _first_attitude(camera, xy_px, u_i, sigma_px):
    return esoq2(unit_vectors(camera, xy_px), u_i, sigma_px)


def _refuse_if_few(data, used, estimated):
    """ValueError unless each frame has its attitude and something is left for the camera."""
    per_frame = np.add.reduceat(used, data.begin[:-1])
    if per_frame.min() < 2:
        raise ValueError(
            f"frame {int(per_frame.argmin())} has {per_frame.min()} stars that fit; its attitude needs 2"
        )
    spare = int(2 * used.sum() - 3 * len(per_frame))
    if spare <= estimated.sum():
        raise ValueError(
            f"too few stars: {int(used.sum())} in {len(per_frame)} frames leave {spare} measurements beyond "
            f"the attitudes, {int(estimated.sum())} parameters need more"
        )


def _refuse_if_loose(camera0, theta, covariance, estimated):
    """ValueError if a parameter was not determined by these frames."""
    sigma = np.zeros(5)
    sigma[estimated] = np.sqrt(np.diag(covariance))
    f, width = camera0.focal_length_px, camera0.width_px
    r = 0.5 * width / f
    loose = []
    if not sigma[0] < LOOSEST["focal_length"] * f:
        loose.append(f"focal length (known to {sigma[0] / f:.1%}): stars further apart in a frame")
    if not sigma[1:3].max() < LOOSEST["principal_point"] * width:
        loose.append(f"principal point (known to {sigma[1:3].max():.0f} px): more frames, or wider ones")
    if not max(sigma[3] * r**2, sigma[4] * r**4) < LOOSEST["edge"]:
        loose.append("distortion: stars at more different distances from the middle")
    if loose:
        raise ValueError("the frames do not determine " + "; nor ".join(loose))


def _judged(data, camera0, estimated):
    """Fit, and the centroids that belong to their stars: used (n,), theta (5,), q_ic (n_frames, 4), chi2."""
    theta = np.array([camera0.focal_length_px, camera0.cx_px, camera0.cy_px, 0.0, 0.0])
    q_ic = np.array([_first_attitude(camera0, *frame) for frame in _split(data)])
    _refuse_if_few(data, data.sigma_px > 0.0, estimated)
    used = np.ones(len(data.sigma_px), dtype=bool)
    limit = stats.chi2.isf(FALSE_REJECTION, 2)
    theta, q_ic, _ = _minimise(data, used, theta, q_ic, estimated, HUBER)
    for _ in range(MAX_ROUNDS):
        accepted = _distances2(data, theta, q_ic) < limit
        if (accepted == used).all():
            break
        used = accepted
        _refuse_if_few(data, used, estimated)
        theta, q_ic, _ = _minimise(data, used, theta, q_ic, estimated, np.inf)
    return used, *_minimise(data, used, theta, q_ic, estimated, np.inf)


def _minimise(data, used, theta, q_ic, estimated, huber):
    """Levenberg-Marquardt. Parameters (5,), attitudes (n, 4) and cost at the minimum."""
    m, damping = int(estimated.sum()), 1e-6
    cost, S, g, back = _normal_kernel(data, used, theta, q_ic, estimated, huber, damping)
    for _ in range(MAX_STEPS):
        try:
            step = np.linalg.solve(S, g)
        except np.linalg.LinAlgError:
            raise ValueError("the frames do not determine the camera: all stars alike") from None
        new_theta = theta.copy()
        new_theta[estimated] += step
        new_q = _turned(q_ic, back[:, :, m] - back[:, :, :m] @ step)
        trial = _normal_kernel(data, used, new_theta, new_q, estimated, huber, 0.1 * damping)
        settled = abs(cost - trial[0]) <= CONVERGED * (cost + 1.0)
        if trial[0] <= cost or settled:
            theta, q_ic, damping = new_theta, new_q, 0.1 * damping
            cost, S, g, back = trial
            if settled:
                return theta, q_ic, cost
        else:
            damping = max(10.0 * damping, 1e-9)
            if damping > 1e12:
                break
            cost, S, g, back = _normal_kernel(data, used, theta, q_ic, estimated, huber, damping)
    raise ValueError("the fit does not converge: are these the stars of these frames?")


def _turned(q_ic, rotation):
    """Attitudes turned by small rotations in camera axes. (n, 4), (n, 3) -> (n, 4)."""
    return np.array(
        [quat_normalise(quat_multiply(q, quat_from_rotvec(d))) for q, d in zip(q_ic, rotation, strict=True)]
    )


def _covariance(data, used, theta, q_ic, estimated):
    """Of the estimated parameters: inverse of the undamped Schur complement."""
    _, S, _, _ = _normal_kernel(data, used, theta, q_ic, estimated, np.inf, 0.0)
    scale = np.sqrt(np.abs(np.diag(S)))  # of the size of one each: the parameters differ by 1e7
    try:
        inverse = np.linalg.inv(S / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise ValueError("the frames do not determine the camera: all stars alike") from None
    covariance = inverse / np.outer(scale, scale)
    if not (np.diag(covariance) > 0.0).all():
        raise ValueError("the frames do not determine the camera: all stars alike")
    return covariance


def _distances2(data, theta, q_ic):
    """Squared distance of each centroid from its star in units of its sigma. (n,)."""
    return _distance_kernel(data, theta, q_ic)


@inner
def _star(theta, C, u_i):
    """Direction x, y, z in the camera; pixel; radial factor."""
    X = C[0, 0] * u_i[0] + C[1, 0] * u_i[1] + C[2, 0] * u_i[2]
    Y = C[0, 1] * u_i[0] + C[1, 1] * u_i[1] + C[2, 1] * u_i[2]
    Z = C[0, 2] * u_i[0] + C[1, 2] * u_i[1] + C[2, 2] * u_i[2]
    x, y = X / Z, Y / Z
    r2 = x * x + y * y
    radial = 1.0 + r2 * (theta[3] + r2 * theta[4])
    return x, y, r2, radial


@kernel
def _distance_kernel(data, theta, q_ic):
    out = np.empty(data.xy_px.shape[0])
    for frame in range(q_ic.shape[0]):
        C = dcm_from_quat(q_ic[frame])
        for k in range(data.begin[frame], data.begin[frame + 1]):
            x, y, _, radial = _star(theta, C, data.u_i[k])
            dx = data.xy_px[k, 0] - theta[1] - theta[0] * radial * x
            dy = data.xy_px[k, 1] - theta[2] - theta[0] * radial * y
            out[k] = (dx * dx + dy * dy) / data.sigma_px[k] ** 2
    return out


@inner
def _jacobian(theta, x, y, r2, radial, Jc, Ja):
    """Fill the derivatives of a pixel by the camera, Jc (2, 5), and by the rotation dtheta_c, Ja (2, 3)."""
    f = theta[0]
    Jc[:] = 0.0
    Jc[0, 0], Jc[1, 0] = radial * x, radial * y
    Jc[0, 1], Jc[1, 2] = 1.0, 1.0
    Jc[0, 3], Jc[1, 3] = f * x * r2, f * y * r2
    Jc[0, 4], Jc[1, 4] = f * x * r2 * r2, f * y * r2 * r2
    slope = 2.0 * (theta[3] + 2.0 * r2 * theta[4])  # d radial = slope (x dx + y dy)
    xx, xy, yy = f * (radial + slope * x * x), f * slope * x * y, f * (radial + slope * y * y)
    dx, dy = turn_slopes(x, y)
    for axis in range(3):
        Ja[0, axis], Ja[1, axis] = xx * dx[axis] + xy * dy[axis], xy * dx[axis] + yy * dy[axis]


@kernel
def _normal_kernel(data, used, theta, q_ic, estimated, huber, damping):
    """Normal equations with the attitudes eliminated.

    Parameters
    ----------
    data : _Data
    used : (n,) bool
    theta : (5,) the camera, in the order of NAMES
    q_ic : (n_frames, 4)
    estimated : (5,) bool, m of them true
    huber : float, HUBER or infinite
    damping : float, of Levenberg-Marquardt

    Returns
    -------
    cost : float, sum of Huber's function of the distances (chi2 if huber is infinite)
    S, g : (m, m), (m,) Schur complement and right-hand side: S step = g
    back : (n_frames, 3, m + 1) the rotation of frame k is back[k, :, m] - back[k, :, :m] step
    """
    columns = np.flatnonzero(estimated)
    m = len(columns)
    H, g, reduction = np.zeros((m, m)), np.zeros(m), np.zeros((m, m))
    back = np.zeros((q_ic.shape[0], 3, m + 1))
    cost = 0.0
    for frame in range(q_ic.shape[0]):
        rows = data.begin[frame], data.begin[frame + 1]
        A, E, b = np.zeros((3, 3)), np.zeros((3, m)), np.zeros(3)
        sums = A, E, b, H, g
        cost += _add_frame(data, rows, used, theta, q_ic[frame], columns, huber, sums)
        for r in range(3):
            A[r, r] *= 1.0 + damping
        inverse = inverse3(A)
        for r in range(3):
            for j in range(3):
                back[frame, r, m] += inverse[r, j] * b[j]
                for c in range(m):
                    back[frame, r, c] += inverse[r, j] * E[j, c]
        for r in range(m):
            for j in range(3):
                g[r] -= E[j, r] * back[frame, j, m]
                for c in range(m):
                    reduction[r, c] += E[j, r] * back[frame, j, c]
    for r in range(m):
        H[r, r] *= 1.0 + damping
    return cost, H - reduction, g, back


@inner
def _add_frame(data, rows, used, theta, q_ic, columns, huber, sums):
    """Add the stars of one frame, rows first ... last - 1 of the data, to the sums; returns their cost.

    sums : A (3, 3), E (3, m), b (3,) of this frame's attitude, H (m, m), g (m,) of the camera
    """
    A, E, b, H, g = sums
    C, m, cost = dcm_from_quat(q_ic), len(columns), 0.0
    Jc, Ja = np.zeros((2, 5)), np.zeros((2, 3))
    for k in range(rows[0], rows[1]):
        if not used[k]:
            continue
        x, y, r2, radial = _star(theta, C, data.u_i[k])
        _jacobian(theta, x, y, r2, radial, Jc, Ja)
        residual = (
            data.xy_px[k, 0] - theta[1] - theta[0] * radial * x,
            data.xy_px[k, 1] - theta[2] - theta[0] * radial * y,
        )
        distance = np.sqrt(residual[0] ** 2 + residual[1] ** 2) / data.sigma_px[k]
        weight = 1.0 / data.sigma_px[k] ** 2
        if distance > huber:
            cost += huber * (2.0 * distance - huber)
            weight *= huber / distance
        else:
            cost += distance**2
        for i in range(2):
            for r in range(3):
                b[r] += weight * Ja[i, r] * residual[i]
                for c in range(3):
                    A[r, c] += weight * Ja[i, r] * Ja[i, c]
                for c in range(m):
                    E[r, c] += weight * Ja[i, r] * Jc[i, columns[c]]
            for r in range(m):
                g[r] += weight * Jc[i, columns[r]] * residual[i]
                for c in range(m):
                    H[r, c] += weight * Jc[i, columns[r]] * Jc[i, columns[c]]
    return cost
