"""What software on board is told before the flight."""

from typing import Any, NamedTuple

import numpy as np

from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.geometry.pinhole import Pinhole

SHEETS = "imu", "gps", "star_camera", "star_tracker"


class MissionData(NamedTuple):
    """What software on board is told before the flight."""

    epoch_utc: str  # ISO 8601, t = 0
    start_s: float  # mission time at which it is switched on
    earth: EarthRotation  # for `geometry.frames`
    sun_i: np.ndarray  # (3,) unit vector to the Sun
    earth_velocity_i: np.ndarray  # (3,) m/s, of the Earth relative to the solar-system barycentre
    camera: Pinhole  # as calibrated
    C_bc: np.ndarray  # (3, 3) nominal mounting, camera to body axes
    sigma_mounting: float  # rad, each axis
    l_ba_b: np.ndarray  # (3,) m, IMU to GPS antenna
    sheets: dict  # name of a section -> its settings, SI, as the computer is told them: imu, gps ...
    settings: dict[str, Any]  # what the scenario gives under `software.settings`
    scenario: str  # YAML text of all of it


def mission_data(scenario, params, earth, own_settings):
    """MissionData of a Scenario.

    params : onboard.computer.ComputerParams;  earth : EarthRotation;  own_settings : dict
    """
    from shefex_nav.scenario import aboard, params_onboard
    from shefex_nav.scenario.of_settings import settings
    from shefex_nav.scenario.told import as_told

    told = as_told(scenario)
    sheets = {name: settings(getattr(told, name)) for name in SHEETS}
    sheets |= {one.name: settings(given) for one, given in aboard.instruments(told)}
    return MissionData(
        epoch_utc=scenario.mission.epoch,
        start_s=scenario.mission.start,
        earth=earth,
        sun_i=params.sun_i,
        earth_velocity_i=params.tracker.earth_velocity_i,
        camera=params_onboard.nominal_camera(told),
        C_bc=params.nav.C_bc,
        sigma_mounting=told.star_camera.mounting.error,
        l_ba_b=params.nav.l_ba_b,
        sheets=sheets,
        settings=dict(own_settings),
        scenario=scenario.source,
    )
