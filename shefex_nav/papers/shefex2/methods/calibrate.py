"""Calibration of the camera from identified frames: focal length, principal point, radial distortion.

In: centroids with their identified stars, frame by frame, and a first camera. Out: the camera that explains
them, with covariance. The attitude of each frame is estimated along and eliminated (Schur complement), so the
work grows with the number of frames, not with its cube. SHEFEX section 4 asks for focal length and principal
point; radial distortion after Brown (1966), x_d = x (1 + k1 r^2 + k2 r^4), x = X/Z.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from shefex_nav.geometry.pinhole import Pinhole, turn_slopes, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply, quat_normalise
from shefex_nav.onboard.startracker.attitude import esoq2

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
    cost, S, g, back = _normal_equations(data, used, theta, q_ic, estimated, huber, damping)
    for _ in range(MAX_STEPS):
        try:
            step = np.linalg.solve(S, g)
        except np.linalg.LinAlgError:
            raise ValueError("the frames do not determine the camera: all stars alike") from None
        new_theta = theta.copy()
        new_theta[estimated] += step
        new_q = _turned(q_ic, back[:, :, m] - back[:, :, :m] @ step)
        trial = _normal_equations(data, used, new_theta, new_q, estimated, huber, 0.1 * damping)
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
            cost, S, g, back = _normal_equations(data, used, theta, q_ic, estimated, huber, damping)
    raise ValueError("the fit does not converge: are these the stars of these frames?")


def _turned(q_ic, rotation):
    """Attitudes turned by small rotations in camera axes. (n, 4), (n, 3) -> (n, 4)."""
    return np.array(
        [quat_normalise(quat_multiply(q, quat_from_rotvec(d))) for q, d in zip(q_ic, rotation, strict=True)]
    )


def _covariance(data, used, theta, q_ic, estimated):
    """Of the estimated parameters: inverse of the undamped Schur complement."""
    _, S, _, _ = _normal_equations(data, used, theta, q_ic, estimated, np.inf, 0.0)
    scale = np.sqrt(np.abs(np.diag(S)))  # of the size of one each: the parameters differ by 1e7
    try:
        inverse = np.linalg.inv(S / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise ValueError("the frames do not determine the camera: all stars alike") from None
    covariance = inverse / np.outer(scale, scale)
    if not (np.diag(covariance) > 0.0).all():
        raise ValueError("the frames do not determine the camera: all stars alike")
    return covariance


def _residuals(data, theta, q_ic):
    """Ideal place of each star, its radial factor, and its centroid minus where the camera puts it.

    -> x, y = X/Z, Y/Z (n, 2); radial (n,); residual [px] (n, 2)
    """
    C_ic = np.repeat([dcm_from_quat(q) for q in q_ic], np.diff(data.begin), axis=0)
    u_c = np.einsum("nij,ni->nj", C_ic, data.u_i)
    ideal = u_c[:, :2] / u_c[:, 2:]
    r2 = (ideal**2).sum(axis=1)
    radial = 1.0 + r2 * (theta[3] + r2 * theta[4])
    return ideal, radial, data.xy_px - theta[1:3] - theta[0] * radial[:, None] * ideal


def _distances2(data, theta, q_ic):
    """Squared distance of each centroid from its star in units of its sigma. (n,)."""
    return (_residuals(data, theta, q_ic)[2] ** 2).sum(axis=1) / data.sigma_px**2


def _jacobian(theta, ideal, radial):
    """Derivatives of pixels (n, 2, 8): by the rotation dtheta_c, then by the camera in the order of NAMES."""
    f, r2 = theta[0], (ideal**2).sum(axis=1)[:, None]
    slope = 2.0 * (theta[3] + 2.0 * r2 * theta[4])  # d radial = slope (x dx + y dy)
    squares = ideal[:, :, None] * ideal[:, None]
    by_place = f * (radial[:, None, None] * np.eye(2) + slope[:, :, None] * squares)
    dx, dy = turn_slopes(*ideal.T)
    by_turn = by_place @ np.stack([np.column_stack(dx), np.column_stack(dy)], axis=1)
    by_point = np.broadcast_to(np.eye(2), (len(ideal), 2, 2))
    by_radial = f * ideal[:, :, None] * np.stack([r2, r2**2], axis=-1)
    return np.concatenate([by_turn, (radial[:, None] * ideal)[:, :, None], by_point, by_radial], axis=2)


def _normal_equations(data, used, theta, q_ic, estimated, huber, damping):
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
    ideal, radial, residual = (values[used] for values in _residuals(data, theta, q_ic))
    J = _jacobian(theta, ideal, radial)[:, :, np.concatenate([[True] * 3, estimated])]
    distance = np.sqrt((residual**2).sum(axis=1)) / data.sigma_px[used]
    is_far = distance > huber
    cost = np.where(is_far, huber * (2.0 * distance - huber), distance**2).sum()
    weight = np.where(is_far, huber / distance, 1.0) / data.sigma_px[used] ** 2
    WJ = weight[:, None, None] * J
    begin = np.concatenate([[0], np.cumsum(np.add.reduceat(used, data.begin[:-1]))[:-1]])
    M = np.add.reduceat(np.einsum("nij,nik->njk", WJ, J), begin)
    b = np.add.reduceat(np.einsum("nij,ni->nj", WJ, residual), begin)
    diagonal = np.arange(M.shape[1])
    M[:, diagonal, diagonal] *= 1.0 + damping
    E = M[:, :3, 3:]
    back = np.linalg.solve(M[:, :3, :3], np.concatenate([E, b[:, :3, None]], axis=2))
    reduction = np.einsum("fji,fjk->ik", E, back)
    return cost, M[:, 3:, 3:].sum(axis=0) - reduction[:, :-1], b[:, 3:].sum(axis=0) - reduction[:, -1], back
