"""The pinhole camera: pixels and unit vectors.

Camera axes: x right, y down, z along the boresight. Pixel (0, 0) is the centre of the top-left pixel.
x_px = cx + f * X/Z, y_px = cy + f * Y/Z.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.fields import integer, number


class Pinhole(NamedTuple):
    """Intrinsic camera model."""

    width_px: integer("detector [px]")
    height_px: integer("detector [px]")
    focal_length_px: number("px", "nominal")
    cx_px: number("px", "principal point")
    cy_px: number("px", "principal point")


def pinhole(width_px, height_px, focal_length_px, principal_point=None):
    """Camera with its principal point (x, y) px, by default in the middle of the detector."""
    middle = (0.5 * (width_px - 1), 0.5 * (height_px - 1)) if principal_point is None else principal_point
    return Pinhole(width_px, height_px, focal_length_px, *middle)


def solid_angle(width_px, height_px, focal_px):
    """Solid angle of a picture whose middle is on the axis [sr]: less than its area over f^2."""
    half = 0.5 * np.array([width_px, height_px]) / focal_px
    return 4.0 * float(np.arcsin(np.prod(half / np.sqrt(1.0 + half**2))))


@kernel
def turn_slopes(x, y):
    """How a small turn of the camera, dtheta_c, moves the direction (x, y) = (X/Z, Y/Z) of a star.

    q_ic(true) = q_ic exp(dtheta): u_c(true) = u_c - dtheta x u_c, over its third component. All that
    linearises a star's place starts here.

    Returns
    -------
    dx, dy : tuples of 3 each, derivatives by dtheta_c [1/rad]
    """
    return (x * y, -(1.0 + x * x), y), (1.0 + y * y, -x * y, -x)


@kernel
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


@kernel
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


@kernel
def cross_axes(u_c):
    """Two axes across each direction: e1 is the camera's x made perpendicular to u, e2 = u x e1.

    u_c : (n, 3) unit vectors, none along x -> (n, 2, 3) unit vectors
    """
    E = np.empty((u_c.shape[0], 2, 3))
    for k in range(u_c.shape[0]):
        x, y, z = u_c[k, 0], u_c[k, 1], u_c[k, 2]
        norm = np.sqrt(y * y + z * z)
        a, b, c = norm, -x * y / norm, -x * z / norm
        E[k, 0, 0], E[k, 0, 1], E[k, 0, 2] = a, b, c
        E[k, 1, 0], E[k, 1, 1], E[k, 1, 2] = y * c - z * b, z * a - x * c, x * b - y * a
    return E


@kernel
def cross_covariance(camera, xy_px, P_px):
    """Covariance of directions along their `cross_axes` from that of their places in the picture.

    With n = (x, y, 1), u = n/|n|: du = (I - u u^T) dn/|n|, and the axes are perpendicular to u.

    camera : Pinhole;  xy_px : (n, 2);  P_px : (n, 2, 2) px^2 -> (n, 2, 2) rad^2
    """
    E = cross_axes(unit_vectors(camera, xy_px))
    P_u = np.empty((xy_px.shape[0], 2, 2))
    f = camera.focal_length_px
    for k in range(xy_px.shape[0]):
        x, y = (xy_px[k, 0] - camera.cx_px) / f, (xy_px[k, 1] - camera.cy_px) / f
        n2 = f * f * (1.0 + x * x + y * y)
        for i in range(2):
            for j in range(2):
                total = 0.0
                for a in range(2):
                    for b in range(2):
                        total += E[k, i, a] * P_px[k, a, b] * E[k, j, b]
                P_u[k, i, j] = total / n2
    return P_u
