"""The chain of the Improved Multi-Poles paper, frame after frame: its sections 2, 3.2, 5 and 6.2.

Two halves. `objects`: clusters of a frame, fused with those of the frame before, which tells their
directions; all brought to one instant. `attitude`: the identification of such a list, and Davenport's
q-method on the recognised stars.

    clusters = None
    for frame in frames:
        clusters, detections = objects(detection, camera, times, clusters, frame.image_dn)
        found, q_ic = attitude(identification, camera, pairs, detections)
"""

import numpy as np

from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.onboard.startracker.attitude import davenport
from shefex_nav.papers.impa.methods import multipole
from shefex_nav.papers.impa.methods.as_printed import AS_READ, READ
from shefex_nav.papers.impa.methods.clusters import find, fuse
from shefex_nav.papers.impa.methods.compensate import compensate
from shefex_nav.records import Detections, Reason


def objects(settings, camera, times, previous, image_dn, reading=AS_READ):
    """Objects of a frame that were in the frame before as well and are whole, at the frame's instant.

    Parameters
    ----------
    settings : Detection
    camera : CameraModel; of it `electrons_per_dn`
    times : RowTimes of the frame
    previous : Clusters of the frame before, None if there is none
    image_dn : (rows, columns) uint8 or uint16
    reading : as_printed.Reading, of it border and magnitude

    Returns
    -------
    clusters : Clusters, `previous` of the next frame
    detections : Detections, brightest first; none without a frame before. flux_dn is per exposure of a row
    """
    clusters = find(settings, camera, image_dn)
    if previous is None:
        return clusters, _nothing()
    rows, shift_px = fused(settings.run_length, previous, clusters, image_dn.shape, reading)
    return clusters, detections(settings.run_length, times, clusters, rows, shift_px, reading)


def fused(settings, previous, clusters, shape, reading=AS_READ):
    """Clusters that were in the frame before and are not cut off: rows (m,), shift_px (m, 2) since then.

    settings : RunLength
    reading : as_printed.Reading; with its border as printed those that are cut off are among them
    """
    found = fuse(previous, clusters, settings.fusion_distance)
    cut_off = at_border(clusters, shape)[found[:, 1]] & (reading.border == READ)
    whole = found[~cut_off]
    return whole[:, 1], clusters.xy_px[whole[:, 1]] - previous.xy_px[whole[:, 0]]


def at_border(clusters, shape):
    """Which clusters are cut off by the border, so that their centroids are not the stars'. (n,) bool."""
    first = np.minimum(clusters.first_row, clusters.first_column)
    return (first == 0) | (clusters.last_row == shape[0] - 1) | (clusters.last_column == shape[1] - 1)


def detections(settings, times, clusters, rows, shift_px, reading=AS_READ, longer_px=0.0):
    """Some clusters at the frame's instant.

    Parameters
    ----------
    settings : RunLength
    times : RowTimes
    clusters : Clusters
    rows : (m,) of clusters
    shift_px : (m, 2) of their centroids since the frame before
    reading : as_printed.Reading; with its magnitude as printed the light is that of the whole cluster
    longer_px : as of `compensated`

    Returns
    -------
    Detections
    """
    streaks = compensated(settings, times, clusters, rows, shift_px, longer_px=longer_px)
    flux_dn, order = brightest_first(times, clusters.energy_dn[rows], streaks, reading)
    n_pixels = np.diff(clusters.begin)[rows]
    return Detections(
        streaks.xy_px[order],
        flux_dn[order],
        n_pixels[order],
        clusters.n_saturated[rows][order],
        streaks.P_px[order],
    )


def brightest_first(times, energy_dn, streaks, reading=AS_READ):
    """Light of streaks, and which of them are objects, brightest first: flux_dn (m,), rows (n,) of them.

    energy_dn : (m,) of their clusters; the others as in `detections`
    """
    flux_dn = energy_dn
    if reading.magnitude == READ:
        flux_dn = flux_dn * times.exposure_s / streaks.seen_s
    order = np.argsort(-flux_dn, kind="stable")
    return flux_dn, order[np.isfinite(streaks.xy_px[order].sum(axis=1))]  # no star makes the others


def compensated(settings, times, clusters, rows, shift_px, form="explicit", *, longer_px=0.0, row_time=1.0):
    """`compensate` of some clusters, as `detections`: Streaks.

    longer_px : added to the extents. (7) is the last row less the first; 1 counts both, as the box around a
        cluster does
    row_time : as of `compensate`
    """
    columns = clusters.last_column[rows] - clusters.first_column[rows]
    extent_px = np.column_stack((columns, clusters.last_row[rows] - clusters.first_row[rows])) + longer_px
    sigma_px = clusters.sigma_px[rows]
    return compensate(settings, times, clusters.xy_px[rows], extent_px, shift_px, sigma_px, form, row_time)


def _nothing():
    """No Detections."""
    none = np.zeros(0, dtype=np.int64)
    return Detections(np.zeros((0, 2)), np.zeros(0), none, none, np.zeros((0, 2, 2)))


def attitude(settings, camera, pairs, detections, published=False):
    """Identify a list of objects and find the attitude.

    Parameters
    ----------
    settings : Identification
    camera : CameraModel
    pairs : StarPairs; the attitude is that of `pairs.stars.u_i`, without aberration
    detections : Detections, brightest first
    published : bool, believe the check phase as the paper does; otherwise it is verified

    Returns
    -------
    found : Identification
    q_ic : (4,) by the q-method, all stars alike; NaN when nothing was recognised
    """
    u_c = unit_vectors(camera.pinhole, detections.xy_px)
    method = multipole.match if published else multipole.identify
    return _with_attitude(pairs, u_c, method(settings, camera, pairs, u_c, detections.flux_dn))


def attitudes(settings, camera, pairs, detections):
    """`attitude` believed as published and verified, in the time of one of them: two pairs of results."""
    u_c = unit_vectors(camera.pinhole, detections.xy_px)
    found = multipole.both(settings, camera, pairs, u_c, detections.flux_dn)
    return tuple(_with_attitude(pairs, u_c, one) for one in found)


def _with_attitude(pairs, u_c, found):
    known = found.star >= 0
    if found.reason != Reason.NONE:
        return found, np.full(4, np.nan)
    return found, davenport(u_c[known], pairs.stars.u_i[found.star[known]], np.ones(known.sum()))
