"""Vehicle, programme, start, air and wind of a scenario as the flight gets them, in SI."""

import math
from pathlib import Path

import numpy as np
import pytest

from shefex_nav.environment import ephemeris, gravity
from shefex_nav.scenario import params, surroundings
from shefex_nav.scenario.checks_flight import possible_events
from shefex_nav.scenario.load import load
from shefex_nav.world.flight import params as flight
from shefex_nav.world.flight import tasks

DEFAULT = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"
DEG = math.pi / 180.0
G = 9.80665  # m/s^2
NO_FLIGHT = ["gps.outages=[]", "programme=null", "programme={}", "vehicle.stages=null", "vehicle.stages={}"]
NO_FLIGHT += ["imu.vibration.boost=[]", "launch=null"]
BODY = (
    "vehicle.payload.aerodynamics={area: 0.1 m2, diameter: 0.36 m, mach: [0, 30], axial: [0, 0], "
    "normal_slope: [0, 0], pressure_station: [0.2 m, 0.2 m], drag: [2.2, 2.2], pitch_damping: [0, 0], "
    "roll_damping: [0, 0]}"
)
ORBIT = (
    "orbit={perigee_height: 500 km, apogee_height: 520 km, inclination: 97 deg, node: 40 deg, "
    "perigee: 20 deg, anomaly: 70 deg}"
)


@pytest.fixture(scope="module")
def scenario():
    return load(DEFAULT)


@pytest.fixture(scope="module")
def default(scenario):
    return params.flight_params(scenario)


def first_stage(*overrides):
    """The first stage of the default vehicle with overrides of its own keys."""
    scenario = load(DEFAULT, [f"vehicle.stages.S40M.{text}" for text in overrides])
    return params.flight_params(scenario).stages[0]


def test_default_flight(default):
    assert default.sample_rate_hz == 400.0
    assert default.start.azimuth == pytest.approx(352.0 * DEG)
    assert default.start.rail_length == 10.0
    assert [stage.name for stage in default.stages] == ["S40M", "S44"]
    assert default.stages[1].dry.mass == 200.0
    assert [stage.drops_at for stage in default.stages] == [65.0, math.inf]
    assert default.payload_aerodynamics is None
    assert default.parachute is None
    assert default.attitude == flight.FLOWN
    assert (default.air.table.shape, default.air.density_factor) == ((0, 4), 1.0)
    np.testing.assert_allclose(default.imu_b, [-2.2, 0.03, 0.02])
    assert default.payload.centre_of_mass_offset == (0.0, 0.0)


def test_motor_by_its_shape(default):
    """Area under the thrust: propellant times exhaust speed."""
    motor = default.stages[1].motor
    np.testing.assert_allclose(motor.t_s, [0.0, 0.3, 64.0, 68.0])
    assert motor.exhaust_speed == pytest.approx(282.0 * G)
    assert np.trapezoid(motor.vacuum_thrust_n, motor.t_s) == pytest.approx(814.0 * 282.0 * G)
    assert motor.vacuum_thrust_n[2] / motor.vacuum_thrust_n[1] == pytest.approx(0.891)


def test_thrust_factor_takes_the_exhaust_speed_along(default):
    """More impulse from the same propellant in the same time."""
    nominal, strong = default.stages[0].motor, first_stage("motor.thrust_factor=103 %").motor
    np.testing.assert_allclose(strong.vacuum_thrust_n, 1.03 * nominal.vacuum_thrust_n)
    assert strong.exhaust_speed == pytest.approx(1.03 * nominal.exhaust_speed)
    np.testing.assert_array_equal(strong.t_s, nominal.t_s)
    used = np.trapezoid(strong.vacuum_thrust_n, strong.t_s) / strong.exhaust_speed
    assert used == pytest.approx(4240.0)


def test_imperfections():
    stage = first_stage(
        "motor.misalignment=[0.1 deg, -0.2 deg]",
        "motor.offset=[1 mm, 2 mm]",
        "separation.impulse=300 N s",
        "separation.tip_off=[1 deg/s, 2 deg/s]",
        "aerodynamics.axial_factor=110 %",
        "aerodynamics.normal_factor=90 %",
    )
    np.testing.assert_allclose(stage.motor.nozzle.misalignment, [0.1 * DEG, -0.2 * DEG])
    np.testing.assert_allclose(stage.motor.nozzle.offset, [1e-3, 2e-3])
    assert stage.separation.impulse == 300.0
    np.testing.assert_allclose(stage.separation.tip_off, [DEG, 2.0 * DEG])
    assert stage.aerodynamics.axial[0, 0] == pytest.approx(1.1 * 0.45)
    assert stage.aerodynamics.normal_slope[0, 0] == pytest.approx(0.9 * 9.0)
    whole = load(
        DEFAULT,
        [
            "vehicle.payload.centre_of_mass_offset=[1 mm, 2 mm]",
            "vehicle.payload.principal_axis_tilt=[1 deg, 2 deg]",
        ],
    )
    np.testing.assert_allclose(params.flight_params(whole).payload.centre_of_mass_offset, [1e-3, 2e-3])
    np.testing.assert_allclose(params.flight_params(whole).payload.principal_axis_tilt, [DEG, 2.0 * DEG])


def test_grain_is_a_hollow_cylinder_that_burns_outwards(default):
    """Mass, and moments of inertia of a hollow cylinder of the same density, at rows and between."""
    grain = default.stages[0].propellant
    outer, inner, length, full = 0.49, 0.18, 4.4, 4240.0
    density = full / (math.pi * (outer**2 - inner**2) * length)
    assert (grain.mass_kg[0], grain.mass_kg[-1]) == (0.0, pytest.approx(full))
    for left in (0.0, 1234.5, 3000.0, full):
        hole = math.sqrt(max(0.0, outer**2 - left / (math.pi * density * length)))
        roll = 0.5 * math.pi * density * length * (outer**4 - hole**4)
        pitch = 0.5 * roll + left * length**2 / 12.0
        assert np.interp(left, grain.mass_kg, grain.inertia_roll) == pytest.approx(
            roll, abs=1e-4 * full * outer**2
        )
        assert np.interp(left, grain.mass_kg, grain.inertia_pitch) == pytest.approx(pitch, abs=1e-2)
    np.testing.assert_array_equal(grain.station_m, np.full(len(grain.station_m), 9.2))


def test_propellant_by_a_table():
    """From empty to full, linear between the shares that are given; the shares are kept."""
    stage = first_stage(
        *(f"propellant.{key}=null" for key in ("station", "length", "outer_radius", "inner_radius")),
        "propellant.table={burnt: [0 %, 30.3 %, 100 %], station: [9 m, 9.5 m, 9.1 m], "
        "inertia_roll: [500 kg m2, 400 kg m2, 0 kg m2], inertia_pitch: [7000 kg m2, 5000 kg m2, 0 kg m2]}",
    )
    grain = stage.propellant
    assert np.all(np.diff(grain.mass_kg) > 0.0)
    row = np.argmin(np.abs(grain.mass_kg - 0.697 * 4240.0))
    assert grain.mass_kg[row] == pytest.approx(0.697 * 4240.0)
    assert (grain.station_m[row], grain.inertia_roll[row], grain.inertia_pitch[row]) == (9.5, 400.0, 5000.0)
    assert (grain.mass_kg[0], grain.station_m[0], grain.inertia_roll[0]) == (0.0, 9.1, 0.0)
    assert (grain.mass_kg[-1], grain.station_m[-1], grain.inertia_roll[-1]) == (4240.0, 9.0, 500.0)
    middle = np.interp(0.5 * 0.697 * 4240.0, grain.mass_kg, grain.inertia_roll)
    assert middle == pytest.approx(200.0)


def test_coefficients_over_angle_and_mach():
    aero = first_stage(
        "aerodynamics.mach=[0, 2, 5]",
        "aerodynamics.angle_of_attack=[0 deg, 30 deg]",
        "aerodynamics.axial=[[1, 2, 3], [4, 5, 6]]",
        "aerodynamics.normal_slope=[[1, 2, 3], [4, 5, 6]]",
        "aerodynamics.pressure_station=[[1 m, 2 m, 3 m], [4 m, 5 m, 6 m]]",
        "aerodynamics.damping_mach=[0, 1, 5]",
        "aerodynamics.pitch_damping=[-1, -2, -6]",
        "aerodynamics.roll_damping=[-1, -1, -1]",
        "aerodynamics.roll_by_cant=[1, 1, 1]",
    ).aerodynamics
    np.testing.assert_allclose(aero.mach, [0, 1, 2, 5])
    np.testing.assert_allclose(aero.alpha, [0.0, 30.0 * DEG])
    np.testing.assert_allclose(aero.axial, [[1, 4], [1.5, 4.5], [2, 5], [3, 6]])
    np.testing.assert_allclose(aero.pressure_station_m[2], [2, 5])
    np.testing.assert_allclose(aero.pitch_damping, [-1, -2, -3, -6])
    assert aero.drag.shape == (4, 2)


def test_programme(default):
    (name, damp), *others = default.programme
    turn, spin, point, dwell, align = (task for _, task in others)
    assert isinstance(damp, tasks.Damp) and (name, damp.start, damp.end) == ("damping", 65.0, 70.0)
    assert isinstance(turn, tasks.Turn) and turn.level_at == 149.2
    assert turn.elevation == pytest.approx(8.58 * DEG)
    assert isinstance(spin, tasks.SpinTo) and spin.rate == 0.0
    assert isinstance(point, tasks.Point) and point.azimuth == pytest.approx(115.0 * DEG)
    assert isinstance(dwell, tasks.Dwell) and dwell.boresight_rate == dwell.cross_rate == 0.0
    assert isinstance(align, tasks.AlignVelocity) and align.at == 405.0
    other = load(
        DEFAULT,
        [
            "programme.precession.at=null",
            "programme.pointing.cross_rate=0.1 deg/s",
            "programme.pointing.cross_period=20 s",
            "programme.pointing.ramp=3 s",
            "programme.despin={task: hold, from: 222 s, until: 235 s}",
        ],
    )
    _, turn, hold, _, dwell, _ = (task for _, task in params.flight_params(other).programme)
    assert turn.level_at == 145.0
    assert isinstance(hold, tasks.Hold)
    assert (dwell.cross_rate, dwell.cross_period, dwell.ramp) == (pytest.approx(0.1 * DEG), 20.0, 3.0)


def test_devices(default):
    assert (default.spin_motors.at, default.spin_motors.duration) == (384.0, 2.0)
    assert default.yo_yo.at == 219.0
    assert default.cold_gas.period == pytest.approx(0.02)
    assert len(default.cold_gas.torque) == len(default.cold_gas.dead_band_rate) == 3
    assert default.cold_gas.reference.drift == pytest.approx(10.0 * DEG / 3600.0)
    low = "vehicle.parachute={height: 5 km, drag_area: 12 m2, inflation: 2 s, station: 1 m}"
    late = low.replace("height: 5 km", "at: 450 s")
    by_height = params.flight_params(load(DEFAULT, [low])).parachute
    by_time = params.flight_params(load(DEFAULT, [late])).parachute
    assert (by_height.opens_below, by_height.opens_at) == (5000.0, math.inf)
    assert (by_time.opens_below, by_time.opens_at) == (-math.inf, 450.0)


def test_start_in_orbit_and_on_the_ground():
    free = ["vehicle.spin_motors=null", "vehicle.yo_yo=null", "vehicle.cold_gas=null", *NO_FLIGHT]
    orbit = load(DEFAULT, [*free, ORBIT, BODY])
    start = params.flight_params(orbit).start
    assert (start.perigee_height, start.apogee_height) == (500e3, 520e3)
    angles = (start.inclination, start.node, start.perigee, start.anomaly)
    assert angles == pytest.approx([angle * DEG for angle in (97, 40, 20, 70)])
    assert params.flight_params(orbit).payload_aerodynamics.drag[0, 0] == 2.2
    assert params.flight_params(orbit).stages == ()
    site = (
        "ground={latitude: 48 deg, longitude: 11 deg, height: 600 m, azimuth: 90 deg, elevation: 0 deg, "
        "roll: 9 deg}"
    )
    ground = load(DEFAULT, [*free, site])
    start = params.flight_params(ground).start
    assert isinstance(start, flight.Ground)
    assert (start.height, start.roll) == (600.0, pytest.approx(9.0 * DEG))
    assert possible_events(ground) == []
    assert possible_events(orbit) == ["apogee", "entry", "altitude_60km", "altitude_20km", "impact"]


def test_gravity_and_air():
    kinds = {"egm96": gravity.load("egm96", 4), "j2": gravity.load("j2"), "point": gravity.load("point")}
    for kind, field in kinds.items():
        scenario = load(
            DEFAULT, [f"earth.gravity={kind}", "earth.gravity_degree=4", "atmosphere.density=90 %"]
        )
        found = params.flight_params(scenario)
        assert found.air.density_factor == pytest.approx(0.9)
        for a, b in zip(found.gravity, field, strict=True):
            np.testing.assert_array_equal(a, b)


def test_msis_is_that_of_day_and_place():
    pytest.importorskip("pymsis", reason="the extra [msis] is not installed")
    from shefex_nav.environment import sampling
    from shefex_nav.environment.models import BUILT_IN, Atmosphere, Msis, Site

    scenario = load(DEFAULT, ["atmosphere.model=msis"])
    table = params.flight_params(scenario).air.table
    sun = Msis(f107=97.7, f107_average=127.3, ap=4.0)
    site = Site("2012-06-22T19:18:00", 69.2942 * DEG, 16.0190 * DEG, sun)
    expected = sampling.air_table(BUILT_IN[Atmosphere]["msis"], site)
    np.testing.assert_array_equal(table, expected)


def test_place_below_an_orbit():
    """Argument of latitude 90 deg: as far north as the inclination allows; the node then is 90 deg behind."""
    free = ["vehicle.spin_motors=null", "vehicle.yo_yo=null", "vehicle.cold_gas=null", *NO_FLIGHT]
    scenario = load(DEFAULT, [*free, ORBIT.replace("97 deg", "60 deg"), BODY, "mission.start=0 s"])
    latitude, longitude = surroundings.place(scenario)
    assert latitude == pytest.approx(60.0 * DEG, abs=2e-3)  # precession of the pole since 2000
    angle = ephemeris.earth_rotation(scenario.mission.epoch, -0.58479, 0.0, 0.0).angle_0
    expected = (40.0 + 90.0) * DEG - angle
    assert math.remainder(longitude - expected, 2.0 * math.pi) == pytest.approx(0.0, abs=6e-3)


def test_events_of_the_flight_are_among_the_possible_ones(scenario, default):
    """So that every event can interrupt GPS, and none is offered that the default flight cannot have."""
    from shefex_nav.world.flight.fly import fly

    earth = scenario.earth
    rotation = ephemeris.earth_rotation(
        scenario.mission.epoch, earth.ut1_minus_utc, earth.pole_x, earth.pole_y
    )
    coarse = default._replace(sample_rate_hz=100.0, gravity=gravity.load("j2"))
    names = {event.name for event in fly(coarse, rotation, None).events}
    assert names == set(possible_events(scenario)) - {"cold_gas_empty"}
