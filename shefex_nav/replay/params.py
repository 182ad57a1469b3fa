"""Replay scenario -> parameters of the navigation filter, in SI."""

import numpy as np

from shefex_nav.onboard.navigation import integrity_imu, integrity_protection, integrity_watch
from shefex_nav.onboard.navigation.state import ImuModel, NavParams, ReleaseRule


def nav_params(scenario, dt_s):
    """NavParams of a ReplayScenario whose IMU samples last dt_s: no star camera, no motors."""
    navigation, gyro, accelerometer = scenario.navigation, scenario.imu.gyro, scenario.imu.accelerometer

    def rule(release):
        return ReleaseRule(release.rejections, release.duration)

    return NavParams(
        imu=imu_model(scenario),
        sigma_gyro_bias=float(np.hypot(gyro.bias, gyro.in_run_bias)),
        sigma_accel_bias=float(np.hypot(accelerometer.bias, accelerometer.in_run_bias)),
        sigma_blocks=_sigma_blocks(scenario),
        l_ba_b=np.array(scenario.gnss.lever_arm),
        C_bc=np.eye(3),
        gate_probability=navigation.gate_probability,
        star_sigma_floor=navigation.star_fix_floor,
        release_gps=rule(navigation.release.gps),
        release_star_first=rule(navigation.release.first_star_fix),
        release_star=rule(navigation.release.star_fix),
        gps_agreement=navigation.gps_agreement,
        history_s=navigation.history + scenario.gnss.latency,
        motors=np.zeros((0, 2)),
        states=tuple(navigation.states),
        integrity=_integrity(scenario, dt_s),
    )


def _integrity(scenario, dt_s):
    """IntegrityParams of a ReplayScenario.

    An axis that repeats its reading is suspected only where the scenario says how coarse readings are: files
    of others may well have been rounded.
    """
    section, navigation = scenario.navigation.integrity, scenario.navigation
    triads = (scenario.imu.gyro, scenario.imu.accelerometer)
    repeats = [
        integrity_imu.repeats(triad.random_walk * np.sqrt(dt_s), triad.quantum) if triad.quantum else np.inf
        for triad in triads
    ]
    return integrity_watch.IntegrityParams(
        imu=integrity_imu.ImuRules(
            repeats=np.array(repeats),
            range=np.array([triad.range for triad in triads]),
            wrong=np.array([navigation.saturated_rate, navigation.saturated_acceleration]),
            change=np.array([section.angular_acceleration, section.thrust_change]),
        ),
        wanted=integrity_protection.requirement(section.attitude, section.risk),
        wrong_star_fix=section.wrong_star_fix,
        release_gps_jump=ReleaseRule(section.gps_jump.rejections, section.gps_jump.duration),
    )


def _sigma_blocks(scenario):
    """What is known at the start of the optional blocks that are on: name -> (size,) sigma."""
    navigation, gyro, accelerometer = scenario.navigation, scenario.imu.gyro, scenario.imu.accelerometer
    known = {
        "gyro_roll_column": (gyro.scale_factor_roll, gyro.misalignment, gyro.misalignment),
        "gyro_scale": (gyro.scale_factor_roll, gyro.scale_factor, gyro.scale_factor),
        "gyro_misalignment": (gyro.misalignment,) * 6,
        "gyro_g_sensitivity": (gyro.g_sensitivity,) * 9,
        "accel_scale": (accelerometer.scale_factor,) * 3,
        "accel_misalignment": (accelerometer.misalignment,) * 6,
        "lever_arm": (navigation.sensors.lever_arm_error,) * 3,
        "gps_latency": (navigation.sensors.gps_latency_error,),
    }
    return {name: np.array(known[name]) for name in navigation.states}


def imu_model(scenario):
    """ImuModel of a ReplayScenario, as `scenario.params_onboard` makes it for a mission.

    A bias that wanders with sigma and correlation time tau (Gauss-Markov) starts out as a random walk of
    density sigma sqrt(2/tau). Errors whose block is estimated are left out.
    """

    def left(name, value):
        return 0.0 if name in scenario.navigation.states else value

    navigation, gyro, accelerometer = scenario.navigation, scenario.imu.gyro, scenario.imu.accelerometer
    scale_factor = left("gyro_scale", gyro.scale_factor)
    misalignment = left("gyro_misalignment", gyro.misalignment)
    return ImuModel(
        gyro_random_walk=gyro.random_walk,
        gyro_bias_walk=float(gyro.in_run_bias * np.sqrt(2.0 / gyro.in_run_bias_time)),
        gyro_cross=float(np.sqrt((scale_factor**2 + 2.0 * misalignment**2) / 3.0)),
        manoeuvre_angle=navigation.manoeuvre_angle,
        gyro_g_sensitivity=left("gyro_g_sensitivity", gyro.g_sensitivity),
        gyro_rectification=0.0,
        gyro_vibration=0.0,
        gyro_quantum=gyro.quantum,
        accel_random_walk=accelerometer.random_walk,
        accel_bias_walk=float(accelerometer.in_run_bias * np.sqrt(2.0 / accelerometer.in_run_bias_time)),
        accel_scale=left("accel_scale", accelerometer.scale_factor),
        accel_misalignment=left("accel_misalignment", accelerometer.misalignment),
        accel_rectification=0.0,
        accel_vibration=0.0,
        thrust_threshold=navigation.thrust_threshold,
        shake_threshold=np.inf,
        thrust_time_s=navigation.thrust_memory,
        gravity=navigation.gravity_error,
        gravity_time_s=navigation.gravity_memory,
        saturated_rate=navigation.saturated_rate,
    )
