"""Light of point sources on the detector, smeared by the motion during the exposure.

In: directions and electrons of the sources, the attitude of the camera at many instants of the exposure.
Out: mean electrons per pixel. The point-spread function is a Gaussian integrated over each pixel; the
motion is a sum over instants less than MAX_STEP_PX apart on the detector, which for a Gaussian of 0.8 px
has a ripple below 1e-12.
"""

from math import erfc, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.geometry.rotation import (
    dcm_from_quat,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)

MAX_STEP_PX = 0.5
LOST_ELECTRONS = 0.1  # light outside the square of pixels that a source is given, per edge
LEAST_ELECTRONS = 0.02  # a source leaves out pixels with less: the corners of its square


class Psf(NamedTuple):
    """Distribution function of the Gaussian point-spread function along one axis, as a table."""

    cdf: np.ndarray  # at steps of 1/per_px from -reach_px to reach_px; interpolated linearly
    per_px: int
    reach_px: int


class Light(NamedTuple):
    """Electrons per pixel and which pixels have any: work memory, dark between two frames."""

    electrons: np.ndarray  # (rows * columns,)
    lit: np.ndarray  # (rows * columns,) int32, indices of lit pixels in the order of their first light
    n_lit: np.ndarray  # (1,) int64, how many


def gaussian_psf(sigma_px):
    """Table of the Gaussian's distribution function; interpolation error below 1e-6 for sigma > 0.7 px."""
    per_px = 256
    reach_px = int(np.ceil(6.0 * sigma_px)) + 1
    x_px = np.arange(-reach_px * per_px, (reach_px + 1) * per_px + 1) / per_px
    cdf = np.array([0.5 * erfc(-x / (sqrt(2.0) * sigma_px)) for x in x_px])
    return Psf(cdf, per_px, reach_px)


def darkness(n_pixels):
    """Light of a frame before any source has been added."""
    return Light(np.zeros(n_pixels), np.empty(n_pixels, np.int32), np.zeros(1, np.int64))


def lit_pixels(light):
    """Indices of the pixels with light, in the order of their first."""
    return light.lit[: light.n_lit[0]]


def darken(light):
    """Take all light away again, in place: new memory for every frame would cost 0.15 ms more."""
    light.electrons[lit_pixels(light)] = 0.0
    light.n_lit[0] = 0


def attitudes(trajectory, q_bc, times_s):
    """C_ci at times within the trajectory, at constant rate between its samples. (n,) s -> (n, 3, 3)."""
    t_s = trajectory.t_s
    step_s = (t_s[-1] - t_s[0]) / (len(t_s) - 1)
    C_ci = np.empty((len(times_s), 3, 3))
    _attitudes_kernel(trajectory.q_ib, (times_s - t_s[0]) / step_s, q_bc, C_ci)
    return C_ci


@njit(cache=True)
def _attitudes_kernel(q_ib, samples, q_bc, C_ci):
    """Write C_ci at fractional sample numbers."""
    before = -1
    phi_b = np.zeros(3)
    for k in range(samples.size):
        sample = min(int(samples[k]), q_ib.shape[0] - 2)
        if sample != before:
            before = sample
            phi_b = rotvec_from_quat(quat_multiply(quat_conjugate(q_ib[sample]), q_ib[sample + 1]))
        q_ib_k = quat_multiply(q_ib[sample], quat_from_rotvec((samples[k] - sample) * phi_b))
        C_ic = dcm_from_quat(quat_multiply(q_ib_k, q_bc))
        for row in range(3):  # an array assignment would double the time to compile
            for column in range(3):
                C_ci[k, row, column] = C_ic[column, row]


def add_points(light, camera, psf, C_ci, u_i, electrons):
    """Add point sources to `light`, in place; returns where their light is centred.

    Parameters
    ----------
    light : Light
    camera : Pinhole
    psf : Psf
    C_ci : (n, 3, 3) attitudes at equal steps of the exposure
    u_i : (m, 3) directions as the moving camera sees them
    electrons : (m,) of the whole exposure; nothing is drawn for zero

    Returns
    -------
    (m, 2) px, mean position over the exposure; NaN for a source that was behind the camera
    """
    xy_px = np.empty((len(u_i), 2))
    _points_kernel(light, camera, psf, C_ci, u_i, electrons, xy_px)
    return xy_px


@njit(cache=True)
def _points_kernel(light, camera, psf, C_ci, u_i, electrons, xy_px):
    """Write the mean positions to xy_px and add the sources to light."""
    n = C_ci.shape[0]
    for star in range(u_i.shape[0]):
        radius = _patch_radius(psf, electrons[star])
        sum_x, sum_y = 0.0, 0.0
        for k in range(n):
            ux, uy, uz = u_i[star, 0], u_i[star, 1], u_i[star, 2]
            z = C_ci[k, 2, 0] * ux + C_ci[k, 2, 1] * uy + C_ci[k, 2, 2] * uz
            if z <= 0.0:
                sum_x = np.nan
                continue
            scale = camera.focal_length_px / z
            x = camera.cx_px + scale * (C_ci[k, 0, 0] * ux + C_ci[k, 0, 1] * uy + C_ci[k, 0, 2] * uz)
            y = camera.cy_px + scale * (C_ci[k, 1, 0] * ux + C_ci[k, 1, 1] * uy + C_ci[k, 1, 2] * uz)
            sum_x += x
            sum_y += y
            if radius > 0:
                _add_spot(light, camera, psf, x, y, electrons[star] / n, radius, LEAST_ELECTRONS / n)
        xy_px[star, 0], xy_px[star, 1] = sum_x / n, sum_y / n


@njit(cache=True)
def _patch_radius(psf, electrons):
    """Half width in pixels of the square that holds a source but for LOST_ELECTRONS at each edge."""
    if electrons <= 0.0:
        return 0
    for radius in range(1, psf.reach_px - 1):
        if electrons * psf.cdf[(psf.reach_px - radius) * psf.per_px] < LOST_ELECTRONS:
            return radius
    return psf.reach_px - 1


@njit(cache=True)
def _add_spot(light, camera, psf, x, y, electrons, radius, least):
    """Add one Gaussian spot integrated over the pixels within `radius` of its own pixel."""
    if not (-0.5 - radius < x < camera.width_px - 0.5 + radius):
        return
    if not (-0.5 - radius < y < camera.height_px - 0.5 + radius):
        return
    column, row = int(np.floor(x + 0.5)), int(np.floor(y + 0.5))
    # the left edge of pixel c is at c - 0.5 - x from the centre of the spot; all edges share the fraction
    edge_x = (column - radius - 0.5 - x + psf.reach_px) * psf.per_px
    edge_y = (row - radius - 0.5 - y + psf.reach_px) * psf.per_px
    ix, iy = int(edge_x), int(edge_y)
    fx, fy = edge_x - ix, edge_y - iy
    below = psf.cdf[iy] + fy * (psf.cdf[iy + 1] - psf.cdf[iy])
    for r in range(row - radius, row + radius + 1):
        iy += psf.per_px
        above = psf.cdf[iy] + fy * (psf.cdf[iy + 1] - psf.cdf[iy])
        in_row = electrons * (above - below)
        below = above
        if 0 <= r < camera.height_px:
            _add_row(light, camera, psf, r, column - radius, column + radius, ix, fx, in_row, least)


@njit(cache=True)
def _add_row(light, camera, psf, row, first, last, ix, fx, electrons, least):
    """Spread the electrons of one row of a spot over its columns."""
    left = psf.cdf[ix] + fx * (psf.cdf[ix + 1] - psf.cdf[ix])
    for column in range(first, last + 1):
        ix += psf.per_px
        right = psf.cdf[ix] + fx * (psf.cdf[ix + 1] - psf.cdf[ix])
        in_pixel = electrons * (right - left)
        if in_pixel > least and 0 <= column < camera.width_px:
            _add(light, row * camera.width_px + column, in_pixel)
        left = right


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
