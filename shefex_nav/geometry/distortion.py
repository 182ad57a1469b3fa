"""What a lens adds to the pinhole: the distortion of Brown and Conrady, there and back.

With x, y = X/Z, Y/Z of a direction and r^2 = x^2 + y^2 a lens (k1, k2, p1, p2, k3), in the order of OpenCV,
shows it at

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

and the pixel is cx + f x', cy + f y'. Ideal are the places of the pinhole, distorted those of the picture.
(D. C. Brown, Photogrammetric Engineering 32 (1966) 444.)
"""

from itertools import pairwise
from math import atan

import numpy as np

from shefex_nav.compiled import inner, kernel

BEHIND = 0.1  # Z of a unit vector that is no longer before the camera
UNDISTORT_STEPS = 20
GRID = 41  # points along each side of the detector, from border to border


def _bent(k, x, y):
    """Distorted x, y of ideal places, numbers or arrays. k : (5,)"""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    dx = 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x)
    dy = k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y
    return radial * x + dx, radial * y + dy


def _slopes(k, x, y):
    """d distorted / d ideal at ideal places, numbers or arrays: xx, xy, yy of a symmetric matrix. k : (5,)"""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    growth = 2.0 * (k[0] + r2 * (2.0 * k[1] + 3.0 * k[4] * r2))
    xx = radial + growth * x * x + 2.0 * k[2] * y + 6.0 * k[3] * x
    xy = growth * x * y + 2.0 * k[2] * x + 2.0 * k[3] * y
    yy = radial + growth * y * y + 6.0 * k[2] * y + 2.0 * k[3] * x
    return xx, xy, yy


bent_one, slopes_one = inner(_bent), inner(_slopes)  # of one place, in kernels


@inner
def straight_one(distortion, u, v):
    """Ideal x, y = X/Z, Y/Z of a distorted place u, v."""
    k1, k2, p1, p2, k3 = distortion
    x, y = u, v
    for _ in range(UNDISTORT_STEPS):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        dx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        dy = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        x, y = (u - dx) / radial, (v - dy) / radial
    return x, y


@kernel
def undistort(pinhole, distortion, xy_px):
    """Pixels of an ideal pinhole from distorted ones, by iteration. Pinhole, (5,), (n, 2) -> (n, 2)."""
    out = np.empty_like(xy_px)
    for k in range(xy_px.shape[0]):
        u = (xy_px[k, 0] - pinhole.cx_px) / pinhole.focal_length_px
        v = (xy_px[k, 1] - pinhole.cy_px) / pinhole.focal_length_px
        x, y = straight_one(distortion, u, v)
        out[k, 0] = pinhole.cx_px + pinhole.focal_length_px * x
        out[k, 1] = pinhole.cy_px + pinhole.focal_length_px * y
    return out


def distort(pinhole, distortion, xy_px):
    """Distorted pixels of those of an ideal pinhole. Pinhole, (5,), (..., 2) -> (..., 2); NaN stays NaN."""
    middle_px = np.array([pinhole.cx_px, pinhole.cy_px])
    ideal = ideal_of(pinhole, xy_px).reshape(-1, 2)
    return (middle_px + pinhole.focal_length_px * bent(distortion, ideal)).reshape(np.shape(xy_px))


def slopes_at(pinhole, distortion, xy_px):
    """d distorted / d ideal at pixels of the ideal pinhole. Pinhole, (5,), (n, 2) -> (n, 2, 2)."""
    return slopes(distortion, ideal_of(pinhole, xy_px))


def ideal_of(pinhole, xy_px):
    """X/Z, Y/Z of pixels of the ideal pinhole. Pinhole, (..., 2) -> (..., 2)."""
    return (xy_px - np.array([pinhole.cx_px, pinhole.cy_px])) / pinhole.focal_length_px


def bent(k, ideal):
    """Distorted x, y of ideal ones: (n, 2) -> (n, 2)."""
    return np.column_stack(_bent(k, *ideal.T))


def slopes(k, ideal):
    """d distorted / d ideal: (n, 2, 2)."""
    xx, xy, yy = _slopes(k, *ideal.T)
    return np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)


def corners_px(pinhole):
    """Outermost points of the detector: (4, 2) px."""
    right, bottom = pinhole.width_px - 0.5, pinhole.height_px - 0.5
    return np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]])


def grid_px(pinhole):
    """Points over the detector and on its border: (GRID^2, 2) px"""
    (left, top), (right, bottom) = corners_px(pinhole)[[0, 3]]
    x, y = np.linspace(left, right, GRID), np.linspace(top, bottom, GRID)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def undone_to_px(pinhole, distortion):
    """Largest distance on the detector by which a distortion there and back misses, px; NaN: no way back.

    Pinhole, (5,) -> float
    """
    seen_px = grid_px(pinhole)
    again_px = distort(pinhole, distortion, undistort(pinhole, distortion, seen_px))
    return float(np.abs(again_px - seen_px).max())


def displaced_px(pinhole, distortion):
    """Largest distance by which a distortion moves stars on the detector from their ideal places, px.

    Pinhole, (5,) or None of a pinhole -> float
    """
    if distortion is None:
        return 0.0
    xy_px = grid_px(pinhole)
    return float(np.hypot(*(undistort(pinhole, distortion, xy_px) - xy_px).T).max())


def corner_radii_px(pinhole, distortion=None):
    """Distances from the axis of the ideal places of what corners see. Pinhole, (5,) or None -> (4,) px"""
    corners = corners_px(pinhole)
    ideal_px = corners if distortion is None else undistort(pinhole, distortion, corners)
    return np.hypot(*(ideal_px - np.array([pinhole.cx_px, pinhole.cy_px])).T)


def farthest_px(pinhole, distortion=None):
    """The largest of `corner_radii_px`: float."""
    return float(corner_radii_px(pinhole, distortion).max())


def corner_angles(pinhole, distortion=None):
    """Angles from the axis to what the corners see, as `corners_px` has them. -> (4,) rad"""
    return np.array([atan(r) for r in corner_radii_px(pinhole, distortion) / pinhole.focal_length_px])


def border(pinhole, distortion=(), along=8):
    """Directions X/Z, Y/Z that the border of the detector sees, once around. -> (4 along + 1, 2)

    distortion : (5,), () of a pinhole: its four corners are enough
    """
    (left, top), (right, bottom) = corners_px(pinhole)[[0, 3]]
    ends = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
    if not len(distortion):
        return ideal_of(pinhole, ends)
    part = np.arange(along)[:, None] / along
    sides = [start + part * (end - start) for start, end in pairwise(ends)]
    return ideal_of(pinhole, undistort(pinhole, np.array(distortion), np.concatenate([*sides, ends[-1:]])))
