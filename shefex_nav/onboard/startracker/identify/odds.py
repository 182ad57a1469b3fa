"""The terms of the Bayes factor: places, brightnesses, stars that are not seen, attitudes tried.

Chance: n detections anywhere on the detector. The attitude: k of them are stars of the catalogue, near
their predicted places, and the others are anywhere. With the density of the false ones unknown,

    B = prod_matched [A f(r)] (n - k)! / n!  x  volume of the attitude  x  brightness  x  completeness

The mean of B over chance fields is one, so B > 1 / p has a probability below p whatever the number of
attitudes tried; `bayes.CHANCE` is what it is in fact.
"""

from math import lgamma

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry.rotation import quat_from_dcm, rotvec_from_quat
from shefex_nav.onboard.startracker.identify.completeness import add_logs, completeness_odds
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
