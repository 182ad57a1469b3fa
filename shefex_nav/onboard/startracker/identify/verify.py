"""The last word on every identification: does the whole field fit, and can it be chance?

In: a few identified stars. Out: all detections matched with the catalogue, and the odds that this attitude
is right. No method's own criterion is trusted: noise alone can build a pyramid of four.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import triples as t3
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.onboard.startracker.attitude import covariance, det3, esoq2
from shefex_nav.records import Reason

FIRST_GATE = 3.0  # times the gate: four stars in one corner say little about the far one
MAGNITUDE_RANGE = 4.0  # mag, spread of the stars that a frame shows
MUTE_SHARE = 0.2  # of the stars, whose brightness is not to be trusted [E]
BORDER_PX = 5.0  # a predicted star nearer to the border may be missing


class Identification(NamedTuple):
    """Which star each detection is."""

    star: np.ndarray  # (n,) int64 row of the on-board catalogue, -1 where unidentified
    reason: int  # Reason; NONE = identified and verified
    log_odds: float  # natural logarithm of the odds against chance


def nothing(n, reason):
    """Identification of n detections that failed for the given reason."""
    return Identification(np.full(n, -1, dtype=np.int64), int(reason), -np.inf)


def verify(settings, camera, stars, u_c, flux, star):
    """Extend a first identification to the field and decide whether to believe it.

    The attitude of the identified stars predicts where all catalogue stars are; detections near a prediction
    are identified with it, and the attitude is found again with all of them. What is left must still hold
    the stars that the identification began with (else RESIDUALS) and must not be chance (else AMBIGUOUS).

    Parameters
    ----------
    settings : Identification
    camera : CameraModel
    stars : OnboardCatalogue
    u_c : (n, 3) unit vectors, brightest detection first
    flux : (n,) any unit
    star : (n,) int64 rows of `stars`, -1 where unknown; at least two known

    Returns
    -------
    Identification
    """
    hole, error = camera.pinhole, settings.centroid_error
    matched, distance2, n_missing = _extend_kernel(
        hole,
        stars.u_i,
        stars.vmag,
        u_c,
        star,
        (float(settings.gate_sigma * error), float(camera.displaced_px)),
        settings.magnitude_margin,
        settings.fewest_stars,
    )
    if n_missing < 0:
        return nothing(len(star), Reason.RESIDUALS)
    odds = log_odds(hole, error, settings.detection_probability, u_c, matched, distance2, n_missing)
    odds += brightness_odds(settings.magnitude_error, stars.vmag, flux, matched)
    reason = Reason.NONE if odds > -math.log(settings.false_alarm) else Reason.AMBIGUOUS
    return Identification(matched, int(reason), float(odds))


@kernel
def log_odds(camera, centroid_error, detection_probability, u_c, star, distance2, n_missing):
    """Natural logarithm of the odds of an attitude against chance.

    Chance: k detections anywhere on the detector, area A, so k / A of them per pixel. The attitude: an
    identified star lies within its error of the prediction, the others are still anywhere, and a bright
    star is missing with probability 1 - p. The attitude was free, any of 8 pi^2 rad^3, of which the data
    leave sqrt((2 pi)^3 |P|):

        ln sqrt((2 pi)^3 |P|) / (8 pi^2) + sum_identified [ln p A / (2 pi sigma^2 k) - d^2 / (2 sigma^2)]
        + n_missing ln(1 - p)

    Catalogue stars are the brighter ones: taking the k brightest detections only, for the best k, keeps
    many faint uncatalogued ones from hiding them; ln n is the price of that choice.

    Parameters
    ----------
    camera : Pinhole
    centroid_error : float, px per axis
    detection_probability : float, p
    u_c : (n, 3) unit vectors, brightest first
    star : (n,) int64, -1 where unidentified
    distance2 : (n,) px^2, squared distance from the prediction where identified
    n_missing : int, predicted bright stars that were not detected
    """
    known = np.flatnonzero(star >= 0)
    P = covariance(u_c[known], np.full(len(known), centroid_error / camera.focal_length_px))
    attitude = 0.5 * np.log((2.0 * np.pi) ** 3 * det3(P)) - np.log(8.0 * np.pi**2)
    area = camera.width_px * camera.height_px
    peak = np.log(detection_probability * area / (2.0 * np.pi * centroid_error**2))
    total, n_known, best = 0.0, 0, -np.inf
    for k in range(len(star)):
        if star[k] >= 0:
            total += peak - distance2[k] / (2.0 * centroid_error**2)
            n_known += 1
        best = max(best, total - n_known * np.log(k + 1.0))
    return attitude + best - np.log(len(star)) + n_missing * np.log(1.0 - detection_probability)


@kernel
def brightness_odds(magnitude_error, vmag, flux, star):
    """Logarithm of the odds that these brightnesses belong to these stars.

    The zero point is free and is taken as the median. Against chance, where magnitudes spread over
    MAGNITUDE_RANGE, a star counts ln [(1 - f) range N(difference) + f], f the share of stars whose
    brightness says nothing (saturated, blended, variable); the fitted zero point costs one of them.

    Parameters
    ----------
    magnitude_error : float, of the brightness of an identified star
    vmag : magnitudes of the catalogue
    flux : (n,) any unit
    star : (n,) int64 row of the catalogue, -1 where unidentified
    """
    known = np.flatnonzero(star >= 0)
    difference = vmag[star[known]] + 2.5 * np.log10(flux[known])
    difference = (difference - np.median(difference)) / magnitude_error
    peak = MAGNITUDE_RANGE / (np.sqrt(2.0 * np.pi) * magnitude_error)
    each = np.log((1.0 - MUTE_SHARE) * peak * np.exp(-0.5 * difference**2) + MUTE_SHARE)
    return each.sum() - np.log(peak * np.sqrt(len(known)))


@kernel
def _extend_kernel(camera, u_i, vmag, u_c, star, within_px, magnitude_margin, fewest_stars):
    """Attitude and matches in turn, from a wide gate to the final one.

    within_px : gate, and by how much the lens moves stars from their places behind the pinhole `camera`

    Returns
    -------
    star, distance2, n_missing : as `_match_kernel`; n_missing is -1 when the field does not hold what it
        began with
    """
    xy_px, (gate_px, displaced_px) = pixels(camera, u_c), within_px
    matched, distance2, n_missing = star, np.empty(0), 0
    for widening in (FIRST_GATE, 1.0, 1.0):
        known = np.flatnonzero(matched >= 0)
        if len(known) < fewest_stars:
            return matched, distance2, -1
        q_ic = esoq2(u_c[known], u_i[matched[known]], np.ones(len(known)))
        matched, distance2, n_missing = _match_kernel(
            camera, q_ic, u_i, vmag, xy_px, widening * gate_px, magnitude_margin, displaced_px
        )
    for k in range(len(star)):
        if star[k] >= 0 and matched[k] != star[k]:
            return matched, distance2, -1
    return matched, distance2, n_missing


@inner
def _match_kernel(camera, q_ic, u_i, vmag, xy_px, gate_px, magnitude_margin, displaced_px):
    """Nearest detection within the gate of each predicted star; each detection keeps its nearest star.

    Detections may lie outside the pinhole's detector by displaced_px, and stars that near to its border may
    be missing.

    Returns
    -------
    star : (n,) int64 row per detection, -1
    distance2 : (n,) px^2
    n_missing : stars well within the frame, brighter by the margin than the faintest match, undetected
    """
    n = xy_px.shape[0]
    star = np.full(n, -1, dtype=np.int64)
    distance2 = np.full(n, gate_px * gate_px)
    C_ci = t3.transposed(t3.dcm_from_quat(q_ic))
    f, cx, cy = camera.focal_length_px, camera.cx_px, camera.cy_px
    half_x, half_y = 0.5 * (camera.width_px - 1), 0.5 * (camera.height_px - 1)
    rim = np.hypot(half_x + abs(cx - half_x), half_y + abs(cy - half_y))
    cos_rim = f / np.hypot(f, rim + gate_px + displaced_px)
    border_px = BORDER_PX + displaced_px
    inside = np.empty(u_i.shape[0], dtype=np.int64)
    n_inside = 0
    for s in range(u_i.shape[0]):
        X, Y, Z = t3.rotated(C_ci, t3.row(u_i, s))
        if Z < cos_rim:
            continue
        x, y = cx + f * X / Z, cy + f * Y / Z
        if abs(x - half_x) < half_x - border_px and abs(y - half_y) < half_y - border_px:
            inside[n_inside] = s
            n_inside += 1
        nearest, d2 = -1, gate_px * gate_px
        for k in range(n):
            r2 = (xy_px[k, 0] - x) ** 2 + (xy_px[k, 1] - y) ** 2
            if r2 < d2:
                nearest, d2 = k, r2
        if nearest >= 0 and d2 < distance2[nearest]:
            star[nearest], distance2[nearest] = s, d2
    faintest = -np.inf
    for k in range(n):
        if star[k] >= 0:
            faintest = max(faintest, vmag[star[k]])
    n_missing = 0
    for m in range(n_inside):
        if vmag[inside[m]] < faintest - magnitude_margin and not (star == inside[m]).any():
            n_missing += 1
    return star, distance2, n_missing
