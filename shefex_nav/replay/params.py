"""Replay scenario -> parameters of the navigation filter, in SI; what software of a user's own is told."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from shefex_nav.environment import ephemeris
from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.onboard.navigation.blocks import Beforehand, known_sigmas
from shefex_nav.onboard.navigation.hypotheses import WIDE
from shefex_nav.onboard.navigation.state import NavParams
from shefex_nav.onboard.own_navigation import OwnNavigation
from shefex_nav.scenario import aboard, params_filter, software
from shefex_nav.scenario.of_settings import settings
from shefex_nav.software import flown
from shefex_nav.software.mission import MissionData

NO_CAMERA = pinhole(1, 1, 1.0)


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


def _starts_at_fix(alignment):
    """Whether the place of the start comes from fixes; of the truth, where they first find its azimuth."""
    return alignment.method != "reference" or alignment.azimuth > WIDE


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


@dataclass(frozen=True)
class ImuSheet:
    """Data sheet of the inertial sensors, as far as the replay scenario gives it."""

    gyro: Any
    accelerometer: Any


@dataclass(frozen=True)
class GnssSheet:
    """What the replay scenario says of the fixes."""

    lever_arm: np.ndarray  # (3,) m
    latency: float  # s


def navigation(scenario, alignment, earth):
    """OwnNavigation of a ReplayScenario at the alignment; None: the built-in filter navigates."""
    own = software.own(scenario.navigation)
    if own is None:
        return None
    mission = mission_data(scenario, alignment, earth, own.settings)
    return flown.started(OwnNavigation, own, alignment, mission, scenario.requirements)


def mission_data(scenario, alignment, earth, own_settings):
    """MissionData of a ReplayScenario: no camera, and sheets of the sensors that it describes.

    alignment : Alignment;  earth : EarthRotation;  own_settings : dict
    """
    bodies = ephemeris.sky_bodies(scenario.mission.epoch)
    l_ba_b = np.array(scenario.gnss.lever_arm)
    imu = ImuSheet(settings(scenario.imu.gyro), settings(scenario.imu.accelerometer))
    sheets = {"imu": imu, "gps": GnssSheet(l_ba_b, scenario.gnss.latency)}
    sheets |= {one.name: settings(given) for one, given in aboard.instruments(scenario)}
    return MissionData(
        epoch_utc=scenario.mission.epoch,
        start_s=alignment.t_valid_s,
        earth=earth,
        sun_i=ephemeris.apparent_sun(bodies),
        earth_velocity_i=bodies.earth_v_i,
        camera=NO_CAMERA,
        C_bc=np.eye(3),
        sigma_mounting=0.0,
        l_ba_b=l_ba_b,
        sheets=sheets,
        settings=dict(own_settings),
        scenario=scenario.source,
    )
