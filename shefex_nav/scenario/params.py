"""Sections of a scenario -> the parameters of the stages, in SI.

One function for each stage of the world; that of the GPS receiver is in `params_gps`, those of the flight
software are in `params_onboard`. A stage is
imported when its parameters are asked for: checking a scenario must not wait for compiled kernels.
"""

import math

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.scenario.of_settings import settings


def flight_params(scenario):
    """FlightParams of a scenario."""
    from shefex_nav.environment import gravity
    from shefex_nav.scenario import params_vehicle
    from shefex_nav.world.flight import params as flight

    vehicle, payload = scenario.vehicle, scenario.vehicle.payload
    site = scenario.orbit or scenario.launch or scenario.ground
    return flight.FlightParams(
        t_start_s=scenario.mission.start,
        time_limit_s=scenario.mission.time_limit,
        sample_rate_hz=float(IMU_HZ),
        gravity=gravity.load(scenario.earth.gravity, scenario.earth.gravity_degree),
        air=flight.Air(air_table(scenario), scenario.atmosphere.density),
        wind=wind(scenario.wind),
        start=settings(site),
        C_bc=mounting(scenario),
        imu_b=np.array(vehicle.imu),
        payload=params_vehicle.part(payload),
        offset_m=np.array(payload.centre_of_mass_offset),
        tilt=np.array(payload.principal_axis_tilt),
        payload_aerodynamics=params_vehicle.aerodynamics(payload.aerodynamics),
        stages=tuple(params_vehicle.stage(name, stage) for name, stage in vehicle.stages.items()),
        spin_motors=_device(vehicle.spin_motors),
        yo_yo=_device(vehicle.yo_yo),
        cold_gas=_device(vehicle.cold_gas),
        parachute=_device(vehicle.parachute),
        attitude=flight.FLOWN if scenario.attitude == "flown" else flight.PRESCRIBED,
        programme=tuple(params_vehicle.task(name, task) for name, task in scenario.tasks),
    )


def _device(block):
    return None if block is None else settings(block)


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
    """Nominal C_bc of the star camera (3, 3), its axes as columns."""
    return settings(scenario.star_camera.mounting).C_bc


def star_camera(scenario):
    """StarCamera, the settings of the camera of a scenario."""
    return settings(scenario.star_camera)
