"""One star camera of one run: its parameters, its true calibration, and `expose`, which takes a picture.

In: the star tracker's command, the true trajectory, the sky. Out: an 8-bit `Frame` and what it really
showed, `FrameTruth`. Defaults of the SHEFEX-2 mission are those of its star tracker (Prosilica EC655 behind
a 25 mm lens): see `scenarios/`.

Simplifications: no lens distortion (the flight software assumes it was calibrated away), no
vignetting, an anti-blooming drain (charge beyond the full well is lost), stars and background as seen
from above the atmosphere.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment.ephemeris import SkyBodies
from shefex_nav.environment.stars import aberrate, silicon_magnitude
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.geometry.pinhole import Pinhole, unit_vectors
from shefex_nav.records import Frame, FrameTruth
from shefex_nav.world.camera import artefacts, detector, optics, render

TRUTH_VMAG = 5.5  # FrameTruth lists stars down to here: the depth of an on-board catalogue
FAINT = 0.05  # sources whose brightest pixel stays below this fraction of the noise are not drawn


class CameraParams(NamedTuple):
    """Design and tolerances of the camera; `init` draws the true camera from them."""

    width_px: int
    height_px: int
    pixel_m: float
    focal_length_m: float
    C_bc: np.ndarray  # (3, 3) nominal mounting
    sigma_mounting_rad: float  # each axis
    sigma_focal_length: float  # relative
    sigma_principal_point_px: float  # each axis
    zero_magnitude_flux: float  # electrons/s from a star of magnitude 0 in the silicon band
    sigma_psf_px: float
    background_rate: float  # electrons/s and pixel: dark current and sky
    read_noise_electrons: float  # > 0
    full_well_electrons: float
    electrons_per_dn: float  # at 0 dB
    black_level_dn: float
    readout_s: float  # end of exposure to frame in the computer's memory
    render_vmag: float  # fainter stars are left out
    sigma_magnitude: float  # of each star's brightness against the catalogue
    hot_pixels: int
    hot_pixel_rates: tuple  # (least, most) electrons/s
    dead_pixels: int
    unknown_bad_pixels: int  # hot pixels that the flight software's list lacks, besides the above
    false_objects: int  # on the whole sky
    spikes_per_frame: float  # mean number
    false_object_magnitudes: tuple  # (brightest, faintest), of false objects and spikes
    sun_exclusion_rad: float  # boresight to Sun
    earth_exclusion_rad: float  # boresight to limb
    baffle_rad: float  # half angle beyond which no light reaches the lens directly
    stray_rate: float  # electrons/s and pixel at an exclusion angle
    stray_decade_rad: float  # angle over which stray light grows tenfold
    direct_rate: float  # electrons/s and pixel with Sun or day side within the baffle


class Sky(NamedTuple):
    """Point sources at infinity, catalogue stars first, at the epoch of the mission."""

    u_i: np.ndarray  # (n, 3) barycentric
    flux: np.ndarray  # (n,) electrons/s
    hip: np.ndarray  # (n,) 0 for a false object
    is_listed: np.ndarray  # (n,) bool: named in FrameTruth


class Vehicle(NamedTuple):
    """The vehicle in the middle of an exposure."""

    r_i: np.ndarray  # (3,) m
    v_i: np.ndarray  # (3,) m/s
    omega_ib_i: np.ndarray  # (3,) rad/s
    C_ei: np.ndarray  # (3, 3)


class Camera(NamedTuple):
    """The camera of one run, the same for every frame; only `bad_pixel_map` may be known on board."""

    params: CameraParams
    pinhole: Pinhole  # true
    q_bc: np.ndarray  # (4,) true mounting
    psf: render.Psf
    sky: Sky
    bodies: SkyBodies
    planet_flux: np.ndarray  # (5,) electrons/s
    full_moon_flux: float  # electrons/s
    earth: EarthRotation
    bad_pixels: artefacts.BadPixels
    bad_pixel_map: np.ndarray  # (n, 2) row, column of the defects that were found before flight
    light: render.Light  # work memory of `expose`


def init(params, catalogue, bodies, earth, rng):
    """Draw the true camera of a run: mounting, calibration, brightness of the stars, defects.

    Parameters
    ----------
    params : CameraParams
    catalogue : StarCatalogue at the epoch of the mission (`stars.at_epoch`)
    bodies : SkyBodies
    earth : EarthRotation
    rng : np.random.Generator for everything that stays the same during the run
    """
    q_bc = optics.true_mounting(params.C_bc, params.sigma_mounting_rad, rng)
    pinhole = optics.true_pinhole(params, rng)
    defects = artefacts.bad_pixels(params, rng)
    false_u_i, false_magnitudes = artefacts.false_objects(params, rng)
    seen = catalogue.vmag <= params.render_vmag
    vmag, bv = catalogue.vmag[seen], catalogue.bv[seen]
    magnitudes = silicon_magnitude(vmag, bv) + params.sigma_magnitude * rng.standard_normal(len(vmag))
    sky = Sky(
        u_i=np.concatenate([catalogue.u_i[seen], false_u_i]),
        flux=_flux(params, np.concatenate([magnitudes, false_magnitudes])),
        hip=np.concatenate([catalogue.hip[seen], np.zeros(len(false_magnitudes), dtype=np.int64)]),
        is_listed=np.concatenate([vmag <= TRUTH_VMAG, np.zeros(len(false_magnitudes), dtype=bool)]),
    )
    return Camera(
        params=params,
        pinhole=pinhole,
        q_bc=q_bc,
        psf=render.gaussian_psf(params.sigma_psf_px),
        sky=sky,
        bodies=bodies,
        planet_flux=_flux(params, artefacts.planet_magnitudes(bodies)),
        full_moon_flux=float(_flux(params, artefacts.full_moon_magnitude(bodies))),
        earth=earth,
        bad_pixels=defects,
        bad_pixel_map=defects.known,
        light=render.darkness(params.width_px * params.height_px),
    )


def expose(camera, command, trajectory, number, t_start_s, rng):
    """Take one picture.

    Parameters
    ----------
    camera : Camera
    command : CameraCommand, exposure and gain
    trajectory : Trajectory, must cover the exposure
    number : int, of the frame
    t_start_s : float, shutter opens
    rng : np.random.Generator for the noise of the frames

    Returns
    -------
    Frame, FrameTruth
    """
    params, exposure_s = camera.params, command.exposure_s
    t_valid_s, t_end_s = t_start_s + 0.5 * exposure_s, t_start_s + exposure_s
    if t_start_s < trajectory.t_s[0] or t_end_s > trajectory.t_s[-1]:
        raise ValueError(f"exposure from {t_start_s:.4f} s to {t_end_s:.4f} s is outside the trajectory")
    omega_ib_b = _rates(trajectory, t_start_s, exposure_s)
    rate = float(np.sqrt((omega_ib_b**2).sum(axis=1).max()))
    C_ci = _attitudes(camera, trajectory, t_start_s, exposure_s, omega_ib_b)
    C_ci_mid = render.attitudes(trajectory, camera.q_bc, np.array([t_valid_s]))[0]
    vehicle = _vehicle(camera, trajectory, t_valid_s, C_ci_mid, omega_ib_b)
    sun_angle, limb_angle, stray_rate = _surroundings(camera, C_ci_mid[2], vehicle)
    background = (params.background_rate + stray_rate) * exposure_s
    hip, xy_px = _add_sky(camera, C_ci, C_ci_mid, vehicle, exposure_s, rate, background)
    _add_spikes(camera, exposure_s, rng)
    image_dn = _read_out(camera, background, command, rng)
    render.darken(camera.light)

    frame = Frame(
        number=number,
        t_start_s=t_start_s,
        t_valid_s=t_valid_s,
        t_available_s=t_end_s + params.readout_s,
        exposure_s=exposure_s,
        gain_db=command.gain_db,
        image_dn=image_dn,
    )
    truth = FrameTruth(
        number=number,
        t_valid_s=t_valid_s,
        q_ic=rotation.quat_from_dcm(np.ascontiguousarray(C_ci_mid.T)),
        rate=rate,
        sun_angle=sun_angle,
        limb_angle=limb_angle,
        exclusion_met=sun_angle >= params.sun_exclusion_rad and limb_angle >= params.earth_exclusion_rad,
        hip=hip,
        xy_px=xy_px,
    )
    return frame, truth


def _flux(params, magnitudes):
    """Electrons/s of silicon magnitudes."""
    return params.zero_magnitude_flux * 10.0 ** (-0.4 * magnitudes)


def _sample(trajectory, t_s):
    """Fractional number of the trajectory's sample at t_s."""
    times_s = trajectory.t_s
    return (t_s - times_s[0]) / (times_s[-1] - times_s[0]) * (len(times_s) - 1)


def _interpolate(trajectory, values, t_s):
    """Linear interpolation of (N, 3) samples: position within 0.1 mm at 100 m/s^2 and 400 Hz."""
    x = _sample(trajectory, t_s)
    k = min(int(x), len(values) - 2)
    return values[k] + (x - k) * (values[k + 1] - values[k])


def _rates(trajectory, t_start_s, exposure_s):
    """Body rates [rad/s] of the samples in and next to the exposure: (n, 3)."""
    first = int(_sample(trajectory, t_start_s))
    last = int(np.ceil(_sample(trajectory, t_start_s + exposure_s)))
    return trajectory.omega_ib_b[first : last + 1]


def _vehicle(camera, trajectory, t_s, C_ci, omega_ib_b):
    """Position and velocity at t_s, the mean of the rates in the exposure."""
    omega_ib_c = rotation.quat_rotate(rotation.quat_conjugate(camera.q_bc), omega_ib_b.mean(axis=0))
    return Vehicle(
        r_i=_interpolate(trajectory, trajectory.r_i, t_s),
        v_i=_interpolate(trajectory, trajectory.v_i, t_s),
        omega_ib_i=C_ci.T @ omega_ib_c,
        C_ei=np.ascontiguousarray(frames.dcm_ie(camera.earth, t_s).T),
    )


def _attitudes(camera, trajectory, t_start_s, exposure_s, omega_ib_b):
    """C_ci at the middles of steps in which no star moves more than MAX_STEP_PX.

    In a corner, at the angle a from the boresight, the image moves by f / cos^2(a) times the rate across
    the boresight plus f tan(a) times the rate about it.
    """
    focal_length_px = camera.pinhole.focal_length_px
    tan_corner = 0.5 * np.hypot(camera.params.width_px, camera.params.height_px) / focal_length_px
    omega_c = omega_ib_b @ rotation.dcm_from_quat(camera.q_bc)
    across, about = np.hypot(omega_c[:, 0], omega_c[:, 1]), np.abs(omega_c[:, 2])
    speed_px = focal_length_px * ((1.0 + tan_corner**2) * across + tan_corner * about).max()
    n_steps = max(1, int(np.ceil(speed_px * exposure_s / render.MAX_STEP_PX)))
    times_s = t_start_s + exposure_s * (np.arange(n_steps) + 0.5) / n_steps
    return render.attitudes(trajectory, camera.q_bc, times_s)


def _surroundings(camera, boresight_i, vehicle):
    """Angles of the boresight to Sun and limb [rad], and the stray light [electrons/s and pixel]."""
    params, sun_u_i = camera.params, camera.bodies.sun_u_i
    sun_angle = float(np.arccos(np.clip(boresight_i @ sun_u_i, -1.0, 1.0)))
    limb_angle = float(wgs84.limb_angle(vehicle.C_ei @ vehicle.r_i, vehicle.C_ei @ boresight_i))
    sunlight = optics.limb_sunlight(boresight_i, vehicle.r_i, sun_u_i)
    sun_rate = optics.stray_light(sun_angle, params.sun_exclusion_rad, params.baffle_rad, params)
    # the exclusion angle to the limb is less than the baffle's: light past its edge is in the exponential
    earth_rate = optics.stray_light(limb_angle, params.earth_exclusion_rad, 0.0, params)
    return sun_angle, limb_angle, sun_rate + sunlight * earth_rate


def _add_sky(camera, C_ci, C_ci_mid, vehicle, exposure_s, rate, background):
    """Draw stars, false objects, planets and Moon; returns (hip, xy_px) of the listed stars in the frame."""
    params, sky, pinhole = camera.params, camera.sky, camera.pinhole
    observer_v_i = camera.bodies.earth_v_i + vehicle.v_i
    size_px = np.array([params.width_px, params.height_px], dtype=float)
    half_diagonal = np.arctan(0.5 * np.hypot(*size_px) / pinhole.focal_length_px)
    cone = min(np.pi, half_diagonal + 0.5 * rate * exposure_s + 0.005)  # rad; room for spot and aberration
    near = np.flatnonzero(sky.u_i @ C_ci_mid[2] > np.cos(cone))
    planets_i = artefacts.planets(camera.bodies, vehicle.r_i)
    u_i = aberrate(np.concatenate([sky.u_i[near], planets_i]), observer_v_i)
    electrons = exposure_s * np.concatenate([sky.flux[near], camera.planet_flux])
    electrons[electrons < _faintest(camera, u_i, vehicle.omega_ib_i, exposure_s, background)] = 0.0
    is_listed = np.append(sky.is_listed[near], np.zeros(len(planets_i), dtype=bool))
    drawn = np.flatnonzero(((electrons > 0.0) | is_listed) & ~optics.behind_earth(u_i, vehicle))
    xy_px = render.add_points(camera.light, pinhole, camera.psf, C_ci, u_i[drawn], electrons[drawn])

    moon_i, radius = artefacts.moon(camera.bodies, vehicle.r_i)
    if moon_i @ C_ci_mid[2] > np.cos(cone + radius) and not optics.behind_earth(moon_i[None], vehicle)[0]:
        full_moon = camera.full_moon_flux * exposure_s
        render.add_moon(camera.light, pinhole, C_ci, moon_i, radius, camera.bodies.sun_u_i, full_moon)

    with np.errstate(invalid="ignore"):  # NaN behind the camera
        inside = (np.abs(xy_px - 0.5 * (size_px - 1.0)) <= 0.5 * size_px).all(axis=1)
    listed = inside & is_listed[drawn]
    return sky.hip[near[drawn[listed]]], xy_px[listed]


def _faintest(camera, u_i, omega_ib_i, exposure_s, background):
    """Electrons below which a source's brightest pixel stays below FAINT of the noise: (n,).

    A still star puts 1/(2 pi sigma^2) of its light into that pixel, one that moves by L px
    1/(sqrt(2 pi) sigma L). This is what makes frames affordable while the vehicle spins.
    """
    params = camera.params
    speed = np.sqrt(np.maximum(omega_ib_i @ omega_ib_i - (u_i @ omega_ib_i) ** 2, 0.0))  # |omega x u|
    length_px = camera.pinhole.focal_length_px * exposure_s * speed
    width_px = np.sqrt(2.0 * np.pi) * params.sigma_psf_px
    noise = np.sqrt(params.read_noise_electrons**2 + background)
    return FAINT * noise * width_px * np.maximum(width_px, length_px)


def _add_spikes(camera, exposure_s, rng):
    """Draw the spots of this frame that sit still on the detector."""
    xy_px, magnitudes = artefacts.spikes(camera.params, rng)
    if len(xy_px):
        electrons = _flux(camera.params, magnitudes) * exposure_s
        u_c = unit_vectors(camera.pinhole, xy_px)
        render.add_points(camera.light, camera.pinhole, camera.psf, np.eye(3)[None], u_c, electrons)


def _read_out(camera, background, command, rng):
    """Grey values of the whole frame: (rows, columns) uint8."""
    params, defects = camera.params, camera.bad_pixels
    cdf = detector.grey_distribution(params, command.gain_db, background)
    grey = detector.background(params.width_px * params.height_px, cdf, rng)
    lit = render.lit_pixels(camera.light)
    pixels = np.concatenate([lit, defects.hot, defects.dead])
    mean = background + camera.light.electrons[pixels]
    mean[len(lit) : len(lit) + len(defects.hot)] += defects.hot_rate * command.exposure_s
    mean[len(lit) + len(defects.hot) :] = 0.0
    grey[pixels] = detector.digitise(params, command.gain_db, mean, rng)  # the last entry of a pixel holds
    return grey.reshape(params.height_px, params.width_px)
