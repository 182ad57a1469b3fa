"""What stands before the camera during an exposure, if no picture of it is drawn: sources, light, motion.

The same stars, bodies and exposure as in `camera.expose`, without any noise; `sightings` says what is found.
"""

from math import atan, hypot, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from shefex_nav.geometry import frames, rotation
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.shutter import duration_s, instant_after_s, row_times
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.records import Frame, FrameTruth
from shefex_nav.world.camera import motion, sky
from shefex_nav.world.camera.camera import surroundings

EDGE_PX = 0.5  # from the centre of the outermost pixel to the border of the detector
NO_PICTURE = np.zeros((0, 0), dtype=np.uint8)


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
    return _on_detector(hole, move.C_ci, params.width_px, params.height_px, hip, u_i, electrons)


@njit(cache=True)
def _on_detector(hole, C_ci, width_px, height_px, hip, u_i, electrons):
    """Of what is in the cone, what falls on the detector: (hip (n,), xy_px (n, 2), electrons (n,))."""
    kept, seen, light = np.empty_like(hip), np.empty((hip.size, 2)), np.empty(hip.size)
    xy_px, n = pixels(hole, u_i @ C_ci.T), 0
    for k in range(hip.size):
        x, y = xy_px[k]  # NaN behind the camera is inside of nothing
        if -EDGE_PX <= x <= width_px - EDGE_PX and -EDGE_PX <= y <= height_px - EDGE_PX:
            kept[n], seen[n, 0], seen[n, 1], light[n] = hip[k], x, y, electrons[k]
            n += 1
    return kept[:n], seen[:n], light[:n]


def _in_the_mean(hole, move, scene):
    """The scene where its light falls in the mean: elsewhere than in the middle while the rate changes.

    Simpson's rule over the exposure of all rows at once; hole : Pinhole
    """
    hip, xy_px, electrons = scene
    return hip, _bent(hole, move.path.C_ci, move.C_ci, xy_px), electrons


@njit(cache=True)
def _bent(hole, path_ci, C_ci, xy_px):
    """Places of light in the mean of a path (m, 3, 3), from those at its middle (3, 3): (n, 2) px."""
    mean_ci = (path_ci[0] + 4.0 * C_ci + path_ci[-1]) / 6.0
    D = mean_ci @ C_ci.T  # 1 - skew of the turn from the middle to the mean
    bend_c = 0.5 * np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])
    out, H = xy_px.copy(), turn_jacobians(hole, xy_px)
    for k in range(len(xy_px)):
        out[k] += H[k] @ bend_c
    return out


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
