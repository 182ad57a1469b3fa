"""What a pixel weighs in a centroid: a switch of equation (1) of the Improved Multi-Poles paper.

    as printed           E(p), the charge of the pixel above the background
    background left in   all charge of the pixel
    all alike            1: the centroid is the middle of the pixels above the threshold

The paper subtracts the background, so the first is what its text says. With the second the pixels of a faint
star weigh nearly the same: 6100 electrons of background are under the 500 and more of the star. The third is
what routines that list the properties of regions call the centroid if they are not given the picture. Which
pixels there are, their extents and the star's energy stay as they were.
"""

import numpy as np

AS_PRINTED, LEFT_IN, ALIKE = "weights as printed", "background left in", "pixels all alike"
WEIGHTS = (AS_PRINTED, LEFT_IN, ALIKE)


def weighted(weights, clusters, image_dn, black_level_dn):
    """Clusters with the centroids of a reading.

    Parameters
    ----------
    weights : one of WEIGHTS
    clusters : Clusters of the frame, as `clusters.find` has them
    image_dn : (rows, columns) grey values
    black_level_dn : float, grey value of a pixel without charge

    Returns
    -------
    Clusters

    Raises
    ------
    ValueError : no such weights
    """
    if weights not in WEIGHTS:
        raise ValueError(f"weights: {weights!r} is not known; choose from: {', '.join(WEIGHTS)}")
    if weights == AS_PRINTED:
        return clusters
    row, column = clusters.pixels.T
    n = len(clusters.begin) - 1
    which = np.repeat(np.arange(n), np.diff(clusters.begin))
    weight = np.ones(len(row)) if weights == ALIKE else image_dn[row, column] - float(black_level_dn)
    total = np.bincount(which, weight, n)
    sums = (np.bincount(which, weight * place, n) for place in (column, row))
    return clusters._replace(xy_px=np.column_stack([one / total for one in sums]))
