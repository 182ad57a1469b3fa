"""The lens of the camera where it is no pinhole: where it puts what the pinhole would see elsewhere.

In: the distortion of Brown and Conrady (`geometry.distortion`), places and directions by the pinhole. Out:
places on the detector. A polynomial folds somewhere; what lies beyond that, or far outside the detector, is
imaged nowhere (NaN).
"""

from math import hypot
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.distortion import (
    bent_one,
    corner_angles,
    distort,
    farthest_px,
    ideal_of,
    slopes,
    slopes_one,
)
from shefex_nav.geometry.pinhole import Pinhole

BEYOND = 1.3  # times the distance of the farthest corner from the axis, the lens is looked at
ALONG, AROUND = 130, 72  # points from the axis to there, and directions


class Lens(NamedTuple):
    """Distortion of a camera, and how far it goes."""

    k: np.ndarray  # (5,) k1, k2, p1, p2, k3
    reach: float  # tan of the angle from the axis up to which it images
    stretch: float  # by how much more a star moves on the detector than behind the pinhole, at most


def lens_of(hole, distortion):
    """Lens of a Pinhole and a distortion (5,) or None; None where it is the pinhole."""
    if distortion is None or not any(distortion):
        return None
    k = np.array(distortion, dtype=float)
    farthest = farthest_px(hole, k) / hole.focal_length_px
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    r = BEYOND * farthest * np.arange(1, ALONG + 1) / ALONG
    rays = r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)  # (ALONG, AROUND, 2)
    J = slopes(k, rays.reshape(-1, 2)).reshape(ALONG, AROUND, 2, 2)
    trace, det = J[..., 0, 0] + J[..., 1, 1], np.linalg.det(J)
    folds = ((det <= 0.0) | (trace <= 0.0)).any(axis=1)
    n = int(np.argmax(folds)) if folds.any() else ALONG
    sizes = np.linalg.norm(J[:n], ord=2, axis=(-2, -1))
    return Lens(k, float(r[n - 1]) if n else 0.0, float(max(1.0, sizes.max(initial=1.0))))


def corner_angle(hole, lens=None):
    """Angle from the axis to what the farthest corner of the detector sees [rad]. Pinhole, Lens or None"""
    return float(corner_angles(hole, None if lens is None else lens.k).max())


def step_px(hole, lens, step):
    """Step [px] of the path of the pinhole's middle field with which no star of the lens moves by more.

    `motion.fastest` is of a corner as far from the axis as half the diagonal.
    """
    half, far = (
        0.5 * hypot(hole.width_px, hole.height_px) / hole.focal_length_px,
        farthest_px(hole) / hole.focal_length_px,
    )
    further = max(1.0, (1.0 + far * far) / (1.0 + half * half), far / half)
    return step / further if lens is None else step / (further * lens.stretch)


def places(hole, lens, xy_px):
    """Places on the detector of those of the pinhole, (..., 2) px; NaN where nothing is imaged."""
    if lens is None:
        return xy_px
    ideal = ideal_of(hole, xy_px)
    beyond = ~(np.hypot(ideal[..., 0], ideal[..., 1]) <= lens.reach)
    out = distort(hole, lens.k, xy_px)
    out[beyond] = np.nan
    return out


def tracks(hole, lens, path, u_i):
    """Places of directions at the ends of the steps of a path.

    hole : Pinhole;  path : render.Path;  u_i : (m, 3) -> (m, steps + 1, 2) px, NaN where nothing is imaged
    """
    return _tracks_kernel(hole, lens.k, lens.reach, path.C_ci, u_i)


@kernel
def _tracks_kernel(hole, k, reach, C_ci, u_i):
    xy_px = np.empty((u_i.shape[0], C_ci.shape[0], 2))
    for star in range(u_i.shape[0]):
        ux, uy, uz = u_i[star, 0], u_i[star, 1], u_i[star, 2]
        for n in range(C_ci.shape[0]):
            X = C_ci[n, 0, 0] * ux + C_ci[n, 0, 1] * uy + C_ci[n, 0, 2] * uz
            Y = C_ci[n, 1, 0] * ux + C_ci[n, 1, 1] * uy + C_ci[n, 1, 2] * uz
            Z = C_ci[n, 2, 0] * ux + C_ci[n, 2, 1] * uy + C_ci[n, 2, 2] * uz
            x, y = _imaged(k, reach, X, Y, Z)
            xy_px[star, n, 0] = hole.cx_px + hole.focal_length_px * x
            xy_px[star, n, 1] = hole.cy_px + hole.focal_length_px * y
    return xy_px


@inner
def _imaged(k, reach, X, Y, Z):
    """Distorted x, y of a direction, NaN where nothing is imaged."""
    if Z <= 0.0 or X * X + Y * Y > (reach * Z) ** 2:
        return np.nan, np.nan
    return bent_one(k, X / Z, Y / Z)


@kernel
def as_pinhole(lens, u_c):
    """Directions of which a pinhole makes what the lens makes of others, and the scale of the picture there.

    lens : Lens;  u_c : (n, 3) -> (n, 3), Z = -1 where nothing is imaged;  (n,) root of its growth of areas
    """
    out, scale = np.empty_like(u_c), np.empty(len(u_c))
    for n in range(len(u_c)):
        x, y = _imaged(lens.k, lens.reach, u_c[n, 0], u_c[n, 1], u_c[n, 2])
        out[n, 0], out[n, 1], out[n, 2], scale[n] = x, y, 1.0, 1.0
        if np.isnan(x):
            out[n, 0], out[n, 1], out[n, 2] = 0.0, 0.0, -1.0
        else:
            xx, xy, yy = slopes_one(lens.k, u_c[n, 0] / u_c[n, 2], u_c[n, 1] / u_c[n, 2])
            scale[n] = np.sqrt(xx * yy - xy * xy)
    return out, scale


def around(hole, lens):
    """Pinhole of a larger detector, about its middle, that has all that the smaller one sees; their offset.

    -> Pinhole, (2,) px: a place on the larger one minus that on the smaller
    """
    f = hole.focal_length_px
    half = int(np.ceil(farthest_px(hole, None if lens is None else lens.k))) + 1
    return Pinhole(2 * half + 1, 2 * half + 1, f, half, half), half - np.array([hole.cx_px, hole.cy_px])
