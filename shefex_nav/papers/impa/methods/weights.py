"""What a pixel weighs in a centroid: a switch of equation (1) of the Improved Multi-Poles paper.

    as printed     E(p), the charge of the pixel above the background
    all alike      1: the centroid is the middle of the pixels above the threshold

The second is what routines that list the properties of regions call the centroid where they are not given the
picture. Which pixels there are, their extents and the star's energy stay as they were.
"""

import numpy as np

AS_PRINTED, ALIKE = "weights as printed", "pixels all alike"
WEIGHTS = (AS_PRINTED, ALIKE)


def weighted(weights, clusters):
    """Clusters with the centroids of a reading.

    Parameters
    ----------
    weights : one of WEIGHTS
    clusters : Clusters of a frame, as `clusters.find` has them

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
    n_pixels = np.diff(clusters.begin)
    which = np.repeat(np.arange(len(n_pixels)), n_pixels)
    sums = (np.bincount(which, place, len(n_pixels)) for place in clusters.pixels.T[::-1])
    return clusters._replace(xy_px=np.column_stack([one / n_pixels for one in sums]))
