"""IMPA tables 3 to 5 with each pixel as heavy as printed or all alike, and with five spots.

As in `centroids` two contiguous frames are made, and the clusters of the second one that the fusion kept are
held against the stars; but only those that the identification names with these very centroids. The paper
gives the spot's mean width alone, three pixels, and no shape. With the spot of the joint set the extents of
the streaks count both ends, as the box around a cluster does and equation (7) does not.
"""

import numpy as np

from shefex_nav.papers.impa import field, flight, spot, trackers
from shefex_nav.papers.impa.centroids import each_case, nearest, pictures, recognised, truth
from shefex_nav.papers.impa.methods import chain
from shefex_nav.papers.impa.methods import clusters as cluster
from shefex_nav.papers.impa.methods.weights import WEIGHTS, weighted
from shefex_nav.papers.impa.moments import TABLES

WIDE_PX = 3.5  # of the even spot [E]
SPOTS = {  # name -> as `flight.frame` has it; a Gaussian's standard deviation [E]
    "spot of 0.5 px": {"sigma_px": 0.5},
    "spot of 0.6 px": {"sigma_px": 0.6},
    f"spot even over {WIDE_PX:g} px": {"psf": spot.box(WIDE_PX)},
    f"spot of {field.PSF_SIGMA_PX:g} px": {"sigma_px": field.PSF_SIGMA_PX},  # that of `centroids`
    f"spot of {flight.JOINT.sigma_px:g} px, extents of both ends": {"sigma_px": flight.JOINT.sigma_px},
}
BOTH_ENDS_PX = (0.0, 0.0, 0.0, 0.0, 1.0)  # by which the extents are longer with each of SPOTS
COLUMNS = ("sample", "rate_deg_s", "table", "spot", "weights", "apart", "x", "y")


def errors_of(times, first, second, stars, longer_px=0.0):
    """Errors of the recognised clusters in the second of two frames, that are those of a star.

    Parameters
    ----------
    times : RowTimes
    first, second : Clusters, with the centroids of one reading
    stars : centroids.Truth
    longer_px : as of `chain.compensated`

    Returns
    -------
    star : (m,) row of Truth
    errors : (2, m, 2) px, compensated and not
    """
    settings, shape = trackers.DETECT.run_length, (field.CAMERA.height_px, field.CAMERA.width_px)
    rows, shift_px = chain.fused(settings, first, second, shape)
    moved = chain.compensated(settings, times, second, rows, shift_px, longer_px=longer_px)
    star = nearest(moved.xy_px, stars.xy_px)
    mine = (star >= 0) & recognised(times, second.energy_dn[rows], moved)
    places = np.array((moved.xy_px[mine], second.xy_px[rows[mine]]))
    return star[mine], places - stars.xy_px[star[mine]]


def rows_of(shutter, case, seed):
    """Rows of COLUMNS from `table` on, of one case and shutter: (m, 6)."""
    stars, times, rows = truth(shutter, case, 1), field.times(shutter), []
    tables = TABLES[:1] if shutter == field.SHUTTERS[0] else TABLES[1:]
    for s, (how, one) in enumerate(zip(SPOTS.values(), seed.spawn(len(SPOTS)), strict=True)):
        frames = pictures(shutter, case, np.random.default_rng(one), **how)
        found = [cluster.find(trackers.DETECT, trackers.MODEL, image) for image in frames]
        for w, weights in enumerate(WEIGHTS):
            both = (weighted(weights, one) for one in found)
            star, errors = errors_of(times, *both, stars, BOTH_ENDS_PX[s])
            for table, of_table in zip(tables, errors, strict=False):
                for apart, error in zip(stars.apart[star], of_table, strict=True):
                    rows.append((TABLES.index(table), s, w, apart, *error))
    return np.array(rows, dtype=float).reshape(-1, len(COLUMNS) - 2)


def measure(samples, seed, first):
    """Samples first ... : {'rows': (m, len(COLUMNS))}."""
    rows = []
    for number, case, shutter, noise in each_case(samples, seed, first):
        found = rows_of(shutter, case, noise)
        head = np.tile([number, round(np.degrees(case.rate))], (len(found), 1))
        rows.append(np.hstack([head, found]))
    return {"rows": np.concatenate(rows)}
