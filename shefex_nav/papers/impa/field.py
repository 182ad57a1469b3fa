"""The camera, the sky and the campaign of the IMPA paper (tables 1 and 2, section 6.2).

The paper's sensor frame S has its boresight on x and S = (z, -x, -y) of our camera axes (x right, y down, z
boresight): its roll is about our z, its pitch about our -x, its yaw about our -y; its horizontal is our x,
its vertical, along which the rows are exposed one after the other, our y.

What the paper does not say is marked [E]. Attitudes: the centres of the 200 faces of the octahedral geodesic
polyhedron {3,4+}5,0, whose edges are divided into equal angles; a geodesic polyhedron over the icosahedron
has 10 T + 2 vertices and 20 T faces, never 200. The rotation about the boresight is not given: multiples of
the golden angle [E].
"""

from dataclasses import replace
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import EPOCH, load_catalogue
from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.geometry.rotation import quat_from_dcm, quat_from_rotvec, quat_multiply
from shefex_nav.geometry.shutter import row_times
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.stills import StillCamera
from shefex_nav.world.camera import render
from shefex_nav.world.camera.detector import Electronics

SETTINGS, PROTOCOL = IMPA["camera"], IMPA["protocol"]
SHUTTERS = ("global_shutter", "rolling_shutter")
EXPOSURE_S = SETTINGS["exposure_s"]  # and from frame to frame
CAMERA = pinhole(
    SETTINGS["width_px"],
    SETTINGS["height_px"],
    SETTINGS["focal_length_mm"] * 1e3 / SETTINGS["pixel_um"],
)
FIELD = 2.0 * np.arctan(0.5 * np.hypot(CAMERA.width_px, CAMERA.height_px) / CAMERA.focal_length_px)
PSF_SIGMA_PX = 1.124  # Gaussian whose streaks are r_psf = 3 px wide, see impa_detection
ELECTRONS_PER_DN, BLACK_LEVEL_DN, BITS = 16.0, 32.0, 12  # [E]
FULL_WELL = 65e3  # [E]
BACKGROUND = float(IMPA["noise"]["stray_light_e"] + IMPA["noise"]["dark_mean_e"])
# the renderer's shot noise is that of the whole background; the paper gives the dark current a deviation of
# its own, 5 electrons and not 10: the difference is taken off the read-out noise
READ_NOISE = np.sqrt(
    IMPA["noise"]["read_std_e"] ** 2 + IMPA["noise"]["dark_std_e"] ** 2 - IMPA["noise"]["dark_mean_e"]
)
ZERO_MAGNITUDE = SETTINGS["zero_mag_electrons_s"] * EXPOSURE_S  # electrons of one row's exposure
MERGE = 3.0 / CAMERA.focal_length_px  # rad, our catalogue: closer stars are one spot

RATES = np.radians(PROTOCOL["rates_deg_s"])  # rad/s
FAST = np.radians(10.0)  # beyond the paper
N_ATTITUDES, N_DIRECTIONS = PROTOCOL["attitudes"], PROTOCOL["directions"]
PAIRS_OF_ALL = N_ATTITUDES * N_DIRECTIONS  # simulations per rate
AT_REST_EVERY = 13  # simulations at a rate to one at rest, until every attitude has had its own
FAST_EVERY = 5  # and to one at 10 deg/s
SUBDIVISION = 5
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
ORDER_SEED = 20190  # of the order in which the attitudes are taken, fixed


def times(shutter):
    """RowTimes of a shutter. The rolling one has T_exp = t_l n_row (equation 4)."""
    line_s = 0.0 if shutter == "global_shutter" else EXPOSURE_S / CAMERA.height_px
    return row_times(EXPOSURE_S, line_s, CAMERA.height_px)


def camera(shutter):
    """StillCamera of a shutter."""
    return StillCamera(
        CAMERA,
        PSF_SIGMA_PX,
        Electronics(READ_NOISE, FULL_WELL, ELECTRONS_PER_DN, BLACK_LEVEL_DN, BITS),
        BACKGROUND,
        ZERO_MAGNITUDE,
        times(shutter),
    )


@cache
def stars():
    """The sky of the paper's simulator: directions (n, 3) and V (n,), to 6.5; light from V itself."""
    sky = load_catalogue(SETTINGS["simulated_mag"])
    return sky.u_i, sky.vmag


@cache
def pairs(merged):
    """Pairs of the on-board catalogue, V <= 5.5, as in the paper, or with close stars merged: StarPairs.

    2851 stars: Hipparcos has no more, the paper's 3349 cannot be had from it with any of its magnitudes.
    """
    settings = replace(
        STAR_TRACKER.catalogue, faintest=SETTINGS["catalogue_mag"], merge_radius=MERGE if merged else 0.0
    )
    sky = load_catalogue(SETTINGS["simulated_mag"])
    sky = sky._replace(bv=np.full(len(sky.vmag), np.nan))  # the simulated light knows no colour
    return catalogue.pair_table(catalogue.build(settings, sky, EPOCH), FIELD)


@cache
def boresights():
    """Centres of the faces of the octahedral geodesic polyhedron: (200, 3)."""

    def corner(*ijk):
        v = np.sin(np.array(ijk) * (0.5 * np.pi / SUBDIVISION))
        return v / np.linalg.norm(v)

    faces = []
    for i in range(SUBDIVISION):
        for j in range(SUBDIVISION - i):
            k = SUBDIVISION - 1 - i - j
            faces.append(corner(i + 1, j, k) + corner(i, j + 1, k) + corner(i, j, k + 1))
            if k > 0:
                faces.append(corner(i + 1, j + 1, k - 1) + corner(i + 1, j, k) + corner(i, j + 1, k))
    octant = np.array(faces)
    octant /= np.linalg.norm(octant, axis=1, keepdims=True)
    signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)])
    return (octant[None] * signs[:, None]).reshape(-1, 3)


@cache
def attitudes():
    """The attitudes of the campaign, in the middle of the first frame: (200, 4) q_ic."""
    out = np.empty((N_ATTITUDES, 4))
    for k, z in enumerate(boresights()):
        pole = np.eye(3)[np.argmin(np.abs(z))]
        x = np.cross(pole, z)
        x /= np.linalg.norm(x)
        C_ic = np.column_stack([x, np.cross(z, x), z])
        turn = quat_from_rotvec(np.array([0.0, 0.0, GOLDEN * k]))
        out[k] = quat_multiply(quat_from_dcm(np.ascontiguousarray(C_ic)), turn)
    return out


@cache
def directions():
    """Directions of the angular rate in camera axes: (26, 3), all of (-1, 0, 1)^3 but the zero, as units.

    The paper's set in S: it is the same set in any axes that are permuted and mirrored.
    """
    grid = np.array([[a, b, c] for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1)], dtype=float)
    grid = grid[np.abs(grid).sum(axis=1) > 0.0]
    return grid / np.linalg.norm(grid, axis=1, keepdims=True)


class Case(NamedTuple):
    """One simulation of the campaign."""

    rate: float  # rad/s
    attitude: int  # row of attitudes()
    direction: int  # row of directions()

    @property
    def omega_c(self):
        """Angular rate of the camera in its axes: (3,) rad/s."""
        return self.rate * directions()[self.direction]

    @property
    def q_ic(self):
        """Attitude at the instant of the first frame: (4,)."""
        return attitudes()[self.attitude]


def cases(number):
    """The simulations that sample `number` of the campaign consists of: list of Case.

    Sample k has the rate k mod 5, and the samples of each rate go through all 5200 pairs of attitude and
    direction, every one once, in an order in which any stretch holds all directions and all attitudes as
    evenly as can be. So 26 000 samples are the paper's campaign and 2600 are an even tenth. Every thirteenth
    also has an attitude at rest, until the 200 are through, and every fifth the same case at 10 deg/s.
    """
    rate, k = number % len(RATES), number // len(RATES)
    one = pair(RATES[rate], k % PAIRS_OF_ALL)
    found = [one]
    if number % AT_REST_EVERY == 0 and number // AT_REST_EVERY < N_ATTITUDES:
        found.append(Case(0.0, int(_order()[number // AT_REST_EVERY]), 0))
    if number % FAST_EVERY == 0:
        found.append(one._replace(rate=FAST))
    return found


def pair(rate, k):
    """Pair k of attitude and direction: the shift makes the two cycles of 26 and 200 meet every pair once."""
    shift = k // (PAIRS_OF_ALL // 2)
    return Case(float(rate), int(_order()[(k + shift) % N_ATTITUDES]), k % N_DIRECTIONS)


@cache
def _order():
    return np.random.default_rng(ORDER_SEED).permutation(N_ATTITUDES)


def attitude_at(case, frame):
    """True attitude at the instant of a frame (0, 1, ...): (4,). Frames are contiguous, one each exposure."""
    return quat_multiply(case.q_ic, quat_from_rotvec(case.omega_c * (frame * EXPOSURE_S)))


def gyro(case, rng):
    """The rate as the gyros tell it: (3,) rad/s and its covariance (3, 3)."""
    return case.omega_c + RATE_ERROR * rng.standard_normal(3), RATE_ERROR**2 * np.eye(3)


RATE_ERROR = np.radians(0.02)  # rad/s, standard deviation on each axis


# --- the spot as a box, which is how the model of the paper counts (section 4.2) ---
#
# Equation (26) has a streak of the length l cover r_psf l pixels, with the same light in all of them: that is
# a square spot of r_psf pixels. A Gaussian has its third of a streak's light in the middle line too
# (PSF_SIGMA_PX), but soft edges: the streak of a faint star is then narrower and shorter than that of a
# bright one, and the threshold cuts it where the noise decides. The edges of a box stand still.

PER_PX = 256  # places of the table in a pixel
STEP_PX = 0.5  # of a streak: two spots each, which a box of several pixels makes even


@lru_cache(maxsize=4)
def box(width_px):
    """Square spot of this width whose light is even: render.Psf."""
    reach_px = int(np.ceil(0.5 * width_px)) + 1
    x_px = np.arange(-reach_px * PER_PX, (reach_px + 1) * PER_PX + 1) / PER_PX
    cdf = np.clip(0.5 + x_px / width_px, 0.0, 1.0)
    first = np.arange(PER_PX + 1)[:, None] + PER_PX * np.arange(2 * reach_px)
    return render.Psf(cdf, cdf[first + PER_PX] - cdf[first], PER_PX, reach_px, float(width_px), STEP_PX)
