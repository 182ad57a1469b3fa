"""The sky of one run, and which of its point sources an exposure may show.

In: catalogue, brightness, planets, and how the camera looks at them. Out: the sources near the field of view
that the Earth does not hide, where the moving vehicle sees them, with their electrons.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry import wgs84


class Sky(NamedTuple):
    """Point sources at infinity at the epoch of the mission, ordered by the third component of u_i."""

    u_i: np.ndarray  # (n, 3) barycentric
    flux: np.ndarray  # (n,) electrons/s
    hip: np.ndarray  # (n,) 0 for a false object
    is_listed: np.ndarray  # (n,) bool: named in FrameTruth


class Planets(NamedTuple):
    """The planets as seen from anywhere near the Earth."""

    r_i: np.ndarray  # (5, 3) m, geocentric
    flux: np.ndarray  # (5,) electrons/s


class View(NamedTuple):
    """How the camera looks at the sky in the middle of an exposure."""

    boresight_i: np.ndarray  # (3,)
    cone: float  # rad from the boresight: what lies farther away shows in no part of the frame
    r_i: np.ndarray  # (3,) m
    v_i: np.ndarray  # (3,) m/s, barycentric
    omega_ib_i: np.ndarray  # (3,) rad/s
    C_ei: np.ndarray  # (3, 3)


class DrawingLimit(NamedTuple):
    """What a source needs to be worth drawing."""

    exposure_s: float
    focal_length_px: float
    width_px: float  # of the spots: sqrt(2 pi) sigma
    least: float  # electrons in one pixel that count


def ordered(u_i, flux, hip, is_listed):
    """Sky of sources in any order."""
    order = np.argsort(u_i[:, 2], kind="stable")
    return Sky(u_i[order], flux[order], hip[order], is_listed[order])


@kernel
def visible(sky, planets, view, film):
    """Sources that may show: those of the sky, then the planets.

    Listed stars are among them even if too faint to draw, with zero electrons.

    Returns
    -------
    (m,) Hipparcos number of a listed star, otherwise 0; (m, 3) directions as the vehicle sees them, with
    aberration; (m,) electrons of the whole exposure
    """
    rows = _near(sky.u_i, view.boresight_i, view.cone)
    n, n_planets = rows.size, planets.flux.size
    u_i, electrons = np.empty((n + n_planets, 3)), np.empty(n + n_planets)
    hip = np.zeros(n + n_planets, np.int64)
    for k in range(n):
        for j in range(3):
            u_i[k, j] = sky.u_i[rows[k], j]
        hip[k] = sky.hip[rows[k]] if sky.is_listed[rows[k]] else 0
        electrons[k] = film.exposure_s * sky.flux[rows[k]]
    for k in range(n_planets):
        toward_i = planets.r_i[k] - view.r_i
        u_i[n + k] = toward_i / np.sqrt(toward_i @ toward_i)
        electrons[n + k] = film.exposure_s * planets.flux[k]
    u_i = aberrate(u_i, view.v_i)
    hidden = behind_earth(u_i, view.r_i, view.C_ei)
    kept = 0
    for k in range(n + n_planets):
        is_drawn = electrons[k] >= _faintest(u_i[k], view.omega_ib_i, film)
        if not hidden[k] and (is_drawn or hip[k] > 0):
            hip[kept] = hip[k]
            for j in range(3):
                u_i[kept, j] = u_i[k, j]
            electrons[kept] = electrons[k] if is_drawn else 0.0
            kept += 1
    return hip[:kept], u_i[:kept], electrons[:kept]


@inner
def _near(u_i, boresight_i, cone):
    """Rows of the directions within `cone` of the boresight; u_i ordered by its third component."""
    polar = np.arccos(min(1.0, max(-1.0, boresight_i[2])))
    first = np.searchsorted(u_i[:, 2], np.cos(min(np.pi, polar + cone)))
    last = np.searchsorted(u_i[:, 2], np.cos(max(0.0, polar - cone)), side="right")
    rows = np.empty(last - first, np.int64)
    n, least = 0, np.cos(cone)
    for k in range(first, last):
        if u_i[k, 0] * boresight_i[0] + u_i[k, 1] * boresight_i[1] + u_i[k, 2] * boresight_i[2] >= least:
            rows[n] = k
            n += 1
    return rows[:n]


@inner
def _faintest(u_i, omega_ib_i, film):
    """Electrons below which a source's brightest pixel stays below film.least.

    A still star puts 1/(2 pi sigma^2) of its light into that pixel, one that moves by L px
    1/(sqrt(2 pi) sigma L). This is what makes frames affordable while the vehicle spins.
    """
    x, y, z = omega_ib_i
    along = x * u_i[0] + y * u_i[1] + z * u_i[2]
    speed = np.sqrt(max(0.0, x * x + y * y + z * z - along * along))  # |omega x u|
    length_px = film.focal_length_px * film.exposure_s * speed
    return film.least * film.width_px * max(film.width_px, length_px)


@kernel
def behind_earth(u_i, r_i, C_ei):
    """Which directions from r_i end on the ellipsoid. (n, 3) unit vectors, (3,) m, (3, 3) -> (n,) bool.

    With z stretched by A/B the Earth is a unit sphere; |r + s u| = 1 has a solution s > 0 there.
    """
    S = C_ei / np.array([[wgs84.A], [wgs84.A], [wgs84.B]])
    r = S @ r_i
    above = r @ r - 1.0
    hidden = np.empty(u_i.shape[0], np.bool_)
    for k in range(u_i.shape[0]):
        uu, ru = 0.0, 0.0
        for j in range(3):
            x = S[j, 0] * u_i[k, 0] + S[j, 1] * u_i[k, 1] + S[j, 2] * u_i[k, 2]
            uu, ru = uu + x * x, ru + x * r[j]
        hidden[k] = ru < 0.0 and ru * ru > uu * above
    return hidden
