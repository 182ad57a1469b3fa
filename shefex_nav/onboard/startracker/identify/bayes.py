"""Identification by the odds against chance: pairs, a k-vector, a sky grid and a Bayes factor.

The default of the project. Attitudes are proposed by pairs of detections (`search`), adjusted to all stars
that fit (`evidence`) and weighed against chance (`odds`). An attitude is given out only if the expected
number of chance attitudes as good as it is below a limit, in this frame, with its number of detections and
the catalogue as it is there. With a prediction, the few pairs near it are tried first and three stars are
enough (`tracking`); if they do not convince, the search begins again from nothing.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel, lent
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, quat_conjugate, quat_from_dcm
from shefex_nav.onboard.startracker.identify.doubts import (
    fits_badly,
    has_second_image,
    is_named_for_a_neighbour,
    leans_on_one_star,
    recall,
)
from shefex_nav.onboard.startracker.identify.ellipses import are_covariances, checked, ellipses_of
from shefex_nav.onboard.startracker.identify.evidence import (
    BORDER_PX,
    GATE,
    WIDE_GATE,
    Prior,
    Scene,
    new_view,
    predict,
    solve_cholesky,
)
from shefex_nav.onboard.startracker.identify.lever import REACH_PX, no_lever
from shefex_nav.onboard.startracker.identify.screen import MAX_DETECTIONS, new_seen
from shefex_nav.onboard.startracker.identify.search import (
    Task,
    changed,
    look,
    lost_in_space,
    margin,
    new_best,
)
from shefex_nav.onboard.startracker.identify.tracking import track
from shefex_nav.onboard.startracker.identify.verify import Identification
from shefex_nav.onboard.startracker.likelihood import misfit_factor
from shefex_nav.records import Reason

# Expected number of chance attitudes with ln B > x is CHANCE exp(-x): the mean of B over chance fields is
# one, but nearly all of it is in the fields that the truth makes, far above any limit. Measured.
CHANCE = 0.003
ALONE = 0.3  # the same of one star that sets the turn: there are as many chances as false detections
MIN_STARS = 4
MIN_TRACKED = 3  # with a prediction ...
NARROW = np.radians(0.3)  # ... whose sigma is below this about each axis; a wide one leaves room for chance
BUDGET = 80_000  # stars looked at, before giving up
PRIOR_DOF = 4.0  # weight of the expected variance of the centroids against the one of this frame [E]
MANY = 7.0  # [E] squares (seven stars) that tell a noise well enough to fit again with it
MOST_NOISE = 12.0  # times the told centroid error: with more, stars leave the place where they are looked for
OTHER_NOISE = 5.0  # [E] times the told centroid error: nothing that was told of it holds, and then ...
WRONG, WRONG_LIMIT = np.radians(0.5), 1e-3  # ... no attitude that may be so far off, by this probability
NOISY = 1.3  # times the expected centroid error: the focal length may be off

TOO_FEW_STARS, NO_MATCH = int(Reason.TOO_FEW_STARS), int(Reason.NO_MATCH)
AMBIGUOUS, RESIDUALS = int(Reason.AMBIGUOUS), int(Reason.RESIDUALS)


class Numbers(NamedTuple):
    """Camera and settings as plain numbers, passed on to compiled code."""

    width_px: float
    height_px: float
    focal_px: float
    cx_px: float
    cy_px: float
    border_px: float
    centroid_error: float
    magnitude_error: float
    false_alarm: float
    fewest_stars: int
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


def identify(settings, camera, pairs, u_c, flux, P_px=None):
    """Identify the stars of one frame without any idea of the attitude.

    Parameters
    ----------
    settings : Identification
    camera : CameraModel
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera
    flux : (n,) brightness, descending
    P_px : (n, 2, 2) px^2, covariance of each centroid; None: settings.centroid_error for all

    Returns
    -------
    Identification
    """
    return _identify(settings, camera, pairs, u_c, flux, NO_PREDICTION, P_px)[0]


def identify_near(settings, camera, pairs, u_c, flux, prediction, P_px=None):
    """Identify the stars of one frame, first near a predicted attitude, then without.

    Parameters
    ----------
    settings, camera, pairs, u_c, flux, P_px : as in `identify`
    prediction : (q_ic, P_c), attitude and covariance (3, 3) [rad^2] of its error in camera axes

    Returns
    -------
    Identification
    tracked : bool, the prediction was confirmed; MIN_TRACKED stars are enough then
    """
    return _identify(settings, camera, pairs, u_c, flux, (True, *prediction), P_px)


def _identify(settings, camera, pairs, u_c, flux, prediction, P_px):
    """(Identification, whether the prediction was confirmed)."""
    hole = camera.pinhole
    numbers = Numbers(
        float(hole.width_px),
        float(hole.height_px),
        float(hole.focal_length_px),
        float(hole.cx_px),
        float(hole.cy_px),
        BORDER_PX + camera.displaced_px,
        float(settings.centroid_error),
        float(settings.magnitude_error),
        float(settings.false_alarm),
        max(int(settings.fewest_stars), MIN_STARS),
        BUDGET,
    )
    if P_px is not None:
        P_px = np.ascontiguousarray(P_px, dtype=np.float64)
        if P_px.ndim != 3:
            checked(P_px, len(u_c))
    is_sound, *found = _directions_kernel(*pairs.quick, numbers, hole, u_c, flux, prediction, P_px)
    if not is_sound:
        checked(P_px, len(u_c))
    found = Solution(*found)
    return Identification(found.star, int(found.reason), float(found.log_odds)), found.tracked


NO_PREDICTION = (False, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros((3, 3)))


@kernel
def _directions_kernel(stars, pairs, numbers, hole, u_c, flux, prediction, P_px):
    """Whether P_px holds covariances, and `solve_kernel` of directions (n, 3) and fluxes (n,).

    P_px : (n, 2, 2) px^2, or None
    """
    n, xy_px = len(flux), pixels(hole, u_c)
    magnitude = np.empty(n)
    for k in range(n):
        magnitude[k] = -2.5 * math.log10(flux[k])
    frame = xy_px, magnitude, True
    if P_px is None:
        return True, *solve_kernel(stars, pairs, numbers, *frame, prediction, None)
    if not are_covariances(P_px, n):
        return False, *unsolved(n)
    ellipses = ellipses_of(P_px, numbers.centroid_error)
    return True, *solve_kernel(stars, pairs, numbers, *frame, prediction, ellipses)


@inner
def unsolved(n):
    """Solution, as a plain tuple, of n detections that nobody has looked at."""
    nothing = np.full(n, -1, dtype=np.int64), np.full(4, np.nan), np.full((3, 3), np.nan)
    return NO_MATCH, *nothing, -np.inf, 1.0, 0, False


@inner
def solve_kernel(stars, pairs, numbers, xy_px, magnitude, has_flux, prediction, ellipses=None):
    """Attitude of one frame; detections brightest first, if there is a flux.

    Parameters
    ----------
    stars, pairs : Stars, Pairs
    numbers : Numbers
    xy_px : (n, 2) of an ideal pinhole
    magnitude : (n,) -2.5 log10 flux
    has_flux : bool
    prediction : (bool, (4,), (3, 3) rad^2) whether there is one, its q_ic, covariance of its error in camera
        axes; NO_PREDICTION where there is none
    ellipses : Ellipses of the centroids; None: numbers.centroid_error for all

    Returns
    -------
    Solution, as a plain tuple
    """
    stars, pairs, ellipses = lent(stars), lent(pairs), lent(ellipses)
    has_prediction, q_ic, P_c = prediction
    n = min(xy_px.shape[0], MAX_DETECTIONS)
    scene = Scene(
        xy_px[:n], magnitude[:n], has_flux, numbers.width_px, numbers.height_px, numbers.focal_px,
        numbers.cx_px, numbers.cy_px, numbers.border_px, numbers.centroid_error, numbers.magnitude_error,
        ellipses,
    )  # fmt: skip
    threshold = np.log(CHANCE / numbers.false_alarm)
    strict = -np.log(numbers.false_alarm)  # CHANCE is that of searches without a prediction
    prior = Prior(has_prediction, dcm_from_quat(quat_conjugate(q_ic)), P_c)
    is_narrow = max(P_c[0, 0], P_c[1, 1], P_c[2, 2]) < NARROW**2
    least = MIN_TRACKED if is_narrow else numbers.fewest_stars
    seen = new_seen(scene, ellipses)
    tracked = Task(stars, scene, prior, seen, new_best(n), new_view(), least, strict, strict)
    work = 0
    if has_prediction and n >= least and np.isfinite(q_ic.sum() + P_c.sum()):
        work = track(tracked, numbers.budget)
        found = conclude(tracked, numbers, xy_px.shape[0], work, True)
        if found[0] == 0:
            return found
    nothing = Prior(False, prior.C_ci, P_c)
    lost = Task(
        stars, scene, nothing, seen, new_best(n), tracked.room, numbers.fewest_stars, threshold,
        strict + np.log(ALONE),
    )  # fmt: skip
    if n >= numbers.fewest_stars:
        # a prediction that is wrong may have used up the budget of its own
        work += lost_in_space(lost, pairs, numbers.budget)
    return conclude(lost, numbers, xy_px.shape[0], work, False)


@inner
def conclude(task, numbers, n, work, tracked):
    """Reason, and the attitude if it is certain."""
    task = lent(task)
    best, star = task.best, np.full(n, -1, dtype=np.int64)
    if (
        best.score[2] < 4.0
        and best.score[5] > NOISY * numbers.centroid_error
        and margin(task) >= task.threshold
    ):
        best.trial_C[:] = best.C  # is it the focal length?
        gate_px = WIDE_GATE * numbers.centroid_error
        look(task, numbers.focal_px, gate_px, no_lever(gate_px), True)
    reason, denied, nu = verdict(task)
    refitted = denied > 0.0 and nu >= MANY and (reason == 0 or reason == RESIDUALS)
    if refitted and denied >= MOST_NOISE**2:
        reason = RESIDUALS
    elif refitted:
        task = with_noise(task, np.sqrt(denied))
        best, reason = task.best, verdict(task)[0]
        if margin(task) < task.threshold:
            reason = RESIDUALS
    odds, rival = best.score[0], best.score[1]
    wrong = (1.0 if tracked else CHANCE) * np.exp(-odds) + (np.exp(rival - odds) if rival > 0.0 else 0.0)
    wrong, P_c, q_ci = min(wrong, 1.0), np.full((3, 3), np.nan), np.full(4, np.nan)
    if reason == 0:
        seen, nu = covariance(task, refitted, denied, nu, P_c)
        if seen > (OTHER_NOISE * numbers.centroid_error) ** 2 and beyond(P_c, nu) > WRONG_LIMIT:
            reason, P_c[:] = RESIDUALS, np.nan
    if reason == 0:
        star[: len(best.star)], q_ci[:] = best.star, quat_from_dcm(best.C)
    return reason, star, q_ci, P_c, odds, wrong, work, tracked


@inner
def covariance(task, refitted, denied, nu, P_c):
    """Write the covariance (3, 3) [rad^2] of the best attitude.

    The noise is that of the residuals, with the told one for an observation of it. One that is denied is that
    of the neighbourhood, `denied` times the told variance, known by nu squares; after another fit the
    residuals tell it alone.

    -> px^2, mean square of the residuals; squares of which a noise is known that is denied
    """
    best, variance, n_par = task.best, task.scene.centroid_error**2, int(task.best.score[2])
    dof = 2.0 * (best.star >= 0).sum() - n_par
    seen = best.score[3] / dof
    if refitted:
        nu = dof
        variance = seen * student(nu)
    else:
        variance *= max(variance_seen(dof * seen / variance, dof), denied * student(nu))
    column = np.empty(4)
    for c in range(3):
        column[:] = 0.0
        column[c] = variance
        solve_cholesky(best.L, column, n_par)
        for a in range(3):
            P_c[a, c] = column[a]
    return seen, nu


@inner
def student(nu):
    """Variance of an error over that of the noise, which nu squares tell: Student's distribution."""
    return nu / (nu - 2.0)


@inner
def beyond(P_c, nu):
    """Bound of the probability that an attitude is WRONG whose noise is known by nu squares alone.

    Its error over its sigma has Student's distribution, of which it is the tail beyond x, with the density
    c (1 + t^2/nu)^(-(nu + 1)/2), c < 0.4, times t/x > 1.
    """
    x = WRONG * np.sqrt(student(nu) / (P_c[0, 0] + P_c[1, 1] + P_c[2, 2]))
    return 0.8 * nu / ((nu - 1.0) * x) * (1.0 + x * x / nu) ** (-0.5 * (nu - 1.0))


@inner
def with_noise(task, growth):
    """The task with the centroid error so many times the told one, and its best attitude fitted again.

    Stars beyond the gate of the told noise were left out, though the noise had moved them there. A rival
    keeps the odds that it had.
    """
    best, told = task.best, task.scene
    scene = Scene(
        told.xy_px, told.mag, told.has_flux, told.width_px, told.height_px, told.focal_px, told.cx_px,
        told.cy_px, told.border_px, growth * told.centroid_error, told.magnitude_error, told.ellipses,
    )  # fmt: skip
    again = changed(task, scene, task.seen, new_best(len(best.star)), task.room)
    again.best.trial_C[:] = best.C
    gate_px = min(GATE * scene.centroid_error, REACH_PX)
    look(again, best.score[4], gate_px, no_lever(gate_px), best.score[2] == 4.0)
    again.best.score[1] = max(again.best.score[1], best.score[1])
    return again


@inner
def variance_seen(chi2, dof):
    """Variance of the centroids over the told one; what exceeds it is as uncertain as it is in this frame.

    A variance of which only nu squares are known makes an error of Student's distribution: larger than a
    normal one by nu / (nu - 2).
    """
    factor, nu = misfit_factor(chi2, dof, PRIOR_DOF), PRIOR_DOF + dof
    return factor if factor <= 1.0 else 1.0 + (factor - 1.0) * student(nu)


@inner
def verdict(task):
    """Why the best attitude must not be given out: a Reason, 0 when it may be; see `doubts`.

    And the variance of the centroids over the told one if the neighbourhood of the stars denies that, else
    0; and the squares of which it is known.
    """
    best = task.best
    if margin(task) < task.threshold:
        if best.score[0] >= task.threshold:
            return AMBIGUOUS, 0.0, 0.0
        return TOO_FEW_STARS if len(best.star) < task.min_stars else NO_MATCH, 0.0, 0.0
    n_par, focal_px, noise_px = int(best.score[2]), best.score[4], best.score[5]
    n = predict(task.stars, task.scene, best.C, focal_px, task.room)
    badly, denied, nu = fits_badly(task, n, n_par)
    if badly:
        return RESIDUALS, denied, nu
    recall(task, n)
    if leans_on_one_star(task, n, focal_px, noise_px, n_par) or has_second_image(task, n, noise_px):
        return AMBIGUOUS, denied, nu
    if is_named_for_a_neighbour(task, n):
        return AMBIGUOUS, denied, nu
    return 0, denied, nu
