"""IMPA tables 3 to 5 of the stars by which its simulations succeed, weight by weight of a pixel.

A simulation of the paper ends with the image that gives an attitude, after 60 at most. Here the centroids of
that image are taken, those of the stars that the identification names, against the stars' places at the
frame's instant. A second image succeeds where the stars move slowly, a later one also where they move fast:
which stars a table is made of hangs on how many images are waited for. The weights are those of `weights`,
all on the same frames. The spot is that of the joint set.
"""

import numpy as np

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.papers.impa import field, flight, trackers
from shefex_nav.papers.impa.centroids import nearest, recognised
from shefex_nav.papers.impa.methods import chain
from shefex_nav.papers.impa.methods import clusters as cluster
from shefex_nav.papers.impa.methods.weights import WEIGHTS, weighted
from shefex_nav.papers.impa.moments import TABLES

COLUMNS = ("sample", "rate_deg_s", "table", "weights", "images", "row", "x", "y")  # row: of the cluster


def stars_at(shutter, case, number):
    """Places of the stars at the instant of a frame: (n, 2) px."""
    q_ic = field.attitude_at(case, number)
    u_i, _ = flight.near_stars(field.camera(shutter), q_ic)
    return pixels(field.CAMERA, u_i @ dcm_from_quat(q_ic))


def errors_of(shutter, case, number, before, clusters, shape):
    """Rows and errors of the recognised clusters of a frame, None without an identification.

    Returns (tables, m, 3) px: row of the cluster as measured, error in x and in y.

    before, clusters : Clusters of the frame before and of this one, with the centroids of one reading
    """
    times = field.times(shutter)
    rows, shift_px = chain.fused(trackers.DETECT.run_length, before, clusters, shape)
    moved = chain.compensated(trackers.DETECT.run_length, times, clusters, rows, shift_px)
    known = recognised(times, clusters.energy_dn[rows], moved)
    if known.sum() < trackers.IDENTIFY.fewest_stars:
        return None
    stars_px = stars_at(shutter, case, number)
    star = nearest(moved.xy_px[known], stars_px)
    places = [moved.xy_px[known]]
    if shutter != field.SHUTTERS[0]:
        places.append(clusters.xy_px[rows[known]])
    errors = np.array(places) - stars_px[star]
    row = np.broadcast_to(clusters.xy_px[rows[known], 1], errors.shape[:2])
    return np.dstack([row, errors])[:, star >= 0]


def fly(shutter, case, rng):
    """One simulation, flown until all weights have succeeded: rows (m, 6) of COLUMNS from `table` on."""
    rows, before, done = [], {}, set()
    tables = TABLES[:1] if shutter == field.SHUTTERS[0] else TABLES[1:]
    for number in range(flight.MOST_IMAGES):
        image = flight.frame(shutter, case, number, rng, flight.JOINT.sigma_px)
        found = cluster.find(trackers.DETECT, trackers.MODEL, image)
        for w, weights in enumerate(WEIGHTS):
            if w in done:
                continue
            mine = weighted(weights, found, image, field.BLACK_LEVEL_DN)
            errors = None
            if number > 0:
                errors = errors_of(shutter, case, number, before[w], mine, image.shape)
            before[w] = mine
            if errors is not None:
                done.add(w)
                for table, of_table in zip(tables, errors, strict=True):
                    rows += [(TABLES.index(table), w, number + 1, *error) for error in of_table]
        if len(done) == len(WEIGHTS):
            break
    return np.array(rows, dtype=float).reshape(-1, len(COLUMNS) - 2)


def measure(samples, seed, first):
    """Samples first ... : {'rows': (m, len(COLUMNS))}."""
    rows = []
    for number, own in zip(range(first, first + samples), seed.spawn(samples), strict=True):
        for rate, one in zip(field.RATES, own.spawn(len(field.RATES)), strict=True):
            case = field.pair(rate, number)
            for shutter, noise in zip(field.SHUTTERS, one.spawn(2), strict=True):
                found = fly(shutter, case, np.random.default_rng(noise))
                head = np.tile([number, round(np.degrees(rate))], (len(found), 1))
                rows.append(np.hstack([head, found]))
    return {"rows": np.concatenate(rows)}
