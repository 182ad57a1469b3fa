"""What a star tracker finds in a picture that is not drawn: statistics in the place of rendering.

In: the true sky, camera and trajectory, and a `SightingModel` that was fitted to rendered pictures. Out, at
the same instants as pictures: a `Frame` without pixels, its `FrameTruth`, and a `Sighting`, the objects that
the detection finds. Where the stars of the field stand, how they move during the exposure, the sky background
and all that is constant in a run (mounting, focal length, principal point, brightness of each star) are those
of the rendered picture. Fitted are which sources are found and how well their centroids are measured.

The form of both is that of a Gaussian spot in noise. A star of E electrons, drawn out by its motion to the
standard deviations w along and s across, in pixels with the noise n, stands out by

    q = E / (2 pi w s n)

(its brightest pixel, with which a search begins), and no unbiased centroid has less variance along a
direction a, with b the one across, than the larger of w_a^2 / E (the star's own shot noise) and
8 pi w_a^3 w_b (n / E)^2 (that of the background); see Winick, J. Opt. Soc. Am. A 3 (1986) 1809. The fit says
how much of each, and what else, the real chain has.
"""

from math import atan, hypot, pi
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from shefex_nav.geometry import frames, rotation
from shefex_nav.geometry.pinhole import pixels, turn_slopes
from shefex_nav.geometry.shutter import duration_s, instant_after_s, row_times
from shefex_nav.records import Detections, Frame, FrameTruth
from shefex_nav.world.camera import motion, sky
from shefex_nav.world.camera.camera import surroundings

EDGE_PX = 0.5  # from the centre of the outermost pixel to the border of the detector
NO_PICTURE = np.zeros((0, 0), dtype=np.uint8)


class SightingModel(NamedTuple):
    """What rendered pictures showed of sources that are found; fitted by `shefex-nav characterise`."""

    detection: np.ndarray  # (3,) of the odds that a source is found: exp(d0 + d1 ln q + d2 ln(w / s))
    border_px: float  # a source nearer to the border is not found
    noise: np.ndarray  # (3,) of the variance of a centroid: of 1 px^2, of the shot noise, of the background
    reported: np.ndarray  # (3,) of the variance that is reported with it
    saturation_electrons: float  # light in the brightest pixel above which a source counts as saturated
    mean_offset_dn: float  # of the frame's mean grey value against the one expected


class Sighting(NamedTuple):
    """What the detection finds in one frame."""

    detections: Detections
    hip: np.ndarray  # (n,) Hipparcos number of the catalogue star that it is, 0 for anything else
    mean_dn: float  # mean grey value of the frame


class Chances(NamedTuple):
    """Random numbers of one frame for each source, and what they are used with."""

    normal: np.ndarray  # (n, 2)
    uniform: np.ndarray  # (n,)


class Exposure(NamedTuple):
    """The picture that is not drawn."""

    psf_sigma_px: float
    noise_electrons: float  # of a pixel without stars
    exposure_s: float
    omega_c: np.ndarray  # (3,) rad/s, of the camera
    electrons_per_dn: float
    mean_dn: float  # mean grey value that is expected


def catalogued(stars, camera, merge_radius):
    """The camera with a sky whose sources are what the star tracker may tell apart.

    Each star on board gets the light of all sources within `merge_radius` of it, at their centre of light,
    as the catalogue on board was made; all other sources stay as they are, without a number.

    Parameters
    ----------
    stars : OnboardCatalogue, or whatever has hip (n,) and u_i (n, 3)
    camera : Camera
    merge_radius : float [rad]

    Returns
    -------
    Camera
    """
    source = camera.sky
    entries = cKDTree(stars.u_i)
    distance, entry = entries.query(source.u_i, distance_upper_bound=max(merge_radius, 1e-9))
    member = np.isfinite(distance) & (source.hip > 0)
    flux = np.bincount(entry[member], source.flux[member], minlength=len(stars.hip))
    centre = np.column_stack(
        [
            np.bincount(entry[member], source.flux[member] * source.u_i[member, k], minlength=len(stars.hip))
            for k in range(3)
        ]
    )
    lit = flux > 0.0
    u_i = centre[lit] / np.linalg.norm(centre[lit], axis=1, keepdims=True)
    rest = ~member
    merged = sky.ordered(
        u_i=np.concatenate([u_i, source.u_i[rest]]),
        flux=np.concatenate([flux[lit], source.flux[rest]]),
        hip=np.concatenate([stars.hip[lit], np.zeros(rest.sum(), dtype=np.int64)]),
        is_listed=np.concatenate([np.ones(lit.sum(), dtype=bool), np.zeros(rest.sum(), dtype=bool)]),
    )
    return camera._replace(sky=merged)


def look(camera, command, trajectory, number, t_start_s):
    """What stands before the camera during an exposure, without any noise.

    Parameters
    ----------
    camera : Camera, of `catalogued`
    command : CameraCommand
    trajectory : Trajectory
    number : int, of the frame
    t_start_s : float, the shutter opens

    Returns
    -------
    Frame without pixels; FrameTruth; Exposure
    (hip (n,), xy_px (n, 2), electrons (n,)) of all sources on the detector, of any brightness
    """
    params, exposure_s = camera.params, command.exposure_s
    times = row_times(exposure_s, params.line_s, params.height_px)
    t_valid_s, t_end_s = t_start_s + instant_after_s(times), t_start_s + duration_s(times)
    hole = camera.pinhole
    move = motion.during(hole, trajectory, camera.q_bc, t_valid_s, times, np.inf)
    C_ei = np.ascontiguousarray(frames.dcm_ie(camera.earth, t_valid_s).T)
    sun_angle, limb_angle, stray_rate = surroundings(camera, move.C_ci[2], move.r_i, C_ei)
    background = (params.background_rate + stray_rate) * exposure_s
    cone = atan(0.5 * hypot(params.width_px, params.height_px) / hole.focal_length_px) + 1e-3
    view = sky.View(move.C_ci[2], cone, move.r_i, camera.bodies.earth_v_i + move.v_i, np.zeros(3), C_ei)
    every = sky.Film(exposure_s, hole.focal_length_px, camera.psf.width_px, 0.0)
    hip, u_i, electrons = sky.visible(camera.sky, camera.planets, view, every)
    xy_px = pixels(hole, u_i @ move.C_ci.T)
    x, y = xy_px.T  # NaN behind the camera is inside of nothing
    inside = (x >= -EDGE_PX) & (x <= params.width_px - EDGE_PX)
    inside &= (y >= -EDGE_PX) & (y <= params.height_px - EDGE_PX)
    hip, xy_px, electrons = hip[inside], xy_px[inside], electrons[inside]

    per_dn = params.electrons_per_dn / 10.0 ** (command.gain_db / 20.0)
    spread = electrons.sum() / (params.width_px * params.height_px)
    noise = np.sqrt(params.read_noise_electrons**2 + background + per_dn**2 / 12.0)
    frame = Frame(
        number=number,
        t_start_s=t_start_s,
        t_valid_s=t_valid_s,
        t_available_s=t_end_s + params.readout_s,
        exposure_s=exposure_s,
        gain_db=command.gain_db,
        image_dn=NO_PICTURE,
        line_s=params.line_s,
        bits=params.bits,
    )
    listed = hip > 0
    truth = FrameTruth(
        number=number,
        t_valid_s=t_valid_s,
        q_ic=rotation.quat_from_dcm(np.ascontiguousarray(move.C_ci.T)),
        rate=move.rate,
        sun_angle=sun_angle,
        limb_angle=limb_angle,
        exclusion_met=sun_angle >= params.sun_exclusion_rad and limb_angle >= params.earth_exclusion_rad,
        hip=hip[listed],
        xy_px=xy_px[listed],
    )
    mean_dn = min(params.black_level_dn + (background + spread) / per_dn, 2.0**params.bits - 1.0)
    film = Exposure(
        params.sigma_psf_px, float(noise), exposure_s, move.C_ci @ move.omega_ib_i, per_dn, mean_dn
    )
    return frame, truth, film, (hip, xy_px, electrons)


def sight(model, camera, film, scene, rng, *, most, full_dn):
    """Which sources the detection finds, and where it says they are.

    Parameters
    ----------
    model : SightingModel
    camera : Camera
    film, scene : Exposure, (hip, xy_px, electrons) of `look`
    rng : Generator
    most : int, length of the table of objects; the brightest are kept
    full_dn : float, grey value of a saturated pixel: a frame that is as bright on average shows no stars

    Returns
    -------
    Sighting
    """
    hip, xy_px, electrons = scene
    n, params = len(hip), camera.params
    chances = Chances(rng.standard_normal((n, 2)), rng.random(n))
    mean_dn = min(film.mean_dn + model.mean_offset_dn, 2.0**params.bits - 1.0)
    found, seen_px, P_px, saturated = _sight_kernel(model, camera.pinhole, film, xy_px, electrons, chances)
    size = np.array([params.width_px, params.height_px])
    inside = (xy_px > model.border_px - EDGE_PX) & (xy_px < size - EDGE_PX - model.border_px)
    found &= inside.all(axis=1) & (mean_dn < full_dn)
    rows = np.flatnonzero(found)
    rows = rows[np.argsort(-electrons[rows], kind="stable")][:most]
    detections = Detections(
        xy_px=seen_px[rows],
        flux_dn=electrons[rows] / film.electrons_per_dn,
        n_pixels=np.zeros(len(rows), dtype=np.int64),
        n_saturated=np.where(saturated[rows], params.width_px * params.height_px, 0),
        P_px=P_px[rows],
    )
    return Sighting(detections, hip[rows], float(mean_dn))


@njit(cache=True)
def shape(hole, film, x_px, y_px):
    """The spot of a star: standard deviations along its streak and across, and the streak's direction.

    Pinhole, Exposure, place of the star -> (along_px, across_px, unit vector x, y)
    """
    x, y = (x_px - hole.cx_px) / hole.focal_length_px, (y_px - hole.cy_px) / hole.focal_length_px
    dx, dy = turn_slopes(x, y)
    way = film.exposure_s * hole.focal_length_px
    w = film.omega_c
    along_x = way * (dx[0] * w[0] + dx[1] * w[1] + dx[2] * w[2])
    along_y = way * (dy[0] * w[0] + dy[1] * w[1] + dy[2] * w[2])
    length = np.sqrt(along_x * along_x + along_y * along_y)
    s = film.psf_sigma_px
    if length < 1e-9:
        return s, s, 1.0, 0.0
    return np.sqrt(s * s + length * length / 12.0), s, along_x / length, along_y / length


@njit(cache=True)
def terms(along_px, across_px, electrons, noise):
    """Parts of the variance of a centroid: (along: 1, shot noise, background), (across: likewise) [px^2]."""
    ratio2 = (noise / electrons) ** 2
    both = 8.0 * pi * along_px * across_px * ratio2
    return (
        (1.0, along_px**2 / electrons, both * along_px**2),
        (1.0, across_px**2 / electrons, both * across_px**2),
    )


@njit(cache=True)
def contrast(along_px, across_px, electrons, noise):
    """q, by how much the brightest pixel of a star stands out of the noise."""
    return electrons / (2.0 * pi * along_px * across_px * noise)


@njit(cache=True)
def _sight_kernel(model, hole, film, xy_px, electrons, chances):
    """(found, measured places, reported covariances, is saturated) of n sources."""
    n = electrons.size
    found, saturated = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    seen_px, P_px = xy_px.copy(), np.zeros((n, 2, 2))
    for k in range(n):
        if electrons[k] <= 0.0:
            continue
        along, across, ex, ey = shape(hole, film, xy_px[k, 0], xy_px[k, 1])
        q = contrast(along, across, electrons[k], film.noise_electrons)
        odds = (
            model.detection[0] + model.detection[1] * np.log(q) + model.detection[2] * np.log(along / across)
        )
        found[k] = chances.uniform[k] * (1.0 + np.exp(-odds)) < 1.0
        saturated[k] = electrons[k] / (2.0 * pi * along * across) > model.saturation_electrons
        t_along, t_across = terms(along, across, electrons[k], film.noise_electrons)
        true_a, true_b, said_a, said_b = 0.0, 0.0, 0.0, 0.0
        for m in range(3):
            true_a += model.noise[m] * t_along[m]
            true_b += model.noise[m] * t_across[m]
            said_a += model.reported[m] * t_along[m]
            said_b += model.reported[m] * t_across[m]
        a, b = np.sqrt(true_a) * chances.normal[k, 0], np.sqrt(true_b) * chances.normal[k, 1]
        seen_px[k, 0] += a * ex - b * ey
        seen_px[k, 1] += a * ey + b * ex
        P_px[k, 0, 0] = said_a * ex * ex + said_b * ey * ey
        P_px[k, 1, 1] = said_a * ey * ey + said_b * ex * ex
        P_px[k, 0, 1] = P_px[k, 1, 0] = (said_a - said_b) * ex * ey
    return found, seen_px, P_px, saturated
