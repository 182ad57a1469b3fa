"""Whether pictures are of one lens: each gets a focal length of its own, and these have to agree.

Everything else of the lens is common, so that a picture of few stars tells its focal length, too. The noise
is that of this fit: pictures of two lenses do not make it larger, and so do not hide their difference. Lenses
of one focal length are not told apart.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.solve import centroid_noise
from shefex_nav.solve.calibration import lens_fit

FALSE_ALARM = 1e-6  # of a set of pictures of one lens
# 1 sigma, of the focal length: what one lens changes untouched. Air lifts stars by 2.9e-4 tan z: it shrinks a
# picture at the zenith by 0.03 %, one at 30 deg by 0.07 % (both axes together); 30 K make 0.03 % at 1e-5/K.
UNTOUCHED = 3e-4


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
    prior, expected = (x[1:] for x in lens_fit.before(float(np.median(focal_px)), size_px))
    values, attitudes = expected.copy(), [one.C_ci for one in sights]
    used = [np.ones(len(one.u_i), dtype=bool) for one in sights]
    n_lens = 4.0 * len(sights) + len(values)
    for _ in range(lens_fit.STEPS):
        equations = [
            lens_fit.linear(one, C, np.array([f, *values]), size_px)
            for one, C, f in zip(sights, attitudes, focal_px, strict=True)
        ]
        residual = np.concatenate([e[keep] for (_, e), keep in zip(equations, used, strict=True)])
        P_px = np.concatenate([one.P_px[keep] for one, keep in zip(sights, used, strict=True)])
        multiple, floor2 = centroid_noise.noise_seen(residual, P_px, n_lens)
        W = [np.linalg.inv(multiple * one.P_px + floor2 * np.eye(2)) for one in sights]
        used = [lens_fit.fits(e, w) for (_, e), w in zip(equations, W, strict=True)]
        change, common, own = lens_fit.step(equations, W, used, values - expected, prior)
        values = values + change
        attitudes = [dcm_from_rotvec(one.change[:3]) @ C for one, C in zip(own, attitudes, strict=True)]
        d = np.array([one.change[3] for one in own])
        focal_px = focal_px + d
        by_common = np.array([one.by_common[3] for one in own])
        covariance = by_common @ common @ by_common.T + np.diag([one.inverse[3, 3] for one in own])
        if (np.abs(d) < lens_fit.SMALL * np.sqrt(np.diag(covariance))).all():
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
