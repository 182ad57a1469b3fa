"""Attitude and lens that fit the stars of a picture, by weighted least squares.

In: a proposal that is right to a percent, detections with a covariance each. Out: the fit, the joint
covariance of attitude and lens, and which detection is which star. The lens is Brown's and Conrady's: three
radial terms and two of decentring, about an axis that is near the middle of the picture. All are adjusted
always, each with a prior that says what lenses are like (`spread`), so that the covariance of the attitude
has in it what nobody knows of the lens, with few stars as with many. The attitude is that of the middle of
the picture, which a narrow field tells wherever the axis is.

The final attitude (`adjust`) is of all named stars of a proven fit, weighted by what each is worth. A
centroid has the covariance of its own fit, which knows the noise of single pixels. What JPEG and a tone curve
do to noise makes it a multiple of that; what the lens is other than its model and the spots other than round
is an error that all have besides. Multiple and floor are not told: they are the ones of largest likelihood
for the residuals. How well those tell them counts as in decision 27: a variance known from nu squares counts
nu / (nu - 2) times.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import edges
from shefex_nav.geometry.distortion import BEHIND, bent, undistort
from shefex_nav.geometry.pinhole import Pinhole, unit_vectors
from shefex_nav.solve import steps
from shefex_nav.solve.camera import Camera, pinhole_of, undistorted

GATES = (0.008, 0.005, 0.0035, 0.0025, 0.0018, 0.0018)  # of the picture's diagonal: from proposal to fit
WIDE = 0.35  # tan of the half diagonal from which on what makers leave grows no more
OFF_CENTRE = 0.02 / 3.0  # of the diagonal, 1 sigma on each axis: where the axis is off the middle
NO_DISTORTION = (0.0, 0.0, 0.0, 0.0, 0.0)
IN_THE_MIDDLE = (0.0, 0.0)


class Lens(NamedTuple):
    """Orientation and optics of one picture."""

    C_ci: np.ndarray  # (3, 3) of axes through the middle of the picture
    focal_px: float
    k: tuple = NO_DISTORTION  # k1, k2, p1, p2, k3, the order of OpenCV
    off: tuple = IN_THE_MIDDLE  # x, y of the principal point from the middle, over the focal length

    @property
    def terms(self):
        """What `steps` knows of the lens besides its focal length: (7,)."""
        return np.array([*self.k, *self.off], dtype=float)

    @property
    def axis_C_ci(self):
        """Attitude of the axis of the lens (3, 3)."""
        return steps.axis_of(self.C_ci, self.terms) if any(self.off) else self.C_ci


class Fit(NamedTuple):
    """Lens, and how well it is known."""

    lens: Lens
    star: np.ndarray  # (n,) row of the stars per detection, -1
    residual_px: np.ndarray  # (n, 2) detection minus star, 0 where unmatched
    noise_px: float  # of a centroid per axis, from the residuals
    covariance: np.ndarray  # (11, 11) of (turn of the camera (3,) rad, ln f, `Lens.terms`)
    prior: np.ndarray  # (7,) standard deviations of `Lens.terms` before the picture; 0: as it was told


def spread(corner, may_distort=True):
    """Standard deviations of `Lens.terms` over lenses. corner : tan of the half diagonal -> (7,)

    In shares of the distance of a corner: a wide lens with a barrel of two per cent, a long one with less, up
    to one whose angles go linearly with the distance, r = f theta, which is -1/3, 1/5, -1/7 in powers of
    tan^2. Decentring is what makers leave: half a per mille of a wide lens, less of a long one. The axis is
    as far off the middle as the mounting of a detector leaves it, whatever the lens.
    """
    if not may_distort:
        return np.zeros(7)
    c2, made = corner * corner, min(1.0, corner / WIDE)
    k1, k2, k3 = (
        0.02 * made / c2 + 1.0 / 3.0,
        0.004 * made / c2**2 + 1.0 / 5.0,
        0.001 * made / c2**3 + 1.0 / 7.0,
    )
    decentred, off = 5e-4 * made / corner, 2.0 * OFF_CENTRE * corner
    return np.array([k1, k2, decentred, decentred, k3, off, off])


def project(lens, u_i, size_px):
    """Pixels of directions. (n, 3) -> xy_px (n, 2), NaN behind the camera; ideal x, y = X/Z, Y/Z (n, 2)."""
    u_c = u_i @ lens.axis_C_ci.T
    with np.errstate(divide="ignore", invalid="ignore"):
        ideal = np.where(u_c[:, 2:] > BEHIND, u_c[:, :2] / u_c[:, 2:], np.nan)
    return principal_point(lens, size_px) + lens.focal_px * bent(lens.k, ideal), ideal


def middle(size_px):
    """(cx, cy) of a picture (width, height)."""
    return 0.5 * (np.asarray(size_px, dtype=float) - 1.0)


def principal_point(lens, size_px):
    """Where the axis of the lens meets the picture: (2,) px."""
    return middle(size_px) + lens.focal_px * np.array(lens.off)


def camera_of(lens, size_px):
    """Camera of a fit; its axes are those of `Lens.axis_C_ci`."""
    centre = tuple(principal_point(lens, size_px).tolist()) if any(lens.off) else None
    return Camera(*size_px, lens.focal_px, centre, lens.k if any(lens.k) else None)


def fit(lens, u_i, xy_px, size_px, *, gates=GATES, least=4, may_distort=True):
    """Least squares from a proposal, with gates from wide to narrow; None when fewer than `least` match.

    Parameters
    ----------
    lens : Lens
    u_i : (m, 3) stars that may be in the picture
    xy_px : (n, 2) detections
    size_px : (width, height)
    gates : of the diagonal, one a step
    least : int, matches
    may_distort : bool; False: the lens is as it was told but for its focal length

    Returns
    -------
    Fit, or None
    """
    if len(u_i) == 0 or len(xy_px) == 0:
        return None
    diagonal = float(np.hypot(*size_px))
    prior = spread(0.5 * diagonal / lens.focal_px, may_distort)
    ok, C_ci, focal_px, terms, *rest = steps.fitted(
        (lens.C_ci, float(lens.focal_px), lens.terms), u_i, xy_px,
        tuple(map(float, size_px)), prior, np.array(gates) * diagonal, least,
    )  # fmt: skip
    if not ok:
        return None
    found = of_terms(C_ci, focal_px, terms)
    return Fit(found, *rest, prior) if is_lens(found, size_px) else None


def of_terms(C_ci, focal_px, terms):
    """Lens of what `steps` has found."""
    return Lens(C_ci, focal_px, tuple(terms[:5].tolist()), tuple(terms[5:].tolist()))


def directions(camera, xy_px):
    """Unit vectors of pixels in camera axes. Camera, (n, 2) -> (n, 3)."""
    return unit_vectors(pinhole_of(camera), undistorted(camera, xy_px))


def rays(lens, size_px, xy_px):
    """Unit vectors of pixels of a picture (width, height) in axes of the lens. (n, 2) -> (n, 3)."""
    hole = Pinhole(*size_px, float(lens.focal_px), *principal_point(lens, size_px).tolist())
    if any(lens.k):
        xy_px = undistort(hole, np.array(lens.k), np.ascontiguousarray(xy_px))
    return unit_vectors(hole, xy_px)


def corner_angle(lens, size_px):
    """Angle from the axis to the farthest corner, at least [rad]."""
    return edges.corner_angle(float(lens.focal_px), np.array(lens.k), _as_wide(lens, size_px))


def is_lens(lens, size_px):
    """Whether each corner is the image of one direction: a polynomial may fold, where few stars hold it."""
    return edges.is_lens(float(lens.focal_px), np.array(lens.k), _as_wide(lens, size_px))


def _as_wide(lens, size_px):
    """Size of a picture with its middle on the axis that reaches as far to either side as this one does."""
    return tuple((np.asarray(size_px) + 2.0 * lens.focal_px * np.abs(lens.off)).tolist())


def across(lens, size_px):
    """Field of view between the middles of the left and the right edge [rad]."""
    return edges.across(float(lens.focal_px), np.array(lens.k), tuple(map(float, size_px)))


class Adjusted(NamedTuple):
    """Lens, and the covariance of what was adjusted."""

    lens: Lens
    covariance: np.ndarray  # (11, 11), as in `lens.Fit`, with what the residuals say of the noise
    used: np.ndarray  # (n,) bool, of the named stars given
    residual_px: float  # RMS of the stars used
    floor_px: float  # error that all centroids have besides their own
    multiple: float  # of their own covariances


def adjust(lens, prior, u_i, xy_px, P_px, size_px):
    """Weighted least squares of attitude and lens over stars that have a name.

    Parameters
    ----------
    lens : Lens, within pixels
    prior : (7,) standard deviations of `Lens.terms`, 0 where they are told
    u_i, xy_px, P_px : (n, 3), (n, 2), (n, 2, 2) px^2
    size_px : (width, height)

    Returns
    -------
    Adjusted
    """
    ok, C_ci, focal_px, terms, covariance, used, n_lens, multiple, floor2 = steps.adjusted(
        lens.C_ci, float(lens.focal_px), lens.terms, prior, u_i, xy_px, P_px, tuple(map(float, size_px)),
    )  # fmt: skip
    if not ok:
        raise np.linalg.LinAlgError("the stars of a proven picture do not tell its attitude")
    lens = of_terms(C_ci, focal_px, terms)
    predicted, _ = project(lens, u_i[used], size_px)
    rest = xy_px[used] - predicted
    nu = max(2.0 * used.sum() - n_lens, 0.5)
    grown = nu / (nu - 2.0) if nu > 4.0 else 2.0 * (4.0 / nu) ** 2  # no variance at two squares: very large
    rms = float(np.sqrt((rest**2).sum() / max(used.sum(), 1)))
    return Adjusted(lens, grown * covariance, used, rms, float(np.sqrt(floor2)), multiple)


def of_axis(covariance):
    """Covariance of the attitude of the axis of the lens, from that of an Adjusted: (11, 11) -> (3, 3) rad^2.

    A principal point that moves by (x, y) turns the lens by (y, -x) against the middle of the picture, as in
    `steps.fill_jacobian`: the axis is known less well by what is not known of the principal point.
    """
    G = np.zeros((3, steps.UNKNOWNS))
    G[:, :3] = np.eye(3)
    G[0, 10], G[1, 9] = 1.0, -1.0
    return G @ covariance @ G.T
