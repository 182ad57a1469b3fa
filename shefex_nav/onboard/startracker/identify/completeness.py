"""The probability that just these stars of the catalogue are seen.

In: the stars that an attitude predicts, with or without a detection. Out: the logarithm of the probability of
that pattern. A star is detected with a probability that falls softly with its magnitude: a catalogue has
another band than the camera, stars vary, doubles are split, so that the camera's limit is no cut in V.
"""

from math import exp

import numpy as np

from shefex_nav.compiled import inner

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
