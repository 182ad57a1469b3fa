"""Which detections may belong to a star: those that find a neighbour of it at the right angle.

A right attitude is a set of detections of which any two have the angle of their stars. So if detection i is
star a, and j is b, the other stars of that attitude are among the detections k for which a has a neighbour
at the angle between i and k, and b one at the angle between j and k. Where there are too few of them, the
pair need not be looked at, and most pairs of a wrong attitude have too few: the search gives up early.
"""

import numpy as np

from shefex_nav.compiled import inner


@inner
def mark(pairs, partners, ij, entries, gate):
    """Mark two detections as partners for the stars of all catalogue pairs with their angle.

    Parameters
    ----------
    pairs : Pairs
    partners : (n, n_stars) uint32, written: bit j of [i, a] is set if a pair of stars (a, b) may be (i, j)
    ij : the detections
    entries : (begin, end) of the catalogue pairs
    gate : (lowest, highest) magnitude of the star of j minus that of i
    """
    i, j = ij
    of_i, of_j = partners[i], partners[j]
    bit_i, bit_j = np.uint32(1 << i), np.uint32(1 << j)
    star, fainter = pairs.star, pairs.fainter
    for p in range(entries[0], entries[1]):
        a, b, difference = star[p, 0], star[p, 1], fainter[p]
        if gate[0] < difference < gate[1]:
            of_i[a] |= bit_j
            of_j[b] |= bit_i
        if gate[0] < -difference < gate[1]:
            of_i[b] |= bit_j
            of_j[a] |= bit_i
