"""Brightness-referenced identification (Sensors 2014, 14, section 4.3).

The table of pairs says which star of each is the brighter one. Where two detections differ by more than
gamma, the brighter detection can only be the brighter star, which halves the candidates; where a detection is
surely brighter than magnitude 3, only the 165 stars of that brightness are left, and three stars are enough
(reference-star mode). Otherwise it takes four (four-star mode), which is also the fallback. A star is always
combined with the dimmest ones, so that the order of brightness is certain.

Where the text leaves a choice: gamma is a difference of magnitudes, not of intensities, as its error is; it
is three times the magnitude error, which at the paper's 0.2 mag is the value with which its share of frames
"within the accuracy" (97.5 per cent, section 4.1) comes out. The two angles of section 4.3.1 are those of
s_i with s_j and s_k, printed s_i s_j and s_j s_k. All further angles of a candidate are checked.
`match` believes what the paper believes; `identify` has it verified.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing
from shefex_nav.papers.angles import (
    believed,
    extend,
    first_verified,
    fits,
    is_published,
    look_up,
    new_sides,
    table,
)
from shefex_nav.records import Reason

REFERENCE_MAGNITUDE = 3.0
GAMMA_SIGMAS = 3.0  # gamma in units of the magnitude error
SEEN_BEFORE = 2  # [E] of three stars; the paper says 'compared'
MAX_TRIPLES = 64  # candidates of three detections; 0.1 is usual
MAX_CANDIDATES = 24  # that `identify` has verified before it gives up; 1 or 2 are usual

NONE, NO_MATCH = int(Reason.NONE), int(Reason.NO_MATCH)


class Light(NamedTuple):
    """What is known of the brightness."""

    first_vmag: np.ndarray  # (m,) magnitude of the brighter star of each pair
    second_vmag: np.ndarray  # (m,) and of the other
    flux: np.ndarray  # (n,) of the detections, descending
    brighter_by: float  # ratio of two fluxes whose order is certain
    reference_flux: float  # M_t


def match(settings, camera, pairs, u_c, flux, reference_flux=np.inf, previous=None):
    """The paper's own algorithm with its own acceptance; nothing is verified.

    Parameters
    ----------
    settings : Identification; of it `tolerance`, `most_centroids` and `magnitude_error`
    camera : CameraModel, not used
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera
    flux : (n,) brightness, descending
    reference_flux : float, a star with more is surely brighter than REFERENCE_MAGNITUDE
    previous : rows of the catalogue that were identified before, which three stars alone are compared with:
        two of them must be among these (section 4.3.2); None: no comparison

    Returns
    -------
    Identification, its log_odds NaN: nobody has asked
    """
    n = min(len(flux), settings.most_centroids)
    if n < 3:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    star = np.full(len(flux), -1, dtype=np.int64)
    light = _light(settings, pairs, flux[:n], reference_flux)
    reason = _match_kernel(table(pairs), light, u_c[:n], float(settings.tolerance), 0, star[:n])
    if n == 3 and previous is not None and np.isin(star[star >= 0], previous).sum() < SEEN_BEFORE:
        return nothing(len(flux), Reason.NO_MATCH)
    return Identification(star, reason, np.nan)


def identify(settings, camera, pairs, u_c, flux, P_px=None, reference_flux=None):
    """Identify the stars of one frame without any idea of the attitude: right or nothing.

    Parameters
    ----------
    settings : Identification; of it `reference_magnitude`, without which there is no reference-star mode
    camera : CameraModel; of it `zero_flux`, by which grey values have a magnitude
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera
    flux : (n,) brightness, descending
    P_px : ignored; the published method knows one tolerance for all centroids
    reference_flux : as of `match`; None: as settings and camera say

    Returns
    -------
    Identification

    Raises
    ------
    ValueError : a reference magnitude and no zero_flux
    """
    if reference_flux is None:
        reference_flux = flux_of(settings, camera)
    if is_published(settings):
        return believed(settings, match(settings, camera, pairs, u_c, flux, reference_flux))
    n = min(len(flux), settings.most_centroids)
    if n < settings.fewest_stars:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    light, tolerance = _light(settings, pairs, flux[:n], reference_flux), float(settings.tolerance)
    candidates = _candidates(pairs, light, u_c[:n], tolerance, len(flux))
    return first_verified(settings, camera, pairs.stars, u_c, flux, candidates)


def _candidates(pairs, light, u_c, tolerance, n_all):
    """Stars of each match, (n_all,) int64 with -1: iterator."""
    for skip in range(MAX_CANDIDATES):
        star = np.full(n_all, -1, dtype=np.int64)
        if _match_kernel(table(pairs), light, u_c, tolerance, skip, star[: len(u_c)]) != Reason.NONE:
            return
        yield star


def flux_of(settings, camera):
    """M_t: the light above which a detection is a reference star; inf where none can be one. -> float"""
    if settings.reference_magnitude is None:
        return np.inf
    if not camera.zero_flux > 0.0:
        raise ValueError("a reference magnitude needs zero_flux, the light of a star of magnitude 0")
    return camera.zero_flux * 10.0 ** (-0.4 * settings.reference_magnitude)


def _light(settings, pairs, flux, reference_flux):
    """Light of one frame."""
    gamma = GAMMA_SIGMAS * settings.magnitude_error
    return Light(
        pairs.first_vmag,
        pairs.second_vmag,
        np.asarray(flux, dtype=np.float64),
        float(10.0 ** (0.4 * gamma)),
        float(reference_flux),
    )


@inner
def _ways(table, light, i, j, faintest, p, way):
    """Stars of detections i and j if they are pair p, one way or the other; (-1, -1) where it cannot be.

    i is the brighter detection. Way 0: its star is the brighter one too; way 1: the other way round, out of
    the question when the order of brightness is certain. The star of i is not fainter than `faintest`.
    """
    if way == 0:
        if light.first_vmag[p] > faintest:
            return -1, -1
        return table.first[p], table.second[p]
    if light.flux[i] > light.brighter_by * light.flux[j] or light.second_vmag[p] > faintest:
        return -1, -1
    return table.second[p], table.first[p]


@inner
def _partners(table, light, sides, i, j, faintest, head):
    """Candidates of detection i with the star that j would be, as lists: head[star of i] -> entries.

    Returns
    -------
    partner, link : star of j, and the next entry of the same star or -1
    """
    begin, end = look_up(table, sides, i, j)
    partner, link = np.empty(2 * (end - begin), dtype=np.int64), np.empty(2 * (end - begin), dtype=np.int64)
    m = 0
    for p in range(begin, end):
        for way in range(2):
            a, b = _ways(table, light, i, j, faintest, p, way)
            if a >= 0:
                partner[m], link[m], head[a] = b, head[a], m
                m += 1
    return partner, link


@inner
def _clear(table, sides, i, j, head):
    """Make the lists of `_partners` empty again."""
    begin, end = look_up(table, sides, i, j)
    for p in range(begin, end):
        head[table.first[p]] = -1
        head[table.second[p]] = -1


@inner
def _triples(table, light, sides, ijk, faintest, lists, triples):
    """List the stars of three detections that have all three angles.

    Returns
    -------
    n : int, of triples (a, b, c)
    is_one : bool, detection i was one single star already after the angles with j and k
    """
    i, j, k = ijk
    head, partner, link = lists
    begin, end = look_up(table, sides, i, k)
    n, reference, is_one = 0, -1, True
    for p in range(begin, end):
        for way in range(2):
            a, c = _ways(table, light, i, k, faintest, p, way)
            if a < 0 or head[a] < 0:
                continue
            is_one = is_one and (reference < 0 or reference == a)
            reference = a
            e = head[a]
            while e >= 0:
                b = partner[e]
                e = link[e]
                if b != c and n < triples.shape[0] and fits(table, sides, j, k, b, c):
                    triples[n, 0], triples[n, 1], triples[n, 2] = a, b, c
                    n += 1
    return n, is_one


@inner
def _quadruple(table, light, sides, ijk, m, triples, n):
    """The quadruple of stars that n triples make with detection m, if there is just one; else -1s."""
    i, j, k = ijk
    begin, end = look_up(table, sides, i, m)
    n_found, found = 0, (-1, -1, -1, -1)
    for p in range(begin, end):
        for way in range(2):
            star_i, d = _ways(table, light, i, m, np.inf, p, way)
            for t in range(n):
                a, b, c = triples[t, 0], triples[t, 1], triples[t, 2]
                if star_i == a and fits(table, sides, j, m, b, d) and fits(table, sides, k, m, c, d):
                    n_found += 1
                    found = (a, b, c, d)
    return found if n_found == 1 else (-1, -1, -1, -1)


@inner
def _reference_mode(table, light, sides, room, skip, star):
    """Figure 5: each surely bright star with two dim ones; candidates still to skip, -1 when done."""
    head, triples = room
    n = len(light.flux)
    for i in range(n - 2):
        if light.flux[i] <= light.reference_flux:
            break
        for j in range(n - 1, i + 1, -1):
            lists = (head, *_partners(table, light, sides, i, j, REFERENCE_MAGNITUDE, head))
            for k in range(j - 1, i, -1):
                ijk = (i, j, k)
                n_found, is_one = _triples(table, light, sides, ijk, REFERENCE_MAGNITUDE, lists, triples)
                if n_found == 1 and is_one:
                    skip -= 1
                    if skip < 0:
                        extend(table, sides, ijk, (triples[0, 0], triples[0, 1], triples[0, 2]), star)
                        return skip
            _clear(table, sides, i, j, head)
    return skip


@inner
def _four_star_mode(table, light, sides, room, skip, star):
    """Each star with three dim ones; candidates still to skip, -1 when one has been written to `star`.

    The three angles of i, j, k are looked at before the fourth star: where they are not a triangle of the
    catalogue, no fourth star can make them one.
    """
    head, triples = room
    n = len(light.flux)
    for i in range(n - 3):
        for j in range(n - 1, i + 2, -1):
            lists = (head, *_partners(table, light, sides, i, j, np.inf, head))
            for k in range(j - 1, i + 1, -1):
                ijk = (i, j, k)
                n_found, _ = _triples(table, light, sides, ijk, np.inf, lists, triples)
                for m in range(k - 1, i if n_found > 0 else k - 1, -1):
                    a, b, c, d = _quadruple(table, light, sides, ijk, m, triples, n_found)
                    skip -= a >= 0
                    if skip < 0:
                        extend(table, sides, ijk, (a, b, c), star)
                        star[m] = d
                        return skip
            _clear(table, sides, i, j, head)
    return skip


@kernel
def _match_kernel(table, light, u_c, tolerance, skip, star):
    """Figure 6: write the candidate after `skip` others to `star`; the reason."""
    sides = new_sides(u_c, tolerance, 0.0)
    head = np.full(table.u_i.shape[0], -1, dtype=np.int64)
    triples = np.empty((MAX_TRIPLES, 3), dtype=np.int64)
    if len(light.flux) == 3:
        lists = (head, *_partners(table, light, sides, 0, 1, np.inf, head))
        n, _ = _triples(table, light, sides, (0, 1, 2), np.inf, lists, triples)
        if n != 1 or skip > 0:
            return NO_MATCH
        star[:] = triples[0]
        return NONE
    skip = _reference_mode(table, light, sides, (head, triples), skip, star)
    if skip >= 0:
        skip = _four_star_mode(table, light, sides, (head, triples), skip, star)
    return NONE if skip < 0 else NO_MATCH
