"""Frames of a turning camera for the tests of the streak detection: slow, plain, and exact to 0.05 px.

Light of a small step of the path falls as a Gaussian spot, integrated over each pixel, on the rows that are
open during that step, for the part of the step for which they are open.
"""

from dataclasses import replace
from math import erf, sqrt
from typing import NamedTuple

import numpy as np
from star_fields import DETECT

from shefex_nav.compiled import kernel
from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import Pinhole, pinhole, pixels
from shefex_nav.geometry.rotation import dcm_from_quat, quat_normalise
from shefex_nav.geometry.shutter import row_start_s, row_times
from shefex_nav.geometry.streak import place_at
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.streaks import Motion

DEG = np.pi / 180.0


class Bench(NamedTuple):
    """A camera: optics, detector, exposure."""

    name: str
    camera: Pinhole
    sigma_px: float
    exposure_s: float
    zero_electrons: float  # of a star of magnitude 0 in one exposure
    background_electrons: float  # per pixel and exposure
    read_electrons: float
    electrons_per_dn: float
    black_dn: float
    bits: int

    @property
    def model(self):
        """The camera as the detection knows it."""
        return CameraModel(self.camera, electrons_per_dn=self.electrons_per_dn, psf_sigma=self.sigma_px)

    @property
    def saturation_dn(self):
        return 2**self.bits - 1

    @property
    def noise_dn(self):
        """Noise of a pixel without a star, quantisation included."""
        electrons2 = self.background_electrons + self.read_electrons**2
        return np.sqrt(electrons2 / self.electrons_per_dn**2 + 1.0 / 12.0)


IMPA = Bench("impa", pinhole(1024, 1024, 52e-3 / 18e-6), 1.1, 0.2, 7.3e6 * 0.2, 6100.0, 50.0, 16.0, 32.0, 12)
PER_DN = 118.0 * 10.0 ** (-24.0 / 20.0)
SHEFEX = Bench(
    "shefex", pinhole(659, 493, 24.95e-3 / 9.9e-6), 0.8, 0.05, 2.5e6 * 0.05, 20.0, 16.0, PER_DN, 16.0, 8
)


def detect_params(bench, **changes):
    """Settings of the detection for a camera."""
    settings = replace(DETECT, tile=96, most_objects=100, saturation=float(bench.saturation_dn))
    return replace(settings, **changes)


def times_of(bench, rolling):
    """Row times: a rolling shutter opens its last row an exposure after the first."""
    rows = bench.camera.height_px
    return row_times(bench.exposure_s, bench.exposure_s / rows if rolling else 0.0, rows)


def motion_of(bench, omega_c, rolling=False, sigma=0.0):
    """Motion with an isotropic uncertainty of the rate, rad/s."""
    omega_c = np.asarray(omega_c, dtype=float)
    return Motion(omega_c, sigma**2 * np.eye(3), times_of(bench, rolling))


@kernel
def _smear(light, camera, sigma, times, omega_c, x, y, electrons, begin, end, step_px):
    """Add the light of one star between two instants."""
    rows, columns = light.shape
    xa, ya = place_at(camera, omega_c, x, y, begin)
    xb, yb = place_at(camera, omega_c, x, y, end)
    n = 1 + int(np.hypot(xb - xa, yb - ya) / step_px)
    dt = (end - begin) / n
    reach = int(6.0 * sigma) + 2
    edge = np.empty(2 * reach + 2)
    for k in range(n):
        t = begin + k * dt
        xs, ys = place_at(camera, omega_c, x, y, t + 0.5 * dt)
        if not (-reach < xs < columns + reach and -reach < ys < rows + reach):
            continue
        left, top = int(np.floor(xs)) - reach, int(np.floor(ys)) - reach
        for j in range(2 * reach + 2):
            edge[j] = 0.5 * erf((left + j - 0.5 - xs) / (sqrt(2.0) * sigma))
        for i in range(2 * reach + 1):
            r = top + i
            if r < 0 or r >= rows:
                continue
            start = row_start_s(times, r)
            open_s = min(t + dt, start + times.exposure_s) - max(t, start)
            if open_s <= 0.0:
                continue
            z = (r - 0.5 - ys) / (sqrt(2.0) * sigma)
            share = 0.5 * (erf(z + 1.0 / (sqrt(2.0) * sigma)) - erf(z)) * open_s / times.exposure_s
            for j in range(2 * reach + 1):
                c = left + j
                if 0 <= c < columns:
                    light[r, c] += electrons * share * (edge[j + 1] - edge[j])


def add_star(light, bench, times, omega_c, x, y, electrons, step_px=0.1):
    """Add a star that is at (x, y) at the instant; electrons of one row's exposure."""
    span = 0.5 * times.exposure_s + (times.middle_row + 10.0) * times.line_s
    omega_c = np.asarray(omega_c, dtype=float)
    args = (float(x), float(y), float(electrons), -span, span, step_px)
    _smear(light, bench.camera, bench.sigma_px, times, omega_c, *args)


def digitise(bench, light, rng):
    """Grey values of a frame with this light [electrons] of stars."""
    mean = light + bench.background_electrons
    electrons = np.where(mean > 200.0, np.rint(rng.normal(mean, np.sqrt(mean))), 0.0)
    small = mean <= 200.0
    electrons[small] = rng.poisson(mean[small])
    electrons += bench.read_electrons * rng.standard_normal(light.shape)
    grey = np.rint(electrons / bench.electrons_per_dn + bench.black_dn)
    return np.clip(grey, 0, bench.saturation_dn).astype(np.uint8 if bench.bits <= 8 else np.uint16)


def dark(bench):
    """Light of no star."""
    return np.zeros((bench.camera.height_px, bench.camera.width_px))


def grid_places(bench, rng, spacing=128):
    """Places on a coarse grid at random phases, clear of each other and of the border: (n, 2)."""
    x = np.arange(spacing / 2, bench.camera.width_px - spacing / 2 + 1, spacing)
    y = np.arange(spacing / 2, bench.camera.height_px - spacing / 2 + 1, spacing)
    xx, yy = np.meshgrid(x, y)
    places = np.column_stack([xx.ravel(), yy.ravel()])
    return places + rng.uniform(-6.0, 6.0, places.shape)


def sky(bench, rng, faintest=6.5):
    """The catalogue stars of a random attitude on and around the detector: (n, 2) px, (n,) V."""
    stars = load_catalogue(8.0)
    u_c = stars.u_i @ dcm_from_quat(quat_normalise(rng.normal(size=4)))
    xy_px = pixels(bench.camera, u_c)
    size = np.array([bench.camera.width_px, bench.camera.height_px])
    near = ((xy_px > -150.0) & (xy_px < size + 150.0)).all(axis=1) & (stars.vmag <= faintest)
    return xy_px[near], stars.vmag[near]


def frame(bench, motion, xy_px, electrons, rng):
    """Image of stars: places at the instant, electrons of one row's exposure."""
    light = dark(bench)
    for (x, y), signal in zip(xy_px, np.broadcast_to(electrons, len(xy_px)), strict=True):
        add_star(light, bench, motion.times, motion.omega_c, x, y, signal)
    return digitise(bench, light, rng)


def match(found_px, true_px, reach_px):
    """Nearest found object of each true one: (n,) rows, -1 where none is within reach_px."""
    if len(found_px) == 0:
        return np.full(len(true_px), -1)
    distance = np.linalg.norm(np.asarray(true_px)[:, None] - found_px[None], axis=2)
    nearest = distance.argmin(axis=1)
    return np.where(distance.min(axis=1) < reach_px, nearest, -1)
