"""Navigation software of a user's own over external data."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from shefex_nav.environment import ephemeris
from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.onboard.own_navigation import OwnNavigation
from shefex_nav.scenario import aboard, software
from shefex_nav.scenario.of_settings import settings
from shefex_nav.software import flown
from shefex_nav.software.mission import MissionData

NO_CAMERA = pinhole(1, 1, 1.0)


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
