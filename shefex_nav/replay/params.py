"""Replay scenario -> parameters of the navigation filter, in SI."""

import numpy as np

from shefex_nav.onboard.navigation.blocks import Beforehand, known_sigmas
from shefex_nav.onboard.navigation.state import NavParams
from shefex_nav.scenario import aboard, params_filter

VIBRATION_S = 0.05  # [E] its longest period, of which nothing is told


def nav_params(scenario, dt_s):
    """NavParams of a ReplayScenario whose IMU samples last dt_s: no star camera, no motors."""
    gyro, accelerometer = scenario.imu.gyro, scenario.imu.accelerometer
    integrity = params_filter.integrity_params(scenario, dt_s, coarse_if_silent=True)
    told, late_s = _beforehand(scenario), max(scenario.gnss.latency, aboard.longest_latency(scenario))
    return NavParams(
        imu=params_filter.imu_model(scenario, told, **_rounded(scenario.imu, dt_s)),
        sigma_gyro_bias=float(np.hypot(gyro.bias, gyro.in_run_bias)),
        sigma_accel_bias=float(np.hypot(accelerometer.bias, accelerometer.in_run_bias)),
        sigma_blocks=known_sigmas(scenario.navigation.states, told),
        l_ba_b=np.array(scenario.gnss.lever_arm),
        C_bc=np.eye(3),
        **params_filter.common(scenario, integrity),
        history_s=params_filter.memory_s(scenario.navigation.history + late_s, late_s, VIBRATION_S),
        vibration_period_s=VIBRATION_S,
        motors=np.zeros((0, 2)),
        aids=aboard.aids(scenario),
        lasting_share=scenario.gnss.lasting_share,
        range_bias_time_s=scenario.gnss.lasting_time,
    )


def _rounded(imu, dt_s):
    """White noise of readings that are rounded one by one, as files are: q^2/12 of each sample adds to it."""
    return {
        "gyro_random_walk": _noise(imu.gyro, dt_s),
        "gyro_quantum": 0.0,
        "accel_random_walk": _noise(imu.accelerometer, dt_s),
        "accel_quantum": 0.0,
    }


def _noise(triad, dt_s):
    """Root of a density."""
    return float(np.hypot(triad.random_walk, triad.quantum / np.sqrt(12.0 * dt_s)))


def _beforehand(scenario):
    """Beforehand of a ReplayScenario."""
    gyro, sensors = scenario.imu.gyro, scenario.navigation.sensors
    return Beforehand(
        gyro=gyro,
        accelerometer=scenario.imu.accelerometer,
        gyro_roll=gyro.scale_factor_roll,
        gyro_misalignment=gyro.misalignment,
        gravity=scenario.navigation.gravity_error,
        lever_arm=sensors.lever_arm_error,
        gps_latency=sensors.gps_latency_error,
    )
