"""Coast lines of the Earth: Natural Earth, as the package world-atlas carries it (NOTICE).

Two scales: 1:110 million for the globe, 1:10 million for maps of a region.

The file is TopoJSON: each arc is a list of steps in a grid, the first one its first point, and a transform
from the grid to degrees (topojson-specification 2.1.2 and 2.1.4).
"""

import gzip
import json
from functools import cache
from importlib.resources import files

import numpy as np

WORDS = {  # what the legend of a map says of its coast, by `fine`
    True: "Natural Earth 1:10 million, to 1 km,\nwithout smaller islands; sea or land is not marked",
    False: "Natural Earth 1:110 million,\nwithout islands below 100 km; sea or land is not marked",
}
_SEAM = 179.99  # deg; the map of the source is cut at the antimeridian, where there is no coast


@cache
def lines(fine=False):
    """Coast lines: list of arrays (n, 2) of longitude -180 to 180 and latitude [deg].

    fine : 1:10 million, 409 000 points; else 1:110 million, 5000 points
    """
    name = "land_10m.json.gz" if fine else "land_110m.json"
    content = (files("shefex_nav") / "data" / name).read_bytes()
    atlas = json.loads(gzip.decompress(content) if fine else content)
    scale, origin = np.array(atlas["transform"]["scale"]), np.array(atlas["transform"]["translate"])
    out = []
    for arc in atlas["arcs"]:
        points = np.cumsum(np.array(arc), axis=0) * scale + origin
        on_seam = np.abs(points[:, 0]) > _SEAM
        jumps = np.abs(np.diff(points[:, 0])) > 180.0  # over the antimeridian
        cuts = np.flatnonzero(on_seam[1:] & on_seam[:-1] | jumps) + 1
        out += [part for part in np.split(points, cuts) if len(part) > 1]
    return out


@cache
def broken(fine=False):
    """The same as one array (n, 2) with a row of NaN after each line, which breaks a drawn curve."""
    gap = np.full((1, 2), np.nan)
    return np.vstack([part for line in lines(fine) for part in (line, gap)])
