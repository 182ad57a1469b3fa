"""Where the camera is mounted, how it projects, and how much light comes in from the side.

In: the design values and their tolerances; directions of Sun and Earth. Out: the true mounting and pinhole
of this run, and the background that stray light adds to every pixel. The exclusion angles (90 deg to the
Sun, 45 deg to the Earth's limb) and the 50 deg baffle are those of the SHEFEX-2 star tracker; the shape
of the stray light between them is an engineering guess [E].

A lens that is no pinhole (the distortion of Brown and Conrady, `geometry.distortion`) puts elsewhere what the
pinhole would see. A polynomial folds somewhere; what lies beyond that, or far outside the detector, is imaged
nowhere (NaN).
"""

from math import asin, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import pinhole, rotation, wgs84
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
SUN_RADIUS = 4.65e-3  # rad, of its disc from 1 au
TWILIGHT = 0.02  # brightness of the limb at sunrise as a fraction of the one under a high Sun [E]


def true_mounting(mounting, rng):
    """q_bc with a small random rotation, C_bc exp(phi), phi ~ N(0, error^2) about each camera axis."""
    phi = mounting.error * rng.standard_normal(3)
    return rotation.quat_multiply(rotation.quat_from_dcm(mounting.C_bc), rotation.quat_from_rotvec(phi))


def true_pinhole(optics, detector, rng):
    """Pinhole with random errors of focal length and principal point."""
    focal_length = optics.focal_length * (1.0 + optics.focal_length_error * rng.standard_normal())
    nominal = pinhole.pinhole(
        detector.columns, detector.rows, focal_length / detector.pixel_size, optics.principal_point
    )
    dx, dy = optics.principal_point_error * rng.standard_normal(2)
    return nominal._replace(cx_px=nominal.cx_px + dx, cy_px=nominal.cy_px + dy)


@inner
def share_above(limb_angle):
    """Share of the Sun's disc above the Earth's limb, which is straight over half a degree.

    limb_angle : rad, of the middle of the Sun -> 0 behind the Earth, 1 clear of it
    """
    x = min(1.0, max(-1.0, limb_angle / SUN_RADIUS))
    return 0.5 + (asin(x) + x * sqrt(1.0 - x * x)) / pi


@inner
def limb_sunlight(boresight_i, r_i, sun_u_i):
    """How brightly the Sun lights the limb below the boresight: 0 at night, 1 under a zenith Sun.

    The sine of the Sun's elevation at the tangent point of a spherical Earth, smoothed over the twilight.
    """
    distance = np.sqrt(r_i @ r_i)
    up_i = r_i / distance
    across_i = boresight_i - (boresight_i @ up_i) * up_i
    norm = np.sqrt(across_i @ across_i)
    cos_arc = min(1.0, wgs84.A / distance)  # arc from below the vehicle to the tangent point
    limb_up_i = cos_arc * up_i
    if norm > 1e-9:
        limb_up_i = limb_up_i + np.sqrt(1.0 - cos_arc**2) / norm * across_i
    sin_elevation = limb_up_i @ sun_u_i
    return 0.5 * (sin_elevation + np.hypot(sin_elevation, 2.0 * TWILIGHT))


def stray_light(angle, exclusion, baffle, settings):
    """Electrons per second and pixel from a source at `angle` [rad] from the boresight.

    `rate_at_exclusion` of the settings (StrayLight) at the exclusion angle; ten times more (less) for every
    `tenfold_angle` inside (outside) it; below the baffle's half angle the lens itself is lit: `direct_rate`.
    """
    if angle <= baffle:
        return settings.direct_rate
    decades = min((exclusion - angle) / settings.tenfold_angle, 300.0)  # more are no number
    return min(settings.direct_rate, settings.rate_at_exclusion * 10.0**decades)


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
