"""Sections of the default scenario as the parameters of the stages."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_settings import PERFECT

from shefex_nav.environment import ephemeris
from shefex_nav.onboard.computer import is_on
from shefex_nav.scenario import params, params_onboard
from shefex_nav.scenario.load import load
from shefex_nav.scenario.of_settings import settings
from shefex_nav.settings import Settings, declared

SCENARIOS = Path(__file__).parents[2] / "scenarios"
DEG = math.pi / 180.0
G = 9.80665  # m/s^2
NO_BAD_PIXELS = np.zeros((0, 2), dtype=np.int64)


@pytest.fixture(scope="module")
def scenario():
    return load(SCENARIOS / "shefex2_andoya.yaml")


@pytest.fixture(scope="module")
def bodies():
    return ephemeris.sky_bodies("2012-06-22T19:18:00")


MAY_BE_NONE = (
    *(
        "parachute",
        "cosine_error",
        "reference_magnitude",
        "height",
        "at",
        "payload_aerodynamics",
        "faintest_south",
    ),
    *("satellite", "ionosphere", "troposphere", "multipath", "reacquisition", "line_time", "deepest"),
    *("cross_period", "ramp", "separation", "spent"),
    *("f_number", "aperture", "transmission", "quantum_efficiency", "principal_point", "distortion"),
)


def is_number(value):
    return isinstance(value, int | float) and not isinstance(value, bool)


def is_record(value):
    return hasattr(value, "_fields") or isinstance(value, Settings)


def assert_plain(record):
    """Numbers, texts, arrays and records of them: nothing of the scenario's own types gets into a stage."""
    names = declared(type(record)) if isinstance(record, Settings) else record._fields
    for name in names:
        value = getattr(record, name)
        if is_record(value):
            assert_plain(value)
        elif isinstance(value, tuple):
            items = [one for item in value for one in (item if type(item) is tuple else (item,))]  # pairs too
            assert all(is_number(item) or isinstance(item, str) or is_record(item) for item in items)
            for item in items:
                if is_record(item):
                    assert_plain(item)
        elif isinstance(value, dict):
            assert all(item.dtype == np.float64 for item in value.values()), name
        elif value is None:
            assert name in MAY_BE_NONE, name
        elif isinstance(value, np.ndarray):
            assert value.dtype in (np.float64, np.int64), name
        else:
            assert is_number(value) or isinstance(value, str | bool), name


def test_every_stage_gets_plain_parameters(scenario, bodies):
    for convert in (
        params.flight_params,
        params_onboard.nav_params,
    ):
        assert_plain(convert(scenario))
    assert_plain(settings(scenario.gps))
    assert_plain(settings(scenario.star_camera))
    assert_plain(params_onboard.computer_params(scenario, bodies, NO_BAD_PIXELS))


def test_mounting_is_a_right_handed_frame(scenario):
    """Boresight along body y, picture's right along body x: the camera's y axis is against body z."""
    C_bc = params.mounting(scenario)
    np.testing.assert_allclose(C_bc, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-15)
    tilted = load(
        SCENARIOS / "shefex2_andoya.yaml",
        ["star_camera.mounting.boresight=[0, 3, 4]", "star_camera.mounting.image_right=[0, -4, 3]"],
    )
    C_bc = params.mounting(tilted)
    np.testing.assert_allclose(C_bc.T @ C_bc, np.eye(3), atol=1e-15)
    assert np.linalg.det(C_bc) == pytest.approx(1.0)
    np.testing.assert_allclose(C_bc[:, 2], [0.0, 0.6, 0.8], atol=1e-15)


def test_units_of_the_imu(scenario):
    """Data-sheet units converted by hand."""
    imu = settings(scenario.imu)
    assert imu.gyro.bias == pytest.approx(0.5 * DEG / 3600.0)
    assert imu.gyro.random_walk == pytest.approx(0.03 * DEG / 60.0)
    assert imu.gyro.g_sensitivity == pytest.approx(0.5 * DEG / 3600.0 / G)
    assert imu.gyro.vibration_rectification == pytest.approx(0.02 * DEG / 3600.0 / G**2)
    assert imu.accelerometer.bias == pytest.approx(0.5e-3 * G)
    assert imu.accelerometer.random_walk == pytest.approx(0.03 / 60.0)
    assert imu.accelerometer.vibration_rectification == pytest.approx(20e-6 * G / G**2)
    np.testing.assert_allclose(imu.vibration.boost, [7.0 * G, 3.5 * G])
    free = load(SCENARIOS / "shefex2_andoya.yaml", ["imu.gyro.range=unlimited", "imu.gyro.quantum=off"])
    assert settings(free.imu).gyro.range == math.inf
    assert settings(free.imu).gyro.quantum == 0.0


def test_gps_outages(scenario):
    outages = settings(scenario.gps).outages
    assert [outage.event for outage in outages] == [
        "lift_off",
        "burn_out_1",
        "separation_1",
        "ignition_2",
        "burn_out_2",
    ]
    assert (outages[0].shortest, outages[0].longest) == (0.0, 2.0)


def test_filter_knows_the_data_sheets(scenario):
    nav, imu = params_onboard.nav_params(scenario), settings(scenario.imu)
    assert nav.sigma_gyro_bias == pytest.approx(math.hypot(imu.gyro.bias, imu.gyro.in_run_bias))
    np.testing.assert_allclose(nav.sigma_blocks["gyro_roll_column"], [30e-6, 5e-5, 5e-5])
    assert nav.imu.gyro_random_walk == imu.gyro.random_walk
    camera = settings(scenario.star_camera)
    offset = math.atan(
        camera.optics.principal_point_error * camera.detector.pixel_size / camera.optics.focal_length
    )
    assert nav.sigma_blocks["mounting"][0] == pytest.approx(math.hypot(camera.mounting.error, offset))
    np.testing.assert_array_equal(nav.l_ba_b, settings(scenario.gps).antenna.lever_arm)
    np.testing.assert_array_equal(nav.C_bc, params.flight_params(scenario).C_bc)


@pytest.mark.parametrize("burns", [True, False])
def test_filter_expects_the_vibration_that_the_imu_reports(burns):
    """The sum of the simulated increments swings as far as the filter is told, in the boost and at rest.

    Over 12 seeds it is 1.5 % more, with a scatter of 0.3 %: the band of the sensor has no sharp edge.
    """
    from shefex_nav.records import Phase, Trajectory
    from shefex_nav.world.imu import measure

    scenario = load(SCENARIOS / "shefex2_andoya.yaml", ["imu.vibration.coast=0.14 gee"])
    n, phase = 40_001, Phase.BOOST if burns else Phase.PAD
    quiet = replace(PERFECT, vibration=settings(scenario.imu).vibration)
    none = np.zeros((n, 3))
    trajectory = Trajectory(
        t_s=np.arange(n) / 400.0,
        phase=np.full(n, phase, dtype=np.int8),
        burning=np.full(n, int(burns), dtype=np.int8),
        q_ib=np.zeros((n, 4)),
        **dict.fromkeys(("r_i", "v_i", "omega_ib_b", "f_b", "dtheta_b", "dv_b"), none),
        **dict.fromkeys(
            (*("mass_kg", "mach", "dynamic_pressure_pa", "thrust_n"), "angle_of_attack"), np.zeros(n)
        ),
    )
    data = measure(quiet, trajectory, np.random.default_rng(1))
    told = params_onboard.nav_params(scenario)
    boost = told.imu.gyro_vibration, told.imu.accel_vibration
    for increments, swing in zip(
        (data.dtheta_b, data.dv_b), boost if burns else told.swing_at_rest, strict=True
    ):
        phi = np.cumsum(increments, axis=0)
        assert phi.std(axis=0).mean() == pytest.approx(swing, rel=0.03)


def test_the_longest_period_of_the_vibration_is_told_and_remembered():
    """The filter remembers the motion of that time before a fix that comes late; what is slower than 1 Hz
    says nothing."""
    for low, period_s, memory_s in (
        (20.0, 0.05, 0.6),
        (2.0, 0.5, 0.2 + 0.5 + 0.1),
        (0.5, 2.0, 0.2 + 1.0 + 0.1),
    ):
        overrides = f"imu.vibration.lowest_frequency={low} Hz", "gps.latency=200 ms"
        told = params_onboard.nav_params(load(SCENARIOS / "shefex2_andoya.yaml", overrides))
        assert told.vibration_period_s == pytest.approx(period_s)
        assert told.history_s == pytest.approx(memory_s)


def test_overrides_of_what_the_filter_knows():
    changed = load(
        SCENARIOS / "shefex2_andoya.yaml",
        [
            "navigation.sensors.gyro_bias=3 deg/h",
            "navigation.sensors.gyro_scale_factor_roll=1000 ppm",
            "navigation.sensors.gyro_misalignment=1 mrad",
            "navigation.sensors.gyro_random_walk=1 deg/sqrt(h)",
            "navigation.sensors.accelerometer_bias=2 mgee",
            "navigation.sensors.accelerometer_random_walk=1 m/s/sqrt(h)",
            "navigation.sensors.camera_mounting=0.1 deg",
            "navigation.sensors.lever_arm=[1 m, 2 m, 3 m]",
        ],
    )
    nav, imu = params_onboard.nav_params(changed), settings(changed.imu)
    assert nav.sigma_gyro_bias == pytest.approx(3.0 * DEG / 3600.0)
    np.testing.assert_allclose(nav.sigma_blocks["gyro_roll_column"], [1e-3, 1e-3, 1e-3])
    assert nav.imu.gyro_random_walk == pytest.approx(DEG / 60.0)
    assert nav.sigma_accel_bias == pytest.approx(2e-3 * G)
    assert nav.imu.accel_random_walk == pytest.approx(1.0 / 60.0)
    assert nav.sigma_blocks["mounting"][0] == pytest.approx(0.1 * DEG)
    np.testing.assert_allclose(nav.l_ba_b, [1.0, 2.0, 3.0])
    unchanged = load(SCENARIOS / "shefex2_andoya.yaml")
    assert imu == settings(unchanged.imu)  # the sensors stay as they are


def test_filter_knows_which_motor_may_burn(scenario):
    """From the start the first, from its separation on the second, by the vibration of the strongest."""
    np.testing.assert_allclose(params_onboard.nav_params(scenario).motors, [[-np.inf, 1.0], [65.0, 0.5]])
    calm = load(SCENARIOS / "shefex2_andoya.yaml", ["imu.vibration.boost=[0 gee, 2 gee]"])
    nav = params_onboard.nav_params(calm)
    np.testing.assert_allclose(nav.motors, [[-np.inf, 0.0], [65.0, 1.0]])
    assert nav.sigma_blocks["accel_rectification"] == pytest.approx(np.full(3, 20e-6 * G * 4.0))
    assert nav.imu.accel_rectification == 0.0  # a state, no noise as well
    still = load(SCENARIOS / "shefex2_andoya.yaml", ["imu.vibration.boost=[0 gee, 0 gee]"])
    np.testing.assert_array_equal(params_onboard.nav_params(still).motors[:, 1], [0.0, 0.0])


def test_tracker_looks_through_the_nominal_camera(scenario, bodies):
    computer = params_onboard.computer_params(scenario, bodies, [[1, 2], [3, 4]])
    camera, settings = computer.tracker.camera.pinhole, computer.tracker.settings
    assert camera.focal_length_px == pytest.approx(24.95e-3 / 9.9e-6)
    assert (camera.width_px, camera.height_px) == (659, 493)
    np.testing.assert_array_equal(computer.tracker.camera.bad_pixels, [[1, 2], [3, 4]])
    np.testing.assert_array_equal(computer.sun_i, ephemeris.apparent_sun(bodies))
    assert np.degrees(np.arccos(computer.sun_i @ bodies.sun_u_i)) * 3600.0 == pytest.approx(20.3, abs=0.4)
    assert (settings.on, settings.off) == (234.0, 385.0)


def test_a_disabled_tracker_is_never_switched_on(bodies):
    scenario = load(SCENARIOS / "no_star_tracker.yaml")
    computer = params_onboard.computer_params(scenario, bodies, NO_BAD_PIXELS)
    assert not is_on(computer, np.arange(0.0, 1000.0, 0.5)).any()


def test_methods_offered_are_methods_flown(scenario):
    """The choices of the schema are those of the star tracker, with those of the papers."""
    from typing import get_args

    from shefex_nav.onboard.startracker import settings
    from shefex_nav.plugins import STEPS, methods

    classes = {"identification": settings.Identification, "detection": settings.Detection}
    for _, section, key in {step.path for step in STEPS.values()}:
        chosen = get_args(declared(classes[section])[key][0])
        assert sorted(chosen) == sorted(methods.ways(("star_tracker", section, key)))
        assert len(chosen) >= 4
