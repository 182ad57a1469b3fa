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

from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.solve import lens as lenses

STEPS = 12  # bound only: four are usual
SMALL = 1e-8  # rad; the next step is smaller by its square
FLOORS = 30  # halvings of the search for the floor
MULTIPLES = 2.0 ** np.arange(-2.0, 6.5, 0.5)  # of the covariances of the centroids
OUTLIER = 4.0  # standard deviations; a star further from where the lens puts it is named, not weighed
MOST_FLOOR_PX = 8.0


class Adjusted(NamedTuple):
    """Lens, and the covariance of what was adjusted."""

    lens: lenses.Lens
    covariance: np.ndarray  # (9, 9), as in `lens.Fit`, with what the residuals say of the noise
    used: np.ndarray  # (n,) bool, of the named stars given
    residual_px: float  # RMS of the stars used
    floor_px: float  # error that all centroids have besides their own
    multiple: float  # of their own covariances


def adjust(lens, prior, u_i, xy_px, P_px, size_px):
    """Weighted least squares of attitude, focal length and distortion over stars that have a name.

    Parameters
    ----------
    lens : Lens, within pixels
    prior : (5,) standard deviations of the distortion, 0 where it is told
    u_i, xy_px, P_px : (n, 3), (n, 2), (n, 2, 2) px^2
    size_px : (width, height)

    Returns
    -------
    Adjusted
    """
    used, n_lens = np.ones(len(xy_px), dtype=bool), 4.0
    for _ in range(STEPS):
        predicted, ideal = lenses.project(lens, u_i, size_px)
        residual = xy_px - predicted
        J = lenses.jacobian(lens, ideal)
        multiple, floor2 = noise_of(residual[used], P_px[used], n_lens)
        W = np.linalg.inv(multiple * P_px + floor2 * np.eye(2))
        kept = np.einsum("ni,nij,nj->n", residual, W, residual) < OUTLIER**2
        if kept.sum() >= max(5, 0.6 * len(xy_px)):
            used = kept
        change, covariance, WJ = lenses.solved(J[used], W[used], residual[used], lens.k, prior)
        # degrees of freedom that the unknowns take, of which a prior leaves a part
        n_lens = float(np.einsum("nij,jk,nik->", WJ, covariance, J[used]))
        k = tuple((np.array(lens.k) + change[4:]).tolist())
        turned = dcm_from_rotvec(change[:3]) @ lens.C_ci
        lens = lenses.Lens(turned, lens.focal_px * float(np.exp(change[3])), k)
        if np.abs(change[:3]).max() < SMALL:
            break
    predicted, _ = lenses.project(lens, u_i[used], size_px)
    rest = xy_px[used] - predicted
    nu = max(2.0 * used.sum() - n_lens, 0.5)
    grown = nu / (nu - 2.0) if nu > 4.0 else 2.0 * (4.0 / nu) ** 2  # no variance at two squares: very large
    rms = float(np.sqrt((rest**2).sum() / max(used.sum(), 1)))
    return Adjusted(lens, grown * covariance, used, rms, float(np.sqrt(floor2)), multiple)


def noise_of(residual_px, P_px, n_lens):
    """Multiple of the covariances and variance of the floor [px^2] of largest likelihood.

    Each multiple has the floor that makes chi squared what its degrees of freedom say. n_lens : of those
    that the unknowns take
    """
    values, vectors = np.linalg.eigh(P_px)
    along2 = np.einsum("nij,ni->nj", vectors, residual_px) ** 2
    dof = max(2.0 * len(residual_px) - n_lens, 1.0)
    best = np.inf, 1.0, 0.0
    for multiple in MULTIPLES:
        floor2 = _floor(along2, multiple * values, dof)
        whole = multiple * values + floor2
        # minus twice the logarithm of the restricted likelihood, the unknowns' share left out
        cost = (1.0 - n_lens / (2.0 * len(residual_px))) * np.log(whole).sum() + (along2 / whole).sum()
        if cost < best[0]:
            best = cost, float(multiple), float(floor2)
    return best[1:]


def _floor(along2, values, dof):
    """Variance [px^2] that, added to `values`, makes chi squared equal to its degrees of freedom.

    along2 : (n, 2) squared residuals along the axes of the covariances, whose eigenvalues are `values`
    """
    low, high = lenses.LEAST_FLOOR_PX**2, MOST_FLOOR_PX**2
    if (along2 / (values + low)).sum() <= dof:
        return low
    for _ in range(FLOORS):
        between = np.sqrt(low * high)
        low, high = (between, high) if (along2 / (values + between)).sum() > dof else (low, between)
    return np.sqrt(low * high)
