"""What stands before the camera during an exposure, if no picture of it is drawn: sources, light, motion.

The same stars, bodies and exposure as in `camera.expose`, without any noise; `sightings` says what is found.
"""

from math import atan, hypot, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel, lent
from shefex_nav.geometry import frames, rotation
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.shutter import duration_s, instant_after_s, row_times
from shefex_nav.geometry.streak import velocity
from shefex_nav.world.camera import motion, optics, sky
from shefex_nav.world.camera.camera import aimed, frame_of, stray_rate, truth_of

EDGE_PX = 0.5  # from the centre of the outermost pixel to the border of the detector
SPARE = 1e-3  # rad, around the detector: aberration and rounding
NO_PICTURE = np.zeros((0, 0), dtype=np.uint8)


class Exposure(NamedTuple):
    """The picture that is not drawn."""

    psf_sigma_px: float
    noise_electrons: float  # of a pixel without stars
    exposure_s: float
    omega_c: np.ndarray  # (3,) rad/s, of the camera
    electrons_per_dn: float
    mean_dn: float  # mean grey value that is expected


class Heaven(NamedTuple):
    """What there is to be seen from near the Earth."""

    sources: sky.Sky
    planets: sky.Planets
    earth_v_i: np.ndarray  # (3,) m/s, of the Earth, barycentric
    sun_u_i: np.ndarray  # (3,) direction of the Sun


class Shot(NamedTuple):
    """When and how the shutter opens."""

    t_valid_s: float  # the frame's instant
    exposure_s: float  # of each row
    at_once: bool  # all rows are exposed at once
    width_px: float  # of the spots: sqrt(2 pi) sigma


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
    from scipy.spatial import cKDTree

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
    settings, exposure_s = camera.settings, command.exposure_s
    line_s = settings.detector.line_s
    times = row_times(exposure_s, line_s, settings.detector.rows)
    t_valid_s, t_end_s = t_start_s + instant_after_s(times), t_start_s + duration_s(times)
    heaven = camera.sky, camera.planets, camera.bodies.earth_v_i, camera.bodies.sun_u_i
    shot = t_valid_s, exposure_s, line_s == 0.0, camera.psf.width_px
    is_plain = camera.lens is None and settings.optics.principal_point is None
    hole, shift_px = (camera.pinhole, 0.0) if is_plain else optics.around(camera.pinhole, camera.lens)
    (q_ic, rate, omega_c), aim, listed, scene = _look(
        hole, motion.states(trajectory), camera.q_bc,
        motion.samples(trajectory.t_s, t_valid_s, times), camera.earth, heaven, shot,
    )  # fmt: skip
    if not is_plain:
        listed, scene = (_through(camera, shift_px, *some) for some in (listed, scene))
    background = (settings.detector.background + stray_rate(settings.stray_light, *aim)) * exposure_s
    film = _drawing_limit(settings, command, omega_c, background, scene[2].sum())
    frame = frame_of(settings.detector, command, number, (t_start_s, t_valid_s, t_end_s), NO_PICTURE)
    truth = truth_of(frame, settings.stray_light, (q_ic, rate), aim, *listed)
    return frame, truth, film, scene


def _through(camera, shift_px, hip, xy_px, *more):
    """Of what a larger pinhole sees (`lens.around`), what the lens puts on the detector, and where."""
    hole = camera.pinhole
    seen_px = optics.places(hole, camera.lens, xy_px - shift_px)
    size_px = np.array([hole.width_px, hole.height_px])
    on = ((seen_px >= -EDGE_PX) & (seen_px <= size_px - EDGE_PX)).all(axis=1)
    return tuple(column[on] for column in (hip, seen_px, *more))


@kernel
def _look(hole, states, q_bc, samples, earth, heaven, shot):
    """All of `look` that is arithmetic.

    hole : Pinhole;  states, samples : of `motion`;  earth : EarthRotation
    heaven, shot : the fields of Heaven, of Shot: plain tuples, which take less time to hand over

    Returns
    -------
    q_ic, greatest rate, omega_c
    of `camera.aimed`
    (hip (n,), xy_px (n, 2)) of listed stars in the middle of the exposure
    (hip (n,), xy_px (n, 2), electrons (n,)) of all sources where their light falls in the mean
    """
    states, heaven, shot = lent(states), Heaven(*lent(heaven)), Shot(*shot)
    path_ci, C_ci, r_i, v_i, omega_i, rate = motion.moved(hole, states, q_bc, samples, 0.0)
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, shot.t_valid_s).T)
    cone = atan(0.5 * hypot(hole.width_px, hole.height_px) / hole.focal_length_px) + SPARE
    view = sky.View(C_ci[2], cone, r_i, heaven.earth_v_i + v_i, np.zeros(3), C_ei)
    every = sky.DrawingLimit(shot.exposure_s, hole.focal_length_px, shot.width_px, 0.0)
    hip, u_i, electrons = sky.visible(heaven.sources, heaven.planets, view, every)
    hip, xy_px, electrons = _on_detector(hole, C_ci, hip, u_i, electrons)
    caught_px = _mean_places(hole, path_ci, C_ci, xy_px) if shot.at_once else xy_px
    q_ic = rotation.quat_from_dcm(np.ascontiguousarray(C_ci.T))
    listed = hip > 0
    return (
        (q_ic, rate, C_ci @ omega_i),
        aimed(C_ci[2], r_i, C_ei, heaven.sun_u_i),
        (hip[listed], xy_px[listed]),
        (hip, caught_px, electrons),
    )


@inner
def _on_detector(hole, C_ci, hip, u_i, electrons):
    """Of what is in the cone, what falls on the detector: (hip (n,), xy_px (n, 2), electrons (n,))."""
    kept, seen, light = np.empty_like(hip), np.empty((hip.size, 2)), np.empty(hip.size)
    xy_px, n = pixels(hole, u_i @ C_ci.T), 0
    for k in range(hip.size):
        x, y = xy_px[k, 0], xy_px[k, 1]  # NaN behind the camera is inside of nothing
        if -EDGE_PX <= x <= hole.width_px - EDGE_PX and -EDGE_PX <= y <= hole.height_px - EDGE_PX:
            kept[n], seen[n, 0], seen[n, 1], light[n] = hip[k], x, y, electrons[k]
            n += 1
    return kept[:n], seen[:n], light[:n]


@inner
def _mean_places(hole, path_ci, C_ci, xy_px):
    """Places of light in the mean of a path of one step, from those at its middle (3, 3): (n, 2) px.

    Elsewhere than in the middle while the rate changes; the step (2, 3, 3) has the mean of the path.
    """
    mean_ci = 0.5 * (path_ci[0] + path_ci[1])
    D = mean_ci @ C_ci.T  # 1 - skew of the turn from the middle to the mean
    bend_c = 0.5 * np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])
    out = xy_px.copy()
    for k in range(len(xy_px)):
        x, y = velocity(hole, bend_c, xy_px[k, 0], xy_px[k, 1])
        out[k, 0] += x
        out[k, 1] += y
    return out


def _drawing_limit(settings, command, omega_c, background, starlight):
    """Exposure with a background in electrons a pixel, and the light of all stars."""
    detector = settings.detector
    per_dn = detector.conversion / 10.0 ** (command.gain_db / 20.0)
    spread = starlight / (detector.columns * detector.rows)
    mean_dn = min(detector.black_level + (background + spread) / per_dn, 2.0**detector.bits - 1.0)
    return Exposure(
        psf_sigma_px=settings.optics.psf_sigma,
        noise_electrons=sqrt(detector.read_noise**2 + background + per_dn**2 / 12.0),
        exposure_s=command.exposure_s,
        omega_c=omega_c,
        electrons_per_dn=per_dn,
        mean_dn=mean_dn,
    )
