"""Attitude from a list of centroids: the star identification of this package for any camera.

In: centroids and, if known, their brightness. Out: attitude, stars, covariance and the probability that it is
wrong, or the reason for none. The catalogue and its pairs are built at the first call with a camera, epoch
and magnitude, and kept.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from shefex_nav import warmup
from shefex_nav.compiled import entry, inner, kernel, lent
from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import Pinhole, unit_vectors
from shefex_nav.geometry.rotation import quat_conjugate
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.identify import bayes
from shefex_nav.onboard.startracker.identify.ellipses import checked, ellipses_of
from shefex_nav.onboard.startracker.likelihood import misfit_factor, refine
from shefex_nav.onboard.startracker.settings import Catalogue, Identification
from shefex_nav.onboard.startracker.tables import Pairs, Stars
from shefex_nav.plugins import STEPS
from shefex_nav.records import Reason
from shefex_nav.solve import given
from shefex_nav.solve.camera import Camera, check_lens, pinhole_of, undistorted

METHODS = STEPS["identification"].ways()  # those of papers and plug-ins among them
MERGE_PX = 2.0  # closer stars are one point of light
REASONS = {int(reason): reason.name.lower() for reason in Reason}
NO_FLUX = np.zeros(0)
MOST_STARS = 50  # of the catalogue, in the field on average
SMALL = 64  # fewer are sorted by insertion
BAD_PLACE, BAD_FLUX = -1, -2  # of the input, found by the compiled code
FARTHEST_PX = 1e9  # of a centroid from the first pixel; squares of much more are no numbers any longer


class StarSolution(NamedTuple):
    """What `solve_centroids` found."""

    status: str  # 'ok' or 'failed'
    reason: str  # empty, or why: too_few_stars, no_match, ambiguous, residuals
    q_ci: np.ndarray  # (4,) ICRS to camera, Hamilton, scalar first; NaN without a solution
    hip: np.ndarray  # (n,) int64 Hipparcos number of each centroid, 0 where unmatched
    covariance: np.ndarray  # (3, 3) rad^2, of the rotation-vector error in camera axes; NaN likewise
    false_probability: float  # bound of the probability that chance made this; 1 without a solution


def solve_centroids(
    xy_px,
    flux,
    *,
    camera,
    epoch,
    method="default",
    max_magnitude=5.5,
    band="silicon",
    centroid_sigma_px=0.15,
    magnitude_sigma=0.2,
    false_limit=1e-5,
    prediction=None,
    centroid_covariance_px=None,
    zero_flux=None,
):
    """Identify the stars of a frame and find the attitude of the camera.

    Positions are those of the catalogue at the epoch. Aberration is not corrected: up to 20.5 arcsec, which
    move a field as a whole, but for what differs within it (11 arcsec either way at 65 deg across, 1.4 at 8).

    Parameters
    ----------
    xy_px : (n, 2) centroids, in any order
    flux : (n,) brightness in any unit, or None
    camera : Camera
    epoch : float, Julian year, e.g. 2012.47
    method : 'default' or another of METHODS
    max_magnitude : float, of the faintest catalogue stars to use; wide fields need fewer and use fewer
    band : 'silicon' (a bare silicon detector, Gaia's G), 'V' or 'Hp': what the camera sees, and the system of
        all magnitudes here
    centroid_sigma_px : float, standard deviation of a centroid per axis
    magnitude_sigma : float, scatter of -2.5 log10 flux against the magnitudes of the catalogue
    false_limit : float, accepted probability that a solution is chance
    prediction : None or (q_ci, P): attitude and covariance (3, 3) [rad^2] of its error in camera axes
    centroid_covariance_px : None or (n, 2, 2) px^2, covariance of the error of each centroid, for those that
        differ or are elongated (not changed by the distortion); centroid_sigma_px is then that of an
        ordinary star
    zero_flux : None or float, flux of a star of magnitude 0, without which 'multipole' cannot do

    Returns
    -------
    StarSolution; a frame that cannot be solved is not an error
    """
    ready = _ready_for(camera, band, epoch, max_magnitude, centroid_sigma_px, magnitude_sigma, false_limit)
    centroids = _of_pinhole(camera, xy_px, flux, centroid_covariance_px)
    if method not in ("default", "bayes"):
        return _by_method(method, ready, *centroids, zero_flux, prediction)
    return _by_default(ready, *centroids, prediction)


def _of_pinhole(camera, xy_px, flux, P_px):
    """Checked centroids (n, 2) without the distortion, brightness (n,) or None, covariances or None."""
    xy_px = given.places(xy_px)
    flux = None if flux is None else given.fluxes(flux, len(xy_px))
    if P_px is not None:
        P_px = checked(P_px, len(xy_px), "centroid_covariance_px")
    return undistorted(camera, xy_px), flux, P_px


def _by_default(ready, xy_px, flux, P_px, prediction):
    """StarSolution of the default method; centroids of `_of_pinhole`."""
    prior = bayes.NO_PREDICTION if prediction is None else given.prediction(prediction)
    flux = NO_FLUX if flux is None else flux
    if P_px is None:
        reason, hip, q_ci, P_c, wrong = ready.solve(*ready.tables, xy_px, flux, prior, None)
    else:
        reason, hip, q_ci, P_c, wrong = _solve_uneven(ready.tables, xy_px, flux, prior, P_px)
    if reason == 0:
        return StarSolution("ok", "", q_ci, hip, P_c, wrong)
    _complain(reason)
    return StarSolution("failed", REASONS[reason], q_ci, hip, P_c, 1.0)


@kernel
def _solve_kernel(stars, index, hips, numbers, xy_px, flux, prediction, ellipses=None):
    """Sort by brightness, solve, name the stars in the order of the input.

    flux : (n,), or (0,) where nothing is known of it
    prediction : of `bayes.solve_kernel`
    ellipses : of centroids that are sorted already, or None
    -> reason (Reason, BAD_PLACE, BAD_FLUX), hip (n,), q_ci, P_c, probability that it is chance
    """
    stars, index, hips, flux, prediction = lent(stars), lent(index), lent(hips), lent(flux), lent(prediction)
    n, has_flux = xy_px.shape[0], flux.shape[0] > 0
    hip = np.zeros(n, dtype=np.int64)
    reason = 0
    for k in range(n):
        if not (abs(xy_px[k, 0]) <= FARTHEST_PX and abs(xy_px[k, 1]) <= FARTHEST_PX):
            reason = BAD_PLACE
        elif has_flux and not (flux[k] > 0.0 and np.isfinite(flux[k])):
            reason = BAD_FLUX
    if reason < 0:
        return reason, hip, np.full(4, np.nan), np.full((3, 3), np.nan), 1.0
    order = np.arange(n)
    ordered, magnitude = xy_px, np.zeros(n)
    if has_flux:
        if n <= SMALL:
            _insertion_sort(flux, order)
        else:
            order = np.argsort(-flux, kind="mergesort")
        ordered = np.empty((n, 2))
        for k in range(n):
            ordered[k, 0], ordered[k, 1] = xy_px[order[k], 0], xy_px[order[k], 1]
            magnitude[k] = -2.5 * np.log10(flux[order[k]])
    reason, star, q_ci, P_c, _, wrong, _, _ = bayes.solve_kernel(
        stars, index, numbers, ordered, magnitude, has_flux, prediction, ellipses
    )
    for k in range(n):
        if star[k] >= 0:
            hip[order[k]] = hips[star[k]]
    return reason, hip, q_ci, P_c, wrong


def _solve_uneven(tables, xy_px, flux, prior, P_px):
    """`_solve_kernel` of centroids with a covariance each."""
    order = np.argsort(-flux, kind="stable") if len(flux) else np.arange(len(xy_px))
    ellipses = ellipses_of(P_px[order], tables[-1].centroid_error)
    flux = flux[order] if len(flux) else flux
    reason, in_order, *found = _solve_kernel(*tables, xy_px[order], flux, prior, ellipses)
    hip = np.empty_like(in_order)
    hip[order] = in_order
    return reason, hip, *found


@inner
def _insertion_sort(flux, order):
    """Sort `order`, 0 ... n - 1, by falling flux; equal ones stay in their order."""
    for k in range(1, flux.shape[0]):
        j, moved = k, order[k]
        while j > 0 and flux[order[j - 1]] < flux[moved]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = moved


class _Sky(NamedTuple):
    """Catalogue and pairs for one camera and epoch."""

    pinhole: Pinhole
    hip: np.ndarray
    pairs: catalogue.StarPairs
    stars: Stars
    index: Pairs
    displaced_px: float  # by the distortion, at most


class _Ready(NamedTuple):
    """All that does not change from frame to frame."""

    sky: _Sky
    numbers: bayes.Numbers
    tables: tuple  # Stars, Pairs, (n,) Hipparcos numbers, Numbers: as `_solve_kernel` takes them
    solve: Callable  # that kernel, for these tables and round errors


def _ready_for(camera, band, *numbers_given):
    """_Ready of what users give, whatever that is."""
    if not isinstance(camera, Camera):
        raise ValueError(f"camera: expected a Camera, got {camera!r}")
    if band not in catalogue.SYSTEMS:
        raise ValueError(f"band: expected {', '.join(catalogue.SYSTEMS)}, got {band!r}")
    try:
        return _ready(camera, band, *numbers_given)
    except TypeError:  # not what a number can be made of, or cannot be looked up
        names = "epoch", "max_magnitude", "centroid_sigma_px", "magnitude_sigma", "false_limit"
        return _ready(camera, band, *(given.number(*one) for one in zip(names, numbers_given, strict=True)))


@lru_cache(maxsize=64)
def _ready(camera, band, epoch, max_magnitude, centroid_sigma_px, magnitude_sigma, false_limit):
    """Check what is said of the camera and its errors, once."""
    for name, value in (("centroid_sigma_px", centroid_sigma_px), ("magnitude_sigma", magnitude_sigma)):
        if not 0.0 < value <= 10.0:
            raise ValueError(f"{name}: expected a number between 0 and 10, got {value!r}")
    if not 0.0 < false_limit < 1.0:
        raise ValueError(f"false_limit: expected a probability between 0 and 1, got {false_limit!r}")
    sky = _sky(camera, band, epoch, max_magnitude)
    numbers = bayes.Numbers(
        float(camera.width_px), float(camera.height_px), sky.pinhole.focal_length_px,
        sky.pinhole.cx_px, sky.pinhole.cy_px, bayes.BORDER_PX + sky.displaced_px,
        float(centroid_sigma_px), float(magnitude_sigma), float(false_limit), bayes.MIN_STARS, bayes.BUDGET,
    )  # fmt: skip
    tables = sky.stars, sky.index, sky.hip, numbers
    frame = np.empty((1, 2)), np.empty(1), bayes.NO_PREDICTION
    return _Ready(sky, numbers, tables, entry(_solve_kernel, *tables, *frame))


@lru_cache(maxsize=8)
def _sky(camera, band, epoch, max_magnitude):
    """Catalogue and pairs of a camera; brighter than max_magnitude where the field would hold too many."""
    warmup.get_ready({"command=solve_centroids"})
    if not 1900.0 < epoch < 2200.0:
        raise ValueError(f"epoch: expected a Julian year between 1900 and 2200, got {epoch!r}")
    faintest = catalogue.SILICON_TO if band == "silicon" else 8.0  # to which the table of stars is whole
    if not -2.0 < max_magnitude <= faintest:
        words = f"between -2 and {faintest:g} ({band})"
        raise ValueError(f"max_magnitude: expected a magnitude {words}, got {max_magnitude!r}")
    check_lens(camera)
    pinhole = pinhole_of(camera)
    right, bottom = camera.width_px - 0.5, camera.height_px - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]])
    displaced = float(np.abs(undistorted(camera, corners) - corners).max())
    farthest_px = np.hypot(*(corners - camera.principal_point_px).T).max() + displaced
    field = 2.0 * np.arctan(farthest_px / pinhole.focal_length_px)
    sky = load_catalogue(8.0)
    depth = _depth(np.sort(catalogue.magnitudes(sky, band)), float(max_magnitude), pinhole)
    settings = Catalogue(
        kind="magnitude_limited",
        system=band,
        faintest=depth,
        faintest_south=None,
        merge_radius=MERGE_PX / pinhole.focal_length_px,
        keep_to=0.0,
        size=0,
    )
    stars = catalogue.build(settings, sky, float(epoch))
    try:
        pairs = catalogue.pair_table(stars, 1.03 * field)  # the focal length may be a little shorter
    except ValueError:
        raise ValueError(
            f"camera, max_magnitude: a field of {np.degrees(field):.3g} deg holds no two of the "
            f"{len(stars.hip)} stars to magnitude {depth:.2g}; expected a wider field or a fainter limit"
        ) from None
    return _Sky(pinhole, stars.hip, pairs, *pairs.quick, displaced)


def _depth(magnitude, max_magnitude, pinhole):
    """Magnitude at which the field holds MOST_STARS on average, if that is brighter than max_magnitude.

    magnitude : ascending, of all stars. A deeper catalogue only slows the search: the brightest stars decide.
    """
    share = pinhole.width_px * pinhole.height_px / pinhole.focal_length_px**2 / (4.0 * np.pi)
    enough = int(MOST_STARS / min(share, 0.5))
    return max_magnitude if enough >= len(magnitude) else min(max_magnitude, float(magnitude[enough]))


def _complain(reason):
    """The input is not what it should be: raise."""
    if reason == BAD_PLACE:
        raise ValueError(f"xy_px: contains NaN or values beyond {FARTHEST_PX:.0e}; expected pixels")
    if reason == BAD_FLUX:
        raise ValueError("flux: expected finite positive values")


def _identification(method, ready):
    """Settings of a method, with the errors that the user says."""
    numbers = ready.numbers
    return Identification(
        method=method,
        tracking=False,
        tolerance=3.0 * np.sqrt(2.0) * numbers.centroid_error / numbers.focal_px,
        most_centroids=200 if method == "multipole" else 15,  # the others build triangles
        acceptance="verified",
        fewest_stars=4,
        centroid_error=numbers.centroid_error,
        gate_sigma=4.5,
        detection_probability=0.9,
        magnitude_margin=0.3,
        magnitude_error=numbers.magnitude_error,
        magnitude_tolerance=0.7,  # eps_m of the multipole method is not given [E]
        false_alarm=numbers.false_alarm,
        cosine_error=None,
        reference_magnitude=None,
        deepest=None,
    )


def _by_method(method, ready, xy_px, flux, P_px, zero_flux, prediction):
    """Another method of the package, lost in space."""
    if prediction is not None:
        raise ValueError(
            f"prediction: method {method!r} cannot use one; expected None, or the default method"
        )
    if method not in METHODS:
        known = ", ".join(["default", *METHODS])
        raise ValueError(f"method: {method!r} is not known; choose from: {known}")
    pinhole, sigma_px = ready.sky.pinhole, ready.numbers.centroid_error
    if not (np.abs(xy_px) <= FARTHEST_PX).all():
        _complain(BAD_PLACE)
    if flux is not None and not (np.isfinite(flux) & (flux > 0.0)).all():
        _complain(BAD_FLUX)
    zero_flux = np.nan if zero_flux is None else given.number("zero_flux", zero_flux)
    if method == "multipole" and (flux is None or not zero_flux > 0.0):
        raise ValueError("method: 'multipole' compares magnitudes; it needs flux and a positive zero_flux")
    brightness = np.ones(len(xy_px)) if flux is None else flux
    order = np.argsort(-brightness, kind="stable")
    camera = CameraModel(pinhole, zero_flux=zero_flux)
    u_c = unit_vectors(pinhole, xy_px[order])
    found = METHODS[method](
        _identification(method, ready),
        camera,
        ready.sky.pairs,
        u_c,
        brightness[order],
        None if P_px is None else P_px[order],
    )
    hip = np.zeros(len(xy_px), dtype=np.int64)
    if found.reason != Reason.NONE:
        nothing = np.full(4, np.nan), hip, np.full((3, 3), np.nan), 1.0
        return StarSolution("failed", REASONS[int(found.reason)], *nothing)
    known = found.star >= 0
    hip[order[known]] = ready.sky.hip[found.star[known]]
    k, v_i = int(known.sum()), ready.sky.pairs.stars.u_i[found.star[known]]
    ordinary = np.tile(np.eye(2) * sigma_px**2, (k, 1, 1))
    q_ic = esoq2(u_c[known], v_i, np.full(k, sigma_px / pinhole.focal_length_px))
    errors = ordinary if P_px is None else P_px[order[known]]
    q_ic, P_c, chi2 = refine(pinhole, q_ic, xy_px[order[known]], v_i, errors)
    if not np.isfinite(q_ic.sum() + P_c.sum() + chi2):
        nothing = np.full(4, np.nan), np.zeros_like(hip), np.full((3, 3), np.nan), 1.0
        return StarSolution("failed", REASONS[int(Reason.RESIDUALS)], *nothing)
    P_c *= misfit_factor(chi2, 2 * k - 3, bayes.PRIOR_DOF)  # if the noise is not what was said
    wrong = float(np.exp(-found.log_odds))
    return StarSolution("ok", "", quat_conjugate(q_ic), hip, P_c, wrong)
