"""BRIGHT without a clock: comparisons that each method makes, and the mismatch that equation (15) expects.

The paper orders the methods by their times in MATLAB. What of that is the method's own is the number of
comparisons: two lists of candidates are joined entry by entry, as a program without other tables does. Of a
list the brightness leaves one way round, where the order is certain; the other methods have both.
"""

import numpy as np

from shefex_nav.papers.bright import fields
from shefex_nav.papers.bright.methods import brightness


def spans(pairs, u_c, tolerance):
    """Catalogue pairs with each angle between detections: (n, n) int."""
    cosines = np.clip(u_c @ u_c.T, -1.0, 1.0)
    angle = np.arccos(cosines)
    low = np.searchsorted(pairs.cosine, np.cos(angle + tolerance))
    return np.searchsorted(pairs.cosine, np.cos(np.maximum(angle - tolerance, 0.0))) - low


def comparisons(settings, pairs, field):
    """Comparisons of the first group that each of the paper's methods tries: dict of method -> int.

    Brightness-referenced: the brightest star with the three dimmest, two lists joined and what is left with
    the third. Pyramid: the first triad in the same way, every entry both ways round. Voting: four votes an
    entry of all pairs, and the validation of all identities.
    """
    n = min(len(field.flux), settings.most_centroids)
    size = spans(pairs, field.u_c[:n], settings.tolerance)
    ratio = 10.0 ** (0.4 * brightness.GAMMA_SIGMAS * settings.magnitude_error)
    ways = [1 if field.flux[0] > ratio * field.flux[k] else 2 for k in range(n)]
    first, second = ways[n - 1] * size[0, n - 1], ways[n - 2] * size[0, n - 2]
    third = ways[n - 3] * size[0, n - 3] if n > 3 else 0
    every = int(np.triu(size, 1).sum())
    sides = 2 * size[0, 1], 2 * size[0, 2]
    return {
        "brightness_referenced": int(first * second + _left(pairs, first, second) * third),
        "pyramid": int(sides[0] * sides[1] + _left(pairs, *sides) * size[1, 2]),
        "geometric_voting": 4 * every + n * (n - 1) // 2,
    }


def _left(pairs, first, second):
    """Candidates that two lists of stars have in common, on average, if they are drawn at random."""
    return 1.0 + first * second / len(pairs.stars.hip)


def mismatch(n_stars, error, angles):
    """Probability that another star has all three angles: equation (15), (N - 1) (N sin k sigma)^3 x sines.

    n_stars : N, stars of the catalogue;  error : float [rad], k sigma;  angles : (..., 3) rad
    """
    return (n_stars - 1) * (n_stars * np.sin(error)) ** 3 * np.prod(np.sin(angles), axis=-1)


def mismatch_of(field, n_stars):
    """The same of a field's brightest star and its three dimmest of ten."""
    n = min(len(field.flux), fields.IDENTIFY.most_centroids)
    cosines = np.clip(field.u_c[n - 3 : n] @ field.u_c[0], -1.0, 1.0)
    return float(mismatch(n_stars, fields.TOLERANCE, np.arccos(cosines)))
