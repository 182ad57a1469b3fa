"""SHEFEX-2 as reconstructed from public figures.

Sourced: launch time and site, length 12.6 m, propellant and thrust of the motors (S44: 33.2 kN, 282 s, 68 s;
S40: 4240 kg), take-off mass of 6.7 t, apogee 177 km, Mach 10 to 11 at the entry. Everything else is assumed
[E]. Rail elevation, payload mass and elevation of the second burn are fitted to apogee 177.0 km, range
800.0 km and a largest descent speed of 3056 m/s.
"""

from functools import lru_cache

import numpy as np

from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.world.flight.attitude_program import Program
from shefex_nav.world.flight.fly import FlightParams, LaunchSite, fly
from shefex_nav.world.flight.vehicle import Aerodynamics, Part, Stage

DEG = np.pi / 180.0

# Earth at 2012-06-22T19:18:00 UTC: rotation angle from UT1 (UTC - 0.58479 s), precession left out
_DAYS = 2456101.0 - 2451545.0 + (7.0 + 18.0 / 60.0) / 24.0 - 0.58479 / 86400.0
EARTH = EarthRotation(
    np.eye(3),
    np.eye(3),
    float(2.0 * np.pi * ((0.7790572732640 + 1.00273781191135448 * _DAYS) % 1.0)),
    7.292115146706979e-5,
)

SITE = LaunchSite(69.2942 * DEG, 16.0190 * DEG, 10.0, 352.0 * DEG, 86.43 * DEG, 0.0, 10.0)

MACH = np.array([0.0, 0.6, 0.9, 1.05, 1.2, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0])

STACK = Aerodynamics(
    area_m2=0.80,
    diameter_m=1.01,
    fin_cant=0.365 * DEG,
    mach=MACH,
    axial=np.array([0.45, 0.45, 0.58, 0.80, 0.78, 0.68, 0.56, 0.44, 0.36, 0.32, 0.32]),
    normal_slope=np.array([9.0, 9.2, 10.0, 10.8, 10.5, 9.6, 8.2, 6.6, 5.2, 4.4, 4.0]),
    pressure_station_m=np.array([9.6, 9.6, 9.7, 9.8, 9.8, 9.6, 9.2, 8.6, 8.1, 7.9, 7.8]),
    pitch_damping=np.full(11, -600.0),
    roll_damping=np.array([-10.2, -10.2, -11.0, -11.2, -10.5, -9.2, -7.5, -5.4, -3.7, -2.7, -2.4]),
    roll_by_cant=np.array([6.0, 6.0, 6.5, 6.6, 6.2, 5.4, 4.4, 3.2, 2.2, 1.6, 1.4]),
)

UPPER = Aerodynamics(
    area_m2=0.80,
    diameter_m=1.01,
    fin_cant=0.0,
    mach=MACH,
    axial=np.array([0.35, 0.35, 0.45, 0.62, 0.60, 0.52, 0.43, 0.34, 0.28, 0.25, 0.25]),
    normal_slope=np.array([3.2, 3.3, 3.5, 3.7, 3.6, 3.4, 3.2, 3.0, 2.8, 2.6, 2.5]),
    pressure_station_m=np.array([4.3, 4.3, 4.35, 4.4, 4.4, 4.35, 4.3, 4.2, 4.15, 4.1, 4.1]),
    pitch_damping=np.full(11, -60.0),
    roll_damping=np.full(11, -0.15),
    roll_by_cant=np.zeros(11),
)

PROGRAM = Program(
    separation_s=65.0,
    precession_start_s=70.0,
    precession_end_s=145.0,
    burn_azimuth=352.0 * DEG,
    burn_elevation=8.58 * DEG,
    ignition_2_s=149.2,
    despin_start_s=220.0,
    despin_end_s=235.0,
    pointing_start_s=250.0,
    boresight_azimuth=115.0 * DEG,
    boresight_elevation=52.0 * DEG,
    boresight_roll=0.0,
    residual_boresight_rate=0.2 * DEG,
    residual_cross_rate=0.1 * DEG,
    residual_period_s=20.0,
    residual_phase=0.0,
    residual_ramp_s=3.0,
    pointing_end_s=372.0,
    entry_aim_s=405.0,
    entry_slew_end_s=384.0,
    entry_spin=2.0 * np.pi,
    spin_up_end_s=394.0,
)

# C_bc: camera x along body x, boresight along body y
C_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])

PARAMS = FlightParams(
    t_start_s=-10.0,
    sample_rate_hz=400.0,
    time_limit_s=700.0,
    gravity_degree=4,
    site=SITE,
    payload=Part(487.5, 2.6, 40.0, 420.0),
    stage_1=Stage(
        dry=Part(980.0, 9.7, 190.0, 3600.0),
        propellant_mass_kg=4240.0,
        grain_station_m=9.2,
        grain_length_m=4.4,
        grain_outer_radius_m=0.49,
        grain_inner_radius_m=0.18,
        isp_vacuum_s=272.0,
        burn_time_s=56.0,
        rise_s=0.3,
        tail_off_s=4.0,
        level_ratio=0.98 / 1.10,
        exit_area_m2=0.45,
        exit_station_m=12.6,
    ),
    stage_2=Stage(
        dry=Part(200.0, 5.5, 28.0, 75.0),
        propellant_mass_kg=814.0,
        grain_station_m=5.3,
        grain_length_m=1.1,
        grain_outer_radius_m=0.49,
        grain_inner_radius_m=0.17,
        isp_vacuum_s=282.0,
        burn_time_s=68.0,
        rise_s=0.3,
        tail_off_s=4.0,
        level_ratio=0.98 / 1.10,
        exit_area_m2=0.35,
        exit_station_m=6.6,
    ),
    imu_b=np.array([-2.2, 0.03, 0.02]),
    aerodynamics_stack=STACK,
    aerodynamics_upper=UPPER,
    program=PROGRAM,
    C_bc=C_BC,
)


@lru_cache(maxsize=1)
def flown():
    """The default mission, flown once for all tests: (Trajectory, {name: Event})."""
    trajectory, events = fly(PARAMS, EARTH)
    return trajectory, {event.name: event for event in events}
