"""Obvious references for the identification kernels: sets of pairs, written down as the papers say it."""

from itertools import combinations

import numpy as np


def angle(u, v):
    return np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)


class Sky:
    """Catalogue pairs by angle, without a k-vector."""

    def __init__(self, pairs):
        self.u_i, self.vmag = pairs.stars.u_i, pairs.stars.vmag
        self.first, self.second = pairs.first, pairs.second
        u, v = self.u_i[self.first], self.u_i[self.second]
        self.angle = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(axis=1))

    def ways(self, wanted, tolerance):
        """All ordered pairs of stars (a, b) that are the wanted angle apart: a set."""
        rows = np.flatnonzero(np.abs(self.angle - wanted) <= tolerance)
        one = list(zip(self.first[rows].tolist(), self.second[rows].tolist(), strict=True))
        return set(one) | {(b, a) for a, b in one}

    def tuples(self, u_c, detections, tolerance):
        """All tuples of stars whose angles are all those of the detections."""
        measured = {
            (p, q): self.ways(angle(u_c[detections[p]], u_c[detections[q]]), tolerance)
            for p, q in combinations(range(len(detections)), 2)
        }
        partial = measured[0, 1]
        for d in range(2, len(detections)):
            grown = set()
            for stars in partial:
                for a, s in measured[0, d]:
                    if a == stars[0] and s not in stars:
                        if all((stars[p], s) in measured[p, d] for p in range(1, d)):
                            grown.add((*stars, s))
            partial = grown
        return partial


def volume(u, triple):
    return np.linalg.det(u[list(triple)])
