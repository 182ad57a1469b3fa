"""What the Improved Multi-Poles paper leaves open, as it is printed: one switch for each equation or step.

    switch      as printed                                        as read by us
    magnitude   (32): all light of a cluster over G_0 T_exp       the light of a row's exposure: a star that
                                                                  moves with the rows is seen for longer
    votes       (41): a pair that suits the pole and a neighbour  a star counts once with each neighbour,
                is one element, and both its stars occur in it    and only where it has the pole's magnitude
    border      the text has none: all clusters                   those that the border cuts are left out
    poles       each detection is the pole once; a set is held    all pairs of poles, the second one out of
                against the one before it                         the neighbours of the first

`match` is the identification with any of them; with all as read by us it is that of `multipole`.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing
from shefex_nav.papers.angles import look_up, new_sides, table
from shefex_nav.papers.impa.methods import multipole
from shefex_nav.papers.impa.methods.multipole import LOW, SHIFT
from shefex_nav.records import Reason

PRINTED, READ = "as printed", "as read by us"


class Reading(NamedTuple):
    """How each is taken: PRINTED or READ."""

    magnitude: str = READ
    votes: str = READ
    border: str = READ
    poles: str = READ


AS_READ = Reading()
AS_PRINTED = Reading(PRINTED, PRINTED, PRINTED, PRINTED)


def match(settings, camera, pairs, u_c, flux, reading=AS_READ):
    """As `multipole.match`, with votes and poles as `reading` has them: Identification."""
    if reading.votes == reading.poles == READ:
        return multipole.match(settings, camera, pairs, u_c, flux)
    n = min(len(flux), settings.most_centroids)
    if n < settings.fewest_stars:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    magnitude = multipole.magnitudes(camera.zero_flux, flux[:n])
    sky = table(pairs), multipole.packed(pairs)
    light = multipole.light_of(pairs.stars.vmag, magnitude, settings.magnitude_tolerance)
    sides = new_sides(u_c[:n], float(settings.tolerance), 0.0)
    votes = multipole.new_votes(n, len(pairs.stars.vmag), len(sky[1]))
    star = np.full(len(flux), -1, dtype=np.int64)
    printed = reading.votes == PRINTED, reading.poles == PRINTED
    least = int(settings.fewest_stars)
    if not _search_kernel(sky, light, sides, votes, printed, least, star[:n]):
        return nothing(len(flux), Reason.NO_MATCH)
    return Identification(star, int(Reason.NONE), np.nan)


@inner
def _is_element(light, i, j, brighter, fainter):
    """Whether a pair of stars has the magnitudes of detections i and j, one way or the other: (38)."""
    one_way = light.begin[i] <= brighter < light.end[i] and light.begin[j] <= fainter < light.end[j]
    return one_way or (light.begin[i] <= fainter < light.end[i] and light.begin[j] <= brighter < light.end[j])


@inner
def _occurrences(sky, light, sides, i, count):
    """Write how often each star occurs in the union (41) of pole i to `count`: (n_stars,) uint32."""
    is_element = np.zeros(len(sky[1]), dtype=np.bool_)
    count[:] = 0
    for j in range(len(light.begin)):
        if j == i:
            continue
        begin, end = look_up(sky[0], sides, i, j)
        for p in range(begin, end):
            brighter, fainter = np.int64(sky[1][p] & LOW), np.int64(sky[1][p] >> SHIFT)
            if not is_element[p] and _is_element(light, i, j, brighter, fainter):
                is_element[p] = True
                count[brighter] += 1
                count[fainter] += 1


@inner
def _partner(sky, light, sides, i, j, pole):
    """The star that makes an element of (40) with the pole, -1 if there is none or more than one: (42)."""
    begin, end = look_up(sky[0], sides, i, j)
    found = -1
    for p in range(begin, end):
        brighter, fainter = np.int64(sky[1][p] & LOW), np.int64(sky[1][p] >> SHIFT)
        if (brighter == pole or fainter == pole) and _is_element(light, i, j, brighter, fainter):
            if found >= 0:
                return -1
            found = fainter if brighter == pole else brighter
    return found


@inner
def _accept(task, i, row):
    """As `multipole.accept`, its stars counted as they are printed with the union of (41)."""
    sky, light, sides, votes, count, union = task
    if not union:
        return multipole.accept(sky, light, sides, votes, i, row)
    row[:] = -1
    _occurrences(sky, light, sides, i, count)
    pole = count.argmax()
    if count[pole] == 0 or (count == count[pole]).sum() > 1:
        return False
    for j in range(len(row)):
        row[j] = pole if j == i else _partner(sky, light, sides, i, j, pole)
    return True


@inner
def _next_pole(named, is_tried, first):
    """The brightest detection that was no pole yet, of the neighbours of pole `first` if there is one; -1."""
    for i in range(len(is_tried)):
        if not is_tried[i] and (first < 0 or named[first, i] >= 0):
            return i
    return -1


@inner
def _once_each(task, least, named, star):
    """Each detection the pole once, each set held against the one before: whether two agree."""
    is_tried, first = np.zeros(len(star), dtype=np.bool_), -1
    while True:
        i = _next_pole(named, is_tried, first)
        if i < 0 and first < 0:
            return False
        if i < 0:
            first = -1  # its neighbours are through
            continue
        is_tried[i] = True
        if not _accept(task, i, named[i]):
            continue
        if first >= 0 and multipole.common(named[first], named[i], star) >= least:
            return True
        first = i


@inner
def _all_pairs(task, least, named, star):
    """All pairs of poles, as `multipole` has them: whether two agree."""
    n = len(star)
    is_known = np.zeros(n, dtype=np.bool_)
    for number in range(n * n):
        i, j = number // n, number % n
        for pole in (i, j):
            if not is_known[pole] and (pole == i or named[i, j] >= 0):
                _accept(task, pole, named[pole])
                is_known[pole] = True
        is_pair = i != j and named[i, j] >= 0 and named[j, j] >= 0
        if is_pair and multipole.common(named[i], named[j], star) >= least:
            return True
    return False


@kernel
def _search_kernel(sky, light, sides, votes, printed, least, star):
    """Write the stars that two poles agree on to `star`; whether there are any. printed: of votes, poles."""
    union, once = printed
    n = len(star)
    named = np.full((n, n), -1, dtype=np.int64)
    task = sky, light, sides, votes, np.zeros(votes.counts.shape[1], dtype=np.uint32), union
    if once:
        found = _once_each(task, least, named, star)
    else:
        found = _all_pairs(task, least, named, star)
    if not found:
        star[:] = -1
    return found
