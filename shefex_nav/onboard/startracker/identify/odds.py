"""The terms of the Bayes factor: places, brightnesses, stars that are not seen, attitudes tried.

Chance: n detections anywhere on the detector. The attitude: k of them are stars of the catalogue, near
their predicted places, and the others are anywhere. With the density of the false ones unknown,

    B = prod_matched [A f(r)] (n - k)! / n!  x  volume of the attitude  x  brightness  x  completeness

The mean of B over chance fields is one, so B > 1 / p has a probability below p whatever the number of
attitudes tried; `bayes.CHANCE` is what it is in fact.
"""

from math import exp, lgamma

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry.rotation import quat_from_dcm, rotvec_from_quat
from shefex_nav.onboard.startracker.identify.ellipses import apart, log_area
from shefex_nav.onboard.startracker.identify.evidence import (
    DEEPER,
    FOCAL_SHARE,
    FOCAL_SIGMA,
    MUTE,
    NOISE_SCALES,
    NOISE_WEIGHTS,
    TAIL_SCALE,
    TAIL_SHARE,
    ZERO_POINT_SIGMA,
    median,
)
from shefex_nav.onboard.startracker.identify.screen import MAX_DETECTIONS

CROWD = 3  # neighbours that tell how dense the detections are about one of them
CROWDED = 4.0  # times the usual density
LOG_FACTORIAL = np.array([lgamma(k + 1.0) for k in range(MAX_DETECTIONS + 1)])  # ln 0!, ln 1! ...


@inner
def crowding_of(scene, of_det):
    """By how much each matched detection is more likely to be chance because others crowd around it.

    ln of the density of the CROWD nearest others against that of the frame, where it is more than
    CROWDED times as high: evenly spread detections are rarely so close by chance.
    """
    n = scene.xy_px.shape[0]
    crowding = np.zeros(n)
    usual = n / (scene.width_px * scene.height_px)
    within2 = CROWD / (np.pi * usual * CROWDED)
    for j in range(n):
        if of_det[j] < 0.0:
            continue
        near, furthest2 = 0, 1.0  # px^2: one place, not a point
        for k in range(n):
            dx, dy = apart(scene.xy_px, k, scene.xy_px, j)
            d2 = dx**2 + dy**2
            if k != j and d2 < within2:
                near += 1
                furthest2 = max(furthest2, d2)
        if near >= CROWD:
            crowding[j] = np.log(near / (np.pi * furthest2 * usual * CROWDED))
    return crowding


@inner
def place_odds(scene, view, n, log_det, n_par):
    """Logarithm of the places' part: over noise scales, of matches, false ones and attitude volume.

    Catalogue stars are the brighter ones, and many faint uncatalogued ones would hide them. With a share
    DEEPER of the cameras only the j brightest detections are data, any j being as likely.
    """
    n_det = scene.xy_px.shape[0]
    area = scene.width_px * scene.height_px
    of_det = np.full(n_det, -1.0)
    for s in range(n):
        if view.det[s] >= 0:
            of_det[view.det[s]] = view.distance2[s]
    crowding = crowding_of(scene, of_det)
    all_data = np.log(1.0 - DEEPER) if scene.has_flux else 0.0
    first_data = np.log(DEEPER / n_det)
    total = -np.inf
    for q in range(len(NOISE_SCALES)):
        variance = (NOISE_SCALES[q] * scene.centroid_error) ** 2
        tail = TAIL_SCALE**2 * variance
        volume = 0.5 * n_par * np.log(2.0 * np.pi * variance) - 0.5 * log_det
        sum_log, k, best = 0.0, 0, -np.inf
        for j in range(n_det):
            if of_det[j] >= 0.0:
                narrow = (1.0 - TAIL_SHARE) / variance * np.exp(-0.5 * of_det[j] / variance)
                wide = TAIL_SHARE / tail * np.exp(-0.5 * of_det[j] / tail)
                sum_log += np.log(area / (2.0 * np.pi) * (narrow + wide)) - crowding[j]
                sum_log -= log_area(scene.ellipses, j)
                k += 1
            first = sum_log + LOG_FACTORIAL[j + 1 - k] - LOG_FACTORIAL[j + 1]
            if j == n_det - 1:
                best = max(best, all_data + first)
            elif scene.has_flux:
                best = max(best, first_data + first)
        total = add_logs(total, np.log(NOISE_WEIGHTS[q]) + volume + best)
    return total


@inner
def attitude_odds(prior, C, L, noise_px):
    """Logarithm of the prior density at the attitude [rad^-3].

    Lost in space: 1 / (8 pi^2). With a prediction: its normal density, with the uncertainty of the
    attitude itself added; twice the covariance, as predictions are more often too sure than too modest.
    """
    if not prior.known:
        return -np.log(8.0 * np.pi**2)
    R = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for c in range(3):
                R[a, b] += C[a, c] * prior.C_ci[b, c]
    d = rotvec_from_quat(quat_from_dcm(R))
    S = 2.0 * prior.P_c
    for a in range(3):
        S[a, a] += noise_px**2 / L[a, a] ** 2
    M = np.linalg.inv(S)
    chi2 = 0.0
    for a in range(3):
        for b in range(3):
            chi2 += d[a] * M[a, b] * d[b]
    return -0.5 * np.log((2.0 * np.pi) ** 3 * np.linalg.det(S)) - 0.5 * chi2


@inner
def focal_odds(scene, focal_px, n_par):
    """Logarithm of the prior of the focal length: off or not, and by how much."""
    if n_par < 4:
        return np.log(1.0 - FOCAL_SHARE)
    off = np.log(focal_px / scene.focal_px) / FOCAL_SIGMA
    return np.log(FOCAL_SHARE / (np.sqrt(2.0 * np.pi) * FOCAL_SIGMA)) - 0.5 * off**2


@inner
def zero_point(stars, scene, view, n):
    """Median of -2.5 log10 flux - V of the matched stars."""
    difference, m = view.spare, 0
    for s in range(n):
        if view.det[s] >= 0:
            difference[m] = scene.mag[view.det[s]] - stars.vmag[view.row[s]]
            m += 1
    return median(difference, m)


@inner
def brightness_odds(stars, scene, view, n, zero):
    """Logarithm of the odds that these brightnesses belong to these stars.

    Against chance, where a star of the catalogue has any of its magnitudes; zero point free, tails wide.
    A share MUTE of the frames has brightnesses that say nothing (gain, saturation): the loss is bounded.
    """
    if not scene.has_flux:
        return 0.0
    sigma, total, m = scene.magnitude_error, 0.0, 0
    peak = 1.0 / (np.sqrt(2.0 * np.pi) * sigma)
    for s in range(n):
        if view.det[s] >= 0:
            z2 = ((scene.mag[view.det[s]] - stars.vmag[view.row[s]] - zero) / sigma) ** 2
            inner = 0.65 * np.exp(-0.5 * z2) + 0.1 * np.exp(-0.08 * z2)  # 0.25 with 2.5 sigma
            total += np.log(peak * inner + 0.0125) - stars.log_density[view.row[s]]  # 0.1 over 8 mag
            m += 1
    n_det = scene.mag.shape[0]
    middle = 0.5 * (scene.mag[(n_det - 1) // 2] + scene.mag[n_det // 2])  # they are sorted
    expected = middle - stars.vmag[len(stars.vmag) // 2]
    total += np.log(sigma / (np.sqrt(m) * ZERO_POINT_SIGMA))
    total -= 0.5 * ((zero - expected) / ZERO_POINT_SIGMA) ** 2
    return add_logs(np.log(1.0 - MUTE) + total, np.log(MUTE))


@inner
def log_odds(stars, scene, prior, view, fit):
    """ln B of an adjusted attitude, whose stars are in the view."""
    n = fit.n
    zero = zero_point(stars, scene, view, n)
    return (
        place_odds(scene, view, n, fit.log_det, fit.n_par)
        + attitude_odds(prior, fit.C, fit.L, fit.noise_px)
        + focal_odds(scene, fit.focal_px, fit.n_par)
        + brightness_odds(stars, scene, view, n, zero)
        + completeness_odds(stars, view, n, scene, zero)
    )


# ----------------------------------------------------------------------------------------------------------
# The probability that just these stars of the catalogue are seen.
#
# In: the stars that an attitude predicts, with or without a detection. Out: the logarithm of the
# probability of that pattern. A star is detected with a probability that falls softly with its magnitude: a
# catalogue has another band than the camera, stars vary, doubles are split, so that the camera's limit is
# no cut in V.


BLEND_PX = 8.0  # a star nearer than this to a brighter one may be part of its spot
SHARES = (0.99, 0.93, 0.8, 0.55)  # of the bright stars that are detected, and how likely each is
SHARE_WEIGHTS = (0.4, 0.3, 0.2, 0.1)
LIMITS = (-1.5, -0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0)  # mag, catalogue's faintest star over the camera's
LIMIT_WEIGHTS = (0.4, 0.15, 0.1, 0.08, 0.07, 0.06, 0.05, 0.05, 0.04)
SOFTNESS = 0.17  # mag, of a logistic fall: half of it within +-0.19 mag, nine tenths within +-0.5
BLURRED = 0.03  # share of the stars far beyond the limit that are detected
FAINTER, FAINTER_MARGIN = 0.5, 0.3  # odds of each detection that is fainter than the limit, by this [mag]
FADING = tuple(exp(limit / SOFTNESS) for limit in LIMITS)  # of the catalogue's faintest star
RESCALED = 16  # stars after which products are made larger: above 1e-32 of what they were


@inner
def add_logs(a, b):
    """ln(exp(a) + exp(b))."""
    high, low = max(a, b), min(a, b)
    return high + np.log1p(np.exp(low - high)) if low > -np.inf else high


@inner
def _is_due(scene, view, n, s):
    """Well inside the frame and not beside a brighter star (those come first)."""
    x, y = view.xy_px[s, 0], view.xy_px[s, 1]
    b = scene.border_px
    if x < b or y < b or x > scene.width_px - 1.0 - b or y > scene.height_px - 1.0 - b:
        return False
    for r in range(s):
        if (view.xy_px[r, 0] - x) ** 2 + (view.xy_px[r, 1] - y) ** 2 < BLEND_PX**2:
            return False
    return True


@inner
def detectable(fading):
    """Share of the stars of a magnitude that are bright enough; fading: exp((vmag - limit) / SOFTNESS)."""
    return BLURRED + (1.0 - BLURRED) / (1.0 + fading)


@inner
def count_fainter(mag, limit):
    """Detections fainter than a magnitude."""
    n = 0
    for k in range(mag.shape[0]):
        n += mag[k] > limit
    return n


@inner
def completeness_odds(stars, view, n, scene, zero):
    """Logarithm of the probability that these stars of the view are seen and those are not.

    The share of the bright stars that are detected and the camera's limit are unknown. A frame with many
    detections below a limit does not have that limit. Products, star by star for all shares and limits; they
    are made larger together before they are too small, and then count against the largest.
    """
    faintest = stars.vmag[len(stars.vmag) - 1]
    odds, log_scale, m = np.empty((len(LIMITS), len(SHARES))), 0.0, 0
    for q in range(len(LIMITS)):
        fainter = 0
        if LIMITS[q] > 0.0 and scene.has_flux:
            fainter = count_fainter(scene.mag, zero + faintest - LIMITS[q] + FAINTER_MARGIN)
        for p in range(len(SHARES)):
            odds[q, p] = LIMIT_WEIGHTS[q] * SHARE_WEIGHTS[p] * FAINTER**fainter
    for s in range(n):
        seen = view.det[s] >= 0
        if not (seen or _is_due(scene, view, n, s)):
            continue
        fading = np.exp((stars.vmag[view.row[s]] - faintest) / SOFTNESS)
        for q in range(len(LIMITS)):
            bright_enough = detectable(fading * FADING[q])
            for p in range(len(SHARES)):
                share = SHARES[p] * bright_enough
                odds[q, p] *= share if seen else 1.0 - share
        m += 1
        if m % RESCALED == 0:
            most = odds.max()
            odds /= most
            log_scale += np.log(most)
    return log_scale + np.log(odds.sum())
