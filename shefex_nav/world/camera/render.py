"""Light of point sources on the detector, smeared by the motion during the exposure.

In: directions and electrons of the sources, the attitude of the camera at many instants of the exposure.
Out: mean electrons per pixel. The point-spread function is a Gaussian integrated over each pixel; the
motion is a sum over instants less than 0.5 px apart on the detector (`motion`), which for a Gaussian of
0.8 px has a ripple below 1e-12.

Pixels to which a source gives less than `least` electrons are left out: the wings of the spots, far below
the noise, are most of their area, and every pixel that is lit costs a draw from a Poisson distribution. A
still source loses 2 pi sigma^2 least electrons by that, however bright it is.
"""

from math import erfc, pi, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit


class Psf(NamedTuple):
    """Distribution function of the Gaussian point-spread function along one axis, as a table."""

    cdf: np.ndarray  # at steps of 1/per_px from -reach_px to reach_px; interpolated linearly
    per_px: int
    reach_px: int
    width_px: float  # sqrt(2 pi) sigma: of a box of the Gaussian's height and area


class Light(NamedTuple):
    """Electrons per pixel and which pixels have any: work memory, dark between two frames."""

    electrons: np.ndarray  # (rows * columns,) float32: half the memory to fetch
    lit: np.ndarray  # (rows * columns,) int32, indices of lit pixels in the order of their first light
    n_lit: np.ndarray  # (1,) int64, how many


def gaussian_psf(sigma_px):
    """Table of the Gaussian's distribution function; interpolation error below 1e-6 for sigma > 0.7 px."""
    per_px = 256
    reach_px = int(np.ceil(6.0 * sigma_px)) + 1
    x_px = np.arange(-reach_px * per_px, (reach_px + 1) * per_px + 1) / per_px
    cdf = np.array([0.5 * erfc(-x / (sqrt(2.0) * sigma_px)) for x in x_px])
    return Psf(cdf, per_px, reach_px, sqrt(2.0 * pi) * sigma_px)


def darkness(n_pixels):
    """Light of a frame before any source has been added."""
    return Light(np.zeros(n_pixels, np.float32), np.empty(n_pixels, np.int32), np.zeros(1, np.int64))


def lit_pixels(light):
    """Indices of the pixels with light, in the order of their first."""
    return light.lit[: light.n_lit[0]]


def darken(light):
    """Take all light away again, in place: new memory for every frame would cost 0.15 ms more."""
    light.electrons[lit_pixels(light)] = 0.0
    light.n_lit[0] = 0


def add_points(light, camera, psf, C_ci, u_i, electrons, least):
    """Add point sources to `light`, in place; returns where their light is centred.

    Parameters
    ----------
    light : Light
    camera : Pinhole
    psf : Psf
    C_ci : (n, 3, 3) attitudes at equal steps of the exposure
    u_i : (m, 3) directions as the moving camera sees them
    electrons : (m,) of the whole exposure; nothing is drawn for zero
    least : float, electrons that a pixel is lit for

    Returns
    -------
    (m, 2) px, mean position over the exposure; NaN for a source that was behind the camera
    """
    xy_px = np.empty((len(u_i), 2))
    _points_kernel(light, camera, psf, C_ci, u_i, electrons, float(least), xy_px)
    return xy_px


@njit(cache=True)
def _points_kernel(light, camera, psf, C_ci, u_i, electrons, least, xy_px):
    """Write the mean positions to xy_px and add the sources to light."""
    n = C_ci.shape[0]
    shares = np.empty((2, 2 * psf.reach_px))
    for star in range(u_i.shape[0]):
        x_0, y_0 = _project(camera, C_ci[0], u_i[star])
        x_1, y_1 = _project(camera, C_ci[n - 1], u_i[star])
        length_px = np.hypot(x_1 - x_0, y_1 - y_0)
        # so many of the n steps give most of the light of one pixel
        together = n / (length_px / psf.width_px) if length_px > psf.width_px else n
        spot, faint = electrons[star] / n, least / together
        radius = _patch_radius(psf, spot, faint)
        sum_x, sum_y = 0.0, 0.0
        for k in range(n):
            x, y = _project(camera, C_ci[k], u_i[star])
            sum_x += x
            sum_y += y
            if radius >= 0:
                _add_spot(light, camera, psf, x, y, spot, radius, faint, shares)
        xy_px[star, 0], xy_px[star, 1] = sum_x / n, sum_y / n


@njit(cache=True)
def _project(camera, C, u):
    """Pixel position of a direction, NaN behind the camera. Pinhole, (3, 3), (3,) -> x, y."""
    z = C[2, 0] * u[0] + C[2, 1] * u[1] + C[2, 2] * u[2]
    if z <= 0.0:
        return np.nan, np.nan
    scale = camera.focal_length_px / z
    x = camera.cx_px + scale * (C[0, 0] * u[0] + C[0, 1] * u[1] + C[0, 2] * u[2])
    y = camera.cy_px + scale * (C[1, 0] * u[0] + C[1, 1] * u[1] + C[1, 2] * u[2])
    return x, y


@njit(cache=True)
def _patch_radius(psf, electrons, least):
    """Half width of the square of pixels outside which a spot gives none `least` electrons; -1: no spot."""
    if electrons <= 0.0:
        return -1
    middle, half = psf.reach_px * psf.per_px, psf.per_px // 2
    most = electrons * (psf.cdf[middle + half] - psf.cdf[middle - half])  # in one row
    for radius in range(psf.reach_px - 1):
        # the centre may lie half a pixel off the middle of the square, at the edge of its pixel
        if most * psf.cdf[middle - radius * psf.per_px] < least:
            return radius
    return psf.reach_px - 1


@njit(cache=True)
def _shares(psf, centre, first, last, shares):
    """Write the shares of a spot's light that fall on pixels first ... last of one axis."""
    place = (first - 0.5 - centre + psf.reach_px) * psf.per_px
    k = int(place)
    part = place - k  # the same at all edges
    below = psf.cdf[k] + part * (psf.cdf[k + 1] - psf.cdf[k])
    for j in range(last - first + 1):
        k += psf.per_px
        above = psf.cdf[k] + part * (psf.cdf[k + 1] - psf.cdf[k])
        shares[j] = above - below
        below = above


@njit(cache=True)
def _add_spot(light, camera, psf, x, y, electrons, radius, least, shares):
    """Add one Gaussian spot integrated over the pixels within `radius` of its own pixel."""
    if not (-0.5 - radius < x < camera.width_px - 0.5 + radius):
        return
    if not (-0.5 - radius < y < camera.height_px - 0.5 + radius):
        return
    column, row = int(np.floor(x + 0.5)), int(np.floor(y + 0.5))
    left, right = max(0, column - radius), min(camera.width_px - 1, column + radius)
    top, bottom = max(0, row - radius), min(camera.height_px - 1, row + radius)
    _shares(psf, x, left, right, shares[0])
    _shares(psf, y, top, bottom, shares[1])
    for j in range(bottom - top + 1):
        in_row, pixel = electrons * shares[1, j], (top + j) * camera.width_px + left
        for i in range(right - left + 1):
            in_pixel = in_row * shares[0, i]
            if in_pixel > least:
                _add(light, pixel + i, in_pixel)


@njit(cache=True)
def _add(light, pixel, electrons):
    """Add electrons to a pixel and list it when it had none."""
    if light.electrons[pixel] == 0.0:
        light.lit[light.n_lit[0]] = pixel
        light.n_lit[0] += 1
    light.electrons[pixel] += electrons


def add_moon(light, camera, C_ci, moon_u_i, angular_radius, sun_u_i, electrons):
    """Add the Moon, in place: a sphere lit by the Sun, with a sharp edge.

    Parameters
    ----------
    light, camera, C_ci : as in add_points
    moon_u_i, sun_u_i : (3,) unit vectors
    angular_radius : float [rad]
    electrons : float, of the whole exposure from a full Moon; the phase is in the picture
    """
    radius_px = camera.focal_length_px * np.tan(angular_radius)
    # the mean of cos(incidence) over the disc of a fully lit sphere is 2/3
    per_px = 1.5 * electrons / (np.pi * radius_px**2) / len(C_ci)
    _moon_kernel(light, camera, C_ci @ moon_u_i, radius_px, C_ci @ sun_u_i, per_px)


@njit(cache=True)
def _moon_kernel(light, camera, moon_c, radius_px, sun_c, electrons_per_px):
    """Add one disc for each attitude."""
    for k in range(moon_c.shape[0]):
        if moon_c[k, 2] <= 0.0:
            continue
        x = camera.cx_px + camera.focal_length_px * moon_c[k, 0] / moon_c[k, 2]
        y = camera.cy_px + camera.focal_length_px * moon_c[k, 1] / moon_c[k, 2]
        for row in range(max(0, int(y - radius_px)), min(camera.height_px, int(y + radius_px) + 2)):
            for column in range(max(0, int(x - radius_px)), min(camera.width_px, int(x + radius_px) + 2)):
                a, b = (column - x) / radius_px, (row - y) / radius_px
                if a * a + b * b < 1.0:  # the visible half of the sphere faces the camera: -z
                    cos_incidence = (
                        a * sun_c[k, 0] + b * sun_c[k, 1] - np.sqrt(1.0 - a * a - b * b) * sun_c[k, 2]
                    )
                    if cos_incidence > 0.0:
                        _add(light, row * camera.width_px + column, electrons_per_px * cos_incidence)
