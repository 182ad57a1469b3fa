"""States that the program chooses by itself: the figures of the rule, what it does to a scenario."""

import sys

import numpy as np
import pytest
from broken import SCENARIO_FOLDER, the_message

from shefex_nav import prepare
from shefex_nav.campaign.running import prepared
from shefex_nav.commands.app import main
from shefex_nav.records import Event
from shefex_nav.scenario import params_onboard
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.load import load
from shefex_nav.scenario.onboard import Navigation
from shefex_nav.scenario.wanted_states import SWAMPS, WINDOW_S, Motion, effects

NAME = "shefex2_andoya"
SET = f"navigation.states={AUTOMATIC}"
DT_S, K = 0.01, 20001  # 200 s
W = WINDOW_S


@pytest.fixture(scope="module")
def scenario():
    return load(NAME, [SET])


def moving(omega_b=(0.0, 0.0, 0.0), f_b=(0.0, 0.0, 0.0), until_s=1e9, C_ib=None, burning=0):
    """Motion of a body with constant rate and specific force until a time."""
    acts = (DT_S * np.arange(K) < until_s)[:, None]
    C_ib = np.broadcast_to(np.eye(3), (K, 3, 3)) if C_ib is None else C_ib
    stage = np.where(acts[:, 0], burning, 0)
    return Motion(DT_S, C_ib, acts * np.array(omega_b), acts * np.array(f_b), stage)


def found(scenario, moved, events=(), end_s=200.0):
    return {one.block: one for one in effects(scenario, moved, events, end_s)}


def test_a_turn_about_a_fixed_axis(scenario):
    """Roll at 1 rad/s: scale factor along, two misalignments across, each grown with the time."""
    gyro, of = scenario.imu.gyro, found(scenario, moving(omega_b=(1.0, 0.0, 0.0)))
    along, across = gyro.scale_factor_roll * W, np.sqrt(2.0) * gyro.misalignment * W
    assert of["gyro_scale"].effect == pytest.approx(along / np.sqrt(3.0), rel=1e-3)
    assert of["gyro_misalignment"].effect == pytest.approx(across / np.sqrt(3.0), rel=1e-3)
    assert of["gyro_roll_column"].effect == pytest.approx(np.hypot(along, across) / np.sqrt(3.0), rel=1e-3)
    assert of["gyro_roll_column"].noise == pytest.approx(gyro.random_walk * np.sqrt(W))
    assert of["gyro_roll_column"].on and not of["gyro_scale"].on and not of["gyro_misalignment"].on
    pitch = found(scenario, moving(omega_b=(0.0, 1.0, 0.0)))
    assert pitch["gyro_scale"].on and not pitch["gyro_roll_column"].on
    assert pitch["gyro_scale"].effect == pytest.approx(gyro.scale_factor * W / np.sqrt(3.0), rel=1e-3)


def test_a_spin_takes_turns_with_what_is_across(scenario):
    """Seen from outside, an error across the spin axis goes round and adds up to nothing."""
    t_s = DT_S * np.arange(K)
    cosine, sine, one, zero = np.cos(6.3 * t_s), np.sin(6.3 * t_s), np.ones(K), np.zeros(K)
    C_ib = np.stack([one, zero, zero, zero, cosine, -sine, zero, sine, cosine], axis=-1).reshape(K, 3, 3)
    spun = found(scenario, moving(omega_b=(6.3, 0.0, 0.0), C_ib=C_ib))
    still = found(scenario, moving(omega_b=(6.3, 0.0, 0.0)))
    assert spun["gyro_scale"].effect == pytest.approx(still["gyro_scale"].effect, rel=1e-3)
    assert spun["gyro_misalignment"].effect < 0.01 * still["gyro_misalignment"].effect


def test_a_misalignment_that_a_spin_fixes_to_the_body_is_estimated():
    """No noise of the filter stands for it: the attitude of this rocket was wrong by four sigma of it."""
    spinning = load("rexus_spinning", ["imu.use=adis16470", SET])
    of = {one.block: one for one in prepare.wanted(spinning)}
    assert of["gyro_scale"].on and not of["gyro_roll_column"].on
    one = of["gyro_misalignment"]
    assert one.on and one.noise < one.effect < SWAMPS * one.noise


def test_thrust_that_ends(scenario):
    """100 m/s^2 along the nose for 20 s: what goes with force, in velocity; g-sensitivity in attitude."""
    imu, of = scenario.imu, found(scenario, moving(f_b=(100.0, 0.0, 0.0), until_s=20.0, burning=1))
    gained = 2000.0 / np.sqrt(3.0)
    expected = {
        "accel_scale": imu.accelerometer.scale_factor * gained,
        "accel_misalignment": imu.accelerometer.misalignment * np.sqrt(2.0) * gained,
        "gyro_g_sensitivity": imu.gyro.g_sensitivity * np.sqrt(3.0) * gained,
        "accel_rectification": imu.accelerometer.vibration_rectification * imu.vibration.boost[0] ** 2 * 20.0,
    }
    for name, size in expected.items():
        assert of[name].effect == pytest.approx(size, rel=2e-3), name
    sigma = 2.0 * scenario.gps.range_rate_noise * np.sqrt(12.0 / (W * scenario.gps.rate))
    assert of["accel_scale"].noise == pytest.approx(sigma)


def test_what_noise_makes_of_velocities_and_of_positions():
    """Against the covariance of a straight line and of a parabola, by least squares."""
    n, positions = 60, load("baro_2d_gps", [SET, "gps.rate=1 Hz"])
    t_s = np.linspace(0.0, W, n + 1)[:n]
    for chosen, degree, sigma in (
        (load(NAME, [SET]), 1, 0.1),
        (positions, 2, 2.0 * positions.gps.range_noise),
    ):
        A = np.vander(t_s, degree + 1)
        spread = np.sqrt(np.linalg.inv(A.T @ A)[0, 0])  # of the slope; of half the acceleration
        noise = found(chosen, moving())["accel_scale"].noise
        assert noise == pytest.approx(degree * spread * sigma * W, rel=0.05)


def test_only_what_swamps_the_noise_is_on(scenario):
    of = found(scenario, moving(f_b=(100.0, 0.0, 0.0), until_s=20.0))
    for one in of.values():
        if one.block.startswith(("accel", "gravity")) or one.block == "gyro_g_sensitivity":
            assert one.on == (one.effect > SWAMPS * one.noise), one
    quiet = load(NAME, [SET, "imu.accelerometer.scale_factor=1 ppm"])
    assert of["accel_scale"].on
    assert not found(quiet, moving(f_b=(100.0, 0.0, 0.0), until_s=20.0))["accel_scale"].on
    assert not any(one.on for one in found(scenario, moving()).values() if one.block != "mounting")


def test_weight_that_lasts_makes_biases(scenario):
    """Under a parachute for longer than the filter's noise keeps its sign: on, however small."""
    events = (Event(10.0, "parachute", 5e3, ""), Event(190.0, "impact", 0.0, ""))
    names = "gyro_g_sensitivity", "accel_scale", "accel_misalignment"
    of = found(scenario, moving(), events)
    assert all(of[name].on and of[name].why.endswith("parachute for 180 s: a bias") for name in names)
    brief = found(scenario, moving(), (events[0], Event(40.0, "impact", 0.0, "")))
    assert not any(brief[name].on for name in names)


def test_what_the_rest_of_the_scenario_asks_for(scenario):
    assert found(scenario, moving())["mounting"].on
    without = found(load(NAME, [SET, "star_tracker.enabled=false"]), moving())
    assert not without["mounting"].on and "clock" not in without
    pressed = found(load("baro_2d_gps", [SET]), moving())
    assert pressed["baro_bias"].on and pressed["baro_scale"].on and "baro_bias" not in without
    tight = found(load("tight", [SET]), moving())
    assert tight["clock"].on and tight["range_bias"].on and np.isnan(tight["clock"].effect)


def test_a_principal_point_that_is_off_turns_the_camera_as_its_mounting_does(scenario):
    """2 pixels of 9.9 um behind 24.95 mm; without the block the NEES of the attitude was 20000 to 110000."""
    camera = ["star_camera.mounting.error=0 deg", "star_camera.optics.principal_point_error=2 pix"]
    one = found(load(NAME, [SET, *camera]), moving())["mounting"]
    assert one.on and one.effect == pytest.approx(2.0 * 9.9e-6 / 24.95e-3)
    both = found(scenario, moving())["mounting"].effect
    assert both == pytest.approx(np.hypot(np.radians(0.02), 0.3 * 9.9e-6 / 24.95e-3))
    assert not found(load(NAME, [SET, camera[0], camera[1].replace("2", "0", 1)]), moving())["mounting"].on


def test_they_follow_what_the_filter_is_to_assume():
    """`navigation.sensors` is what counts on board: a sigma of a block that is off would have no effect."""
    spun = moving(omega_b=(9.0, 0.0, 0.0))

    def of(key, value, *more):
        return found(load(NAME, [SET, f"navigation.sensors.{key}={value}", *more]), spun)

    assert of("gyro_scale_factor_roll", "1 %")["gyro_scale"].effect == pytest.approx(
        0.01 * 9.0 * W / np.sqrt(3.0), rel=1e-3
    )
    assert not of("gyro_scale_factor_roll", "1e-9 ppm", "imu.gyro.misalignment=0 mrad")["gyro_roll_column"].on
    across = of("gyro_misalignment", "20 mrad", "imu.gyro.scale_factor_roll=0 ppm")["gyro_roll_column"]
    assert across.on and across.effect == pytest.approx(0.02 * np.sqrt(2.0 / 3.0) * 9.0 * W, rel=1e-3)
    walk = of("gyro_random_walk", "10 deg/sqrt(h)")["gyro_scale"]
    assert walk.noise == pytest.approx(np.radians(10.0) / 60.0 * np.sqrt(W)) and not walk.on
    mounted = of("camera_mounting", "0.5 deg", "star_camera.mounting.error=0 deg")["mounting"]
    assert mounted.on and mounted.effect == pytest.approx(np.radians(0.5))


def test_it_is_the_default_and_every_scenario_of_the_package_names_its_states():
    assert Navigation.model_fields["states"].default == AUTOMATIC
    for path in SCENARIO_FOLDER.glob("*.yaml"):
        assert load(path).navigation.states != AUTOMATIC, path.stem
    assert load(NAME, ["navigation.states=null"]).navigation.states == AUTOMATIC
    said = the_message(NAME, ["navigation.states=automtic"])
    assert "'automtic' is not known; choose from: automatic, or give a list of: gyro_roll_column, " in said
    assert said.endswith("sun_alignment; did you mean 'automatic'?")


def test_a_scenario_that_names_its_states_keeps_them():
    named = load(NAME)
    assert prepare.settled(named) is named


def test_the_planned_flight_settles_them(scenario):
    """The same of every run: names in the scenario and in its text, good to be read again."""
    settled = prepare.settled(scenario)
    names = settled.navigation.states
    assert names == [one.block for one in prepare.wanted(scenario) if one.on]
    assert {"gyro_roll_column", "accel_scale", "mounting"} <= set(names)
    assert scenario.navigation.states == AUTOMATIC and scenario.source != settled.source
    assert settled.place(("imu", "gyro", "bias")) == scenario.place(("imu", "gyro", "bias"))
    again = load_source(settled)
    assert again.navigation.states == names and again.model_dump() == settled.model_dump()
    assert params_onboard.nav_params(settled).states == tuple(names)
    with pytest.raises(ValueError, match=r"prepare\.settled"):
        params_onboard.nav_params(scenario)


def load_source(scenario):
    from shefex_nav.scenario.load import load_text

    return load_text(scenario.source, "again.yaml")


def test_a_campaign_settles_them_once_for_all_runs(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(f"extends: {NAME}\nnavigation: {{states: automatic}}\n"
                    "dispersions: {imu.gyro.g_sensitivity: {log_normal: 200 %}}\n")  # fmt: skip
    loaded = load(path)
    plan, _ = prepared(loaded, 2, 1)
    assert plan.source == prepare.settled(loaded).source and "gyro_g_sensitivity" in plan.source


def test_they_follow_what_the_computer_is_told():
    """It cannot know of an error that it is not told of."""
    small = "navigation.told.imu.gyro.g_sensitivity=0 deg/h/gee"
    told = {one.block: one.on for one in prepare.wanted(load(NAME, [SET, small]))}
    true = {one.block: one.on for one in prepare.wanted(load(NAME, [SET]))}
    assert true["gyro_g_sensitivity"] and not told.pop("gyro_g_sensitivity")
    assert all(true[name] == on for name, on in told.items())


def test_check_says_which_and_why(monkeypatch, capsys):
    def check(*words):
        monkeypatch.setattr(sys, "argv", ["shefex-nav", "check", NAME, *words])
        with pytest.raises(SystemExit):
            main()
        return capsys.readouterr().out

    assert check() == f"{NAME}: good\n"
    said = check("--set", SET)
    rows = {line.split()[1]: line for line in said.splitlines() if line.startswith("│")}
    assert "yes" in rows["accel_scale"] and "times the noise" in rows["accel_scale"]
    assert "m/s" in rows["accel_scale"] and "deg" in rows["gyro_roll_column"]
    assert " no " in rows["gyro_scale"] and "gyro_roll_column" in rows["gyro_scale"]
