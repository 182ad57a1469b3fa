"""The pyramid of the comparison (section 5), as its results tell: it believes a triangle of two angles.

With three true stars and a false one the paper has its pyramid never fail and be wrong 75 times of about 140,
which three closed angles never give. Here a triad without a fourth star that confirms it is believed if two
of its angles, those at one of its stars, leave a single triple of catalogue stars: first with the first star
of each triad as that pivot, triad after triad, then with the second and the third.
"""

from dataclasses import replace

import numpy as np

from shefex_nav.onboard.startracker.identify.verify import Identification, nothing
from shefex_nav.papers.shefex2.methods import pyramid
from shefex_nav.records import Reason

PIVOTS = 3


def match(settings, camera, pairs, u_c, flux, triangle_tolerance):
    """A pyramid, or else the first triad that two angles name; as `pyramid.match`.

    triangle_tolerance : float [rad], of the two angles
    """
    n = min(len(flux), settings.most_centroids)
    found = pyramid.match(settings, camera, pairs, u_c, flux)
    if n < 3 or found.reason == Reason.NONE:
        return found
    spans = _Spans(replace(settings, tolerance=triangle_tolerance), pairs, u_c[:n])
    triads = pyramid.smart_triads(n)
    for pivot in range(PIVOTS):
        for triad in triads:
            order = np.roll(triad, -pivot)
            triples = spans.triples(*order)
            if len(triples) == 1:
                star = np.full(len(flux), -1, dtype=np.int64)
                star[order] = triples[0]
                return Identification(star, int(Reason.NONE), np.nan)
    return nothing(len(flux), Reason.NO_MATCH)


class _Spans:
    """Catalogue pairs of the angles between detections, each looked up once."""

    def __init__(self, settings, pairs, u_c):
        self.pairs, self.u_c, self.tolerance, self.known = pairs, u_c, settings.tolerance, {}

    def partners(self, i, j):
        """Pairs with the angle of detections i and j, both ways round: dict star -> set of stars."""
        key = (min(i, j), max(i, j))
        if key not in self.known:
            angle = np.arccos(np.clip(self.u_c[i] @ self.u_c[j], -1.0, 1.0))
            limits = np.cos([angle + self.tolerance, max(angle - self.tolerance, 0.0)])
            begin, end = np.searchsorted(self.pairs.cosine, limits)
            found = {}
            for a, b in zip(self.pairs.first[begin:end], self.pairs.second[begin:end], strict=True):
                found.setdefault(int(a), set()).add(int(b))
                found.setdefault(int(b), set()).add(int(a))
            self.known[key] = found
        return self.known[key]

    def triples(self, i, j, k):
        """Triples (a, b, c) of which a-b and a-c have the angles of i-j and i-k: list, of two at most."""
        out, others = [], self.partners(i, k)
        for a, ends in self.partners(i, j).items():
            for b in ends:
                out += [(a, b, c) for c in others.get(a, ()) if c != b]
            if len(out) > 1:
                return out[:2]
        return out
