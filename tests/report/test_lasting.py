"""Weight that lasts, where the filter takes what goes with it for noise: told, with the missing states."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.geometry import rotation
from shefex_nav.records import Event, Phase
from shefex_nav.report import lasting, programme
from shefex_nav.scenario import load

SCENARIOS = Path(__file__).parents[2] / "scenarios"
DEFAULT = SCENARIOS / "shefex2_andoya.yaml"
NIGHT_SKY = SCENARIOS / "night_sky.yaml"
PARACHUTE = "vehicle.parachute={height: 5 km, drag_area: 12 m2, inflation: 2 s, station: 1 m}"
OF_THE_DEFAULT = "navigation.states=[gyro_roll_column, accel_scale, accel_rectification, gravity, mounting]"
OF_THE_SCHEMA = "navigation.states=[gyro_roll_column, mounting]"


def said(scenario, *events, end_s=600.0):
    """Words about a flight with these events, (time, name)."""
    made = tuple(Event(t_s, name, 0.0, "") for t_s, name in events)
    return lasting.words(scenario, programme.Flown(made, 0.0, end_s))


def foreseen(path, *overrides):
    """{field: text} of what `check` tells."""
    found = programme.foreseen(load.load(path, overrides))
    return {".".join(one.field): one.text for one in found}


def test_minutes_under_a_parachute_are_told():
    text = said(load.load(DEFAULT, [PARACHUTE]), (450.0, "parachute"), (580.0, "impact"))
    assert text.startswith(
        "gyro_g_sensitivity and accel_misalignment are missing: the vehicle hangs on its parachute for 130 s"
    )
    assert "noise with a memory of 20 s" in text
    assert text.endswith(
        "; write states: [gyro_roll_column, gyro_g_sensitivity, accel_scale, accel_misalignment, "
        "accel_rectification, gravity, mounting]"
    )


@pytest.mark.parametrize(
    ("landed_s", "memory", "is_told"),
    [(459.0, "20 s", False), (461.0, "20 s", True), (461.0, "30 s", False), (430.0, "9 s", True)],
)
def test_a_parachute_counts_from_three_memories_on(landed_s, memory, is_told):
    scenario = load.load(DEFAULT, [PARACHUTE, f"navigation.thrust_memory={memory}"])
    text = said(scenario, (400.0, "parachute"), (landed_s, "impact"), end_s=1000.0)
    assert bool(text) == is_told


def test_a_parachute_that_did_not_open_or_was_not_seen_for_long_is_not_told():
    scenario = load.load(DEFAULT, [PARACHUTE])
    assert not said(scenario, (500.0, "impact"), end_s=500.0)
    assert not said(scenario, (400.0, "parachute"), end_s=455.0)  # a log that ends there
    assert said(scenario, (400.0, "parachute"), end_s=465.0)


@pytest.mark.parametrize(
    ("sigma", "named"),
    [
        ("imu.gyro.g_sensitivity=0 deg/h/gee", "accel_misalignment is missing"),
        ("imu.accelerometer.misalignment=0 mrad", "gyro_g_sensitivity is missing"),
        ("imu.gyro.misalignment=0 mrad", "gyro_g_sensitivity and accel_misalignment are missing"),
    ],
)
def test_only_errors_that_the_imu_has_are_named(sigma, named):
    found = foreseen(NIGHT_SKY, OF_THE_DEFAULT, sigma)
    assert list(found) == ["navigation.states"]
    assert found["navigation.states"].startswith(f"{named}: the vehicle stands on the ground for 600 s")


def test_an_imu_without_such_errors_needs_no_states():
    perfect = ["imu.gyro.g_sensitivity=0 deg/h/gee", "imu.accelerometer.misalignment=0 mrad"]
    assert foreseen(NIGHT_SKY, OF_THE_DEFAULT, *perfect) == {}


def test_scale_factors_of_the_accelerometers_are_named_where_they_are_no_states():
    text = foreseen(NIGHT_SKY, OF_THE_SCHEMA)["navigation.states"]
    assert text.startswith("gyro_g_sensitivity, accel_scale and accel_misalignment are missing: ")


@pytest.mark.parametrize("states", [OF_THE_DEFAULT, OF_THE_SCHEMA, "navigation.states=[gyro_scale]"])
def test_what_is_to_be_written_is_accepted_and_enough(states):
    text = foreseen(NIGHT_SKY, states)["navigation.states"]
    assert foreseen(NIGHT_SKY, f"navigation.states={text.partition('write states: ')[2]}") == {}


def test_nothing_is_told_of_states_that_software_of_ones_own_does_not_have():
    scenario = load.load(DEFAULT, [PARACHUTE])
    own = scenario.with_sections(navigation=scenario.navigation.model_copy(update={"software": "mine"}))
    assert said(own, (450.0, "parachute"), (580.0, "impact")) == ""


def test_a_minute_on_the_ground_is_not_told():
    short = ["star_tracker.off=50 s", OF_THE_DEFAULT]
    assert foreseen(NIGHT_SKY, "mission.time_limit=60 s", *short) == {}
    assert list(foreseen(NIGHT_SKY, "mission.time_limit=61 s", *short)) == ["navigation.states"]


def test_minutes_on_the_pad_are_told():
    """The default waits for ten seconds there."""
    assert not said(load.load(DEFAULT), (0.0, "lift_off"), end_s=550.0)
    waiting = load.load(DEFAULT, ["mission.start=-200 s"])
    assert "the vehicle stands on the pad for 200 s" in said(waiting, (0.0, "lift_off"), end_s=550.0)
    assert "on the pad for 205 s" in said(waiting, (5.0, "lift_off"), end_s=550.0)  # a late ignition
    assert "on the pad for 90 s" in said(waiting, end_s=-110.0)  # a log that ends there


def test_who_floats_feels_no_weight():
    assert foreseen(SCENARIOS / "orbit.yaml", OF_THE_SCHEMA) == {}


def pushed(rate, push=20.0, hz=100.0, phase=Phase.BOOST):
    """Two minutes at rest, then 100 s in which a force along x pushes a body that spins about x."""
    t_s = np.arange(0.0, 220.0, 1.0 / hz)
    q_ib = np.array([rotation.quat_from_rotvec(np.array([rate * t, 0.0, 0.0])) for t in t_s])
    f_b = np.where(t_s[:, None] > 120.0, [push, 0.0, 0.0], 0.0)
    phases = np.where(t_s > 120.0, phase, Phase.COAST).astype(np.int8)
    return lasting.pushed(SimpleNamespace(t_s=t_s, q_ib=q_ib, f_b=f_b, phase=phases))


def test_what_an_error_of_the_accelerometers_makes_of_thrust_and_drag():
    """A scale factor pushes along x, two misalignments across: f T each, rms of three axes."""
    found, most = pushed(0.0), 20.0 * lasting.WINDOW_S
    np.testing.assert_allclose(found, [most / np.sqrt(3.0), most * np.sqrt(2.0 / 3.0)], rtol=0.01)
    spun = pushed(9.0)
    assert spun.scale == pytest.approx(found.scale, rel=0.01)  # a spin takes turns across alone
    assert spun.misalignment < 2.0 * 20.0 / 9.0
    assert pushed(0.0, push=0.5) is None
    assert pushed(0.0, phase=Phase.DESCENT) == found  # drag
    for phase in (Phase.PAD, Phase.GROUND):
        assert pushed(0.0, phase=phase) is None  # weight


def test_thrust_that_makes_an_error_too_large_for_noise_is_told():
    """From fifteen times on what GPS leaves open; more fixes leave less."""
    field = "navigation.states"
    assert field not in foreseen(DEFAULT)
    large = "imu.accelerometer.misalignment=2.4 mrad"
    text = foreseen(DEFAULT, large)[field]
    assert text.startswith("accel_misalignment is missing: its error moves the velocity by 1.8 m/s within")
    assert field not in foreseen(DEFAULT, large, f"{field}={text.partition('write states: ')[2]}")
    some = "imu.accelerometer.misalignment=0.5 mrad"
    assert field not in foreseen(DEFAULT, some) and field in foreseen(DEFAULT, some, "gps.rate=10 Hz")
    both = foreseen(DEFAULT, large, OF_THE_SCHEMA, "imu.accelerometer.scale_factor=1 %")[field]
    assert both.startswith("accel_scale and accel_misalignment are missing: their errors move")


def test_check_flies_the_parachute_and_names_the_line(command, tmp_path):
    """The states are the default's: where they are, and which file to change."""
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        f"extends: {SCENARIOS / 'rexus_like.yaml'}\nnavigation:\n  states: [gyro_scale, gravity]\n"
    )
    result = command("check", mine)
    assert (result.code, result.out) == (0, f"{mine}: good, with 1 warning\n")
    line, seen = result.err.splitlines()
    assert seen.startswith("star_camera: a field of view of ")
    names = "gyro_g_sensitivity, accel_scale and accel_misalignment"
    assert line.startswith(
        f"warning: {mine}:3:11: navigation.states: {names} are missing: the vehicle hangs on"
    )

    mine.write_text(f"extends: {NIGHT_SKY}\n")
    result = command("check", mine)
    assert (result.code, result.out) == (0, f"{mine}: good\n")
    assert result.err.startswith("star_camera: ") and len(result.err.splitlines()) == 1


def test_run_tells_it_before_and_in_its_result(command, tmp_path):
    """Three seconds on the ground are long against a memory of half a second."""
    short = "mission.time_limit=3 s", "star_tracker.off=3 s", "navigation.thrust_memory=0.5 s"
    settings = [part for one in (*short, OF_THE_DEFAULT) for part in ("--set", one)]
    result = command("run", NIGHT_SKY, "--out", tmp_path / "flown.mcap", "--json", *settings)
    assert result.code == 0
    (line,) = [line for line in result.err.splitlines() if line.startswith("warning: ")]
    (told,) = json.loads(result.out)["warnings"]
    assert told["field"] == "navigation.states" and line.endswith(told["text"])
    assert "stands on the ground for 3 s" in told["text"]


def turning(rate, seconds=100.0, hz=100.0):
    """A minute at rest, then a body that spins about x."""
    t_s = np.arange(0.0, 60.0 + seconds, 1.0 / hz)
    angle = rate * np.maximum(t_s - 60.0, 0.0)
    q_ib = np.array([rotation.quat_from_rotvec(np.array([one, 0.0, 0.0])) for one in angle])
    omega_b = np.where(t_s[:, None] > 60.0, [rate, 0.0, 0.0], 0.0)
    return lasting.turned(SimpleNamespace(t_s=t_s, q_ib=q_ib, omega_ib_b=omega_b))


def test_what_an_error_of_the_gyros_makes_of_a_spin():
    """The scale factor of the roll gyro grows with the angle; what is across goes round."""
    angle = 9.0 * lasting.WINDOW_S
    worst = np.sqrt(turning(9.0).max(axis=0))
    assert worst[0, 0] == pytest.approx(angle, rel=0.01)
    assert worst[1, 0] < 2.1 and worst[2, 0] < 2.1  # 2 of a radian per rad: a half turn
    assert not worst[:, 1:].any()
    assert turning(0.04) is None


def told_of_turns(states, rate=9.0, *overrides):
    """What is said of the gyros of the default scenario in a spin."""
    scenario = load.load(DEFAULT, [f"navigation.states={states}", "star_tracker.enabled=false", *overrides])
    return lasting.words(scenario, programme.Flown((), 0.0, 160.0, turned=turning(rate)))


def test_a_spin_that_makes_an_error_of_the_gyros_too_large_for_noise_is_told():
    """The default flight without gyro_roll_column: NEES of the attitude per axis 1460 at T+150 s."""
    text = told_of_turns("[gravity]")
    size = np.degrees(30e-6 * 9.0 * lasting.WINDOW_S / np.sqrt(3.0))
    assert text.startswith(f"gyro_roll_column is missing: its error turns the attitude by {size:.2g} deg")
    assert text.endswith("write states: [gyro_roll_column, gravity]")
    for enough in ("[gyro_roll_column]", "[gyro_scale]", "[gyro_scale, gyro_misalignment]"):
        assert not told_of_turns(enough)
    assert told_of_turns("[gyro_misalignment]").endswith("write states: [gyro_scale, gyro_misalignment]")
    assert not told_of_turns("[gravity]", 9.0, "imu.gyro.scale_factor_roll=1 ppm")  # noise is larger
    assert not told_of_turns("[gravity]", 9.0, "navigation.manoeuvre_angle=100 rad")  # noise stands for it


def test_a_camera_that_is_off_for_good_is_told():
    """NEES of the attitude of the default flight without the block: 4700 to 14500, 3 expected."""
    without = OF_THE_DEFAULT.replace(", mounting", "")

    def text(*overrides):
        return said(load.load(DEFAULT, [without, *overrides]))

    error = np.hypot(0.02, np.degrees(0.3 * 9.9e-6 / 24.95e-3))
    assert text().startswith(f"mounting is missing: the star camera is off by {error:.3g} deg (1 sigma, of ")
    assert text().endswith(f"write states: {OF_THE_DEFAULT.partition('=')[2]}")
    assert not said(load.load(DEFAULT, [OF_THE_DEFAULT])) and not text("star_tracker.enabled=false")
    mounted, point = "star_camera.mounting.error=0 deg", "star_camera.optics.principal_point_error=0 pix"
    assert text(mounted) and text(point) and not text(mounted, point)
    absent = "without=[camera_mounting, camera_principal_point]"
    assert not text(absent) and not text("navigation.star_fix_floor=1 deg")
