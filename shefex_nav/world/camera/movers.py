"""Satellites and debris: points of light that move among the stars.

In: how many there are on the whole sky, how fast and how bright. Out: where they are on the detector during a
frame. Each runs along a great circle of the inertial sky at a constant rate, so it enters the field of view,
crosses it in some direction and leaves; its streak has another length and another direction than those of the
stars. Distances, the shadow of the Earth and changes of brightness are left out; rates are engineering
values [E].
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.elementary import arccos, exp, log


class Movers(NamedTuple):
    """u_i(t) = a cos(rate t) + b sin(rate t) for each of n objects."""

    a_i: np.ndarray  # (n, 3)
    b_i: np.ndarray  # (n, 3) unit vectors at right angles to a_i
    rate: np.ndarray  # (n,) rad/s
    flux: np.ndarray  # (n,) electrons/s


def draw(n, rates, flux, rng):
    """Movers anywhere, in any direction, rates spread evenly in the logarithm between two [rad/s]."""
    a_i, b_i = rng.standard_normal((2, n, 3))
    a_i /= np.linalg.norm(a_i, axis=1, keepdims=True)
    b_i -= (b_i * a_i).sum(axis=1, keepdims=True) * a_i
    b_i /= np.linalg.norm(b_i, axis=1, keepdims=True)
    return Movers(a_i, b_i, exp(rng.uniform(*log(rates), n)), flux)


def directions(movers, t_s):
    """Unit vectors (n, 3) at a time (s)."""
    angle = (movers.rate * t_s)[:, None]
    return movers.a_i * np.cos(angle) + movers.b_i * np.sin(angle)


def near(movers, t_s, boresight_i, cone, longest_s):
    """Those that may come within `cone` [rad] of the boresight within longest_s of a time. -> (m,) rows"""
    cosine = np.clip(directions(movers, t_s) @ boresight_i, -1.0, 1.0)
    return np.flatnonzero(arccos(cosine) < cone + movers.rate * longest_s)


def tracks(movers, camera, path, t_valid_s):
    """Places on the detector at the ends of the steps of a frame's path.

    Parameters
    ----------
    movers : Movers
    camera : Pinhole
    path : render.Path
    t_valid_s : float, the frame's instant

    Returns
    -------
    (n, steps + 1, 2) px, NaN behind the camera
    """
    n_ends = len(path.C_ci)
    t_s = t_valid_s + path.begin_s + path.step_s * np.arange(n_ends)
    angle = movers.rate[:, None, None] * t_s[None, :, None]
    u_i = movers.a_i[:, None] * np.cos(angle) + movers.b_i[:, None] * np.sin(angle)  # (n, ends, 3)
    u_c = np.einsum("kij,nkj->nki", path.C_ci, u_i)
    z = np.where(u_c[:, :, 2] > 0.0, u_c[:, :, 2], np.nan)
    centre = np.array([camera.cx_px, camera.cy_px])
    return centre + camera.focal_length_px * u_c[:, :, :2] / z[:, :, None]
