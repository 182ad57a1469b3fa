"""Coast lines of the Earth: Natural Earth, 1:110 million, as the package world-atlas carries it (NOTICE).

The file is TopoJSON: each arc is a list of steps in a grid, the first one its first point, and a transform
from the grid to degrees (topojson-specification 2.1.2 and 2.1.4).
"""

import json
from functools import cache
from importlib.resources import files

import numpy as np

_SEAM = 179.99  # deg; the map of the source is cut at the antimeridian, where there is no coast


@cache
def lines():
    """Coast lines: list of arrays (n, 2) of longitude -180 to 180 and latitude [deg]."""
    atlas = json.loads((files("shefex_nav") / "data" / "land_110m.json").read_bytes())
    scale, origin = np.array(atlas["transform"]["scale"]), np.array(atlas["transform"]["translate"])
    out = []
    for arc in atlas["arcs"]:
        points = np.cumsum(np.array(arc), axis=0) * scale + origin
        on_seam = np.abs(points[:, 0]) > _SEAM
        jumps = np.abs(np.diff(points[:, 0])) > 180.0  # over the antimeridian
        cuts = np.flatnonzero(on_seam[1:] & on_seam[:-1] | jumps) + 1
        out += [part for part in np.split(points, cuts) if len(part) > 1]
    return out
