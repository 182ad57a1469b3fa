"""Everything that decides a flight, as data: where it starts, what flies, what it is told to do.

Places along the roll axis are stations: distance behind the nose tip, m. Body axes: x along the roll axis to
the nose. Times are mission times in seconds.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.world.flight.settings import (
    ColdGas,
    Ground,
    Launch,
    Nozzle,
    Orbit,
    Parachute,
    Payload,
    RigidPart,
    Separation,
    SpinMotors,
    YoYo,
)

FLOWN, PRESCRIBED = 0, 1  # attitude by the cold-gas system, or as the programme says


class Propellant(NamedTuple):
    """Propellant of a motor by what is left of it, n rows from empty to full; linear in between."""

    mass_kg: np.ndarray  # (n,) left, from 0
    station_m: np.ndarray  # (n,) its centre of mass
    inertia_roll: np.ndarray  # (n,) kg m^2
    inertia_pitch: np.ndarray  # (n,) kg m^2, about its own centre of mass


class Motor(NamedTuple):
    """Vacuum thrust over the time since ignition, a broken line of area propellant times exhaust speed."""

    t_s: np.ndarray  # (m,) increasing from 0
    vacuum_thrust_n: np.ndarray  # (m,)
    exhaust_speed: float  # m/s, thrust in vacuum per mass flow
    nozzle: Nozzle


class Aerodynamics(NamedTuple):
    """Coefficients of one configuration, all to the same reference area and diameter.

    n Mach numbers, k total angles of attack; k = 1: C_A cos(alpha) |cos(alpha)| and C_N' sin(alpha) hold.
    """

    area_m2: float
    diameter_m: float
    fin_cant: float  # rad
    mach: np.ndarray  # (n,) increasing
    alpha: np.ndarray  # (k,) rad, increasing from 0
    axial: np.ndarray  # (n, k) C_A
    normal_slope: np.ndarray  # (n, k) C_N / sin(alpha)
    pressure_station_m: np.ndarray  # (n, k) centre of pressure
    drag: np.ndarray  # (n, k) C_D along the air velocity, added to the above; spheres, satellites
    pitch_damping: np.ndarray  # (n,) C_mq + C_m,alpha-dot for omega d/(2V), negative
    roll_damping: np.ndarray  # (n,) C_lp for omega d/(2V), negative
    roll_by_cant: np.ndarray  # (n,) dC_l/d(fin cant), 1/rad


class Spent(NamedTuple):
    """Drag of a stage that falls empty, over n Mach numbers, to a reference area."""

    area_m2: float
    mach: np.ndarray  # (n,) increasing
    drag: np.ndarray  # (n,) C_D, however it turns


class Stage(NamedTuple):
    """A stage with a solid motor."""

    name: str
    dry: RigidPart
    propellant: Propellant
    motor: Motor
    t_ignition_s: float
    separation: Separation | None  # None: stays attached
    aerodynamics: Aerodynamics  # while this stage is the lowest one attached
    spent: Spent | None = None  # None: the drag of the empty stage is not known

    @property
    def drops_at(self):
        """Time, s; inf: it stays attached."""
        return np.inf if self.separation is None else self.separation.at


class Air(NamedTuple):
    """The air: a table, or the US Standard Atmosphere 1976 where the table is empty."""

    table: np.ndarray  # (n, 4) height m, ln(density), ln(pressure), speed of sound m/s; (0, 4): US76
    density_factor: float


class FlightParams(NamedTuple):
    """Everything that decides the flight."""

    t_start_s: float  # at most 0 for a launch; lift-off is at 0
    time_limit_s: float
    sample_rate_hz: float  # of the IMU
    gravity: tuple  # environment.gravity.GravityModel
    air: Air
    wind: np.ndarray  # (m, 1 + 2 k) height m, then north m/s, east m/s at each of the times; (0, 3): none
    start: Launch | Ground | Orbit
    C_bc: np.ndarray  # (3, 3) nominal mounting of the star camera
    imu_b: np.ndarray  # (3,) m, IMU from the nose tip, body axes
    payload: Payload
    payload_aerodynamics: Aerodynamics | None  # once every stage is gone; None: some stage stays
    stages: tuple  # of Stage, in order of burning
    spin_motors: SpinMotors | None
    yo_yo: YoYo | None
    cold_gas: ColdGas | None
    parachute: Parachute | None
    attitude: int  # FLOWN or PRESCRIBED
    programme: tuple  # of (name, one of `tasks`) in order of time
    wind_times: tuple = (0.0,)  # (k,) s, increasing; one: the same wind always
