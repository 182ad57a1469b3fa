"""Sections of a scenario -> the parameters of the stages, in SI.

One function for each stage of the world; that of the GPS receiver is in `params_gps`, those of the flight
software are in `params_onboard`. A stage is
imported when its parameters are asked for: checking a scenario must not wait for compiled kernels.
"""

import math

import numpy as np

from shefex_nav.clock import IMU_HZ


def flight_params(scenario):
    """FlightParams of a scenario."""
    from shefex_nav.environment import gravity
    from shefex_nav.scenario import params_vehicle
    from shefex_nav.world.flight import params as flight

    vehicle, payload = scenario.vehicle, scenario.vehicle.payload
    return flight.FlightParams(
        t_start_s=scenario.mission.start,
        time_limit_s=scenario.mission.time_limit,
        sample_rate_hz=float(IMU_HZ),
        gravity=gravity.load(scenario.earth.gravity, scenario.earth.gravity_degree),
        air=flight.Air(air_table(scenario), scenario.atmosphere.density),
        wind=wind(scenario.wind),
        start=_start(scenario),
        C_bc=mounting(scenario),
        imu_b=np.array(vehicle.imu),
        payload=params_vehicle.part(payload),
        offset_m=np.array(payload.centre_of_mass_offset),
        tilt=np.array(payload.principal_axis_tilt),
        payload_aerodynamics=params_vehicle.aerodynamics(payload.aerodynamics),
        stages=tuple(params_vehicle.stage(name, stage) for name, stage in vehicle.stages.items()),
        spin_motors=params_vehicle.spin_motors(vehicle.spin_motors),
        yo_yo=params_vehicle.yo_yo(vehicle.yo_yo),
        cold_gas=params_vehicle.cold_gas(vehicle.cold_gas),
        parachute=params_vehicle.parachute(vehicle.parachute),
        attitude=flight.FLOWN if scenario.attitude == "flown" else flight.PRESCRIBED,
        programme=tuple(params_vehicle.task(name, task) for name, task in scenario.tasks),
    )


def _start(scenario):
    """LaunchSite, GroundSite or Orbit."""
    from shefex_nav.world.flight import params as flight

    if scenario.orbit is not None:
        orbit = scenario.orbit
        angles = (orbit.inclination, orbit.node, orbit.perigee, orbit.anomaly)
        return flight.Orbit(orbit.perigee_height, orbit.apogee_height, *angles)
    site = scenario.launch or scenario.ground
    place = (site.latitude, site.longitude, site.height, site.azimuth, site.elevation, site.roll)
    if scenario.ground is not None:
        return flight.GroundSite(*place)
    return flight.LaunchSite(*place, site.rail_length)


def wind(section):
    """Wind by height, (m, 3): height m, north m/s, east m/s, both towards which it blows; (0, 3) for none.

    Speed and direction are given at the heights; between them the components are linear.
    """
    if isinstance(section, str):
        return np.zeros((0, 3))
    speed, whence = np.array(section.speed), np.array(section.direction)
    return np.column_stack([section.height, -speed * np.cos(whence), -speed * np.sin(whence)])


def air_table(scenario):
    """Air of NRLMSIS above the place of the start, (n, 4) as `environment.msis.table`; (0, 4) for US76."""
    atmosphere = scenario.atmosphere
    if atmosphere.model == "us76":
        return np.zeros((0, 4))
    from shefex_nav.environment import msis

    indices = atmosphere.msis
    return msis.table(
        scenario.mission.epoch, *_place(scenario), indices.f107, indices.f107_average, indices.ap
    )


def _place(scenario):
    """Latitude and longitude at the start, rad; for an orbit those below, latitude to a fifth of a degree."""
    site = scenario.launch or scenario.ground
    if site is not None:
        return site.latitude, site.longitude
    from shefex_nav.environment import ephemeris
    from shefex_nav.geometry import frames

    orbit, earth = scenario.orbit, scenario.earth
    along = orbit.perigee + orbit.anomaly  # from the ascending node
    x, y = np.cos(along), np.sin(along) * np.cos(orbit.inclination)
    cosine, sine = np.cos(orbit.node), np.sin(orbit.node)
    u_i = np.array([cosine * x - sine * y, sine * x + cosine * y, np.sin(along) * np.sin(orbit.inclination)])
    rotation = ephemeris.earth_rotation(
        scenario.mission.epoch, earth.ut1_minus_utc, earth.pole_x, earth.pole_y
    )
    u_e = frames.dcm_ie(rotation, scenario.mission.start).T @ u_i
    return math.asin(min(max(u_e[2], -1.0), 1.0)), math.atan2(u_e[1], u_e[0])


def mounting(scenario):
    """Nominal C_bc of the star camera (3, 3): columns are image right, image down and boresight."""
    boresight_b = np.array(scenario.star_camera.mounting.boresight)
    boresight_b /= np.linalg.norm(boresight_b)
    right_b = np.array(scenario.star_camera.mounting.image_right)
    right_b -= (right_b @ boresight_b) * boresight_b  # checks.py holds the angle to 90 deg within rounding
    right_b /= np.linalg.norm(right_b)
    return np.column_stack([right_b, np.cross(boresight_b, right_b), boresight_b])


def camera_params(scenario):
    """CameraParams of a scenario."""
    from shefex_nav.world.camera.camera import CameraParams

    camera = scenario.star_camera
    optics, detector, artefacts, stray = camera.optics, camera.detector, camera.artefacts, camera.stray_light
    return CameraParams(
        width_px=detector.columns,
        height_px=detector.rows,
        pixel_m=detector.pixel_size,
        focal_length_m=optics.focal_length,
        C_bc=mounting(scenario),
        sigma_mounting_rad=camera.mounting.error,
        sigma_focal_length=optics.focal_length_error,
        sigma_principal_point_px=optics.principal_point_error,
        zero_magnitude_flux=optics.zero_magnitude_flux,
        sigma_psf_px=optics.psf_sigma,
        background_rate=detector.background,
        read_noise_electrons=detector.read_noise,
        full_well_electrons=detector.full_well,
        electrons_per_dn=detector.conversion,
        black_level_dn=detector.black_level,
        readout_s=detector.readout,
        render_vmag=camera.stars.faintest,
        sigma_magnitude=camera.stars.brightness_error,
        hot_pixels=artefacts.hot_pixels,
        hot_pixel_rates=(artefacts.hot_pixel_weakest, artefacts.hot_pixel_strongest),
        dead_pixels=artefacts.dead_pixels,
        unknown_bad_pixels=artefacts.unknown_bad_pixels,
        false_objects=artefacts.false_objects,
        spikes_per_frame=artefacts.spikes_per_frame,
        false_object_magnitudes=(artefacts.false_brightest, artefacts.false_faintest),
        sun_exclusion_rad=stray.sun_exclusion,
        earth_exclusion_rad=stray.earth_exclusion,
        baffle_rad=stray.baffle,
        stray_rate=stray.rate_at_exclusion,
        stray_decade_rad=stray.tenfold_angle,
        direct_rate=stray.direct_rate,
        hot_pixel_smear=artefacts.hot_pixel_smear,
        upsets_per_frame=artefacts.upsets_per_frame,
        trails_per_frame=artefacts.trails_per_frame,
        particle_electrons=(artefacts.particle_weakest, artefacts.particle_strongest),
        trail_longest_px=artefacts.trail_longest,
        moving_objects=artefacts.moving_objects,
        moving_rates=(artefacts.moving_slowest, artefacts.moving_fastest),
        stray_gradient=stray.gradient,
        bits=detector.bits,
        line_s=detector.line_s,
        band=camera.stars.band,
    )
