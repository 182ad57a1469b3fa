"""Sections of a scenario -> the parameters of the stages, in SI.

One function for each stage of the world; those of the flight software are in `params_onboard`. A stage is
imported when its parameters are asked for: checking a scenario must not wait for compiled kernels.
"""

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.scenario.of_settings import settings


def flight_params(scenario):
    """FlightParams of a scenario."""
    from shefex_nav.scenario import params_vehicle, surroundings
    from shefex_nav.world.flight import params as flight

    vehicle, payload = scenario.vehicle, scenario.vehicle.payload
    site = scenario.orbit or scenario.launch or scenario.ground
    wind, wind_times = surroundings.wind(scenario)
    return flight.FlightParams(
        t_start_s=scenario.mission.start,
        time_limit_s=scenario.mission.time_limit,
        sample_rate_hz=float(IMU_HZ),
        gravity=surroundings.gravity(scenario),
        air=flight.Air(surroundings.air(scenario), scenario.atmosphere.density),
        wind=wind,
        start=settings(site),
        C_bc=mounting(scenario),
        imu_b=np.array(vehicle.imu),
        payload=settings(payload),
        payload_aerodynamics=params_vehicle.aerodynamics(payload.aerodynamics),
        stages=tuple(params_vehicle.stage(name, stage) for name, stage in vehicle.stages.items()),
        spin_motors=_device(vehicle.spin_motors),
        yo_yo=_device(vehicle.yo_yo),
        cold_gas=_device(vehicle.cold_gas),
        parachute=_device(vehicle.parachute),
        attitude=flight.FLOWN if scenario.attitude == "flown" else flight.PRESCRIBED,
        programme=tuple((name, settings(task)) for name, task in scenario.tasks),
        wind_times=wind_times,
    )


def _device(block):
    return None if block is None else settings(block)


def mounting(scenario):
    """Nominal C_bc of the star camera (3, 3), its axes as columns."""
    return settings(scenario.star_camera.mounting).C_bc


def star_camera(scenario):
    """StarCamera, the settings of the camera of a scenario."""
    return settings(scenario.star_camera)


# ----------------------------------------------------------------------------------------------------------
# The section `gps` of a scenario -> the settings of the simulated receiver, and its satellites.


def receiver(scenario):
    """gps_settings.Gps of a scenario."""
    return settings(scenario.gps)


def clock(scenario):
    """gps_settings.Clock of a scenario."""
    return settings(scenario.gps.clock)


def almanac(scenario):
    """yuma.Almanac of the section `gps.almanac`."""
    from shefex_nav.environment import yuma

    return yuma.almanac({name: getattr(scenario.gps.almanac, name) for name in yuma.Almanac._fields})
