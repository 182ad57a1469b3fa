"""The pinhole camera: pixels and unit vectors.

Camera axes: x right, y down, z along the boresight. Pixel (0, 0) is the centre of the top-left pixel.
x_px = cx + f * X/Z, y_px = cy + f * Y/Z.
"""

from typing import NamedTuple

import numpy as np
from numba import njit


class Pinhole(NamedTuple):
    """Intrinsic camera model."""

    width_px: int
    height_px: int
    focal_length_px: float
    cx_px: float  # principal point
    cy_px: float


def pinhole(width_px, height_px, focal_length_px):
    """Camera with its principal point in the middle of the detector."""
    return Pinhole(width_px, height_px, focal_length_px, 0.5 * (width_px - 1), 0.5 * (height_px - 1))


@njit(cache=True)
def turn_slopes(x, y):
    """How a small turn of the camera, dtheta_c, moves the direction (x, y) = (X/Z, Y/Z) of a star.

    q_ic(true) = q_ic exp(dtheta): u_c(true) = u_c - dtheta x u_c, over its third component. All that
    linearises a star's place starts here.

    Returns
    -------
    dx, dy : tuples of 3 each, derivatives by dtheta_c [1/rad]
    """
    return (x * y, -(1.0 + x * x), y), (1.0 + y * y, -x * y, -x)


@njit(cache=True)
def unit_vectors(camera, xy_px):
    """Directions in camera axes of pixel positions. (n, 2) px -> (n, 3)."""
    n = xy_px.shape[0]
    u_c = np.empty((n, 3))
    for k in range(n):
        x = (xy_px[k, 0] - camera.cx_px) / camera.focal_length_px
        y = (xy_px[k, 1] - camera.cy_px) / camera.focal_length_px
        norm = np.sqrt(1.0 + x * x + y * y)
        u_c[k, 0], u_c[k, 1], u_c[k, 2] = x / norm, y / norm, 1.0 / norm
    return u_c


@njit(cache=True)
def pixels(camera, u_c):
    """Pixel positions of directions in front of the camera. (n, 3) -> (n, 2) px; NaN behind it."""
    n = u_c.shape[0]
    xy_px = np.empty((n, 2))
    for k in range(n):
        if u_c[k, 2] <= 0.0:
            xy_px[k, 0] = xy_px[k, 1] = np.nan
        else:
            xy_px[k, 0] = camera.cx_px + camera.focal_length_px * u_c[k, 0] / u_c[k, 2]
            xy_px[k, 1] = camera.cy_px + camera.focal_length_px * u_c[k, 1] / u_c[k, 2]
    return xy_px
