"""Improved Multi-Poles Algorithm (2019, section 5): one star and its distances to all others, twice.

Acceptance: a detection is the pole, brightest first. Its angle with each other detection is looked up in the
catalogue, pairs whose magnitudes do not suit the two detections are left out, and the star that occurs most
often in what remains is the pole, if there is just one such star; each neighbour that makes a pair with it is
accepted as the other star of the pair. Check: a second pole, out of the accepted neighbours, gives a second
list, and the detections that have the same name in both are recognised when they are at least min_stars
(t*).

Where the text leaves a choice: the occurrences are counted over different pairs, as Π(i) is a set (41). A
neighbour that the pole makes pairs with in two or more ways is given no name, as (42) has room for one. When
the check fails, the next accepted neighbour is the second pole, and after the last of them the next detection
is the first one. Two recognised detections with the name of one star both lose it. (44) is taken with its >=
and not with the text's "greater". eps_m is not given: `magnitude_tolerance`.
`match` believes what the paper believes; `identify` has it verified.
"""

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.identify.angles import look_up, new_sides, table
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing, verify
from shefex_nav.records import Reason

MAX_CANDIDATES = 24  # that `identify` has verified before it gives up; one is usual

NONE, NO_MATCH = int(Reason.NONE), int(Reason.NO_MATCH)


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
    quick, vmag = table(pairs), pairs.stars.vmag
    sides = new_sides(u_c[:n], float(params.tolerance), float(params.cos_error))
    accepted = np.full((n, n), -1, dtype=np.int64)  # A of each pole
    is_known = np.zeros(n, dtype=np.bool_)  # whose A has been found
    filter_ = vmag, magnitude, float(params.magnitude_tolerance)
    least, begin = int(params.min_stars), 0
    while begin >= 0:
        star = np.full(len(flux), -1, dtype=np.int64)
        begin = _next_kernel(quick, filter_, sides, least, accepted, is_known, begin, star[:n])
        if begin >= 0:
            yield star


@njit(cache=True)
def suits(filter_, i, j, a, b):
    """Whether stars a and b have the magnitudes of detections i and j, one way or the other: (38)."""
    vmag, magnitude, tolerance = filter_
    if abs(vmag[a] - magnitude[i]) < tolerance and abs(vmag[b] - magnitude[j]) < tolerance:
        return True
    return abs(vmag[b] - magnitude[i]) < tolerance and abs(vmag[a] - magnitude[j]) < tolerance


@njit(cache=True)
def _suitable_pairs(table, filter_, sides, i):
    """Catalogue pairs of pole i with each neighbour, (37) to (40).

    Returns
    -------
    pair : (m,) int64 catalogue pairs, neighbour after neighbour
    end : (n,) int64, those of neighbour j end here and begin where those of j - 1 end
    """
    n = sides.u_c.shape[0]
    pair, end, m = np.empty(256, dtype=np.int64), np.zeros(n, dtype=np.int64), 0
    for j in range(n):
        if j != i:
            first, last = look_up(table, sides, i, j)
            for p in range(first, last):
                if suits(filter_, i, j, table.first[p], table.second[p]):
                    if m == len(pair):
                        pair = np.concatenate((pair, np.empty_like(pair)))
                    pair[m] = p
                    m += 1
        end[j] = m
    return pair[:m], end


@njit(cache=True)
def _most_frequent(table, pair):
    """The star that occurs in the most different pairs, -1 if that is not one alone."""
    occurrence = np.zeros(table.u_i.shape[0], dtype=np.int64)
    ordered = np.sort(pair)
    for k in range(len(ordered)):
        if k == 0 or ordered[k] != ordered[k - 1]:  # else found with another neighbour already
            occurrence[table.first[ordered[k]]] += 1
            occurrence[table.second[ordered[k]]] += 1
    star = occurrence.argmax()
    return star if (occurrence == occurrence[star]).sum() == 1 else -1


@njit(cache=True)
def accept(table, filter_, sides, i, row):
    """Write A of pole i to `row`: the star of the pole and of each neighbour, -1; whether there is a pole."""
    row[:] = -1
    pair, end = _suitable_pairs(table, filter_, sides, i)
    pole = _most_frequent(table, pair)
    if pole < 0:
        return False
    row[i] = pole
    begin = 0
    for j in range(len(row)):
        for k in range(begin, end[j]):
            a, b = table.first[pair[k]], table.second[pair[k]]
            if a == pole or b == pole:
                other = b if a == pole else a
                row[j] = other if row[j] == -1 else -2
        begin = end[j]
    for j in range(len(row)):
        row[j] = max(row[j], -1)
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
def _next_kernel(table, filter_, sides, least, accepted, is_known, begin, star):
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
            accept(table, filter_, sides, i, accepted[i])
            is_known[i] = True
        if i == j or accepted[i, j] < 0:
            continue
        if not is_known[j]:
            accept(table, filter_, sides, j, accepted[j])
            is_known[j] = True
        if accepted[j, j] >= 0 and common(accepted[i], accepted[j], star) >= least:
            return number + 1
    return -1
