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
`match` believes what the paper believes; `identify` has it verified; `both` answers as the two of them do.

The pairs of the catalogue that have the angle of two detections are looked up and sifted by magnitude once,
for either of the two as the pole. Stars are numbered from the brightest on: those of a detection's magnitude
are a range of numbers, and where a pair suits two detections with its fainter star on the brighter detection,
it suits them the other way round as well.
"""

from itertools import chain, islice
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.elementary import log10
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing
from shefex_nav.papers.angles import believed, first_verified, is_published, look_up, new_sides, table
from shefex_nav.records import Reason

MAX_CANDIDATES = 24  # that `identify` has verified before it gives up; one is usual

NONE = int(Reason.NONE)

LOW, SHIFT = np.uint32(0xFFFF), np.uint32(16)  # of two numbers in a word


class Light(NamedTuple):
    """Stars of the magnitude of each detection, (38): rows begin ... end - 1 of the catalogue."""

    begin: np.ndarray  # (n,) int64
    end: np.ndarray  # (n,) int64


class Votes(NamedTuple):
    """How often each star occurs where each detection is the pole, as far as that has been counted."""

    counts: np.ndarray  # (n, n_stars) uint32: low 16 bits neighbours, high 16 bits the last of them plus one
    is_counted: np.ndarray  # (n, n) bool, of pole and neighbour
    work: np.ndarray  # (m + 1,) uint32, room for all pairs: touched only as far as it is needed


class Accepted(NamedTuple):
    """Set A of each detection as the pole, as far as it has been found."""

    star: np.ndarray  # (n, n) int64, of pole and detection: the star that it is accepted as, -1
    is_known: np.ndarray  # (n,) bool, whose A has been found


def magnitudes(zero_flux, flux):
    """Magnitude of each flux, equation (32). float, (n,) -> (n,); ValueError without zero_flux."""
    if not zero_flux > 0.0:
        raise ValueError(f"star identification 'multipole' needs the flux of magnitude 0, not {zero_flux}")
    return -2.5 * log10(np.asarray(flux, dtype=np.float64) / zero_flux)


def light_of(vmag, magnitude, tolerance):
    """Stars of each magnitude: |vmag - magnitude| < tolerance.

    Parameters
    ----------
    vmag : (n_stars,) ascending
    magnitude : (n,) of the detections; NaN suits no star
    tolerance : float, eps_m

    Returns
    -------
    Light
    """
    if not (vmag[1:] >= vmag[:-1]).all():
        raise ValueError("star identification 'multipole' needs a catalogue that is sorted by magnitude")
    return _light_kernel(vmag, magnitude, float(tolerance))


@kernel
def _light_kernel(vmag, magnitude, tolerance):
    begin, end = np.zeros(len(magnitude), dtype=np.int64), np.zeros(len(magnitude), dtype=np.int64)
    for i in range(len(magnitude)):
        low, high = 0, len(vmag)  # the first star that is not too bright is in low ... high
        while low < high:
            middle = (low + high) // 2
            if vmag[middle] - magnitude[i] > -tolerance:
                high = middle
            else:
                low = middle + 1
        begin[i], high = low, len(vmag)
        while low < high:  # and the first that is too faint
            middle = (low + high) // 2
            if vmag[middle] - magnitude[i] < tolerance:
                low = middle + 1
            else:
                high = middle
        end[i] = low
    return Light(begin, end)


def packed(pairs):
    """Rows of each catalogue pair in one word: the brighter star in the low 16 bits. StarPairs -> (m,)."""
    star = pairs.quick[1].star
    return star.view(np.dtype("<u4")).ravel()


def match(settings, camera, pairs, u_c, flux):
    """The paper's own algorithm with its own acceptance; nothing is verified.

    Parameters
    ----------
    settings : Identification; of it `tolerance` (eps_theta), `fewest_stars` (t*), `most_centroids` and
        `magnitude_tolerance` (eps_m)
    camera : CameraModel; of it `zero_flux`
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera, brightest detection first
    flux : (n,)

    Returns
    -------
    Identification, its log_odds NaN: nobody has asked
    """
    return _believed(settings, flux, next(_candidates(settings, camera, pairs, u_c, flux), None))


def _believed(settings, flux, star):
    """Identification of recognised stars as they are; None: there are none."""
    if star is None:
        few = min(len(flux), settings.most_centroids) < settings.fewest_stars
        return nothing(len(flux), Reason.TOO_FEW_STARS if few else Reason.NO_MATCH)
    return Identification(star, NONE, np.nan)


def identify(settings, camera, pairs, u_c, flux, P_px=None):
    """Identify the stars of one frame without any idea of the attitude: right or nothing.

    What the check phase recognises is verified against the whole field; where that fails, the poles go on.

    Parameters
    ----------
    settings, camera : as of `match`
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
    if is_published(settings):
        return believed(settings, match(settings, camera, pairs, u_c, flux))
    return both(settings, camera, pairs, u_c, flux)[1]


def both(settings, camera, pairs, u_c, flux):
    """What `match` and `identify` find, with one search: the first candidate of the second is the first's.

    Parameters
    ----------
    settings, camera, pairs, u_c, flux : as `match`

    Returns
    -------
    published, verified : Identification
    """
    candidates = _candidates(settings, camera, pairs, u_c, flux)
    first = next(candidates, None)
    published = _believed(settings, flux, first)
    if first is None:
        return published, published
    every = chain([first], islice(candidates, MAX_CANDIDATES - 1))
    return published, first_verified(settings, camera, pairs.stars, u_c, flux, every)


def _candidates(settings, camera, pairs, u_c, flux):
    """Recognised stars, (len(flux),) int64 with -1, of each two poles that pass the check."""
    n = min(len(flux), settings.most_centroids)
    magnitude = magnitudes(camera.zero_flux, flux[:n])
    if n < settings.fewest_stars:
        return
    sky = table(pairs), packed(pairs)
    light = light_of(pairs.stars.vmag, magnitude, settings.magnitude_tolerance)
    sides = new_sides(u_c[:n], float(settings.tolerance), 0.0)
    votes = new_votes(n, len(pairs.stars.vmag), len(sky[1]))
    accepted = Accepted(np.full((n, n), -1, dtype=np.int64), np.zeros(n, dtype=np.bool_))
    least, begin = int(settings.fewest_stars), 0
    while begin >= 0:
        star = np.full(len(flux), -1, dtype=np.int64)
        begin = _next_kernel(sky, light, sides, votes, least, accepted, begin, star[:n])
        if begin >= 0:
            yield star


def new_votes(n, n_stars, n_pairs):
    """Votes of n detections for n_stars stars that make n_pairs pairs: nothing counted."""
    counts, is_counted = np.zeros((n, n_stars), dtype=np.uint32), np.zeros((n, n), dtype=np.bool_)
    return Votes(counts, is_counted, np.empty(n_pairs + 1, dtype=np.uint32))


@inner
def _sift(pairs, light, i, j, out):
    """List the pairs whose brighter star has the magnitude of detection i and the fainter that of j.

    Without a branch: which of them it will be is not to be guessed, and a wrong guess costs as much as ten
    pairs. Returns how many are in `out`.
    """
    i_begin, i_many = np.uint32(light.begin[i]), np.uint32(light.end[i] - light.begin[i])
    j_begin, j_many = np.uint32(light.begin[j]), np.uint32(light.end[j] - light.begin[j])
    n = 0
    for pair in pairs:
        out[n] = pair
        # a row before the first becomes a great number and is not below how many there are
        is_i = np.uint32((pair & LOW) - i_begin) < i_many
        n += is_i & (np.uint32((pair >> SHIFT) - j_begin) < j_many)
    return n


@inner(inline="always")
def _vote(counts, star, voter, is_so):
    """Count a neighbour for a star of a pole, once, if it is so; without a branch, as in `_sift`."""
    count = counts[star]
    more = np.uint32(((voter << SHIFT) | (count & LOW)) + np.uint32(1))
    counts[star] = more if is_so & (count >> SHIFT != voter) else count


@inner
def _count(sky, light, sides, votes, i, j):
    """Count what detections i and j say about each other's star, equations (37) to (40)."""
    begin, end = look_up(sky[0], sides, i, j)
    if light.begin[i] > light.begin[j] or (light.begin[i] == light.begin[j] and light.end[i] > light.end[j]):
        i, j = j, i  # i is the brighter one, or they are alike
    of_i, of_j, work = votes.counts[i], votes.counts[j], votes.work
    i_voter, j_voter = np.uint32(i + 1), np.uint32(j + 1)
    i_end, j_begin = np.uint32(light.end[i]), np.uint32(light.begin[j])
    n = _sift(sky[1][begin:end], light, i, j, work)
    for k in range(n):
        brighter, fainter = work[k] & LOW, work[k] >> SHIFT
        _vote(of_i, brighter, j_voter, True)
        _vote(of_j, fainter, i_voter, True)
        in_reverse = (brighter >= j_begin) & (fainter < i_end)
        _vote(of_i, fainter, j_voter, in_reverse)
        _vote(of_j, brighter, i_voter, in_reverse)
    votes.is_counted[i, j] = votes.is_counted[j, i] = True


@inner
def occurrences(sky, light, sides, votes, i):
    """With how many neighbours each star can be pole i: (n_stars,) uint32, equations (37) to (41)."""
    for j in range(len(light.begin)):
        if j != i and not votes.is_counted[i, j]:
            _count(sky, light, sides, votes, i, j)
    return votes.counts[i] & LOW


@inner
def partner(sky, light, sides, i, j, pole):
    """The star of neighbour j if that of i is `pole`; -1 if there is none or more than one: (42).

    The pole has the magnitude of i.
    """
    begin, end = look_up(sky[0], sides, i, j)
    pairs, pole, with_pole, others = sky[1][begin:end], np.uint32(pole), np.uint32(0), np.uint32(0)
    for k in range(len(pairs)):  # sums alone: eight pairs at a time
        brighter, fainter = pairs[k] & LOW, pairs[k] >> SHIFT
        with_pole += np.uint32((brighter == pole) | (fainter == pole))
        others += fainter if brighter == pole else (brighter if fainter == pole else np.uint32(0))
    if with_pole <= 1:
        is_one = with_pole == 1 and light.begin[j] <= others < light.end[j]
        return np.int64(others) if is_one else -1
    found = -1
    for pair in pairs:
        brighter, fainter = pair & LOW, pair >> SHIFT
        if brighter == pole or fainter == pole:
            other = np.int64(fainter if brighter == pole else brighter)
            if light.begin[j] <= other < light.end[j]:
                if found >= 0:
                    return -1
                found = other
    return found


@inner
def accept(sky, light, sides, votes, i, row):
    """Write A of pole i to `row`: the star of the pole and of each neighbour, -1; whether there is a pole."""
    row[:] = -1
    count = occurrences(sky, light, sides, votes, i)
    pole = count.argmax()
    if count[pole] == 0 or (count == count[pole]).sum() > 1:
        return False
    for j in range(len(row)):
        row[j] = pole if j == i else partner(sky, light, sides, i, j, pole)
    return True


@inner
def common(first, second, star):
    """Write the names that two lists have in common to `star`; how many (44), (45)."""
    n, count = len(star), 0
    for k in range(n):
        star[k] = first[k] if first[k] == second[k] else -1
    for k in range(n):
        if star[k] < 0:
            continue
        rivals = 0
        for e in range(k + 1, n):
            if star[e] == star[k]:
                star[e] = -1
                rivals += 1
        if rivals > 0:
            star[k] = -1
        else:
            count += 1
    return count


@kernel
def _next_kernel(sky, light, sides, votes, least, accepted, begin, star):
    """Go on from the two poles number `begin` (first n + second) until two pass; they are in `star`.

    A list depends on its pole alone and is made once, in `accepted`.

    Returns
    -------
    next : int, where to go on; -1 when there are no more
    """
    n, named = len(star), accepted.star
    for number in range(begin, n * n):
        i, j = number // n, number % n
        if not accepted.is_known[i]:
            accept(sky, light, sides, votes, i, named[i])
            accepted.is_known[i] = True
        if i == j or named[i, j] < 0:
            continue
        if not accepted.is_known[j]:
            accept(sky, light, sides, votes, j, named[j])
            accepted.is_known[j] = True
        if named[j, j] >= 0 and common(named[i], named[j], star) >= least:
            return number + 1
    return -1
