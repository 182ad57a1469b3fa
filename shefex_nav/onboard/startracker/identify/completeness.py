"""The probability that just these stars of the catalogue are seen.

In: the stars that an attitude predicts, with or without a detection. Out: the logarithm of the probability of
that pattern. A star is detected with a probability that falls softly with its magnitude: a catalogue has
another band than the camera, stars vary, doubles are split, so that the camera's limit is no cut in V.
"""

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
SMALLEST = 1e-250  # products are taken apart before they are smaller


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
def detectable(vmag, limit):
    """Share of the stars of a magnitude that are bright enough for a camera with this limit."""
    return BLURRED + (1.0 - BLURRED) / (1.0 + np.exp((vmag - limit) / SOFTNESS))


@inner
def pattern_odds(bright_enough, seen, share):
    """ln of the probability that stars are seen or not.

    bright_enough : (n,) of `detectable`;  seen : (n,) bool;  share : of the bright ones that are detected
    """
    product, total = 1.0, 0.0
    for s in range(bright_enough.shape[0]):
        p = share * bright_enough[s]
        product *= p if seen[s] else 1.0 - p
        if product < SMALLEST:
            total, product = total + np.log(product), 1.0
    return total + np.log(product)


@inner
def completeness_odds(stars, view, n, scene, zero):
    """Logarithm of the probability that these stars of the view are seen and those are not.

    The share of the bright stars that are detected and the camera's limit are unknown. A frame with many
    detections below a limit does not have that limit.
    """
    faintest = stars.vmag[len(stars.vmag) - 1]
    vmag, seen, m = np.empty(n), np.empty(n, dtype=np.bool_), 0
    for s in range(n):
        if view.det[s] >= 0 or _is_due(scene, view, n, s):
            vmag[m], seen[m] = stars.vmag[view.row[s]], view.det[s] >= 0
            m += 1
    bright_enough, total = np.empty(m), -np.inf
    for q in range(len(LIMITS)):
        limit, fainter = faintest - LIMITS[q], 0.0
        for s in range(m):
            bright_enough[s] = detectable(vmag[s], limit)
        if LIMITS[q] > 0.0 and scene.has_flux:
            fainter = (scene.mag > zero + limit + FAINTER_MARGIN).sum() * np.log(FAINTER)
        for p in range(len(SHARES)):
            pattern = pattern_odds(bright_enough, seen[:m], SHARES[p])
            weight = np.log(LIMIT_WEIGHTS[q] * SHARE_WEIGHTS[p])
            total = add_logs(total, weight + pattern + fainter)
    return total
