"""Replay scenario -> parameters of the navigation filter, in SI."""

import numpy as np

from shefex_nav.onboard.navigation.blocks import Beforehand, known_sigmas
from shefex_nav.onboard.navigation.hypotheses import WIDE
from shefex_nav.onboard.navigation.state import NavParams
from shefex_nav.scenario import aboard, params_filter


def nav_params(scenario, dt_s):
    """NavParams of a ReplayScenario whose IMU samples last dt_s: no star camera, motors as one."""
    gyro, accelerometer = scenario.imu.gyro, scenario.imu.accelerometer
    vibration = scenario.imu.vibration
    shaken, period_s = params_filter.at_rest(vibration, dt_s), 1.0 / vibration.lowest_frequency
    integrity = params_filter.integrity_params(scenario, dt_s, coarse_if_silent=True, shaken=shaken)
    told, late_s = _beforehand(scenario), max(scenario.gnss.latency, aboard.longest_latency(scenario))
    return NavParams(
        imu=params_filter.imu_model(scenario, told, **_of_imu(scenario.imu, dt_s)),
        sigma_gyro_bias=float(np.hypot(gyro.bias, gyro.in_run_bias)),
        sigma_accel_bias=float(np.hypot(accelerometer.bias, accelerometer.in_run_bias)),
        sigma_blocks=known_sigmas(scenario.navigation.states, told),
        l_ba_b=np.array(scenario.gnss.lever_arm),
        C_bc=np.eye(3),
        **params_filter.common(scenario, integrity),
        history_s=params_filter.memory_s(scenario.navigation.history + late_s, late_s, period_s),
        motors=np.array([[-np.inf, 1.0]] if any(vibration.boost) else []).reshape(-1, 2),
        vibration_period_s=period_s,
        swing_at_rest=params_filter.swings(vibration, vibration.coast),
        aids=aboard.aids(scenario),
        lasting_share=scenario.gnss.lasting_share,
        range_bias_time_s=scenario.gnss.lasting_time,
        starts_at_fix=_starts_at_fix(scenario.alignment),
    )


def _starts_at_fix(settings):
    """Whether the place of the start comes from fixes; of the truth, where they first find its azimuth."""
    return settings.method != "reference" or settings.azimuth > WIDE


def _of_imu(imu, dt_s):
    """Fields of ImuModel of section imu.

    White noise is of readings that are rounded one by one, as files are: q^2/12 of each sample adds to it.
    """
    return params_filter.imu_fields(imu, dt_s) | {
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
        rectified=scenario.imu.accelerometer.vibration_rectification
        * params_filter.strongest(scenario.imu.vibration) ** 2,
        gravity=scenario.navigation.gravity_error,
        lever_arm=sensors.lever_arm_error,
        gps_latency=sensors.gps_latency_error,
    )
