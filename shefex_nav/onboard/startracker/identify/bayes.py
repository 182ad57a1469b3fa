"""Identification by the odds against chance: pairs, a k-vector, a sky grid and a Bayes factor.

The default of the project. Attitudes are proposed by pairs of detections (`search`), adjusted to all stars
that fit (`evidence`) and weighed against chance (`odds`). An attitude is given out only if the expected
number of chance attitudes as good as it is below a limit, in this frame, with its number of detections and
the catalogue as it is there. With a prediction, the few pairs near it are tried first and three stars are
enough (`tracking`); if they do not convince, the search begins again from nothing.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.elementary import log10
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_dcm
from shefex_nav.onboard.startracker.identify.doubts import (
    fits_badly,
    has_second_image,
    leans_on_one_star,
    recall,
)
from shefex_nav.onboard.startracker.identify.ellipses import checked, ellipses_of
from shefex_nav.onboard.startracker.identify.evidence import (
    WIDE_GATE,
    Prior,
    Scene,
    new_view,
    solve_cholesky,
)
from shefex_nav.onboard.startracker.identify.lever import no_lever
from shefex_nav.onboard.startracker.identify.screen import MAX_DETECTIONS, Seen, detection_table
from shefex_nav.onboard.startracker.identify.search import Best, Task, look, lost_in_space, margin
from shefex_nav.onboard.startracker.identify.tracking import track
from shefex_nav.onboard.startracker.identify.verify import Identification
from shefex_nav.onboard.startracker.likelihood import misfit_factor
from shefex_nav.records import Reason

# Expected number of chance attitudes with ln B > x is CHANCE exp(-x): the mean of B over chance fields is
# one, but nearly all of it is in the fields that the truth makes, far above any limit. Measured.
CHANCE = 0.003
MIN_STARS = 4
MIN_TRACKED = 3  # with a prediction ...
NARROW = np.radians(0.3)  # ... whose sigma is below this about each axis; a wide one leaves room for chance
BUDGET = 400_000  # stars looked at, before giving up
PRIOR_DOF = 4.0  # weight of the expected variance of the centroids against the one of this frame [E]
NOISY = 1.3  # times the expected centroid error: the focal length may be off
BORDER_PX = 5.0  # a predicted star nearer to the border may be missing

TOO_FEW_STARS, NO_MATCH = int(Reason.TOO_FEW_STARS), int(Reason.NO_MATCH)
AMBIGUOUS, RESIDUALS = int(Reason.AMBIGUOUS), int(Reason.RESIDUALS)


class Settings(NamedTuple):
    """What is said of the camera; plain numbers, passed on to compiled code."""

    width_px: float
    height_px: float
    focal_px: float
    cx_px: float
    cy_px: float
    border_px: float
    sigma_px: float
    magnitude_sigma: float
    false_limit: float
    min_stars: int
    budget: int


class Solution(NamedTuple):
    """Outcome of one frame."""

    reason: int  # Reason; NONE = identified
    star: np.ndarray  # (n,) int64 row of the catalogue, -1 where unidentified
    q_ci: np.ndarray  # (4,)
    P_c: np.ndarray  # (3, 3) rad^2, covariance of the rotation-vector error in camera axes
    log_odds: float  # ln B of the best attitude, given out or not
    false_probability: float  # expected number of chance attitudes as good
    work: int  # stars looked at
    tracked: bool  # found near the prediction


def identify(params, pairs, u_c, flux, P_px=None):
    """Identify the stars of one frame without any idea of the attitude.

    Parameters
    ----------
    params : IdentifyParams
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera
    flux : (n,) brightness, descending
    P_px : (n, 2, 2) px^2, covariance of each centroid; None: params.sigma_px for all

    Returns
    -------
    Identification
    """
    return _identify(params, pairs, u_c, flux, NO_PREDICTION, P_px)[0]


def identify_near(params, pairs, u_c, flux, prediction, P_px=None):
    """Identify the stars of one frame, first near a predicted attitude, then without.

    Parameters
    ----------
    params, pairs, u_c, flux, P_px : as in `identify`
    prediction : (q_ci, P_c), attitude and covariance (3, 3) [rad^2] of its error in camera axes

    Returns
    -------
    Identification
    tracked : bool, the prediction was confirmed; MIN_TRACKED stars are enough then
    """
    return _identify(params, pairs, u_c, flux, (True, *prediction), P_px)


def _identify(params, pairs, u_c, flux, prediction, P_px):
    """(Identification, whether the prediction was confirmed)."""
    camera = params.camera
    settings = Settings(
        float(camera.width_px),
        float(camera.height_px),
        float(camera.focal_length_px),
        float(camera.cx_px),
        float(camera.cy_px),
        BORDER_PX,
        float(params.sigma_px),
        float(params.magnitude_sigma),
        float(params.false_alarm),
        max(int(params.min_stars), MIN_STARS),
        BUDGET,
    )
    magnitude = -2.5 * log10(flux)
    frame = pixels(camera, u_c), magnitude, True
    if P_px is None:
        found = Solution(*solve_kernel(*pairs.quick, settings, *frame, prediction))
    else:
        ellipses = ellipses_of(checked(P_px, len(u_c)), settings.sigma_px)
        found = Solution(*solve_kernel(*pairs.quick, settings, *frame, prediction, ellipses))
    return Identification(found.star, int(found.reason), float(found.log_odds)), found.tracked


NO_PREDICTION = (False, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros((3, 3)))


@kernel
def solve_kernel(stars, pairs, settings, xy_px, magnitude, has_flux, prediction, ellipses=None):
    """Attitude of one frame; detections brightest first, if there is a flux.

    Parameters
    ----------
    stars, pairs : Stars, Pairs
    settings : Settings
    xy_px : (n, 2) of an ideal pinhole
    magnitude : (n,) -2.5 log10 flux
    has_flux : bool
    prediction : (bool, (4,), (3, 3) rad^2) whether there is one, its q_ci, covariance of its error in camera
        axes; NO_PREDICTION where there is none
    ellipses : Ellipses of the centroids; None: settings.sigma_px for all

    Returns
    -------
    Solution, as a plain tuple
    """
    has_prediction, q_ci, P_c = prediction
    n = min(xy_px.shape[0], MAX_DETECTIONS)
    scene = Scene(
        xy_px[:n], magnitude[:n], has_flux, settings.width_px, settings.height_px, settings.focal_px,
        settings.cx_px, settings.cy_px, settings.border_px, settings.sigma_px, settings.magnitude_sigma,
        ellipses,
    )  # fmt: skip
    threshold = np.log(CHANCE / settings.false_limit)
    strict = -np.log(settings.false_limit)  # CHANCE is that of searches without a prediction
    prior = Prior(has_prediction, dcm_from_quat(q_ci), P_c)
    is_narrow = max(P_c[0, 0], P_c[1, 1], P_c[2, 2]) < NARROW**2
    least = MIN_TRACKED if is_narrow else settings.min_stars
    seen = Seen(detection_table(scene), scene.xy_px, ellipses)
    tracked = Task(stars, scene, prior, seen, new_best(n), new_view(), least, strict)
    work = 0
    if has_prediction and n >= least and np.isfinite(q_ci.sum() + P_c.sum()):
        work = track(tracked, settings.budget // 4)
        found = conclude(tracked, settings, xy_px.shape[0], work, True)
        if found[0] == 0:
            return found
    nothing = Prior(False, prior.C_ci, P_c)
    lost = Task(stars, scene, nothing, seen, new_best(n), tracked.room, settings.min_stars, threshold)
    if n >= settings.min_stars:
        work += lost_in_space(lost, pairs, settings.budget - work)
    return conclude(lost, settings, xy_px.shape[0], work, False)


@inner
def new_best(n):
    """Nothing found yet in n detections."""
    score = np.array([-np.inf, -np.inf, 3.0, 0.0, 1.0, 1.0])
    return Best(np.zeros((3, 3)), np.full(n, -1, dtype=np.int64), np.eye(3), np.zeros((4, 4)), score)


@inner
def conclude(task, settings, n, work, tracked):
    """Reason, and the attitude if it is certain."""
    best = task.best
    star = np.full(n, -1, dtype=np.int64)
    if best.score[2] < 4.0 and best.score[5] > NOISY * settings.sigma_px and margin(task) >= task.threshold:
        best.trial_C[:] = best.C  # is it the focal length?
        gate_px = WIDE_GATE * settings.sigma_px
        look(task, settings.focal_px, gate_px, no_lever(gate_px), True)
    odds, rival = best.score[0], best.score[1]
    wrong = min(
        (1.0 if tracked else CHANCE) * np.exp(-odds) + (np.exp(rival - odds) if rival > 0.0 else 0.0), 1.0
    )
    k, n_par = (best.star >= 0).sum(), int(best.score[2])
    reason = verdict(task, k, n_par)
    if reason != 0:
        return reason, star, np.full(4, np.nan), np.full((3, 3), np.nan), odds, wrong, work, tracked
    star[: len(best.star)] = best.star
    variance = settings.sigma_px**2
    variance *= misfit_factor(best.score[3] / variance, 2 * k - n_par, PRIOR_DOF)
    P_c = np.empty((3, 3))
    for c in range(3):
        column = np.zeros(4)
        column[c] = variance
        solve_cholesky(best.L, column, n_par)
        for a in range(3):
            P_c[a, c] = column[a]
    return 0, star, quat_from_dcm(best.C), P_c, odds, wrong, work, tracked


@inner
def verdict(task, n_matched, n_par):
    """Why the best attitude must not be given out: a Reason, 0 when it may be; see `doubts`."""
    best = task.best
    if margin(task) < task.threshold:
        if best.score[0] >= task.threshold:
            return AMBIGUOUS
        return TOO_FEW_STARS if len(best.star) < task.min_stars else NO_MATCH
    focal_px, noise_px = best.score[4], best.score[5]
    n = recall(task, focal_px)
    if fits_badly(task, n, n_matched, n_par):
        return RESIDUALS
    if leans_on_one_star(task, n, focal_px, noise_px, n_par) or has_second_image(task, n, noise_px):
        return AMBIGUOUS
    return 0
