"""Where the camera is mounted, how it projects, and how much light comes in from the side.

In: the design values and their tolerances; directions of Sun and Earth. Out: the true mounting and pinhole
of this run, and the background that stray light adds to every pixel. The exclusion angles (90 deg to the
Sun, 45 deg to the Earth's limb) and the 50 deg baffle are those of the SHEFEX-2 star tracker; the shape
of the stray light between them is an engineering guess [E].
"""

from math import asin, pi, sqrt

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry import pinhole, rotation, wgs84

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
