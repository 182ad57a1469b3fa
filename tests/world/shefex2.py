"""SHEFEX-2 as reconstructed from public figures.

Sourced: launch time and site, length 12.6 m, propellant and thrust of the motors (S44: 33.2 kN, 282 s, 68 s;
S40: 4240 kg), take-off mass of 6.7 t, apogee 177 km, Mach 10 to 11 at the entry. Everything else is assumed
[E]. Rail elevation, payload mass and elevation of the second burn are fitted to apogee 177.0 km, range
800.0 km and a largest descent speed of 3056 m/s.
"""

from functools import lru_cache
from typing import get_args

import numpy as np

from shefex_nav.environment import gravity
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.settings import declared
from shefex_nav.world.flight import params as p
from shefex_nav.world.flight import settings as s
from shefex_nav.world.flight import tasks
from shefex_nav.world.flight.fly import fly

DEG = np.pi / 180.0
G_0 = 9.80665  # m/s^2

# Earth at 2012-06-22T19:18:00 UTC: rotation angle from UT1 (UTC - 0.58479 s), precession left out
_DAYS = 2456101.0 - 2451545.0 + (7.0 + 18.0 / 60.0) / 24.0 - 0.58479 / 86400.0
EARTH = EarthRotation(
    np.eye(3),
    np.eye(3),
    float(2.0 * np.pi * ((0.7790572732640 + 1.00273781191135448 * _DAYS) % 1.0)),
    7.292115146706979e-5,
)

SITE = s.Launch(
    latitude=69.2942 * DEG,
    longitude=16.0190 * DEG,
    height=10.0,
    azimuth=352.0 * DEG,
    elevation=86.43 * DEG,
    roll=0.0,
    rail_length=10.0,
)

MACH = np.array([0.0, 0.6, 0.9, 1.05, 1.2, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0])


def column(values):
    """Coefficients that do not depend on the angle of attack: (n,) -> (n, 1)."""
    return np.array(values, dtype=float)[:, None]


STACK = p.Aerodynamics(
    area_m2=0.80,
    diameter_m=1.01,
    fin_cant=0.365 * DEG,
    mach=MACH,
    alpha=np.zeros(1),
    axial=column([0.45, 0.45, 0.58, 0.80, 0.78, 0.68, 0.56, 0.44, 0.36, 0.32, 0.32]),
    normal_slope=column([9.0, 9.2, 10.0, 10.8, 10.5, 9.6, 8.2, 6.6, 5.2, 4.4, 4.0]),
    pressure_station_m=column([9.6, 9.6, 9.7, 9.8, 9.8, 9.6, 9.2, 8.6, 8.1, 7.9, 7.8]),
    drag=np.zeros((11, 1)),
    pitch_damping=np.full(11, -600.0),
    roll_damping=np.array([-10.2, -10.2, -11.0, -11.2, -10.5, -9.2, -7.5, -5.4, -3.7, -2.7, -2.4]),
    roll_by_cant=np.array([6.0, 6.0, 6.5, 6.6, 6.2, 5.4, 4.4, 3.2, 2.2, 1.6, 1.4]),
)

UPPER = p.Aerodynamics(
    area_m2=0.80,
    diameter_m=1.01,
    fin_cant=0.0,
    mach=MACH,
    alpha=np.zeros(1),
    axial=column([0.35, 0.35, 0.45, 0.62, 0.60, 0.52, 0.43, 0.34, 0.28, 0.25, 0.25]),
    normal_slope=column([3.2, 3.3, 3.5, 3.7, 3.6, 3.4, 3.2, 3.0, 2.8, 2.6, 2.5]),
    pressure_station_m=column([4.3, 4.3, 4.35, 4.4, 4.4, 4.35, 4.3, 4.2, 4.15, 4.1, 4.1]),
    drag=np.zeros((11, 1)),
    pitch_damping=np.full(11, -60.0),
    roll_damping=np.full(11, -0.15),
    roll_by_cant=np.zeros(11),
)


def grain(mass_kg, station_m, length_m, outer_m, inner_m):
    """A hollow cylinder that burns outwards, as 33 rows of `Propellant`."""
    left = np.linspace(0.0, mass_kg, 33)
    inner2 = outer_m**2 - (outer_m**2 - inner_m**2) * left / mass_kg
    roll = 0.5 * left * (outer_m**2 + inner2)
    pitch = left * (3.0 * (outer_m**2 + inner2) + length_m**2) / 12.0
    return p.Propellant(left, np.full(33, station_m), roll, pitch)


def part(mass, station, inertia_roll, inertia_pitch):
    return s.RigidPart(mass=mass, station=station, inertia_roll=inertia_roll, inertia_pitch=inertia_pitch)


def payload(mass, station, inertia_roll, inertia_pitch, offset=(0.0, 0.0), tilt=(0.0, 0.0)):
    return s.Payload(
        mass=mass,
        station=station,
        inertia_roll=inertia_roll,
        inertia_pitch=inertia_pitch,
        centre_of_mass_offset=offset,
        principal_axis_tilt=tilt,
    )


def nozzle(exit_area, exit_station, misalignment=(0.0, 0.0), offset=(0.0, 0.0)):
    return s.Nozzle(exit_area=exit_area, exit_station=exit_station, misalignment=misalignment, offset=offset)


def motor(mass_kg, isp_s, burn_s, exit_area_m2, exit_station_m):
    """Rise in 0.3 s, slow decline by the ratio 0.98 to 1.10, tail-off in 4 s."""
    t_s, shape = np.array([0.0, 0.3, burn_s - 4.0, burn_s]), np.array([0.0, 1.0, 0.98 / 1.10, 0.0])
    speed = isp_s * G_0
    thrust = shape * mass_kg * speed / np.trapezoid(shape, t_s)
    return p.Motor(t_s, thrust, speed, nozzle(exit_area_m2, exit_station_m))


S40 = p.Stage(
    name="S40M",
    dry=part(980.0, 9.7, 190.0, 3600.0),
    propellant=grain(4240.0, 9.2, 4.4, 0.49, 0.18),
    motor=motor(4240.0, 272.0, 56.0, 0.45, 12.6),
    t_ignition_s=0.0,
    separation=s.Separation(at=65.0, impulse=0.0, tip_off=(0.0, 0.0)),
    aerodynamics=STACK,
)
S44 = p.Stage(
    name="S44",
    dry=part(200.0, 5.5, 28.0, 75.0),
    propellant=grain(814.0, 5.3, 1.1, 0.49, 0.17),
    motor=motor(814.0, 282.0, 68.0, 0.35, 6.6),
    t_ignition_s=149.2,
    separation=None,
    aerodynamics=UPPER,
)

COLD_GAS = s.ColdGas(
    torque=(5.0, 60.0, 60.0),
    arm=(0.5, 2.0, 2.0),
    specific_impulse=68.0,
    propellant=8.0,
    period=0.02,
    dead_band_angle=(0.2 * DEG,) * 3,
    dead_band_rate=(0.1 * DEG,) * 3,
    bandwidth=1.0,
    reference=s.AttitudeReference(misalignment=0.2 * DEG, drift=10.0 * DEG / 3600.0, roll_scale_factor=20e-6),
)


def task(kind, start, end, **values):
    """A task of a class of `tasks`, from start to end, s."""
    (word,) = get_args(declared(kind)["task"][0])
    return kind(task=word, start=start, end=end, **values)


def dwell(start, end, **rates):
    """A Dwell without rates, but for those given."""
    still = {"boresight_rate": 0.0, "cross_rate": 0.0, "cross_period": None, "cross_phase": 0.0, "ramp": None}
    return task(tasks.Dwell, start, end, **still | rates)


PROGRAMME = (
    ("damping", task(tasks.Damp, 65.0, 70.0)),
    ("precession", task(tasks.Turn, 70.0, 145.0, azimuth=352.0 * DEG, elevation=8.58 * DEG, at=149.2)),
    ("despin", task(tasks.SpinTo, 222.0, 235.0, rate=0.0)),
    ("slew", task(tasks.Point, 235.0, 250.0, azimuth=115.0 * DEG, elevation=52.0 * DEG, roll=0.0)),
    ("pointing", dwell(250.0, 372.0)),
    ("entry_slew", task(tasks.AlignVelocity, 372.0, 384.0, at=405.0)),
)

# C_bc: camera x along body x, boresight along body y
C_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])

PARAMS = p.FlightParams(
    t_start_s=-10.0,
    time_limit_s=700.0,
    sample_rate_hz=400.0,
    gravity=gravity.load("egm96", 4),
    air=p.Air(np.zeros((0, 4)), 1.0),
    wind=np.zeros((0, 3)),
    start=SITE,
    C_bc=C_BC,
    imu_b=np.array([-2.2, 0.03, 0.02]),
    payload=payload(487.5, 2.6, 40.0, 420.0),
    payload_aerodynamics=None,
    stages=(S40, S44),
    spin_motors=s.SpinMotors(at=384.0, duration=2.0, torque=213.6),
    yo_yo=s.YoYo(at=219.0, mass=2.0, cord_length=5.82, radius=0.505),
    cold_gas=COLD_GAS,
    parachute=None,
    attitude=p.FLOWN,
    programme=PROGRAMME,
)
PRESCRIBED = PARAMS._replace(attitude=p.PRESCRIBED)


@lru_cache(maxsize=1)
def flown():
    """The default mission flown by cold gas with a perfect reference: (Flight, {name: Event})."""
    flight = fly(PARAMS, EARTH)
    return flight, {event.name: event for event in flight.events}


@lru_cache(maxsize=1)
def prescribed():
    """The default mission with its attitude as told: (Flight, {name: Event})."""
    flight = fly(PRESCRIBED, EARTH)
    return flight, {event.name: event for event in flight.events}
