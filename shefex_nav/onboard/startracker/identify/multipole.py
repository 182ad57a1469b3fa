"""Improved Multi-Poles Algorithm (2019, section 5): one star and its distances to all others, twice.

Acceptance: a detection is the pole, brightest first. Its angle with each other detection is looked up in the
catalogue, pairs whose magnitudes do not suit the two detections are left out, and the star that occurs most
often in what remains is the pole, if there is just one such star; each neighbour that makes a pair with it is
accepted as the other star of the pair. Check: a second pole, out of the accepted neighbours, gives a second
list, and the detections that have the same name in both are recognised when they are at least min_stars
(t*).

Where the text leaves a choice: a star occurs at most once with each neighbour ("in one element of n different
sets, n <= Ns - 1"), and only where it has the magnitude of the pole itself; counted as it is printed, with
both stars of every pair, 60 of 100 fields with 50 false objects are solved in place of 71. A neighbour that
could be two stars is given no name, as (42) has room for one. When the check fails, the next accepted
neighbour is the second pole, and after the last of them the next detection is the first one. Two recognised
detections with the name of one star both lose it. (44) is taken with its >= and not with the text's
"greater". eps_m is not given: `magnitude_tolerance`.
`match` believes what the paper believes; `identify` has it verified.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.identify.angles import look_up, new_sides, table
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing, verify
from shefex_nav.records import Reason

MAX_CANDIDATES = 24  # that `identify` has verified before it gives up; one is usual

NONE, NO_MATCH = int(Reason.NONE), int(Reason.NO_MATCH)


class Light(NamedTuple):
    """Magnitudes, catalogued and measured."""

    first_vmag: np.ndarray  # (m,) of the brighter star of each pair
    second_vmag: np.ndarray  # (m,) and of the other
    magnitude: np.ndarray  # (n,) of the detections
    tolerance: float  # eps_m


def magnitudes(params, flux):
    """Magnitude of each flux, equation (32). IdentifyParams, (n,) -> (n,); ValueError without zero_flux."""
    zero_flux = params.zero_flux
    if not zero_flux > 0.0:
        raise ValueError(f"star identification 'multipole' needs the flux of magnitude 0, not {zero_flux}")
    return -2.5 * np.log10(np.asarray(flux, dtype=np.float64) / zero_flux)


def match(params, pairs, u_c, flux):
    """The paper's own algorithm with its own acceptance; nothing is verified.

    Parameters
    ----------
    params : IdentifyParams; of it `tolerance` (eps_theta) or `cos_error`, `min_stars` (t*), `max_centroids`,
        `zero_flux` and `magnitude_tolerance` (eps_m)
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera, brightest detection first
    flux : (n,)

    Returns
    -------
    Identification, its log_odds NaN: nobody has asked
    """
    found = next(_candidates(params, pairs, u_c, flux), None)
    if found is None:
        few = min(len(flux), params.max_centroids) < params.min_stars
        return nothing(len(flux), Reason.TOO_FEW_STARS if few else Reason.NO_MATCH)
    return Identification(found, NONE, np.nan)


def identify(params, pairs, u_c, flux, P_px=None):
    """Identify the stars of one frame without any idea of the attitude: right or nothing.

    What the check phase recognises is verified against the whole field; where that fails, the poles go on.

    Parameters
    ----------
    params : IdentifyParams, as `match`
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera
    flux : (n,) brightness, descending
    P_px : (n, 2, 2) px^2, not used

    Returns
    -------
    Identification

    Raises
    ------
    ValueError : no zero_flux
    """
    if min(len(flux), params.max_centroids) < params.min_stars:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    best = nothing(len(flux), Reason.NO_MATCH)
    for _, star in zip(range(MAX_CANDIDATES), _candidates(params, pairs, u_c, flux), strict=False):
        found = verify(params, pairs.stars, u_c, flux, star)
        if found.reason == Reason.NONE:
            return found
        if best.reason != Reason.AMBIGUOUS:
            best = nothing(len(flux), found.reason)
    return best


def _candidates(params, pairs, u_c, flux):
    """Recognised stars, (len(flux),) int64 with -1, of each two poles that pass the check."""
    n = min(len(flux), params.max_centroids)
    magnitude = magnitudes(params, flux[:n])
    if n < params.min_stars:
        return
    quick = table(pairs)
    light = Light(pairs.first_vmag, pairs.second_vmag, magnitude, float(params.magnitude_tolerance))
    sides = new_sides(u_c[:n], float(params.tolerance), float(params.cos_error))
    accepted = np.full((n, n), -1, dtype=np.int64)  # A of each pole
    is_known = np.zeros(n, dtype=np.bool_)  # whose A has been found
    least, begin = int(params.min_stars), 0
    while begin >= 0:
        star = np.full(len(flux), -1, dtype=np.int64)
        begin = _next_kernel(quick, light, sides, least, accepted, is_known, begin, star[:n])
        if begin >= 0:
            yield star


@njit(cache=True)
def ways(light, i, j, p):
    """Whether pair p has the magnitudes of detections i and j as it is listed, and in reverse: (38)."""
    mi, mj = light.magnitude[i], light.magnitude[j]
    m1, m2, tolerance = light.first_vmag[p], light.second_vmag[p], light.tolerance
    as_listed = abs(m1 - mi) < tolerance and abs(m2 - mj) < tolerance
    return as_listed, abs(m2 - mi) < tolerance and abs(m1 - mj) < tolerance


@njit(cache=True)
def occurrences(table, light, sides, i):
    """With how many neighbours each star can be pole i: (n_stars,) int64, equations (37) to (41)."""
    n_stars = table.u_i.shape[0]
    count, counted = np.zeros(n_stars, dtype=np.int64), np.full(n_stars, -1, dtype=np.int64)
    for j in range(sides.u_c.shape[0]):
        if j == i:
            continue
        begin, end = look_up(table, sides, i, j)
        for p in range(begin, end):
            as_listed, reverse = ways(light, i, j, p)
            if as_listed and counted[table.first[p]] != j:
                count[table.first[p]] += 1
                counted[table.first[p]] = j
            if reverse and counted[table.second[p]] != j:
                count[table.second[p]] += 1
                counted[table.second[p]] = j
    return count


@njit(cache=True)
def partner(table, light, sides, i, j, pole):
    """The star of neighbour j if that of i is `pole`; -1 if there is none or more than one: (42)."""
    found = -1
    begin, end = look_up(table, sides, i, j)
    for p in range(begin, end):
        if table.first[p] == pole:
            other, fits = table.second[p], ways(light, i, j, p)[0]
        elif table.second[p] == pole:
            other, fits = table.first[p], ways(light, i, j, p)[1]
        else:
            continue
        if fits:
            if found >= 0:
                return -1
            found = other
    return found


@njit(cache=True)
def accept(table, light, sides, i, row):
    """Write A of pole i to `row`: the star of the pole and of each neighbour, -1; whether there is a pole."""
    row[:] = -1
    count = occurrences(table, light, sides, i)
    pole = count.argmax()
    if count[pole] == 0 or (count == count[pole]).sum() > 1:
        return False
    for j in range(len(row)):
        row[j] = pole if j == i else partner(table, light, sides, i, j, pole)
    return True


@njit(cache=True)
def common(first, second, star):
    """Write the names that two lists have in common to `star`; how many (44), (45)."""
    n, count = len(star), 0
    for k in range(n):
        star[k] = first[k] if first[k] == second[k] else -1
    for k in range(n):
        rivals = 0
        for e in range(k + 1, n):
            if star[k] >= 0 and star[e] == star[k]:
                star[e] = -1
                rivals += 1
        if rivals > 0:
            star[k] = -1
        count += star[k] >= 0
    return count


@njit(cache=True)
def _next_kernel(table, light, sides, least, accepted, is_known, begin, star):
    """Go on from the two poles number `begin` (first n + second) until two pass; they are in `star`.

    A list depends on its pole alone and is made once, in `accepted`.

    Returns
    -------
    next : int, where to go on; -1 when there are no more
    """
    n = len(star)
    for number in range(begin, n * n):
        i, j = number // n, number % n
        if not is_known[i]:
            accept(table, light, sides, i, accepted[i])
            is_known[i] = True
        if i == j or accepted[i, j] < 0:
            continue
        if not is_known[j]:
            accept(table, light, sides, j, accepted[j])
            is_known[j] = True
        if accepted[j, j] >= 0 and common(accepted[i], accepted[j], star) >= least:
            return number + 1
    return -1
