"""Is it true? The odds of the identification that flies, with the price of everything that was adjusted.

In: a fit to a picture. Out: the probability that chance made it. The detections go to the tracking of `bayes`
with the camera that the fit found and the fitted attitude as a prediction. Both came from the picture itself
and are no knowledge. So the odds pay for them: for the attitude the volume of all attitudes over that of the
prediction; for the focal length and the seven other terms of the lens what was thought possible over what
fits as well (Laplace's approximation of the integral over the prior); for two noise levels, two lists of
detections, a few depths of the catalogue and the lenses that proposals were made for their numbers. A pinhole
shows the picture of a lens with distortion as a patch with curved borders: what the rectangle around it has
more of area than the patch, chance does not get.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment.stars import select
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_dcm, rotvec_from_quat
from shefex_nav.onboard.startracker import tables
from shefex_nav.onboard.startracker.identify import bayes
from shefex_nav.onboard.startracker.identify.evidence import Prior, Scene, new_view
from shefex_nav.onboard.startracker.identify.screen import MAX_DETECTIONS, new_seen
from shefex_nav.onboard.startracker.identify.search import Task
from shefex_nav.onboard.startracker.identify.tracking import track
from shefex_nav.onboard.startracker.tables import Stars
from shefex_nav.solve import patterns
from shefex_nav.solve.camera import undistorted
from shefex_nav.solve.lens import camera_of, project

LEAST_PROBABILITY = 1e-300  # smaller ones are not told apart
FALSE_LIMIT = 1e-7  # accepted probability that a solution is chance
MAGNITUDE_SIGMA = 0.4  # the picture's band, colour cameras, saturated stars
QUIET_PX, NOISY_PX, LIMIT_PX = 0.25, 0.8, 0.6  # centroid noise: two classes, and the border between them
PREDICTED_PX = 1.0  # the prediction, as an error at the edge of the picture
ALONG = 16  # points of each border of the picture
NEAR = 0.01  # rad, between the fit and what is proved, at most
BUDGET = bayes.BUDGET // 4  # of the identification: the prediction is right or it is not
DEPTHS = (0.0, 1.2, 2.4)  # mag, how much of the catalogue's depth the picture may lack
LISTS = 2.0  # of detections that are tried: all, and those that are no gaps in a foreground
SAME_PX = 4.0  # at the corner, between the fit and what is proved
MIN_MATCHED = 5  # stars; four only fit any four numbers


class Proof(NamedTuple):
    """Outcome for one fit."""

    is_true: bool
    is_rivalled: bool  # another identification of the same stars is nearly as good
    n_matched: int
    false_probability: float


class Canvas(NamedTuple):
    """Rectangle of an ideal pinhole around a picture, in its pixels."""

    left_px: float
    top_px: float
    width_px: float
    height_px: float
    log_excess: float  # ln of its area over that of the picture on it


@lru_cache(maxsize=1)
def border():
    """Points around a picture, in shares of its width and height: (4 ALONG, 2)."""
    along, one = np.linspace(0.0, 1.0, ALONG, endpoint=False), np.ones(ALONG)
    return np.concatenate([
        np.column_stack([along, 0.0 * one]), np.column_stack([one, along]),
        np.column_stack([1.0 - along, one]), np.column_stack([0.0 * one, 1.0 - along]),
    ])  # fmt: skip


def canvas_of(camera):
    """Canvas of a Camera with distortion; the picture itself without."""
    w, h = camera.width_px, camera.height_px
    if camera.distortion is None:
        return Canvas(0.0, 0.0, float(w), float(h), 0.0)
    x, y = undistorted(camera, border() * [w, h] - 0.5).T
    area = 0.5 * abs((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    left, top, width, height = x.min() + 0.5, y.min() + 0.5, np.ptp(x), np.ptp(y)
    excess = float(np.log(max(width * height / area, 1.0)))
    return Canvas(float(left), float(top), float(width), float(height), excess)


def prove(fit, sky, xy_px, flux, size_px, log_focal_range, lenses_tried=1):
    """Probability that chance made a fit.

    Parameters
    ----------
    fit : Fit
    sky : StarCatalogue, brightest first, of the picture and a little around it, as deep as the picture
    xy_px, flux : (n, 2), (n,) detections, brightest first
    size_px : (width, height)
    log_focal_range : float, ln of the longest over the shortest focal length that was looked for
    lenses_tried : int, lenses for which proposals were made

    Returns
    -------
    Proof
    """
    lens = fit.lens
    camera = camera_of(lens, size_px)
    canvas = canvas_of(camera)
    corner = canvas.left_px, canvas.top_px
    xy_px, flux = undistorted(camera, xy_px[:MAX_DETECTIONS]) - corner, flux[:MAX_DETECTIONS]
    P_c, log_price = price(fit, size_px, log_focal_range, lenses_tried)
    log_price += canvas.log_excess * int((fit.star >= 0).sum())
    numbers = bayes.Numbers(
        canvas.width_px, canvas.height_px, lens.focal_px, *(np.array(camera.principal_point_px) - corner),
        bayes.BORDER_PX, QUIET_PX if fit.noise_px < LIMIT_PX else NOISY_PX, MAGNITUDE_SIGMA,
        FALSE_LIMIT * np.exp(-log_price), MIN_MATCHED, BUDGET,
    )  # fmt: skip
    mag = -2.5 * np.log10(flux)
    prediction = (True, quat_from_dcm(lens.axis_C_ci), P_c)
    sky = sky if camera.distortion is None else select(sky, _inside(lens, sky.u_i, size_px))
    best = Proof(False, False, 0, 1.0)
    for shallower in DEPTHS:
        seen = select(sky, sky.vmag <= sky.vmag[-1] - shallower) if len(sky.hip) else sky
        if len(seen.hip) < MIN_MATCHED:
            break
        found = bayes.Solution(*near(stars_of(seen, lens.axis_C_ci), numbers, xy_px, mag, prediction))
        n, rivalled = int((found.star >= 0).sum()), found.reason == bayes.AMBIGUOUS or best.is_rivalled
        chance = bounded(found.false_probability, log_price)
        is_true = found.reason == 0 and n >= MIN_MATCHED and is_of(fit, found, size_px)
        best = Proof(is_true, rivalled, n, chance)
        if best.is_true:
            break
    return best


def stars_of(sky, C_ci):
    """Stars as the identification takes them; every direction near the axis of the picture has all."""
    is_near = patterns.directions_of_cells()[0] @ C_ci[2] > least_cosine()
    n = len(sky.vmag)
    start = np.concatenate([[0], np.cumsum(n * is_near)])
    row = np.tile(np.arange(n, dtype=np.uint16), is_near.sum())
    return Stars(sky.u_i, sky.vmag, tables.log_density(sky.vmag), start, row)


@lru_cache(maxsize=1)
def least_cosine():
    """Of the angle between the middle of each cell of the sky grid and an axis that may be in it: (n,)"""
    return np.cos(patterns.directions_of_cells()[1] + NEAR)


@kernel
def near(stars, numbers, xy_px, magnitude, prediction):
    """The identification that flies, near a prediction alone: what it says elsewhere proves nothing.

    Parameters
    ----------
    stars : Stars;  numbers : bayes.Numbers
    xy_px, magnitude : (n, 2), (n,) of an ideal pinhole, brightest first
    prediction : (True, (4,) q_ci, (3, 3) rad^2)

    Returns
    -------
    bayes.Solution, as a plain tuple
    """
    _, q_ci, P_c = prediction
    n = min(xy_px.shape[0], MAX_DETECTIONS)
    scene = Scene(
        xy_px[:n], magnitude[:n], True, numbers.width_px, numbers.height_px, numbers.focal_px,
        numbers.cx_px, numbers.cy_px, numbers.border_px, numbers.centroid_error, numbers.magnitude_error,
        None,
    )  # fmt: skip
    is_narrow = max(P_c[0, 0], P_c[1, 1], P_c[2, 2]) < bayes.NARROW**2
    least = bayes.MIN_TRACKED if is_narrow else numbers.fewest_stars
    strict = -np.log(numbers.false_alarm)
    seen = new_seen(scene, None)
    prior = Prior(True, dcm_from_quat(q_ci), P_c)
    task = Task(stars, scene, prior, seen, bayes.new_best(n), new_view(), least, strict, strict)
    work = track(task, numbers.budget) if n >= least else 0
    return bayes.conclude(task, numbers, xy_px.shape[0], work, True)


def _inside(lens, u_i, size_px):
    """Stars that the lens puts into the picture: (n,) bool."""
    predicted, _ = project(lens, u_i, size_px)
    return ((predicted > -0.5) & (predicted < np.asarray(size_px) - 0.5)).all(axis=1)


def is_of(fit, found, size_px):
    """Whether what was proved is this fit: no corner of the picture apart. Another one proves nothing."""
    turned_c = rotvec_from_quat(quat_from_dcm(dcm_from_quat(found.q_ci) @ fit.lens.axis_C_ci.T))
    corner_px = 0.5 * np.hypot(*size_px)
    shift_px = np.hypot(np.hypot(turned_c[0], turned_c[1]) * fit.lens.focal_px, turned_c[2] * corner_px)
    return bool(shift_px < SAME_PX)


def bounded(wrong, log_price):
    """Probability times its price, from LEAST_PROBABILITY to 1."""
    with np.errstate(divide="ignore"):
        log_probability = np.log(wrong) + log_price
    return float(np.exp(min(max(log_probability, np.log(LEAST_PROBABILITY)), 0.0)))


def price(fit, size_px, log_focal_range, lenses_tried=1):
    """Covariance of the prediction (3, 3) [rad^2], and ln of what the adjusted numbers cost."""
    size = np.sqrt(size_px[0] * size_px[1])
    across, about = PREDICTED_PX / fit.lens.focal_px, PREDICTED_PX / (0.5 * size)
    P_c = np.diag([across**2, across**2, about**2])
    # the tracking takes twice the covariance; its density is at most that in the middle
    volume = np.sqrt((2.0 * np.pi) ** 3 * np.linalg.det(2.0 * P_c))
    cost = np.log(8.0 * np.pi**2 / volume) + of_lens(fit, log_focal_range)
    return P_c, float(cost + np.log(2.0 * LISTS * len(DEPTHS) * lenses_tried))


def of_lens(fit, log_focal_range):
    """ln of the volume of lenses that were thought possible over that of those that fit.

    The density of the prior at the fit, turned over, over that of the result in its middle: a focal length
    anywhere in the range, its terms by their standard deviations.
    """
    free = np.concatenate([[True], fit.prior > 0.0])
    P = fit.covariance[3:, 3:][np.ix_(free, free)]
    before = np.concatenate([[1.0], fit.prior])[free]
    scaled = P / before[:, None] / before
    _, log_det = np.linalg.slogdet(scaled)
    far2 = ((fit.lens.terms[fit.prior > 0.0] / fit.prior[fit.prior > 0.0]) ** 2).sum()
    cost = np.log(log_focal_range / np.sqrt(2.0 * np.pi)) - 0.5 * log_det + 0.5 * far2
    return max(float(cost), 0.0)
