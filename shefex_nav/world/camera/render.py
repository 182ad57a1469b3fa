"""Light of point sources on the detector, smeared by the motion while the rows are open.

In: directions and electrons of the sources, how the camera looks during the frame (`Path`). Out: mean
electrons per pixel. The point-spread function is a Gaussian integrated over each pixel. The motion is a sum
of spots, two for each step of 1.25 sigma or less at the places of Gauss's quadrature: what that leaves out
is below 2e-3 of its height at its ends and 1e-5 between them. A pixel collects light while its own
row is open: a step in which some of the rows that it reaches open or close is taken in parts, and each row
gets as much of a part as it is open for.

Pixels to which a source gives less than `least` electrons are left out: the wings of the spots, far below
the noise, are most of their area, and every pixel that is lit costs a draw from a Poisson distribution. A
still source loses 2 pi sigma^2 least electrons by that, however bright it is.
"""

from functools import lru_cache
from math import erfc, pi, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.shutter import RowTimes, row_start_s

STEP_SIGMA = 1.25  # longest step of a streak, in sigma of the point-spread function
SLOW_STEP = 0.3  # of such a step: what moves less while it is seen is one spot
GAUSS = 0.5 / sqrt(3.0)  # of a step, from its middle to both spots
PARTS = 6  # of a step in which rows open or close


class Psf(NamedTuple):
    """The Gaussian point-spread function along one axis, as tables that are interpolated linearly."""

    cdf: np.ndarray  # distribution function at steps of 1/per_px from -reach_px to reach_px
    shares: (
        np.ndarray
    )  # (per_px + 1, 2 reach_px) its differences from pixel to pixel, by the first one's place
    per_px: int
    reach_px: int
    width_px: float  # sqrt(2 pi) sigma: of a box of the Gaussian's height and area
    step_px: float  # of a streak, at most


class Path(NamedTuple):
    """How the camera looks during a frame, from the opening of the first row to the closing of the last."""

    C_ci: np.ndarray  # (n + 1, 3, 3) attitudes at the ends of n equal steps
    begin_s: float  # of the first step, from the frame's instant
    step_s: float
    times: RowTimes


class Light(NamedTuple):
    """Electrons per pixel and which pixels have any: work memory, dark between two frames."""

    electrons: np.ndarray  # (rows * columns,) float32: half the memory to fetch
    lit: np.ndarray  # (rows * columns,) int32, indices of lit pixels in the order of their first light
    n_lit: np.ndarray  # (1,) int64, how many


class Track(NamedTuple):
    """Where a source is on the detector, px, at the ends of the n steps of a Path."""

    x: np.ndarray  # (n + 1,)
    y: np.ndarray  # (n + 1,)


class Spot(NamedTuple):
    """How the light of a source falls on one place, and how much of it is drawn."""

    electrons: float
    radius: int  # half width of the square of pixels that is drawn
    least: float  # electrons that a pixel is lit for


class Patch(NamedTuple):
    """First and last column and row of some pixels; none: last < first."""

    left: int
    right: int
    top: int
    bottom: int


@lru_cache(maxsize=16)
def gaussian_psf(sigma_px):
    """Table of the Gaussian's distribution function; interpolation error below 1e-6 for sigma > 0.7 px."""
    per_px = 256
    reach_px = int(np.ceil(6.0 * sigma_px)) + 1
    x_px = np.arange(-reach_px * per_px, (reach_px + 1) * per_px + 1) / per_px
    cdf = np.array([0.5 * erfc(-x / (sqrt(2.0) * sigma_px)) for x in x_px])
    first = np.arange(per_px + 1)[:, None] + per_px * np.arange(2 * reach_px)
    shares = cdf[first + per_px] - cdf[first]
    return Psf(cdf, shares, per_px, reach_px, sqrt(2.0 * pi) * sigma_px, STEP_SIGMA * sigma_px)


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


def add_points(light, camera, psf, path, u_i, electrons, least):
    """Add point sources at infinity to `light`, in place.

    Parameters
    ----------
    light : Light
    camera : Pinhole
    psf : Psf
    path : Path
    u_i : (m, 3) directions as the moving camera sees them
    electrons : (m,) of the exposure of one row from a source at rest; nothing is drawn for zero
    least : float, electrons that a pixel is lit for
    """
    _points_kernel(light, camera, psf, path, u_i, electrons, float(least))


def add_tracks(light, camera, psf, path, xy_px, electrons, least):
    """Add point sources whose places are known, in place.

    As `add_points`, with xy_px (m, n + 1, 2): places at the ends of the steps of `path`, NaN where a source
    is behind the camera; C_ci is not used.
    """
    _tracks_kernel(light, camera, psf, path, xy_px, electrons, float(least))


@kernel
def _points_kernel(light, camera, psf, path, u_i, electrons, least):
    n = path.C_ci.shape[0]
    x, y = np.empty(n), np.empty(n)
    track, shares = Track(x, y), (np.empty(2 * psf.reach_px), np.empty(2 * psf.reach_px))
    for star in range(u_i.shape[0]):
        if electrons[star] > 0.0:
            _project(camera, path.C_ci, u_i, star, x, y)
            _add_track(light, camera, psf, path, track, electrons[star], least, shares)


@kernel
def _tracks_kernel(light, camera, psf, path, xy_px, electrons, least):
    shares = np.empty(2 * psf.reach_px), np.empty(2 * psf.reach_px)
    for k in range(xy_px.shape[0]):
        track = Track(np.ascontiguousarray(xy_px[k, :, 0]), np.ascontiguousarray(xy_px[k, :, 1]))
        _add_track(light, camera, psf, path, track, electrons[k], least, shares)


@inner
def _project(camera, C_ci, u_i, star, x, y):
    """Write the pixel positions of one direction at all attitudes (n, 3, 3) to x, y (n,); NaN behind."""
    ux, uy, uz = u_i[star, 0], u_i[star, 1], u_i[star, 2]
    for k in range(x.size):
        z = C_ci[k, 2, 0] * ux + C_ci[k, 2, 1] * uy + C_ci[k, 2, 2] * uz
        scale = camera.focal_length_px / z if z > 0.0 else np.nan
        x[k] = camera.cx_px + scale * (C_ci[k, 0, 0] * ux + C_ci[k, 0, 1] * uy + C_ci[k, 0, 2] * uz)
        y[k] = camera.cy_px + scale * (C_ci[k, 1, 0] * ux + C_ci[k, 1, 1] * uy + C_ci[k, 1, 2] * uz)


@inner
def _add_track(light, camera, psf, path, track, electrons, least, shares):
    """Add one source.

    shares : two arrays (2 reach_px,) to work in: of a spot's light, by columns and by rows
    """
    x, y, times, exposure_s = track.x, track.y, path.times, path.times.exposure_s
    longest_px = 0.0
    for k in range(x.size - 1):
        square = (x[k + 1] - x[k]) ** 2 + (y[k + 1] - y[k]) ** 2
        if square > longest_px:  # not where one end is behind the camera
            longest_px = square
    longest_px = sqrt(longest_px)
    speed = longest_px / path.step_s  # px/s
    if speed * (exposure_s + 2.0 * psf.reach_px * times.line_s) <= SLOW_STEP * psf.step_px:
        x_mid, y_mid, longer = _middle(path, x, y)
        electrons *= longer
        radius = _patch_radius(psf, electrons, least)
        if radius >= 0:
            _add_spot(light, camera, psf, (x_mid, y_mid), Spot(electrons, radius, least), shares)
        return
    stride = max(1, int(psf.step_px / longest_px))  # steps taken as one
    of_exposure = 0.5 * stride * path.step_s / exposure_s  # one spot
    # so many spots give most of the light of one pixel
    together = 1.0 / (of_exposure * max(1.0, speed * exposure_s / psf.width_px))
    faint = least / together
    radius = _patch_radius(psf, electrons * of_exposure, faint)
    if radius < 0:
        return
    source = Spot(electrons, radius, faint)
    for k in range(0, x.size - 1, stride):
        end = min(k + stride, x.size - 1)
        if _is_near(camera, 0.5 * (x[k] + x[end]), 0.5 * (y[k] + y[end]), radius + 1):
            _add_steps(light, camera, psf, path, track, (k, end), source, shares)


@inner(inline="always")
def _add_steps(light, camera, psf, path, track, ends, source, shares):
    """Add what a source gives in the steps between two ends of steps, taken as one.

    source : Spot of all the light that it gives in the exposure of a row, on one place
    """
    first, last = ends
    (x, y), (electrons, radius, faint) = track, source
    m, times = last - first, path.times
    from_s, length_s = path.begin_s + first * path.step_s, m * path.step_s
    # rows that its light may reach
    first_s = row_start_s(times, max(0.0, min(y[first], y[last]) - radius - 0.5))
    last_s = row_start_s(times, min(camera.height_px - 1.0, max(y[first], y[last]) + radius + 0.5))
    if from_s + length_s <= first_s or from_s >= last_s + times.exposure_s:
        return  # none of them is open
    rate = electrons / times.exposure_s
    if times.line_s == 0.0 or (from_s >= last_s and from_s + length_s <= first_s + times.exposure_s):
        for along in (0.5 - GAUSS, 0.5 + GAUSS):
            place = _between(x, first + along * m), _between(y, first + along * m)
            _add_spot(light, camera, psf, place, Spot(0.5 * rate * length_s, radius, faint), shares)
        return
    part_s, faint = length_s / PARTS, faint * 2.0 / PARTS
    for part in range(PARTS):
        steps, part_from_s = first + m * (part + 0.5) / PARTS, from_s + part * part_s
        place, when_s = (_between(x, steps), _between(y, steps)), (part_from_s, part_from_s + part_s)
        _add_part(light, camera, psf, place, Spot(rate, radius, faint), times, when_s, shares)


@inner
def _between(x, steps):
    """Value at a fractional number of steps of a series."""
    k = min(int(steps), x.size - 2)
    return x[k] + (steps - k) * (x[k + 1] - x[k])


@inner
def _middle(path, x, y):
    """Where a slow source is in the middle of the exposure of the row that it is on then: x, y.

    And for how much longer than the exposure of a row it is seen, 1 / (1 - v_y t_l): as a factor.
    """
    times, n = path.times, x.size - 1
    t_s, x_mid, y_mid, speed = 0.0, 0.0, 0.0, 0.0
    for _ in range(4):  # each shrinks the error to a tenth or less: the source is slow
        steps = min(max((t_s - path.begin_s) / path.step_s, 0.0), float(n))
        x_mid, y_mid = _between(x, steps), _between(y, steps)
        if times.line_s == 0.0 or not np.isfinite(y_mid):
            break
        k = min(int(steps), n - 1)
        speed = (y[k + 1] - y[k]) / path.step_s
        t_s = row_start_s(times, y_mid) + 0.5 * times.exposure_s
    return x_mid, y_mid, 1.0 / (1.0 - speed * times.line_s)


@inner
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


@inner(inline="always")
def _shares(psf, centre, first, last, shares):
    """Write the shares of a spot's light that fall on pixels first ... last of one axis."""
    place = (first - 0.5 - centre + psf.reach_px) * psf.per_px
    k = int(place)
    part, phase, pixel = place - k, k % psf.per_px, k // psf.per_px
    for j in range(last - first + 1):
        share = psf.shares[phase, pixel + j]
        shares[j] = share + part * (psf.shares[phase + 1, pixel + j] - share)


@inner(inline="always")
def _is_near(camera, x, y, radius):
    """Whether a spot reaches the detector; not if it is NaN."""
    return (
        -0.5 - radius < x < camera.width_px - 0.5 + radius
        and -0.5 - radius < y < camera.height_px - 0.5 + radius
    )


@inner
def _patch(camera, x, y, radius):
    """Patch of the pixels within `radius` of a spot's own."""
    if not _is_near(camera, x, y, radius):
        return Patch(0, -1, 0, -1)
    column, row = int(np.floor(x + 0.5)), int(np.floor(y + 0.5))
    left, right = max(0, column - radius), min(camera.width_px - 1, column + radius)
    return Patch(left, right, max(0, row - radius), min(camera.height_px - 1, row + radius))


@inner(inline="always")
def _add_spot(light, camera, psf, place, spot, shares):
    """Add one Gaussian spot integrated over the pixels within its radius of its own pixel."""
    patch = _patch(camera, place[0], place[1], spot.radius)
    if patch.right < patch.left or patch.bottom < patch.top:
        return
    _shares(psf, place[0], patch.left, patch.right, shares[0])
    _shares(psf, place[1], patch.top, patch.bottom, shares[1])
    _add_patch(light, camera, patch, spot, shares)


@inner(inline="always")
def _add_part(light, camera, psf, place, spot, times, when_s, shares):
    """As `_add_spot`, of a source that is there for a time: each row gets what falls into its exposure.

    spot : of the electrons in a second;  times : RowTimes;  when_s : from and to, s
    """
    patch = _patch(camera, place[0], place[1], spot.radius)
    if patch.right < patch.left or patch.bottom < patch.top:
        return
    _shares(psf, place[0], patch.left, patch.right, shares[0])
    _shares(psf, place[1], patch.top, patch.bottom, shares[1])
    for row in range(patch.top, patch.bottom + 1):
        shares[1][row - patch.top] *= open_for(times, row, when_s[0], when_s[1])
    _add_patch(light, camera, patch, spot, shares)


@inner
def open_for(times, row, from_s, to_s):
    """How long a row is open between two instants. RowTimes, px, s, s -> s."""
    start_s = row_start_s(times, row)
    return max(0.0, min(to_s, start_s + times.exposure_s) - max(from_s, start_s))


@inner(inline="always")
def _add_patch(light, camera, patch, spot, shares):
    """Add what of a spot's light `_shares` gave to the pixels of its patch."""
    left, right, top, bottom = patch
    for j in range(bottom - top + 1):
        in_row, pixel = spot.electrons * shares[1][j], (top + j) * camera.width_px + left
        for i in range(right - left + 1):
            in_pixel = in_row * shares[0][i]
            if in_pixel > spot.least:
                add(light, pixel + i, in_pixel)


@inner
def add(light, pixel, electrons):
    """Add electrons to a pixel and list it when it had none."""
    if light.electrons[pixel] == 0.0:
        light.lit[light.n_lit[0]] = pixel
        light.n_lit[0] += 1
    light.electrons[pixel] += electrons


@kernel
def add_charge(light, pixels, electrons):
    """Add electrons (n,) to pixels (n,), indices into the flattened frame, in place; a pixel may recur."""
    for k in range(pixels.size):
        add(light, pixels[k], electrons[k])
