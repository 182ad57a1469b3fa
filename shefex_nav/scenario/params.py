"""Sections of a scenario -> the parameters of the stages, in SI.

One function for each stage of the world; those of the flight software are in `params_onboard`. A stage is
imported when its parameters are asked for: checking a scenario must not wait for compiled kernels.
"""

import numpy as np

IMU_RATE = 400.0  # Hz, samples of the IMU and steps of the flight


def flight_params(scenario):
    """FlightParams of a scenario."""
    from shefex_nav.world.flight.attitude_program import Program
    from shefex_nav.world.flight.fly import FlightParams, LaunchSite

    launch, programme, pointing = scenario.launch, scenario.programme, scenario.programme.pointing
    site = LaunchSite(
        latitude=launch.latitude,
        longitude=launch.longitude,
        height_m=launch.height,
        azimuth=launch.azimuth,
        elevation=launch.elevation,
        roll=launch.roll,
        rail_length_m=launch.rail_length,
    )
    program = Program(
        separation_s=programme.separation,
        precession_start_s=programme.precession_start,
        precession_end_s=programme.precession_end,
        burn_azimuth=programme.burn_azimuth,
        burn_elevation=programme.burn_elevation,
        ignition_2_s=programme.ignition_2,
        despin_start_s=programme.despin_start,
        despin_end_s=programme.despin_end,
        pointing_start_s=programme.pointing_start,
        boresight_azimuth=pointing.azimuth,
        boresight_elevation=pointing.elevation,
        boresight_roll=pointing.roll,
        residual_boresight_rate=pointing.boresight_rate,
        residual_cross_rate=pointing.cross_rate,
        residual_period_s=pointing.cross_period,
        residual_phase=pointing.cross_phase,
        residual_ramp_s=pointing.ramp,
        pointing_end_s=programme.pointing_end,
        entry_aim_s=programme.entry_aim,
        entry_slew_end_s=programme.entry_slew_end,
        entry_spin=programme.entry_spin,
        spin_up_end_s=programme.spin_up_end,
    )
    vehicle = scenario.vehicle
    return FlightParams(
        t_start_s=scenario.mission.start,
        sample_rate_hz=IMU_RATE,
        time_limit_s=scenario.mission.time_limit,
        gravity_degree=scenario.earth.gravity_degree,
        site=site,
        payload=_part(vehicle.payload),
        stage_1=_stage(vehicle.stages[0]),
        stage_2=_stage(vehicle.stages[1]),
        imu_b=np.array(vehicle.imu),
        aerodynamics_stack=_aerodynamics(vehicle.aerodynamics.stack),
        aerodynamics_upper=_aerodynamics(vehicle.aerodynamics.upper),
        program=program,
        C_bc=mounting(scenario),
    )


def _part(part):
    from shefex_nav.world.flight.vehicle import Part

    return Part(part.mass, part.station, part.inertia_roll, part.inertia_pitch)


def _stage(stage):
    from shefex_nav.world.flight.vehicle import Stage

    grain, motor = stage.propellant, stage.motor
    return Stage(
        dry=_part(stage.dry),
        propellant_mass_kg=grain.mass,
        grain_station_m=grain.station,
        grain_length_m=grain.length,
        grain_outer_radius_m=grain.outer_radius,
        grain_inner_radius_m=grain.inner_radius,
        isp_vacuum_s=motor.specific_impulse,
        burn_time_s=motor.burn_time,
        rise_s=motor.rise,
        tail_off_s=motor.tail_off,
        level_ratio=motor.level_ratio,
        exit_area_m2=motor.exit_area,
        exit_station_m=motor.exit_station,
    )


def _aerodynamics(tables):
    from shefex_nav.world.flight.vehicle import Aerodynamics

    return Aerodynamics(
        area_m2=tables.area,
        diameter_m=tables.diameter,
        fin_cant=tables.fin_cant,
        mach=np.array(tables.mach),
        axial=np.array(tables.axial),
        normal_slope=np.array(tables.normal_slope),
        pressure_station_m=np.array(tables.pressure_station),
        pitch_damping=np.array(tables.pitch_damping),
        roll_damping=np.array(tables.roll_damping),
        roll_by_cant=np.array(tables.roll_by_cant),
    )


def mounting(scenario):
    """Nominal C_bc of the star camera (3, 3): columns are image right, image down and boresight."""
    boresight_b = np.array(scenario.star_camera.mounting.boresight)
    boresight_b /= np.linalg.norm(boresight_b)
    right_b = np.array(scenario.star_camera.mounting.image_right)
    right_b -= (right_b @ boresight_b) * boresight_b  # checks.py holds the angle to 90 deg within rounding
    right_b /= np.linalg.norm(right_b)
    return np.column_stack([right_b, np.cross(boresight_b, right_b), boresight_b])


def imu_params(scenario):
    """ImuParams of a scenario."""
    from shefex_nav.world.imu import ImuParams

    gyro, accelerometer, vibration = scenario.imu.gyro, scenario.imu.accelerometer, scenario.imu.vibration
    return ImuParams(
        gyro_bias=gyro.bias,
        gyro_bias_in_run=gyro.in_run_bias,
        gyro_bias_tau_s=gyro.in_run_bias_time,
        gyro_random_walk=gyro.random_walk,
        gyro_scale_factor_roll=gyro.scale_factor_roll,
        gyro_scale_factor=gyro.scale_factor,
        gyro_misalignment=gyro.misalignment,
        gyro_g_sensitivity=gyro.g_sensitivity,
        gyro_vibration_rectification=gyro.vibration_rectification,
        gyro_range=gyro.range,
        gyro_quantum=gyro.quantum,
        accel_bias=accelerometer.bias,
        accel_bias_in_run=accelerometer.in_run_bias,
        accel_bias_tau_s=accelerometer.in_run_bias_time,
        accel_random_walk=accelerometer.random_walk,
        accel_scale_factor=accelerometer.scale_factor,
        accel_misalignment=accelerometer.misalignment,
        accel_vibration_rectification=accelerometer.vibration_rectification,
        accel_range=accelerometer.range,
        accel_quantum=accelerometer.quantum,
        vibration_boost_1=vibration.boost_1,
        vibration_boost_2=vibration.boost_2,
        vibration_coast=vibration.coast,
        vibration_rate=vibration.angular,
        vibration_low_hz=vibration.lowest_frequency,
        vibration_high_hz=vibration.highest_frequency,
    )


def gps_params(scenario):
    """GpsParams of a scenario."""
    from shefex_nav.world.gps import GpsParams, Outage

    gps = scenario.gps
    return GpsParams(
        l_ba_b=np.array(gps.antenna.lever_arm),
        latency_s=gps.latency,
        sigma_range=gps.range_noise,
        sigma_range_rate=gps.range_rate_noise,
        elevation_mask=gps.elevation_mask,
        lowest_height=gps.lowest_ray_height,
        blind_nose=gps.antenna.blind_nose,
        blind_tail=gps.antenna.blind_tail,
        max_pdop=gps.max_pdop,
        spin_threshold=gps.spin.threshold,
        spin_loss=gps.spin.loss,
        spin_noise_factor=gps.spin.noise_factor,
        outages=tuple(Outage(o.event, o.shortest, o.longest) for o in gps.outages),
    )


def pad_params(scenario):
    """PadParams of a scenario."""
    from shefex_nav.world.pad import PadParams

    pad = scenario.pad_alignment
    return PadParams(
        sigma_level=pad.level, sigma_azimuth=pad.azimuth, sigma_r=pad.position, sigma_v=pad.velocity
    )


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
    )
