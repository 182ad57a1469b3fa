"""Calisto, the rocket of RocketPy's first-simulation page, in RocketPy and in this project.

Dimensions, masses, rail and site are those of RocketPy's documentation (docs/user/first_simulation.rst,
version 1.13, MIT licence); the thrust curve is that of the motor's RASP file there (Cesaroni M1670), the drag
a selection of its power-off table. Two things differ from the page, so that nothing has to be downloaded: the
forecast of the weather is the standard atmosphere with a wind that grows with height, and the airfoil of the
fins is the flat plate.
"""

import numpy as np
from rocketpy import Environment, Function, Rocket, SolidMotor
from rocketpy.mathutils.vector_matrix import Matrix

from shefex_nav.environment import gravity
from shefex_nav.environment.atmosphere import us76
from shefex_nav.world.flight import params, settings

LATITUDE, LONGITUDE, ELEVATION = 32.990254, -106.974998, 1400.0  # deg, deg, m: Spaceport America
RAIL_LENGTH, INCLINATION, HEADING = 5.2, 85.0, 0.0  # m, deg, deg
NOSE_TIP = 1.278  # m, in RocketPy's coordinate from the centre of mass without motor to the nose
THRUST = (  # s, N
    (0.0, 0.0), (0.055, 100.0), (0.092, 1500.0), (0.1, 2000.0), (0.15, 2200.0), (0.2, 1800.0), (0.5, 1950.0),
    (1.0, 2034.0), (1.5, 2000.0), (2.0, 1900.0), (2.5, 1760.0), (2.9, 1700.0), (3.0, 1650.0), (3.3, 530.0),
    (3.4, 350.0), (3.9, 0.0),
)  # fmt: skip
DRAG = (  # Mach number, coefficient of the axial force; RocketPy holds the ends constant
    (0.01, 0.334), (0.03, 0.408), (0.1, 0.402), (0.2, 0.388), (0.3, 0.382), (0.4, 0.379), (0.5, 0.381),
    (0.6, 0.389), (0.7, 0.406), (0.8, 0.401), (0.9, 0.457), (0.95, 0.527), (1.0, 0.627), (1.05, 0.728),
    (1.1, 0.712), (1.2, 0.684), (1.3, 0.656),
)  # fmt: skip
WIND = ((0.0, 2.0, 3.0), (3000.0, 4.0, 8.0), (6000.0, 5.0, 15.0))  # height m, towards north, towards east m/s


def environment(wind=True, *, our_air=False, **options):
    """Standard atmosphere, RocketPy's or ours, with the wind or calm. -> rocketpy.Environment"""
    env = Environment(latitude=LATITUDE, longitude=LONGITUDE, elevation=ELEVATION, **options)
    rows = WIND if wind else ((0.0, 0.0, 0.0), (6000.0, 0.0, 0.0))
    air = {}
    if our_air:
        heights = np.arange(0.0, 20e3, 50.0)
        values = [us76(height) for height in heights]
        air["pressure"] = [(height, value[1]) for height, value in zip(heights, values, strict=True)]
        air["temperature"] = [(height, value[2]) for height, value in zip(heights, values, strict=True)]
    env.set_atmospheric_model(
        type="custom_atmosphere",
        wind_u=[(height, east) for height, _, east in rows],
        wind_v=[(height, north) for height, north, _ in rows],
        **air,
    )
    return env


def rocket():
    """Calisto with its motor. -> rocketpy.Rocket"""
    motor = SolidMotor(
        thrust_source=[list(row) for row in THRUST],
        dry_mass=1.815,
        dry_inertia=(0.125, 0.125, 0.002),
        nozzle_radius=0.033,
        grain_number=5,
        grain_density=1815,
        grain_outer_radius=0.033,
        grain_initial_inner_radius=0.015,
        grain_initial_height=0.120,
        grain_separation=0.005,
        grains_center_of_mass_position=0.397,
        center_of_dry_mass_position=0.317,
        nozzle_position=0,
        burn_time=THRUST[-1][0],
        throat_radius=0.011,
        coordinate_system_orientation="nozzle_to_combustion_chamber",
    )
    drag = Function([list(row) for row in DRAG], interpolation="linear", extrapolation="constant")
    calisto = Rocket(
        radius=0.127 / 2,
        mass=14.426,
        inertia=(6.321, 6.321, 0.034),
        power_off_drag=drag,
        power_on_drag=drag,
        center_of_mass_without_motor=0,
        coordinate_system_orientation="tail_to_nose",
    )
    calisto.add_motor(motor, position=-1.255)
    calisto.set_rail_buttons(upper_button_position=0.0818, lower_button_position=-0.6182, angular_position=45)
    calisto.add_nose(length=0.55829, kind="von karman", position=NOSE_TIP)
    calisto.add_trapezoidal_fins(
        n=4, root_chord=0.120, tip_chord=0.060, span=0.110, position=-1.04956, cant_angle=0.5
    )
    calisto.add_tail(top_radius=0.0635, bottom_radius=0.0435, length=0.060, position=-1.194656)
    return calisto


def turn_lever_arms(calisto):
    """Let the vectors that RocketPy counts from the centre of dry mass begin there: its issue 1186, open."""
    calisto.com_to_cdm_function = -1 * calisto.com_to_cdm_function
    calisto.nozzle_to_cdm = -calisto.nozzle_to_cdm


def whole_jet_damping(calisto):
    """Gyration tensor of the exit as that of a disc: radius^2/4 + distance^2 across, radius^2/2 along."""
    radius2, distance2 = calisto.motor.nozzle_radius**2, calisto.nozzle_to_cdm**2
    across = 0.25 * radius2 + distance2
    calisto.nozzle_gyration_tensor = Matrix([[across, 0, 0], [0, across, 0], [0, 0, 0.5 * radius2]])


def steady_flow(calisto):
    """Leave out the force by which the gas in the motor changes its momentum; a measured thrust has it."""
    calisto.total_mass_flow_rate.differentiate_complex_step = lambda t: 0.0


def station(z):
    """Distance behind the nose tip of a coordinate of RocketPy, m."""
    return NOSE_TIP - z


def flight_params(calisto, *, wind=True, field="j2", damping_at_s=np.inf):
    """The same flight for this project: what RocketPy evaluates, tabulated. rocketpy.Rocket -> FlightParams

    The reference point, where the IMU would be, is RocketPy's: the centre of mass without propellant. The
    damping of pitch counts about the centre of mass at one time, `damping_at_s`; by default when burnt out.
    """
    return params.FlightParams(
        t_start_s=0.0,
        time_limit_s=300.0,
        sample_rate_hz=100.0,
        gravity=gravity.load(field),
        air=params.Air(table=np.zeros((0, 4)), density_factor=1.0),
        wind=np.array(WIND) if wind else np.zeros((0, 3)),
        start=settings.Launch(
            latitude=np.radians(LATITUDE),
            longitude=np.radians(LONGITUDE),
            height=ELEVATION,
            azimuth=np.radians(HEADING),
            elevation=np.radians(INCLINATION),
            roll=0.0,
            rail_length=_travel_on_rail(calisto),
        ),
        C_bc=np.eye(3),
        imu_b=np.array([-station(calisto.center_of_dry_mass_position), 0.0, 0.0]),
        payload=settings.Payload(
            mass=calisto.mass,
            station=station(calisto.center_of_mass_without_motor),
            inertia_roll=calisto.I_33_without_motor,
            inertia_pitch=calisto.I_11_without_motor,
            centre_of_mass_offset=(0.0, 0.0),
            principal_axis_tilt=(0.0, 0.0),
        ),
        payload_aerodynamics=None,
        stages=(_stage(calisto, damping_at_s),),
        spin_motors=None,
        yo_yo=None,
        cold_gas=None,
        parachute=None,
        attitude=params.FLOWN,
        programme=(),
    )  # fmt: skip


def _travel_on_rail(calisto):
    """How far RocketPy's rocket goes before its upper button leaves the rail, m."""
    buttons = calisto.rail_buttons[0]
    upper = buttons.position.z + buttons.component.buttons_distance
    return RAIL_LENGTH - abs(calisto.nozzle_position - upper)


def _stage(calisto, damping_at_s):
    motor = calisto.motor
    t_s, thrust = np.array(THRUST).T
    burn = np.linspace(t_s[0], t_s[-1], 200)
    left = np.array([motor.propellant_mass(t) for t in burn])
    keep = np.append(left[:-1] > left[1:] + 1e-6, True)  # strictly less and less, down to the empty motor
    burn, left = burn[keep][::-1], left[keep][::-1]
    left[0] = 0.0
    propellant = params.Propellant(
        mass_kg=left,
        station_m=np.array([station(calisto.center_of_propellant_position(t)) for t in burn]),
        inertia_roll=np.array([motor.propellant_I_33(t) for t in burn]),
        inertia_pitch=np.array([motor.propellant_I_11(t) for t in burn]),
    )
    dry = settings.RigidPart(
        mass=motor.dry_mass,
        station=station(calisto.motor_center_of_dry_mass_position),
        inertia_roll=motor.dry_I_33,
        inertia_pitch=motor.dry_I_11,
    )
    impulse = np.trapezoid(thrust, t_s)
    return params.Stage(
        name="M1670",
        dry=dry,
        propellant=propellant,
        motor=params.Motor(
            t_s=t_s,
            vacuum_thrust_n=thrust,
            exhaust_speed=impulse / left[-1],
            nozzle=settings.Nozzle(
                exit_area=0.0,  # RocketPy's thrust does not depend on the pressure of the air
                exit_station=station(calisto.nozzle_position),
                misalignment=(0.0, 0.0),
                offset=(0.0, 0.0),
            ),
        ),
        t_ignition_s=0.0,
        separation=None,
        aerodynamics=_aerodynamics(calisto, damping_at_s),
    )


def _aerodynamics(calisto, damping_at_s):
    """Sum over nose, fins and tail, each with a lift proportional to the angle of attack, as in RocketPy."""
    mach = np.unique(np.concatenate([np.linspace(0.0, 1.3, 66), [row[0] for row in DRAG]]))
    alpha = np.linspace(0.0, 3.0, 61)
    surfaces = [surface for surface, _ in calisto.aerodynamic_surfaces]
    places = [_pressure_station(calisto, surface) for surface in surfaces]
    slopes = np.array([[surface.clalpha(m) for m in mach] for surface in surfaces])
    slope = slopes.sum(axis=0)
    pressure = np.array(places) @ slopes / slope
    by_sine = alpha / np.where(alpha > 0.0, np.sin(alpha), 1.0)
    by_sine[0] = 1.0
    d = 2.0 * calisto.radius
    centre = station(calisto.center_of_mass(min(damping_at_s, THRUST[-1][0])))
    arms = (np.array(places) - centre) / d
    forcing, damping, cant = calisto.fins[0].roll_parameters
    drag = np.interp(mach, *np.array(DRAG).T)
    across = np.ones(len(alpha))
    return params.Aerodynamics(
        area_m2=calisto.area,
        diameter_m=d,
        fin_cant=cant,
        mach=mach,
        alpha=alpha,
        axial=np.outer(drag, across),
        normal_slope=np.outer(slope, by_sine),
        pressure_station_m=np.outer(pressure, across),
        drag=np.zeros((len(mach), len(alpha))),
        pitch_damping=-2.0 * (arms**2) @ slopes,  # force at l: slope times omega l / V; for omega d / (2 V)
        roll_damping=-np.array([damping(m) for m in mach]),
        roll_by_cant=np.array([forcing(m) for m in mach]),
    )


def _pressure_station(calisto, surface):
    """Station of a surface's centre of pressure, m."""
    from_dry = calisto.surfaces_cp_to_cdm[surface].z
    return station(calisto.center_of_dry_mass_position + from_dry)
