"""The final attitude of a picture: all its named stars, weighted by what each is worth, with its covariance.

In: a proven fit, the stars of all detections. Out: the adjusted lens and the joint covariance of attitude
and lens. A centroid has the covariance of its own fit, which knows the noise of single pixels. What JPEG and
a tone curve do to noise makes it a multiple of that; what the lens is other than its model and the spots
other than round is an error that all have besides. Multiple and floor are not told: they are the ones of
largest likelihood for the residuals. How well those tell them counts as in decision 27: a variance known from
nu squares counts nu / (nu - 2) times.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.solve import lens as lenses
from shefex_nav.solve import steps


class Adjusted(NamedTuple):
    """Lens, and the covariance of what was adjusted."""

    lens: lenses.Lens
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
    lens = lenses.of_terms(C_ci, focal_px, terms)
    predicted, _ = lenses.project(lens, u_i[used], size_px)
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
