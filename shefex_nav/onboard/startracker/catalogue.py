"""The star catalogue that flies: which stars, and the table of their pairs.

In: all stars to V = 8 at the epoch of the mission. Out: `OnboardCatalogue` and `StarPairs`. Two ways to
choose the stars: everything to a magnitude, or the combination flown on SHEFEX-2 (section 3.3), all bright
stars plus fainter ones where the sky would be empty. Stars that the camera cannot separate are one entry at
their centre of light.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.stars import at_epoch, photocentres
from shefex_nav.onboard.startracker import kvector, skygrid


class CatalogueParams(NamedTuple):
    """Which stars fly."""

    kind: str  # 'magnitude_limited' or 'combined'
    max_magnitude: float  # V, of the catalogue or of the pool that fills it
    merge_radius: float  # rad, closer stars are one point of light
    keep_magnitude: float  # V, 'combined': all stars to here are kept
    n_stars: int  # 'combined': size


class OnboardCatalogue(NamedTuple):
    """Stars, brightest first."""

    hip: np.ndarray  # (n,) int64 Hipparcos number of the brightest star of each entry
    u_i: np.ndarray  # (n, 3) unit vectors at the epoch, without aberration
    vmag: np.ndarray  # (n,) V of the summed light


class StarPairs(NamedTuple):
    """Pairs of stars that fit into the field of view, ordered by the cosine of their angle."""

    stars: OnboardCatalogue
    cosine: np.ndarray  # (m,) ascending
    first: np.ndarray  # (m,) int64 row of the brighter star
    second: np.ndarray  # (m,) int64 row of the fainter star
    index: kvector.KVector  # of cosine
    sky: skygrid.SkyGrid  # stars within half of max_angle of each direction


def build(params, catalogue, julian_year):
    """On-board catalogue of the given kind. CatalogueParams, StarCatalogue, year -> OnboardCatalogue."""
    stars = photocentres(at_epoch(catalogue, julian_year), params.max_magnitude, params.merge_radius)
    if params.kind == "magnitude_limited":
        rows = np.flatnonzero(stars.vmag <= params.max_magnitude)
    elif params.kind == "combined":
        rows = combined_rows(stars, params.keep_magnitude, params.n_stars)
    else:
        raise ValueError(f"unknown star catalogue {params.kind!r}")
    return OnboardCatalogue(
        stars.hip[rows].astype(np.int64),
        np.ascontiguousarray(stars.u_i[rows]),
        np.ascontiguousarray(stars.vmag[rows]),
    )


def combined_rows(stars, keep_magnitude, n_stars):
    """Rows of the combined catalogue: all bright stars, the rest as evenly spread as possible.

    Beyond keep_magnitude the stars are tried from bright to faint and taken when no taken star is nearer
    than a separation; the largest separation that still gives n_stars is found by bisection. The paper
    gives the outcome (2023 stars, 54 804 pairs), not the recipe.

    Parameters
    ----------
    stars : StarCatalogue, brightest first
    keep_magnitude : float, V
    n_stars : int

    Returns
    -------
    (n_stars,) int, ascending
    """
    n_keep = int(np.searchsorted(stars.vmag, keep_magnitude, side="right"))
    if not n_keep <= n_stars <= len(stars.hip):
        raise ValueError(f"{n_stars} stars asked for, {n_keep} to keep, {len(stars.hip)} in all")
    u_i = np.ascontiguousarray(stars.u_i)
    low, high = 0.0, np.pi / 4
    rows = np.arange(n_stars)
    while high - low > 1e-5:  # rad; far finer than the step between two separations that matter
        separation = 0.5 * (low + high)
        taken, n_taken = _spread_kernel(u_i, n_keep, n_stars, np.cos(separation))
        if n_taken == n_stars:
            low, rows = separation, taken
        else:
            high = separation
    return rows


@njit(cache=True)
def _spread_kernel(u_i, n_keep, n_stars, cos_separation):
    """Rows 0 ... n_keep - 1 and then each that is far enough from all taken, until there are n_stars."""
    taken = np.arange(n_stars)
    n = n_keep
    for k in range(n_keep, u_i.shape[0]):
        if n == n_stars:
            break
        free = True
        for j in range(n):
            t = taken[j]
            cosine = u_i[k, 0] * u_i[t, 0] + u_i[k, 1] * u_i[t, 1] + u_i[k, 2] * u_i[t, 2]
            if cosine > cos_separation:
                free = False
                break
        if free:
            taken[n] = k
            n += 1
    return taken, n


def pair_table(stars, max_angle):
    """All pairs of stars not further apart than max_angle [rad]. OnboardCatalogue -> StarPairs."""
    cosine, first, second = _pairs_kernel(stars.u_i, np.cos(max_angle))
    order = np.argsort(cosine, kind="stable")
    cosine = cosine[order]
    sky = skygrid.build(stars.u_i, stars.vmag, 0.5 * max_angle)
    return StarPairs(stars, cosine, first[order], second[order], kvector.build(cosine), sky)


@njit(cache=True)
def _pairs_kernel(u_i, cos_max_angle):
    """Pairs (i < j) with a cosine of at least cos_max_angle, in the order of i and j."""
    n, size = 0, 1024
    cosines = np.empty(size)
    first, second = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    for i in range(u_i.shape[0]):
        for j in range(i + 1, u_i.shape[0]):
            cosine = u_i[i, 0] * u_i[j, 0] + u_i[i, 1] * u_i[j, 1] + u_i[i, 2] * u_i[j, 2]
            if cosine < cos_max_angle:
                continue
            if n == size:
                size *= 2
                cosines = np.concatenate((cosines, np.empty(n)))
                first = np.concatenate((first, np.empty(n, dtype=np.int64)))
                second = np.concatenate((second, np.empty(n, dtype=np.int64)))
            cosines[n], first[n], second[n] = cosine, i, j
            n += 1
    return cosines[:n].copy(), first[:n].copy(), second[:n].copy()
