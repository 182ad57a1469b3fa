"""What software on board is told before the flight."""

from typing import Any, NamedTuple

from shefex_nav.fields import matrix, number, text, vector
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.geometry.pinhole import Pinhole

SHEETS = "imu", "gps", "star_camera", "star_tracker"


class MissionData(NamedTuple):
    """What software on board is told before the flight."""

    epoch_utc: text("ISO 8601, mission time 0")
    start_s: number("s", "mission time at which it is switched on")
    earth: EarthRotation  # for `geometry.frames`
    sun_i: vector("", "unit vector to the apparent Sun (aberrated by the Earth), inertial axes")
    earth_velocity_i: vector("m/s", "of the Earth relative to the solar-system barycentre")
    camera: Pinhole  # as calibrated
    C_bc: matrix("", "nominal mounting, camera to body axes")
    sigma_mounting: number("rad", "of that, each axis")
    l_ba_b: vector("m", "IMU to GPS antenna, body axes")
    sheets: dict  # name of a section -> its settings, SI, as the computer is told them: imu, gps ...
    settings: dict[str, Any]  # what the scenario gives under `software.settings`
    scenario: text("YAML text of all of it")


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
