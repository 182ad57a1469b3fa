"""One star camera of one run: its settings, its true calibration, and `expose`, which takes a picture.

In: the star tracker's command, the true trajectory, the sky. Out: a `Frame` and what it really
showed, `FrameTruth`. Defaults of the SHEFEX-2 mission are those of its star tracker (Prosilica EC655 behind
a 25 mm lens): see `scenarios/`.

Simplifications: no vignetting, spots of one width all over the field, an anti-blooming drain (charge beyond
the full well is lost), stars and background as seen from above the atmosphere.
"""

from math import acos, atan, cos, hypot, pi
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment.ephemeris import SkyBodies
from shefex_nav.environment.stars import silicon_magnitude
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.geometry.elementary import power
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.geometry.pinhole import Pinhole, pixels, unit_vectors
from shefex_nav.geometry.shutter import duration_s, instant_after_s, row_times
from shefex_nav.records import Frame, FrameTruth
from shefex_nav.world.camera import artefacts, detector, hits, moon, motion, movers, optics, render, sky
from shefex_nav.world.camera_settings import StarCamera

TRUTH_VMAG = 5.5  # FrameTruth lists stars down to here: the depth of an on-board catalogue
FAINT = 0.05  # light below this fraction of the noise is not drawn: the wings of spots, whole faint sources
BACKGROUND_STEP = 0.01  # electrons, to which the mean is rounded: frames under one sky share their table


class Camera(NamedTuple):
    """The camera of one run, the same for every frame; only `bad_pixel_map` may be known on board."""

    settings: StarCamera  # design and tolerances, from which `init` draws the rest
    pinhole: Pinhole  # true
    q_bc: np.ndarray  # (4,) true mounting
    psf: render.Psf
    sky: sky.Sky
    bodies: SkyBodies
    planets: sky.Planets
    full_moon_flux: float  # electrons/s
    earth: EarthRotation
    movers: movers.Movers
    bad_pixels: artefacts.BadPixels
    bad_pixel_map: np.ndarray  # (n, 2) row, column of the defects that were found before flight
    light: render.Light  # work memory of `expose`
    corner: float  # rad, from the axis to what the farthest corner sees
    step_px: float  # of the path in a frame, of a pinhole: then no star moves by more than psf.step_px
    lens: optics.Lens | None = None  # None: a pinhole


def init(settings, catalogue, bodies, earth, rng):
    """Draw the true camera of a run: mounting, calibration, brightness of the stars, defects.

    Parameters
    ----------
    settings : camera_settings.StarCamera
    catalogue : StarCatalogue at the epoch of the mission (`stars.at_epoch`)
    bodies : SkyBodies
    earth : EarthRotation
    rng : np.random.Generator for everything that stays the same during the run
    """
    lens, sensor, stars, others = settings.optics, settings.detector, settings.stars, settings.artefacts
    q_bc = optics.true_mounting(settings.mounting, rng)
    pinhole = optics.true_pinhole(lens, sensor, rng)
    defects = artefacts.bad_pixels(others, sensor, rng)
    false_u_i, false_magnitudes = artefacts.false_objects(others, rng)
    seen = catalogue.vmag <= stars.faintest
    vmag, bv = catalogue.vmag[seen], catalogue.bv[seen]
    in_band = silicon_magnitude(vmag, bv) if stars.band == "silicon" else vmag
    magnitudes = in_band + stars.brightness_error * rng.standard_normal(len(vmag))
    sources = sky.ordered(
        u_i=np.concatenate([catalogue.u_i[seen], false_u_i]),
        flux=_flux(lens, np.concatenate([magnitudes, false_magnitudes])),
        hip=np.concatenate([catalogue.hip[seen], np.zeros(len(false_magnitudes), dtype=np.int64)]),
        is_listed=np.concatenate([vmag <= TRUTH_VMAG, np.zeros(len(false_magnitudes), dtype=bool)]),
    )
    # last, so that all else is as without them
    moving_flux = _flux(lens, artefacts.magnitudes(others, others.moving_objects, rng))
    moving_rates = others.moving_slowest, others.moving_fastest
    moving = movers.draw(others.moving_objects, moving_rates, moving_flux, rng)
    return Camera(
        settings=settings,
        pinhole=pinhole,
        q_bc=q_bc,
        psf=render.gaussian_psf(lens.psf_sigma),
        sky=sources,
        bodies=bodies,
        planets=sky.Planets(
            np.ascontiguousarray(bodies.planet_r_i), _flux(lens, artefacts.planet_magnitudes(bodies))
        ),
        full_moon_flux=float(_flux(lens, artefacts.full_moon_magnitude(bodies))),
        earth=earth,
        movers=moving,
        bad_pixels=defects,
        bad_pixel_map=defects.known,
        light=render.darkness(sensor.columns * sensor.rows),
        **_projection(lens, pinhole),
    )


def _projection(design, hole):
    """corner, step_px and lens of a Camera. camera_settings.Optics, true Pinhole"""
    lens, step_px = optics.lens_of(hole, design.distortion), render.gaussian_psf(design.psf_sigma).step_px
    if lens is None and design.principal_point is None:  # its error of some pixels is within the margins
        return {"corner": _corner_angle(hole), "step_px": step_px}
    corner, step_px = optics.corner_angle(hole, lens), optics.step_px(hole, lens, step_px)
    return {"corner": corner, "step_px": step_px, "lens": lens}


def expose(camera, command, trajectory, number, t_start_s, rng):
    """Take one picture.

    Parameters
    ----------
    camera : Camera
    command : CameraCommand, exposure and gain
    trajectory : Trajectory, must cover the frame from the opening of the first row to the end of the last
    number : int, of the frame
    t_start_s : float, shutter opens over the first row
    rng : np.random.Generator for the noise of the frames

    Returns
    -------
    Frame, FrameTruth
    """
    sensor, exposure_s = camera.settings.detector, command.exposure_s
    times = row_times(exposure_s, sensor.line_s, sensor.rows)
    t_valid_s, t_end_s = t_start_s + instant_after_s(times), t_start_s + duration_s(times)
    if t_start_s < trajectory.t_s[0] or t_end_s > trajectory.t_s[-1]:
        raise ValueError(f"exposure from {t_start_s:.4f} s to {t_end_s:.4f} s is outside the trajectory")
    move = motion.during(camera.pinhole, trajectory, camera.q_bc, t_valid_s, times, camera.step_px)
    boresight_i, C_ei = move.C_ci[2], np.ascontiguousarray(frames.dcm_ie(camera.earth, t_valid_s).T)
    aim = aimed(boresight_i, move.r_i, C_ei, camera.bodies.sun_u_i)
    stray = stray_rate(camera.settings.stray_light, *aim)
    background = (sensor.background + stray) * exposure_s
    background = BACKGROUND_STEP * round(background / BACKGROUND_STEP)
    slope = _slope(camera, move.C_ci, stray * exposure_s)
    least = FAINT * np.sqrt(sensor.read_noise**2 + background)
    hip, xy_px = _add_sky(camera, move, C_ei, least)
    _add_movers(camera, move, C_ei, t_valid_s, least)
    _add_spikes(camera, exposure_s, least, rng)
    _add_charges(camera, exposure_s, rng)
    image_dn = _read_out(camera, background, slope, command, rng)
    render.darken(camera.light)

    frame = frame_of(sensor, command, number, (t_start_s, t_valid_s, t_end_s), image_dn)
    q_ic = rotation.quat_from_dcm(np.ascontiguousarray(move.C_ci.T))
    return frame, truth_of(frame, camera.settings.stray_light, (q_ic, move.rate), aim, hip, xy_px)


def frame_of(sensor, command, number, times_s, image_dn):
    """Frame of a detector.

    sensor : camera_settings.Detector;  times_s : the first row opens, the instant, the last row closes
    """
    t_start_s, t_valid_s, t_end_s = times_s
    return Frame(
        number=number,
        t_start_s=t_start_s,
        t_valid_s=t_valid_s,
        t_available_s=t_end_s + sensor.readout,
        exposure_s=command.exposure_s,
        gain_db=command.gain_db,
        image_dn=image_dn,
        line_s=sensor.line_s,
        bits=sensor.bits,
    )


def truth_of(frame, stray, motion, aim, hip, xy_px):
    """FrameTruth of a Frame: attitude and rate, where it was `aimed`, listed stars and their places.

    stray : settings of stray light
    """
    (q_ic, rate), (sun_angle, limb_angle, sun_share, _) = motion, aim
    sun_met = sun_angle >= stray.sun_exclusion or sun_share == 0.0
    return FrameTruth(
        number=frame.number,
        t_valid_s=frame.t_valid_s,
        q_ic=q_ic,
        rate=rate,
        sun_angle=sun_angle,
        limb_angle=limb_angle,
        exclusion_met=sun_met and limb_angle >= stray.earth_exclusion,
        hip=hip,
        xy_px=xy_px,
        sun_hidden=sun_share == 0.0,
    )


def _flux(lens, magnitudes):
    """Electrons/s of silicon magnitudes."""
    return lens.zero_magnitude_flux * power(10.0, -0.4 * magnitudes)


def _corner_angle(hole):
    """Angle from the middle of a picture to its corner, rad."""
    return atan(0.5 * hypot(hole.width_px, hole.height_px) / hole.focal_length_px)


@kernel
def aimed(boresight_i, r_i, C_ei, sun_u_i):
    """Where a camera looks: what stray light comes of.

    -> angles of the boresight to Sun and limb, rad; share of the Sun's disc that the Earth does not hide; how
    brightly the Sun lights the limb below the boresight
    """
    sun_angle = acos(min(1.0, max(-1.0, boresight_i @ sun_u_i)))
    limb_angle = wgs84.limb_angle(C_ei @ r_i, C_ei @ boresight_i)
    sun_share = optics.share_above(wgs84.limb_angle(C_ei @ r_i, C_ei @ sun_u_i))
    return sun_angle, limb_angle, sun_share, optics.limb_sunlight(boresight_i, r_i, sun_u_i)


def stray_rate(settings, sun_angle, limb_angle, sun_share, sunlight):
    """Stray light [electrons/s and pixel] where the boresight is `aimed` so."""
    sun_rate = optics.stray_light(sun_angle, settings.sun_exclusion, settings.baffle, settings)
    # the exclusion angle to the limb is less than the baffle's: light past its edge is in the exponential
    earth_rate = optics.stray_light(limb_angle, settings.earth_exclusion, 0.0, settings)
    return sun_share * sun_rate + sunlight * earth_rate


def _add_sky(camera, move, C_ei, least):
    """Draw stars, false objects, planets and Moon; returns (hip, xy_px) of the listed stars in the frame."""
    hole, psf = camera.pinhole, camera.psf
    times, r_i = move.path.times, move.r_i
    cone = min(pi, camera.corner + 0.5 * move.rate * duration_s(times) + 0.005)  # rad; spot and aberration
    observer_v_i = camera.bodies.earth_v_i + move.v_i
    view = sky.View(move.C_ci[2], cone, r_i, observer_v_i, move.omega_ib_i, C_ei)
    film = sky.DrawingLimit(times.exposure_s, hole.focal_length_px, psf.width_px, least)
    hip, u_i, electrons = sky.visible(camera.sky, camera.planets, view, film)
    moon_i, radius = moon.seen_from(camera.bodies, r_i)
    has_moon = moon_i @ view.boresight_i > cos(cone + radius)
    if has_moon:  # nothing is seen through it
        beside = u_i @ moon_i < cos(radius)
        hip, u_i, electrons = hip[beside], u_i[beside], electrons[beside]
    _add_points(camera, move.path, u_i, electrons, least)
    if has_moon:
        if not sky.behind_earth(moon_i[None], r_i, C_ei)[0]:
            full_moon = camera.full_moon_flux * times.exposure_s
            sun_u_i = camera.bodies.sun_u_i
            moon.add_moon(camera.light, hole, move.path, moon_i, radius, sun_u_i, full_moon, camera.lens)

    xy_px = optics.places(hole, camera.lens, pixels(hole, u_i @ move.C_ci.T))
    x, y = xy_px.T  # NaN behind the camera is inside of nothing
    inside = (x >= -0.5) & (x <= hole.width_px - 0.5) & (y >= -0.5) & (y <= hole.height_px - 0.5)
    listed = inside & (hip > 0)
    return hip[listed], xy_px[listed]


def _add_points(camera, path, u_i, electrons, least):
    """Draw sources at infinity."""
    light, hole, psf, lens = camera.light, camera.pinhole, camera.psf, camera.lens
    if lens is None:
        render.add_points(light, hole, psf, path, u_i, electrons, least)
        return
    lit = electrons > 0.0
    xy_px = optics.tracks(hole, lens, path, np.ascontiguousarray(u_i[lit]))
    render.add_tracks(light, hole, psf, path, xy_px, electrons[lit], least)


def _add_spikes(camera, exposure_s, least, rng):
    """Draw the spots of this frame that sit still on the detector."""
    xy_px, magnitudes = artefacts.spikes(camera.settings.artefacts, camera.settings.detector, rng)
    if len(xy_px):
        electrons = _flux(camera.settings.optics, magnitudes) * exposure_s
        u_c = unit_vectors(camera.pinhole, xy_px)
        still = motion.at_rest(np.eye(3))
        render.add_points(camera.light, camera.pinhole, camera.psf, still, u_c, electrons, least)


def _add_movers(camera, move, C_ei, t_valid_s, least):
    """Draw satellites and debris."""
    if not len(camera.movers.rate):
        return
    hole, half_s = camera.pinhole, 0.5 * duration_s(move.path.times)
    cone = camera.corner
    cone += move.rate * half_s + 0.005  # rad; spot
    rows = movers.near(camera.movers, t_valid_s, move.C_ci[2], cone, half_s)
    some = movers.Movers(*(column[rows] for column in camera.movers))
    visible = ~sky.behind_earth(movers.directions(some, t_valid_s), move.r_i, C_ei)
    some = movers.Movers(*(column[visible] for column in some))
    if len(some.rate):
        path = motion.refined(move.path, float(some.rate.max()) * hole.focal_length_px, camera.step_px)
        xy_px = optics.places(hole, camera.lens, movers.tracks(some, hole, path, t_valid_s))
        electrons = some.flux * path.times.exposure_s
        render.add_tracks(camera.light, hole, camera.psf, path, xy_px, electrons, least)


def _add_charges(camera, exposure_s, rng):
    """Add the charge of particles and what hot pixels leave behind in their columns."""
    settings, defects = camera.settings.artefacts, camera.bad_pixels
    if len(defects.smeared):
        render.add_charge(camera.light, defects.smeared, defects.smeared_rate * exposure_s)
    if settings.upsets_per_frame or settings.trails_per_frame:
        # a generator of its own: what they draw must not change the noise of the pixels
        hits.add_hits(camera.light, hits.of_frame(settings, camera.settings.detector, rng.spawn(1)[0]))


def _slope(camera, C_ci, stray):
    """What stray light adds to the mean background of each pixel (rows * columns,); None: it is even.

    It grows towards the Sun's side of the detector, by `gradient` in half a diagonal.
    """
    gradient, hole = camera.settings.stray_light.gradient, camera.pinhole
    if gradient == 0.0 or stray == 0.0:
        return None
    toward = C_ci[:2] @ camera.bodies.sun_u_i
    toward = toward / max(hypot(*toward), 1e-12)
    x, y = np.arange(hole.width_px) - hole.cx_px, np.arange(hole.height_px) - hole.cy_px
    half_diagonal = 0.5 * hypot(hole.width_px, hole.height_px)
    along = (y[:, None] * toward[1] + x * toward[0]) / half_diagonal
    return stray * np.maximum(gradient * along, -1.0).ravel()


def _read_out(camera, background, slope, command, rng):
    """Grey values of the whole frame: (rows, columns) uint8 or uint16."""
    hole, defects = camera.pinhole, camera.bad_pixels
    electronics = detector.electronics(camera.settings.detector, command.gain_db)
    n_hot, n_dead = len(defects.hot), len(defects.dead)
    lit = render.lit_pixels(camera.light)
    pixels = np.concatenate([lit, defects.hot, defects.dead])
    if slope is None:
        cells = detector.background_cells(electronics, background)
        grey = detector.background(hole.width_px * hole.height_px, cells, rng)
        level = background
    else:  # no two pixels are alike
        level = np.maximum(background + slope, 0.0)  # the background is rounded, the slope is not
        grey = detector.digitise(electronics, level, rng)
        level = level[pixels]
    mean = level + camera.light.electrons[pixels]
    mean[len(lit) : len(lit) + n_hot] += defects.hot_rate * command.exposure_s
    mean[len(mean) - n_dead :] = 0.0
    grey[pixels] = detector.digitise(electronics, mean, rng)  # the last entry of a pixel holds
    return grey.reshape(hole.height_px, hole.width_px)
