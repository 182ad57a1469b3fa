"""The pyramid as SHEFEX section 3.4 describes it: a constant tolerance of the cosine, nothing verified."""

import numpy as np

from shefex_nav.onboard.startracker import kvector
from shefex_nav.onboard.startracker.identify import pyramid
from shefex_nav.reproduce.published import SHEFEX

MAX_CENTROIDS = SHEFEX["identification"]["max_centroids"]


def match(pairs, u_c, cos_error):
    """Rows of the catalogue, -1 where unidentified. StarPairs, (n, 3) brightest first, float -> (n,)."""
    star = np.full(len(u_c), -1, dtype=np.int64)
    n = min(len(u_c), MAX_CENTROIDS)
    if n < 4:
        return star
    base = np.ascontiguousarray(u_c[:n])
    cosine = base @ base.T
    low, high = cosine - cos_error, cosine + cos_error
    first, last = kvector.search(pairs.index, pairs.cosine, low.ravel(), high.ravel())
    first, last = first.reshape(n, n), last.reshape(n, n)
    triads, begin = pyramid.smart_triads(n), 0
    while begin < len(triads):
        begin, rows, n_rows = pyramid._pyramid_kernel(
            base, pairs.stars.u_i, pairs.first, pairs.second, low, high, first, last, triads, begin
        )
        if n_rows == 1:
            star[:n] = rows[0]
            return star
    return star
