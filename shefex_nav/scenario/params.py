"""Sections of a scenario -> the parameters of the flight, in SI.

Those of the flight software are in `params_onboard`; the settings of a sensor are those of its section.
"""

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.scenario import surroundings, thrust
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.vehicle import Grain
from shefex_nav.world.flight import params as flight

GRAIN_ROWS = 101  # a grain between them is linear to 1e-5 of its inertia


def flight_params(scenario):
    """FlightParams of a scenario."""
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
        payload_aerodynamics=aerodynamics(payload.aerodynamics),
        stages=tuple(stage(name, one) for name, one in vehicle.stages.items()),
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


def almanac(scenario):
    """yuma.Almanac of the section `gps.almanac`."""
    from shefex_nav.environment import yuma

    return yuma.almanac({name: getattr(scenario.gps.almanac, name) for name in yuma.Almanac._fields})


def stage(name, block):
    """flight.Stage of a stage."""
    return flight.Stage(
        name=name,
        dry=settings(block.dry),
        propellant=propellant(block.propellant),
        motor=motor(block.motor, block.propellant.mass),
        t_ignition_s=block.ignition,
        separation=None if block.separation is None else settings(block.separation),
        aerodynamics=aerodynamics(block.aerodynamics),
        spent=None if block.spent is None else spent(block.spent),
    )


def spent(block):
    """flight.Spent of the drag of an empty stage."""
    return flight.Spent(block.area, np.array(block.mach), np.array(block.drag))


def propellant(block):
    """flight.Propellant, from empty to full.

    The hollow cylinder burns outwards: outer radius, length and middle stay, the inner radius grows. A table
    is linear between its rows; more rows between them let what is made of it, the inertia of the whole
    vehicle, be as right as the table.
    """
    left = np.linspace(0.0, 1.0, GRAIN_ROWS)
    if isinstance(block, Grain):
        outer2, inner2 = block.outer_radius**2, block.inner_radius**2
        inner2 = outer2 - (outer2 - inner2) * left
        roll = 0.5 * block.mass * left * (outer2 + inner2)
        pitch = block.mass * left * (3.0 * (outer2 + inner2) + block.length**2) / 12.0
        return flight.Propellant(block.mass * left, np.full(GRAIN_ROWS, block.station), roll, pitch)
    table = block.table
    burnt = np.clip(table.burnt, 0.0, 1.0)
    burnt[[0, -1]] = 0.0, 1.0  # but for rounding of the percents they are
    given = 1.0 - burnt[::-1]
    left = np.union1d(left, given)
    columns = (table.station, table.inertia_roll, table.inertia_pitch)
    return flight.Propellant(block.mass * left, *(np.interp(left, given, column[::-1]) for column in columns))


def motor(block, propellant_mass):
    """flight.Motor; see `thrust.vacuum_curve` for how impulse and propellant are made to agree."""
    curve = thrust.vacuum_curve(block, propellant_mass)
    return flight.Motor(
        t_s=np.array(curve.t_s),
        vacuum_thrust_n=np.array(curve.thrust_n),
        exhaust_speed=curve.exhaust_speed,
        nozzle=settings(block),
    )


def aerodynamics(block):
    """flight.Aerodynamics, None for None.

    Where the damping has Mach numbers of its own, every column is taken to the union of both, between whose
    rows all of them are linear.
    """
    if block is None:
        return None
    own = np.array(block.mach)
    damping = own if block.damping_mach is None else np.array(block.damping_mach)
    mach = np.union1d(own, damping)

    def grid(values):
        lists = np.atleast_2d(np.array(values, dtype=float))  # (k, n)
        return np.column_stack([np.interp(mach, own, row) for row in lists])

    def row(values):
        return np.interp(mach, damping, np.zeros_like(damping) if values is None else values)

    return flight.Aerodynamics(
        area_m2=block.area,
        diameter_m=block.diameter,
        fin_cant=block.fin_cant,
        mach=mach,
        alpha=np.zeros(1) if block.angle_of_attack is None else np.array(block.angle_of_attack),
        axial=block.axial_factor * grid(block.axial),
        normal_slope=block.normal_factor * grid(block.normal_slope),
        pressure_station_m=grid(block.pressure_station),
        drag=np.zeros_like(grid(block.axial)) if block.drag is None else grid(block.drag),
        pitch_damping=row(block.pitch_damping),
        roll_damping=row(block.roll_damping),
        roll_by_cant=row(block.roll_by_cant),
    )
