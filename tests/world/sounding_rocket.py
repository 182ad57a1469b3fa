"""Small vehicles for tests, all assumed: a sounding rocket of one stage, a satellite, a box that stands."""

from dataclasses import replace

import numpy as np
from shefex2 import C_BC, COLD_GAS, DEG, MACH, PARAMS, STACK, column, grain, motor, part, payload

from shefex_nav.environment import gravity
from shefex_nav.world.flight import params as p
from shefex_nav.world.flight import settings as s

ROCKET_AERO = STACK._replace(
    area_m2=0.0995,
    diameter_m=0.356,
    fin_cant=0.1 * DEG,
    axial=0.6 * STACK.axial,
    pressure_station_m=np.full((11, 1), 4.7),
)
PAYLOAD_AERO = p.Aerodynamics(
    area_m2=0.0995,
    diameter_m=0.356,
    fin_cant=0.0,
    mach=MACH,
    alpha=np.zeros(1),
    axial=np.full((11, 1), 0.6),
    normal_slope=np.full((11, 1), 2.0),
    pressure_station_m=np.full((11, 1), 1.4),
    drag=column(np.full(11, 0.1)),
    pitch_damping=np.full(11, -30.0),
    roll_damping=np.full(11, -0.1),
    roll_by_cant=np.zeros(11),
)
STAGE = p.Stage(
    name="motor",
    dry=part(150.0, 3.9, 4.0, 130.0),
    propellant=grain(290.0, 3.9, 2.8, 0.17, 0.06),
    motor=motor(290.0, 235.0, 26.0, 0.06, 5.6),
    t_ignition_s=0.0,
    separation=None,
    aerodynamics=ROCKET_AERO,
)
GAS = replace(COLD_GAS, torque=(1.0, 8.0, 8.0), arm=(0.17, 1.0, 1.0), propellant=1.0)
ROCKET = PARAMS._replace(
    t_start_s=-1.0,
    time_limit_s=1500.0,
    sample_rate_hz=100.0,
    gravity=gravity.load("j2"),
    start=s.Launch(
        latitude=67.89 * DEG,
        longitude=21.1 * DEG,
        height=300.0,
        azimuth=350.0 * DEG,
        elevation=86.0 * DEG,
        roll=0.3,
        rail_length=8.0,
    ),
    imu_b=np.array([-1.0, 0.02, -0.03]),
    payload=payload(95.0, 1.2, 1.3, 42.0),
    payload_aerodynamics=PAYLOAD_AERO,
    stages=(STAGE,),
    spin_motors=None,
    yo_yo=None,
    cold_gas=GAS,
    parachute=s.Parachute(height=4000.0, at=None, drag_area=20.0, inflation=2.0, station=0.3),
    programme=(),
)
SATELLITE = PARAMS._replace(
    t_start_s=0.0,
    time_limit_s=600.0,
    sample_rate_hz=10.0,
    gravity=gravity.load("point"),
    air=p.Air(np.zeros((0, 4)), 0.0),
    start=s.Orbit(
        perigee_height=400e3,
        apogee_height=900e3,
        inclination=63.0 * DEG,
        node=40.0 * DEG,
        perigee=70.0 * DEG,
        anomaly=20.0 * DEG,
    ),
    C_bc=C_BC,
    imu_b=np.array([-0.4, 0.1, 0.05]),
    payload=payload(80.0, 0.5, 8.0, 11.0),
    payload_aerodynamics=PAYLOAD_AERO,
    stages=(),
    spin_motors=None,
    yo_yo=None,
    cold_gas=replace(
        GAS, torque=(0.05,) * 3, arm=(0.3,) * 3, bandwidth=0.1, dead_band_rate=(0.05 * DEG,) * 3
    ),
    programme=(),
)
BOX = SATELLITE._replace(
    time_limit_s=20.0,
    sample_rate_hz=100.0,
    start=s.Ground(
        latitude=48.0 * DEG,
        longitude=11.0 * DEG,
        height=500.0,
        azimuth=90.0 * DEG,
        elevation=30.0 * DEG,
        roll=0.0,
    ),
    cold_gas=None,
)
