"""A star camera on a bench in space: SHEFEX-2's parameters and a vehicle that turns at a constant rate."""

import functools

import numpy as np

from shefex_nav.environment import ephemeris, stars
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Trajectory
from shefex_nav.settings import changed
from shefex_nav.world import camera
from shefex_nav.world.camera_settings import (
    Artefacts,
    Detector,
    Mounting,
    Optics,
    StarCamera,
    Stars,
    StrayLight,
)

DEG = np.pi / 180.0
EPOCH = "2012-06-22T19:18:00"
SITE = 72.5 * DEG, 14.0 * DEG, 177e3  # apogee of SHEFEX-2: latitude, longitude, height [m]
T_S = 250.0

PARAMS = StarCamera(
    mounting=Mounting(boresight=(0.0, 1.0, 0.0), image_right=(1.0, 0.0, 0.0), error=0.02 * DEG),
    optics=Optics(
        focal_length=24.95e-3,
        focal_length_error=1e-4,
        principal_point=None,
        principal_point_error=0.3,
        distortion=None,
        psf_sigma=0.8,
        zero_magnitude_flux=2.5e6,
        f_number=None,
        aperture=None,
        transmission=None,
    ),
    detector=Detector(
        columns=659,
        rows=493,
        pixel_size=9.9e-6,
        background=400.0,
        read_noise=16.0,
        full_well=30e3,
        conversion=118.0,
        black_level=16.0,
        readout=0.015,
        bits=8,
        shutter="global",
        line_time=None,
        quantum_efficiency=None,
    ),
    stars=Stars(faintest=7.0, brightness_error=0.1, band="silicon"),
    artefacts=Artefacts(
        hot_pixels=60,
        hot_pixel_weakest=2e3,
        hot_pixel_strongest=1e5,
        dead_pixels=10,
        unknown_bad_pixels=3,
        false_objects=250,
        spikes_per_frame=0.0,
        false_brightest=3.0,
        false_faintest=6.0,
        hot_pixel_smear=0.0,
        upsets_per_frame=0.0,
        trails_per_frame=0.0,
        particle_weakest=500.0,
        particle_strongest=20e3,
        trail_longest=100.0,
        moving_objects=0,
        moving_slowest=1.7e-3,
        moving_fastest=35e-3,
    ),
    stray_light=StrayLight(
        sun_exclusion=90.0 * DEG,
        earth_exclusion=45.0 * DEG,
        baffle=50.0 * DEG,
        rate_at_exclusion=100.0,
        tenfold_angle=5.0 * DEG,
        direct_rate=1e8,
        gradient=0.0,
    ),
)
# the same camera without anything but catalogue stars and noise
CLEAN = changed(
    PARAMS,
    {
        "stars.brightness_error": 0.0,
        "artefacts.hot_pixels": 0,
        "artefacts.dead_pixels": 0,
        "artefacts.unknown_bad_pixels": 0,
        "artefacts.false_objects": 0,
    },
)


@functools.cache
def sky():
    """(catalogue at the epoch, SkyBodies, EarthRotation)."""
    catalogue = stars.at_epoch(stars.load_catalogue(7.99), ephemeris.julian_year(EPOCH))
    earth = ephemeris.earth_rotation(EPOCH, -0.58479, 0.0787 / 3600 * DEG, 0.4084 / 3600 * DEG)
    return catalogue, ephemeris.sky_bodies(EPOCH), earth


def build(params, seed=1):
    """Camera of one run."""
    return camera.init(params, *sky(), np.random.default_rng(seed))


def turning(azimuth_deg, elevation_deg, omega_c=(0.0, 0.0, 0.0), duration_s=0.5):
    """Trajectory that starts at T_S with the nominal boresight there and turns at omega_c [rad/s]."""
    earth = sky()[2]
    latitude, longitude, height = SITE
    azimuth, elevation = azimuth_deg * DEG, elevation_deg * DEG
    boresight_n = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)]
    )
    z_i = frames.dcm_ie(earth, T_S) @ wgs84.dcm_en(latitude, longitude) @ boresight_n
    x_i = wgs84.perpendicular(z_i)
    C_ic = np.column_stack([x_i, np.cross(z_i, x_i), z_i])
    q_ib = rotation.quat_from_dcm(C_ic @ PARAMS.mounting.C_bc.T)
    omega_ib_b = PARAMS.mounting.C_bc @ np.asarray(omega_c, dtype=float)
    n = round(duration_s * 400) + 1
    t_s = T_S + np.arange(n) / 400.0
    q = [rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(omega_ib_b * (t - T_S))) for t in t_s]
    r_e = wgs84.ecef_from_geodetic(latitude, longitude, height)
    r_i, v_i = frames.inertial_from_ecef(earth, T_S, r_e, np.array([0.0, 2000.0, 0.0]))
    zero, one = np.zeros((n, 3)), np.ones(n)
    return Trajectory(
        t_s=t_s,
        phase=np.zeros(n, np.int8),
        r_i=np.tile(r_i, (n, 1)),
        v_i=np.tile(v_i, (n, 1)),
        q_ib=np.array(q),
        omega_ib_b=np.tile(omega_ib_b, (n, 1)),
        f_b=zero,
        dtheta_b=zero,
        dv_b=zero,
        mass_kg=one,
        mach=one,
        dynamic_pressure_pa=one,
        thrust_n=one,
        burning=np.zeros(n, np.int8),
        angle_of_attack=one,
    )
