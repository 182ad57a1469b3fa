"""Pictures of the night sky as a camera on a tripod takes them, with what spoils them.

Written for the tests of `shefex_nav.solve`, with its own projection: a sign that is wrong there cannot hide.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, zoom

from shefex_nav.environment.stars import aberrate, at_epoch, load_catalogue

YEAR = 2020.0  # a whole one says no day: aberration is neither drawn nor taken out
STARS = at_epoch(load_catalogue(8.0), YEAR)


class Shot(NamedTuple):
    """A picture and the truth."""

    image: np.ndarray  # (rows, columns) grey values, float
    ra_deg: float
    dec_deg: float
    roll_deg: float
    fov_deg: float
    hip: np.ndarray  # stars on the detector
    xy_px: np.ndarray  # where


def axes(ra_deg, dec_deg, roll_deg):
    """Right, down and forward of a camera in ICRS; roll is the position angle of up."""
    ra, dec, roll = np.radians([ra_deg, dec_deg, roll_deg])
    forward = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    north = np.array([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)])
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    up = np.cos(roll) * north + np.sin(roll) * east
    right = np.cross(forward, up)  # who looks north has east on the right hand
    return right, -up, forward


def shoot(
    rng, *, fov_deg=11.4, width=1024, height=768, ra_deg=None, dec_deg=None, roll_deg=None, limit=7.0,
    sigma_px=1.0, snr=6.0, background=60.0, noise=2.0, k1_edge=0.0, trail_px=0.0, trail_angle=0.5,
    law=None, velocity_i=(0.0, 0.0, 0.0),
):  # fmt: skip
    """A picture whose stars of V = limit have a signal-to-noise ratio of snr.

    k1_edge: relative displacement at the middle of the left and right edge. With 8 bits in mind: background
    and noise are grey values, stars saturate at 255. law: distance from the middle for an angle from the
    axis, in the place of a pinhole, e.g. 2 tan(angle / 2). velocity_i: of the camera [m/s], for aberration.
    """
    ra_deg = rng.uniform(0.0, 360.0) if ra_deg is None else ra_deg
    dec_deg = np.degrees(np.arcsin(rng.uniform(-1.0, 1.0))) if dec_deg is None else dec_deg
    roll_deg = rng.uniform(0.0, 360.0) if roll_deg is None else roll_deg
    right, down, forward = axes(ra_deg, dec_deg, roll_deg)
    # the field of view is that between the two edges, distortion included
    edge = np.tan(0.5 * np.radians(fov_deg))
    f = 0.5 * width / (edge * (1.0 + k1_edge))
    k1 = k1_edge / edge**2
    seen_i = aberrate(STARS.u_i, np.array(velocity_i))
    ahead = seen_i @ forward > 0.3
    u_i, vmag, hip = seen_i[ahead], STARS.vmag[ahead], STARS.hip[ahead]
    x, y = (u_i @ right) / (u_i @ forward), (u_i @ down) / (u_i @ forward)
    radial = 1.0 + k1 * np.minimum(x * x + y * y, 1.6 * (edge * np.hypot(1.0, height / width)) ** 2)
    if law is not None:
        tangent = np.hypot(x, y)
        f = 0.5 * width / law(np.arctan(edge))
        radial = law(np.arctan(tangent)) / np.maximum(tangent, 1e-12)
    px, py = 0.5 * (width - 1) + f * radial * x, 0.5 * (height - 1) + f * radial * y
    margin = 4.0 * sigma_px + trail_px
    near = (px > -margin) & (py > -margin) & (px < width + margin) & (py < height + margin)
    # matched filter: snr = flux / (noise sqrt(4 pi) sigma)
    flux = snr * noise * np.sqrt(4.0 * np.pi) * sigma_px * 10.0 ** (-0.4 * (vmag - limit))
    image = np.zeros((height, width))
    for a, b, light in zip(px[near], py[near], flux[near], strict=True):
        star(image, a, b, light, sigma_px, trail_px, trail_angle)
    image += background + rng.normal(0.0, noise, image.shape)
    on = (px > -0.5) & (py > -0.5) & (px < width - 0.5) & (py < height - 0.5)
    return Shot(image, ra_deg, dec_deg, roll_deg, fov_deg, hip[on], np.column_stack([px, py])[on])


def star(image, x, y, light, sigma_px, trail_px=0.0, angle=0.0):
    """Add a Gaussian spot, or a row of them."""
    n = max(1, int(np.ceil(2.0 * trail_px / sigma_px)))
    reach = int(np.ceil(5.0 * sigma_px + 0.5 * trail_px)) + 1
    r0, c0 = max(int(y) - reach, 0), max(int(x) - reach, 0)
    r1, c1 = min(int(y) + reach + 1, image.shape[0]), min(int(x) + reach + 1, image.shape[1])
    if r1 <= r0 or c1 <= c0:
        return
    rows, columns = np.mgrid[r0:r1, c0:c1]
    for k in range(n):
        along = ((k + 0.5) / n - 0.5) * trail_px
        d2 = (columns - x - along * np.cos(angle)) ** 2 + (rows - y - along * np.sin(angle)) ** 2
        spot = np.exp(-0.5 * d2 / sigma_px**2) / (2.0 * np.pi * sigma_px**2)
        image[r0 : r0 + spot.shape[0], c0 : c0 + spot.shape[1]] += light / n * spot


def glow(image, rng, strength=60.0):
    """City light from below, vignetting, and clouds."""
    h, w = image.shape
    y, x = np.mgrid[0:h, 0:w]
    light = strength * np.exp(-(h - y) / (0.4 * h)) * (1.0 + 0.5 * np.cos(3.0 * x / w))
    clouds = gaussian_filter(rng.normal(size=(h // 16 + 1, w // 16 + 1)), 3.0)
    clouds = zoom(clouds / clouds.std(), 17, order=1)[:h, :w]
    return image + light + 0.12 * strength * clouds


def trees(image, rng, share=0.3, sky=60.0):
    """Branches and leaves along the lower border, darker than the sky, with sharp edges."""
    h, w = image.shape
    rough = gaussian_filter(rng.normal(size=(h, w)), 1.5)
    rough = rough / rough.std() + 1.5 * (lambda z: z / z.std())(
        gaussian_filter(rng.normal(size=(h, w)), 12.0)
    )
    line = h * (1.0 - share * (1.0 + 0.5 * np.sin(np.linspace(0.0, 7.0, w))))
    depth = (np.arange(h)[:, None] - line[None, :]) / (0.1 * h)
    return np.where(rough + depth * 1.5 > 1.0, image - 0.7 * sky, image)


def moon(image, x, y, radius_px):
    """A saturated disc with a halo."""
    h, w = image.shape
    r = np.hypot(*(np.mgrid[0:h, 0:w] - np.array([y, x])[:, None, None]))
    return image + np.where(r < radius_px, 400.0, 120.0 * (radius_px / np.maximum(r, 1.0)) ** 1.5)


def satellite(image, rng, light=200.0, sigma_px=1.0):
    """A streak from border to border."""
    h, w = image.shape
    y0, y1 = rng.uniform(0.0, h, 2)
    y, x = np.mgrid[0:h, 0:w]
    slope = (y1 - y0) / w
    d = (y - y0 - slope * x) / np.hypot(1.0, slope)
    return image + light * np.exp(-0.5 * (d / sigma_px) ** 2)


def hot_pixels(image, rng, n=200):
    """Single bright pixels."""
    image = image.copy()
    image[rng.integers(0, image.shape[0], n), rng.integers(0, image.shape[1], n)] += rng.uniform(
        30.0, 200.0, n
    )
    return image


def to_8_bit(image):
    """Rounded and clipped."""
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def to_16_bit(image):
    """Rounded and clipped, 64 times finer."""
    return np.clip(np.rint(64.0 * image), 0, 65535).astype(np.uint16)
