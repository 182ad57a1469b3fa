"""One lens for all pictures of a camera: weighted least squares with an attitude of each picture.

In: named stars with centroids and covariances, picture by picture. Out: the lens and its covariance, in which
nothing is known of the attitudes: they are eliminated (Schur complement), so that the work grows with the
number of pictures. A shift of the principal point looks nearly like a turn of the camera, and decentring like
that shift; all are adjusted together, with the priors of `lens.spread`, so that what the stars do not tell
keeps a sigma as large as that of lenses nobody has measured.

Whether the pictures are of one lens: each gets a focal length of its own, and these have to agree (`groups`).
Everything else of the lens is common, so that a picture of few stars tells its focal length, too. The noise
is that of this fit: pictures of two lenses do not make it larger, and so do not hide their difference. Lenses
of one focal length are not told apart.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.solve import centroid_noise, steps
from shefex_nav.solve import lens as lenses

FALSE_ALARM = 1e-6  # of a set of pictures of one lens
# 1 sigma, of the focal length: what one lens changes untouched. Air lifts stars by 2.9e-4 tan z: it shrinks a
# picture at the zenith by 0.03 %, one at 30 deg by 0.07 % (both axes together); 30 K make 0.03 % at 1e-5/K.
UNTOUCHED = 3e-4
NAMES = ("focal_length_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
WIDER = (
    3.0  # than the priors of a single picture: here the stars are many, and unusual lenses are to be found
)
STEPS, SMALL = 30, 1e-4  # steps at most; a step of so many sigma of each parameter is the last
TOLD = 0.5  # of the prior's sigma: a parameter that keeps more was not told by the stars


class Sights(NamedTuple):
    """Named stars of one picture."""

    C_ci: np.ndarray  # (3, 3) first attitude
    u_i: np.ndarray  # (n, 3) directions as the moving camera sees them
    xy_px: np.ndarray  # (n, 2)
    P_px: np.ndarray  # (n, 2, 2) px^2


class Own(NamedTuple):
    """Step of the unknowns that are one picture's own: its turn, and what else it has for itself."""

    change: np.ndarray  # (a,)
    by_common: np.ndarray  # (a, k) how far they go back where the common unknowns go on
    inverse: np.ndarray  # (a, a) covariance, were the common unknowns known


class LensFit(NamedTuple):
    """The lens of all pictures."""

    values: np.ndarray  # (8,) of NAMES
    covariance: np.ndarray  # (8, 8), attitudes marginalised
    prior: np.ndarray  # (8,) standard deviations before the pictures; inf for the focal length
    attitudes: list  # (3, 3) C_ci of each picture
    used: list  # (n,) bool of each picture: False for a star that does not belong there
    residual_px: float  # RMS of the stars used, both axes together
    floor_px: float  # error that all centroids have besides their own
    multiple: float  # of their own covariances

    @property
    def sigma(self):
        """Standard deviations of the eight: (8,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def is_told(self):
        """Which parameters the stars tell, not the prior: (8,) bool."""
        return self.sigma < TOLD * self.prior


def fit(sights, first, size_px):
    """LensFit of Sights. first : Lens near it, whose attitude is not looked at;  size_px : (width, height)"""
    prior, expected = before(first.focal_px, size_px)
    values = np.array([first.focal_px, *lenses.middle(size_px), *first.k])
    attitudes = [one.C_ci for one in sights]
    used = [np.ones(len(one.u_i), dtype=bool) for one in sights]
    for _ in range(STEPS):
        equations = [linear(*both, values, size_px) for both in zip(sights, attitudes, strict=True)]
        residual, multiple, floor2, W, used = weighed(sights, equations, used, 3.0 * len(sights) + len(NAMES))
        change, covariance, own = step(equations, W, used, values - expected, prior)
        values = values + change
        attitudes = [dcm_from_rotvec(one.change) @ C for one, C in zip(own, attitudes, strict=True)]
        if (np.abs(change) < SMALL * np.sqrt(np.diag(covariance))).all():
            break
    rms = float(np.sqrt((residual**2).sum(axis=1).mean()))
    return LensFit(values, covariance, prior, attitudes, used, rms, float(np.sqrt(floor2)), float(multiple))


def before(focal_px, size_px):
    """What is known before the pictures: standard deviations and expected values of the eight, (8,) each."""
    spread = WIDER * lenses.spread(0.5 * float(np.hypot(*size_px)) / focal_px)
    prior = np.array([np.inf, *focal_px * spread[5:], *spread[:5]])
    return prior, np.array([0.0, *lenses.middle(size_px), *np.zeros(5)])


def lens_of(values, C_ci):
    """Lens of eight values, about the middle of the picture: without the principal point."""
    return lenses.Lens(C_ci, float(values[0]), tuple(values[3:].tolist()))


def places(values, C_ci, u_i, size_px):
    """Pixels of directions by eight values: (n, 2), NaN behind the camera."""
    at, _ = lenses.project(lens_of(values, C_ci), u_i, size_px)
    return at + values[1:3] - lenses.middle(size_px)


def linear(one, C_ci, values, size_px):
    """Jacobian (n, 2, 11) by turn and the eight, and residual (n, 2) [px], of a picture."""
    at = lens_of(values, C_ci)
    predicted, ideal = lenses.project(at, one.u_i, size_px)
    J = steps.jacobians(at.focal_px, at.terms, ideal)
    by_point = np.broadcast_to(np.eye(2), (len(ideal), 2, 2))
    J = np.concatenate([J[:, :, :3], J[:, :, 3:4] / values[0], by_point, J[:, :, 4:9]], axis=2)
    return J, one.xy_px - predicted - (values[1:3] - lenses.middle(size_px))


def weighed(sights, equations, used, n_lens):
    """Residuals (m, 2) [px] of the stars used, what they say of the noise, and which stars are used by that.

    equations : (Jacobian, residual) of each picture;  n_lens : squares that the unknowns take
    -> residuals, `multiple` and `floor2` of `noise_seen`, weights (n, 2, 2) and (n,) bool of each picture
    """
    residual = np.concatenate([e[keep] for (_, e), keep in zip(equations, used, strict=True)])
    P_px = np.concatenate([one.P_px[keep] for one, keep in zip(sights, used, strict=True)])
    multiple, floor2 = centroid_noise.noise_seen(residual, P_px, n_lens)
    W = [np.linalg.inv(multiple * one.P_px + floor2 * np.eye(2)) for one in sights]
    return residual, multiple, floor2, W, [fits(e, w) for (_, e), w in zip(equations, W, strict=True)]


def fits(residual, W):
    """Which stars are where the lens puts them; all, where most are not: (n,) bool."""
    near = np.einsum("ni,nij,nj->n", residual, W, residual) < steps.OUTLIER**2
    return near if near.sum() >= max(4, 0.6 * len(near)) else np.ones(len(near), dtype=bool)


def step(equations, W, used, off, prior):
    """Gauss-Newton step: change of the common unknowns (k,), their covariance (k, k), list of Own.

    equations : (Jacobian (n, 2, 11), residual (n, 2)) of each picture;  off : (k,) values of the last k of
    the eleven unknowns minus what `prior` (k,) expects; the unknowns before them are each picture's own
    """
    N, b = np.diag(prior**-2.0), -off * prior**-2.0
    a, parts = 3 + len(NAMES) - len(prior), []
    for (J, e), w, keep in zip(equations, W, used, strict=True):
        WJ = w[keep] @ J[keep]
        M = np.einsum("nij,nik->jk", J[keep], WJ)
        r = np.einsum("nij,ni->j", WJ, e[keep])
        scale = 1.0 / np.sqrt(np.diag(M)[:a])
        inverse = scale[:, None] * np.linalg.inv(scale[:, None] * M[:a, :a] * scale) * scale
        by_common, alone = inverse @ M[:a, a:], inverse @ r[:a]  # the picture's own unknowns eliminated
        N += M[a:, a:] - M[a:, :a] @ by_common
        b += r[a:] - M[a:, :a] @ alone
        parts.append((alone, by_common, inverse))
    scale = 1.0 / np.sqrt(np.diag(N))
    covariance = scale[:, None] * np.linalg.inv(scale[:, None] * N * scale) * scale
    change = covariance @ b
    own = [Own(alone - by_common @ change, by_common, inverse) for alone, by_common, inverse in parts]
    return change, covariance, own


class FocalLengths(NamedTuple):
    """Of each picture by itself, under a common principal point and distortion."""

    values: np.ndarray  # (m,) px
    covariance: np.ndarray  # (m, m) px^2, of the noise of the stars
    dof: float  # degrees of freedom that tell the noise


class Group(NamedTuple):
    """Pictures that agree."""

    members: np.ndarray  # (k,) numbers of the pictures
    focal_px: float
    sigma_px: float


def focal_lengths(sights, firsts, size_px):
    """FocalLengths of m pictures. sights : m Sights;  firsts : m Lens, as each picture tells it"""
    focal_px = np.array([one.focal_px for one in firsts])
    prior, expected = (x[1:] for x in before(float(np.median(focal_px)), size_px))
    values, attitudes = expected.copy(), [one.C_ci for one in sights]
    used = [np.ones(len(one.u_i), dtype=bool) for one in sights]
    n_lens = 4.0 * len(sights) + len(values)
    for _ in range(STEPS):
        equations = [
            linear(one, C, np.array([f, *values]), size_px)
            for one, C, f in zip(sights, attitudes, focal_px, strict=True)
        ]
        _, _, _, W, used = weighed(sights, equations, used, n_lens)
        change, common, own = step(equations, W, used, values - expected, prior)
        values = values + change
        attitudes = [dcm_from_rotvec(one.change[:3]) @ C for one, C in zip(own, attitudes, strict=True)]
        d = np.array([one.change[3] for one in own])
        focal_px = focal_px + d
        by_common = np.array([one.by_common[3] for one in own])
        covariance = by_common @ common @ by_common.T + np.diag([one.inverse[3, 3] for one in own])
        if (np.abs(d) < SMALL * np.sqrt(np.diag(covariance))).all():
            break
    dof = max(2.0 * sum(int(keep.sum()) for keep in used) - n_lens, 1.0)
    return FocalLengths(focal_px, covariance, dof)


def groups(found, untouched=UNTOUCHED):
    """Groups of pictures whose focal lengths agree, shortest first; one of all where the lens is one.

    found : FocalLengths;  untouched : 1 sigma, of the focal length, that a picture may have by itself
    """
    P = found.covariance + np.diag((untouched * found.values) ** 2)
    open_, done = [np.argsort(found.values)], []
    while open_:
        members = open_.pop()
        if _agree(found, P, members):
            done.append(Group(np.sort(members), *_mean(found.values, P, members)[:2]))
            continue
        cuts = range(1, len(members))
        misfits = [sum(_mean(found.values, P, part)[2] for part in np.split(members, [n])) for n in cuts]
        open_ += np.split(members, [cuts[int(np.argmin(misfits))]])
    return sorted(done, key=lambda one: one.focal_px)


def _agree(found, P, members):
    """Whether the members have one focal length; the noise is estimated, hence not chi squared but F."""
    from scipy.special import fdtrc

    n = len(members) - 1
    return n == 0 or fdtrc(n, found.dof, _mean(found.values, P, members)[2] / n) > FALSE_ALARM


def _mean(values, P, members):
    """Weighted mean of correlated values, its sigma, and chi squared about it."""
    W = np.linalg.inv(P[np.ix_(members, members)])
    weight = W.sum()
    mean = float((W @ values[members]).sum() / weight)
    d = values[members] - mean
    return mean, float(weight**-0.5), float(d @ W @ d)
