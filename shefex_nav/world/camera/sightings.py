"""What a star tracker finds in a picture that is not drawn: statistics in the place of rendering.

In: the true sky, camera and trajectory, and a `SightingModel` that was fitted to rendered pictures. Out, at
the same instants as pictures: a `Frame` without pixels, its `FrameTruth`, and a `Sighting`, the objects that
the detection finds. Where the stars of the field stand, how they move during the exposure, the sky background
and all that is constant in a run (mounting, focal length, principal point, brightness of each star) are those
of the rendered picture. Fitted are which sources are found and how well their centroids are measured.

The form of both is that of a Gaussian spot in noise: a star of E electrons, drawn out by its motion to the
standard deviations w along and s across, in pixels with the noise n.

The detection searches sums of 3x3 pixels. The middle one of a star holds B electrons of it (a spot that a
uniform streak of the length L draws out, over a square in its middle), with the deviation sqrt(9 n^2 + B); a
search begins where a sum is k times 3 n above the background. So the star is found with the probability

    Phi(d0 + d1 z + d2 ln(1 + L / 3)),    z = (B - 3 k n) / sqrt(9 n^2 + B)

where d1 would be 1, and the last term stands for the several places along a streak that each may be enough.

No unbiased centroid has less variance along a direction a, with b the one across, than the larger of
w_a^2 / E (the star's own shot noise) and 8 pi w_a^3 w_b (n / E)^2 (that of the background); see Winick, J.
Opt. Soc. Am. A 3 (1986) 1809. There the widths are those of the spot as pixels see it, w^2 + 1/12. A spot
that is sharper than about 0.6 pixels is not told by its pixels: what they leave out of it has a power that
goes with exp(-4 pi^2 s^2), the square of the spot's transfer function at one cycle a pixel. The fit says how
much of each, and what else, the real chain has.

Clutter is what is found and is no source of the sky: spots of a frame, hot pixels that no list has, and, the
more the longer the streaks, pieces of those that break up. It is counted by the exposure control; a wrong fix
that it causes is in the table of identification.
"""

from math import atan, erf, erfc, exp, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from shefex_nav.geometry import frames, rotation
from shefex_nav.geometry.pinhole import pixels, turn_slopes
from shefex_nav.geometry.shutter import duration_s, instant_after_s, row_times
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.records import Detections, Frame, FrameTruth
from shefex_nav.world.camera import motion, sky
from shefex_nav.world.camera.camera import surroundings

EDGE_PX = 0.5  # from the centre of the outermost pixel to the border of the detector
BLOCK = 3  # pixels, side of the sums that the detection searches (onboard.startracker.background)
PIXEL_VARIANCE = 1.0 / 12.0  # px^2 per axis
SHARP_PX = 0.5
TERMS = 4  # of a variance
BROKEN_PX = 20.0  # as long are streaks that break up as often as they will
NO_PICTURE = np.zeros((0, 0), dtype=np.uint8)
NOTHING = Detections(
    np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2, 2))
)


class SightingModel(NamedTuple):
    """What rendered pictures showed of sources that are found; fitted by `shefex-nav characterise`."""

    detection: np.ndarray  # (3,) d: a source is found with the probability Phi(d . features)
    border_px: float  # a source nearer to the border is not found
    noise: np.ndarray  # (4,) of the variance of a centroid: of each of its `terms`
    reported: np.ndarray  # (4,) of the variance that is reported with it
    clutter: np.ndarray  # (2,) mean number of other objects: always; more with long streaks, `broken`
    saturation_electrons: float  # light in the brightest pixel above which a source counts as saturated
    mean_offset_dn: float  # of the frame's mean grey value against the one expected


class Sighting(NamedTuple):
    """What the detection finds in one frame."""

    detections: Detections
    hip: np.ndarray  # (n,) Hipparcos number of the catalogue star that it is, 0 for anything else
    mean_dn: float  # mean grey value of the frame


class Limits(NamedTuple):
    """Settings of the detection."""

    most: int  # length of the table of objects; the brightest are kept
    full_dn: float  # grey value of a saturated pixel: a frame that is as bright on average shows no stars
    seed_sigma: float  # a search begins where a sum is so far above the background


class Chances(NamedTuple):
    """Random numbers of one frame for each source, and what they are used with."""

    normal: np.ndarray  # (n, 2)
    uniform: np.ndarray  # (n,)


class Objects(NamedTuple):
    """n things that the detection finds."""

    hip: np.ndarray  # (n,)
    xy_px: np.ndarray  # (n, 2)
    electrons: np.ndarray  # (n,)
    saturated: np.ndarray  # (n,) bool
    P_px: np.ndarray  # (n, 2, 2)


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
    (hip (n,), xy_px (n, 2), electrons (n,)) of all sources on the detector, of any brightness, where their
    light falls in the mean
    """
    params, exposure_s = camera.params, command.exposure_s
    times = row_times(exposure_s, params.line_s, params.height_px)
    t_valid_s, t_end_s = t_start_s + instant_after_s(times), t_start_s + duration_s(times)
    move = motion.during(camera.pinhole, trajectory, camera.q_bc, t_valid_s, times, np.inf)
    C_ei = np.ascontiguousarray(frames.dcm_ie(camera.earth, t_valid_s).T)
    sun_angle, limb_angle, stray_rate = surroundings(camera, move.C_ci[2], move.r_i, C_ei)
    scene = _scene(camera, move, C_ei, exposure_s)
    caught = scene if params.line_s else _in_the_mean(camera.pinhole, move, scene)
    film = _film(params, command, move, (params.background_rate + stray_rate) * exposure_s, scene[2].sum())
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
    return frame, _truth(frame, params, move, (sun_angle, limb_angle), scene), film, caught


def _truth(frame, params, move, angles, scene):
    """FrameTruth of a Frame; angles to Sun and limb."""
    hip, xy_px, _ = scene
    sun_angle, limb_angle = angles
    listed = hip > 0
    return FrameTruth(
        number=frame.number,
        t_valid_s=frame.t_valid_s,
        q_ic=rotation.quat_from_dcm(np.ascontiguousarray(move.C_ci.T)),
        rate=move.rate,
        sun_angle=sun_angle,
        limb_angle=limb_angle,
        exclusion_met=sun_angle >= params.sun_exclusion_rad and limb_angle >= params.earth_exclusion_rad,
        hip=hip[listed],
        xy_px=xy_px[listed],
    )


def _scene(camera, move, C_ei, exposure_s):
    """(hip (n,), xy_px (n, 2), electrons (n,)) of all sources on the detector."""
    params, hole = camera.params, camera.pinhole
    cone = atan(0.5 * hypot(params.width_px, params.height_px) / hole.focal_length_px) + 1e-3
    view = sky.View(move.C_ci[2], cone, move.r_i, camera.bodies.earth_v_i + move.v_i, np.zeros(3), C_ei)
    every = sky.Film(exposure_s, hole.focal_length_px, camera.psf.width_px, 0.0)
    hip, u_i, electrons = sky.visible(camera.sky, camera.planets, view, every)
    xy_px = pixels(hole, u_i @ move.C_ci.T)
    x, y = xy_px.T  # NaN behind the camera is inside of nothing
    inside = (x >= -EDGE_PX) & (x <= params.width_px - EDGE_PX)
    inside &= (y >= -EDGE_PX) & (y <= params.height_px - EDGE_PX)
    return hip[inside], xy_px[inside], electrons[inside]


def _in_the_mean(hole, move, scene):
    """The scene where its light falls in the mean: elsewhere than in the middle while the rate changes.

    Simpson's rule over the exposure of all rows at once; hole : Pinhole
    """
    hip, xy_px, electrons = scene
    C_ci = (move.path.C_ci[0] + 4.0 * move.C_ci + move.path.C_ci[-1]) / 6.0
    D = C_ci @ move.C_ci.T  # 1 - skew of the turn from the middle to the mean
    bend_c = 0.5 * np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])
    return hip, xy_px + turn_jacobians(hole, xy_px) @ bend_c, electrons


def _film(params, command, move, background, starlight):
    """Exposure with a background in electrons a pixel, and the light of all stars."""
    per_dn = params.electrons_per_dn / 10.0 ** (command.gain_db / 20.0)
    spread = starlight / (params.width_px * params.height_px)
    mean_dn = min(params.black_level_dn + (background + spread) / per_dn, 2.0**params.bits - 1.0)
    return Exposure(
        psf_sigma_px=params.sigma_psf_px,
        noise_electrons=sqrt(params.read_noise_electrons**2 + background + per_dn**2 / 12.0),
        exposure_s=command.exposure_s,
        omega_c=move.C_ci @ move.omega_ib_i,
        electrons_per_dn=per_dn,
        mean_dn=mean_dn,
    )


def sight(model, camera, film, scene, rng, limits):
    """What the detection finds, and where it says it is.

    Parameters
    ----------
    model : SightingModel
    camera : Camera
    film, scene : Exposure, (hip, xy_px, electrons) of `look`
    rng : Generator
    limits : Limits

    Returns
    -------
    Sighting, brightest object first
    """
    mean_dn = min(film.mean_dn + model.mean_offset_dn, 2.0**camera.params.bits - 1.0)
    if mean_dn >= limits.full_dn:
        return Sighting(NOTHING, np.zeros(0, dtype=np.int64), float(mean_dn))
    size = np.array([camera.params.width_px, camera.params.height_px])
    stars = _sources(model, camera.pinhole, film, scene, rng, limits, size)
    clutter = _clutter(model, camera.pinhole, film, rng, limits, size)
    both = Objects(*(np.concatenate(columns) for columns in zip(stars, clutter, strict=True)))
    rows = np.argsort(-both.electrons, kind="stable")[: limits.most]
    detections = Detections(
        xy_px=both.xy_px[rows],
        flux_dn=both.electrons[rows] / film.electrons_per_dn,
        n_pixels=np.zeros(len(rows), dtype=np.int64),
        n_saturated=np.where(both.saturated[rows], size.prod(), 0),
        P_px=both.P_px[rows],
    )
    return Sighting(detections, both.hip[rows], float(mean_dn))


def _sources(model, hole, film, scene, rng, limits, size):
    """Objects that are sources of the sky."""
    hip, xy_px, electrons = scene
    chances = Chances(rng.standard_normal((len(hip), 2)), rng.random(len(hip)))
    found, seen_px, P_px, saturated = _sight_kernel(
        model, hole, film, xy_px, electrons, chances, limits.seed_sigma
    )
    inside = (xy_px > model.border_px - EDGE_PX) & (xy_px < size - EDGE_PX - model.border_px)
    rows = np.flatnonzero(found & inside.all(axis=1))
    return Objects(hip[rows], seen_px[rows], electrons[rows], saturated[rows], P_px[rows])


def _clutter(model, hole, film, rng, limits, size):
    """Objects that are no source, anywhere: as bright as it takes, the first to go if the table is full."""
    n = rng.poisson(model.clutter[0] + model.clutter[1] * broken(turned_px(hole, film)))
    least = limits.seed_sigma * BLOCK * film.noise_electrons
    spot = film.psf_sigma_px, film.psf_sigma_px, least, film.noise_electrons
    variance = model.reported @ np.array(terms(*spot)[0])
    return Objects(
        hip=np.zeros(n, dtype=np.int64),
        xy_px=model.border_px - EDGE_PX + (size - 2.0 * model.border_px) * rng.random((n, 2)),
        electrons=np.full(n, least),
        saturated=np.zeros(n, dtype=bool),
        P_px=np.tile(variance * np.eye(2), (n, 1, 1)),
    )


def turned_px(hole, film):
    """By how much the camera turns during an exposure."""
    return hole.focal_length_px * float(np.linalg.norm(film.omega_c)) * film.exposure_s


def broken(length_px):
    """Share of the clutter of long streaks that streaks of a length have: 0 for none, 1 from BROKEN_PX on."""
    return np.minimum(length_px / BROKEN_PX, 1.0) ** 2


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
    """Parts of the variance of a centroid along the streak and across it [px^2].

    Each (1, shot noise, background, sharpness): that of 1 is for all stars; sharpness is 1 at half a pixel.
    """
    along2, across2 = along_px**2 + PIXEL_VARIANCE, across_px**2 + PIXEL_VARIANCE
    both = 8.0 * pi * sqrt(along2 * across2) * (noise / electrons) ** 2
    sharp = exp(-4.0 * pi**2 * (across_px**2 - SHARP_PX**2))
    return (
        (1.0, along2 / electrons, both * along2, sharp),
        (1.0, across2 / electrons, both * across2, sharp),
    )


@njit(cache=True)
def contrast(along_px, across_px, electrons, noise):
    """q, by how much the brightest pixel of a star stands out of the noise."""
    return electrons / (2.0 * pi * along_px * across_px * noise)


@njit(cache=True)
def features(along_px, across_px, electrons, noise, seed_sigma):
    """What a star is found by: (1, z, ln(1 + L / 3)), as at the head of this file."""
    length = sqrt(max(12.0 * (along_px**2 - across_px**2), 0.0))
    half = 0.5 * BLOCK
    if length < 1e-3 * across_px:
        part = erf(half / (sqrt(2.0) * across_px))
    else:
        part = _area(half + 0.5 * length, across_px) - _area(half - 0.5 * length, across_px)
        part /= length
    block = electrons * part * erf(half / (sqrt(2.0) * across_px))
    floor = BLOCK * noise
    z = (block - seed_sigma * floor) / sqrt(floor**2 + block)
    return 1.0, z, np.log(1.0 + length / BLOCK)


@njit(cache=True)
def _area(x, sigma):
    """Integral of erf(x / (sqrt(2) sigma)) from 0, and a constant."""
    return x * erf(x / (sqrt(2.0) * sigma)) + sigma * sqrt(2.0 / pi) * exp(-0.5 * (x / sigma) ** 2)


@njit(cache=True)
def _sight_kernel(model, hole, film, xy_px, electrons, chances, seed_sigma):
    """(found, measured places, reported covariances, is saturated) of n sources."""
    n = electrons.size
    found, saturated = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    seen_px, P_px = xy_px.copy(), np.zeros((n, 2, 2))
    for k in range(n):
        if electrons[k] <= 0.0:
            continue
        along, across, ex, ey = shape(hole, film, xy_px[k, 0], xy_px[k, 1])
        one, z, places = features(along, across, electrons[k], film.noise_electrons, seed_sigma)
        t = model.detection[0] * one + model.detection[1] * z + model.detection[2] * places
        found[k] = chances.uniform[k] < 0.5 * erfc(-t / sqrt(2.0))
        saturated[k] = electrons[k] / (2.0 * pi * along * across) > model.saturation_electrons
        t_along, t_across = terms(along, across, electrons[k], film.noise_electrons)
        true_a, true_b, said_a, said_b = 0.0, 0.0, 0.0, 0.0
        for m in range(TERMS):
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
