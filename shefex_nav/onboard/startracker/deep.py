"""Deep matching: names for the objects that the identification left over, and the attitude of all of them.

The identification works with few bright stars, because it begins with nothing. Its attitude then says where
every star of a deeper catalogue is, to a fraction of a pixel. An object gets the name of the one star within
its gate. The gate is GATE_SIGMA wide, or narrower where the stars are so dense that chance would put one into
it more often than FALSE_MATCH; an object with two stars in the gate stays without a name, and so does one
whose star has another. A star also has to be as bright as its object, by a zero point from the stars named
before.
All magnitudes here, the limit among them, are in the band of the catalogue on board (`catalogue.system`).

Many stars tell their own noise: where the median of their distances is larger than chance makes it, all
covariances grow by that, before the gates and the test of single stars are applied again.

The attitude of all named stars is believed if it differs from the one before by no more than that one's
covariance allows. Otherwise the one before stays, with its names: an error of the deep stars never makes an
attitude worse that was good.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.distortion import farthest_px
from shefex_nav.geometry.elementary import log10
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, rotvec_between
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.onboard.startracker import best_attitude
from shefex_nav.onboard.startracker import catalogue as onboard_catalogue
from shefex_nav.onboard.startracker.catalogue import OnboardCatalogue
from shefex_nav.settings import changed

GATE_SIGMA = 6.0  # of the place of an object relative to its star
FALSE_MATCH = 1e-2  # probability that chance puts a star into the gate of an object that is none
FEWEST, DOUBT = 8, 2.5  # stars that tell their own noise; sigma by which it has to be larger than said
MAGNITUDE_SIGMA = 4.0  # of identification.magnitude_error
CONTRADICTION = 30.7  # chi-square of three degrees of freedom, 1e-6: so far may the attitude move


class DeepStars(NamedTuple):
    """Stars for the deep matching."""

    stars: OnboardCatalogue  # those of the identification in their rows, then the others
    n_first: int  # of the identification


def build(settings, first, catalogue, julian_year):
    """DeepStars of the settings.StarTracker, the OnboardCatalogue of its identification and all stars.

    identification.deepest is in the band of `catalogue.system`, as the magnitudes of `first` are: the zero
    point comes from those, and tells how bright the others look.

    catalogue : StarCatalogue, to V = 8;  CatalogueError: where it is not whole to `deepest` in that band
    """
    onboard_catalogue.check_deepest(settings)
    # a shallower limit of the south is that of the identification
    limit = {"kind": "magnitude_limited", "faintest": settings.identification.deepest, "faintest_south": None}
    more = onboard_catalogue.build(changed(settings.catalogue, limit), catalogue, julian_year)
    others = ~np.isin(more.hip, first.hip)
    stars = OnboardCatalogue(
        np.concatenate([first.hip, more.hip[others]]),
        np.ascontiguousarray(np.concatenate([first.u_i, more.u_i[others]])),
        np.concatenate([first.vmag, more.vmag[others]]),
        first.epoch,
    )
    return DeepStars(stars, len(first.hip))


def attitude(params, deep, star, solution, detections, velocity_i, least, rate=None):
    """Names of all objects and the attitude of all, or None where nothing is gained.

    Parameters
    ----------
    params : TrackerParams
    deep : DeepStars
    star : (n,) rows of the stars that the identification named, -1
    solution : (q_ic, P_c, residual_px) of those
    detections, velocity_i, least, rate : as in `best_attitude.of_named`

    Returns
    -------
    None, or star (n,), (q_ic, P_c, residual_px), StarVectors
    """
    named, scatter = names(params, deep, star, solution, detections, velocity_i, rate)
    if scatter > 1.0:  # wider gates, before the test of single stars takes noise for bad stars
        detections = detections._replace(P_px=scatter * detections.P_px)
        solution = solution[0], scatter * solution[1], solution[2]
        named, _ = names(params, deep, star, solution, detections, velocity_i, rate)
    if (named == star).all():
        return None
    n_used, *better, vectors = best_attitude.of_named(
        params, deep.stars, named, detections, velocity_i, least, rate
    )
    n_before = np.isin(vectors.hip, deep.stars.hip[star[star >= 0]]).sum()
    if n_used < least or 2 * n_before < (star >= 0).sum():
        return None  # the stars that proved the identification are those that do not fit
    d = rotvec_between(solution[0], better[0])
    if d @ np.linalg.solve(solution[1], d) > CONTRADICTION:
        return None
    return named, tuple(better), vectors


def names(params, deep, star, solution, detections, velocity_i, rate=None):
    """Row of the deep stars for each object, -1, and by how much their variance is larger than said.

    Those named before keep their names. -> (n,), float (`_scatter`)
    """
    camera, settings = params.camera.pinhole, params.settings.identification
    free = np.flatnonzero(star < 0)
    known = np.flatnonzero(star >= 0)
    if len(free) == 0:
        return star, 1.0
    rows, xy_px = _in_field(params.camera, deep, solution[0], velocity_i)
    rows, xy_px = _without(rows, xy_px, star[known])
    if len(rows) == 0:
        return star, 1.0
    S = _covariance(params, solution[1], detections, rate)[free]
    magnitude = -2.5 * log10(np.maximum(detections.flux_dn, 1e-9))
    zero = np.median(deep.stars.vmag[star[known]] - magnitude[known])
    off = magnitude[free, None] + zero - deep.stars.vmag[rows]
    alike = np.abs(off) < MAGNITUDE_SIGMA * settings.magnitude_error
    density = alike.sum(axis=1) / (camera.width_px * camera.height_px)
    area = math.pi * np.sqrt(np.linalg.det(S))  # of the gate of one sigma
    with np.errstate(divide="ignore"):
        gate2 = np.minimum(GATE_SIGMA**2, -math.log1p(-FALSE_MATCH) / (density * area))
    d = detections.xy_px[free, None] - xy_px
    distance2 = np.einsum("nmi,nij,nmj->nm", d, np.linalg.inv(S), d)
    within = (distance2 < gate2[:, None]) & alike
    alone = within.sum(axis=1) == 1
    within &= alone[:, None]
    object_, column = np.nonzero(within & (within.sum(axis=0) == 1))
    named = star.copy()
    named[free[object_]] = rows[column]
    own = free[object_]
    return named, _scatter(params, d[object_, column], detections.xy_px[own], S[object_])


def _scatter(params, off_px, xy_px, S):
    """By how much the variances of stars are larger than said, 1 unless the stars leave no doubt.

    A turn that all share is taken out: it may be an error of the attitude, or a contradiction to it. The
    median of a chi-square with two degrees of freedom is 2 ln 2; that of n of them is known to
    1 / (ln 2 sqrt(n)), relative.

    off_px, xy_px, S : (n, 2) objects relative to their stars, (n, 2), (n, 2, 2) px^2
    """
    n = len(off_px)
    if n < FEWEST:
        return 1.0
    G, W = turn_jacobians(params.camera.pinhole, xy_px), np.linalg.inv(S)
    WG = W @ G
    turn = np.linalg.solve(np.einsum("nij,nik->jk", G, WG), np.einsum("nij,ni->j", WG, off_px))
    rest = off_px - G @ turn
    median = np.median(np.einsum("ni,nij,nj->n", rest, W, rest)) * 2 * n / (2 * n - 3)
    ratio = float(median) / (2.0 * math.log(2.0))
    return ratio if ratio > 1.0 + DOUBT / (math.log(2.0) * math.sqrt(n)) else 1.0


def _in_field(model, deep, q_ic, velocity_i):
    """Rows and places [px] of the stars on the pinhole's detector, by an attitude. CameraModel"""
    C_ic, camera = dcm_from_quat(q_ic), model.pinhole
    half = math.atan(farthest_px(camera, model.distortion) / camera.focal_length_px)
    near = np.flatnonzero(deep.stars.u_i @ C_ic[:, 2] > math.cos(1.02 * half + 1e-3))
    seen_i = aberrate(np.ascontiguousarray(deep.stars.u_i[near]), velocity_i)
    xy_px = pixels(camera, np.ascontiguousarray(seen_i @ C_ic))
    size_px = np.array([camera.width_px, camera.height_px])
    on = ((xy_px > -1.0) & (xy_px < size_px)).all(axis=1)
    return near[on], xy_px[on]


def _without(rows, xy_px, taken):
    """The same without stars that are named already."""
    left = ~np.isin(rows, taken)
    return rows[left], xy_px[left]


def _covariance(params, P_c, detections, rate):
    """Covariance of each object relative to the place of its star, (n, 2, 2) px^2."""
    P_px = best_attitude.centroid_covariance(params, detections, rate)
    P_px = P_px + best_attitude.focal_covariance(params, detections.xy_px)
    G = turn_jacobians(params.camera.pinhole, detections.xy_px)
    return P_px + G @ P_c @ G.transpose(0, 2, 1)
