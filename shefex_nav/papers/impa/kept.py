"""Figures of `impa-pixels`, a run of a quarter of an hour, kept in the package for `impa-centroids` to name.

The table's first line is the command that measured it and the digest of the code that did, as `keep` has it;
`benchmarks/keep_impa_pixels.py` writes the table from the chunks that the command has kept.
"""

import csv
from functools import cache
from pathlib import Path

from shefex_nav.papers.impa import moments
from shefex_nav.papers.impa.methods.clusters import AS_PRINTED, WEIGHTS

PATH = Path(__file__).with_name("pixel_moments.csv")
RUN = "impa-pixels"
SPOTS = {  # as `pixels.SPOTS`: how many things are otherwise in each than in `impa-centroids`
    "spot of 0.5 px": 1,
    "spot of 0.6 px": 1,
    "spot even over 3.5 px": 1,
    "spot of 1.124 px": 0,
    "spot of 0.7 px, extents of both ends": 2,
}
CLUSTERS = {  # name -> words
    "recognised": "of clusters of recognised stars",
    "recognised and apart": "of clusters of recognised stars with no other streak within 5 px",
}
READINGS = {
    f"{weights}, {spot}, {of}": (spot, weights, of)
    for spot in SPOTS
    for weights in WEIGHTS
    for of in CLUSTERS
}
THINGS = {  # how many are otherwise than in `impa-centroids`: spot, clusters, weights if not as printed
    reading: SPOTS[spot] + 1 + (weights != AS_PRINTED) for reading, (spot, weights, _) in READINGS.items()
}


def words(reading):
    """What is otherwise in a reading than in `impa-centroids`: str."""
    spot, weights, of = READINGS[reading]
    otherwise = [weights] if weights != AS_PRINTED else []
    otherwise += [spot] if SPOTS[spot] else []
    return ", ".join([*otherwise, CLUSTERS[of]])


def read(path):
    """A table: {(reading, table, moment, axis, rate): moments.Figure}."""
    kinds = moments.Figure.__annotations__
    with Path(path).open(newline="") as file:
        lines = csv.DictReader(line for line in file if not line.startswith("#"))
        rows = [moments.Figure(**{name: kinds[name](row[name]) for name in kinds}) for row in lines]
    return {one[:5]: one for one in rows}


@cache
def figures():
    """The table of the package, as `read` has it."""
    return read(PATH)


def others(table, moment, axis, rate):
    """Row of each reading beside a published figure: dict of Row."""
    found = {reading: figures().get((reading, table, moment, axis, int(rate))) for reading in READINGS}
    return {reading: moments.judged(one, f"{one.samples} samples") for reading, one in found.items() if one}
