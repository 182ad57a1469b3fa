"""Programmes whose times do not fit the flight: found where it was flown, told with the place of the time."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from shefex_nav import prepare
from shefex_nav.geometry import frames, wgs84
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.records import Event, Phase, TruthSample, rows
from shefex_nav.report import metrics, page, programme, table
from shefex_nav.scenario import load
from shefex_nav.scenario.document import dotted

ROOT = Path(__file__).parents[2]
DEFAULT = ROOT / "scenarios" / "shefex2_andoya.yaml"
FLAT = "launch.elevation=84 deg"
SHIFTED = (  # as far as the entry moves
    FLAT,
    "programme.pointing.until=329 s",
    "programme.entry_slew.from=329 s",
    "programme.entry_slew.until=341 s",
    "programme.entry_slew.at=362 s",
    "vehicle.spin_motors.at=341 s",
    "star_tracker.off=342 s",
)


def fields(found):
    return [dotted(one.field) for one in found]


@pytest.fixture(scope="module")
def scenario():
    return load.load(DEFAULT)


ACCEPTANCE = "star_tracker.identification.acceptance"


@pytest.fixture(scope="module")
def flat():
    """A flatter launch under the programme of the default mission, and its flight."""
    scenario = load.load(DEFAULT, [FLAT])
    return scenario, prepare.fly_vehicle(scenario, 1)


@pytest.mark.parametrize(("day", "is_said"), [("2012-06-22", False), ("2040-06-22", True)])
def test_a_day_whose_leap_seconds_are_not_known(day, is_said):
    """ERFA itself would warn in every call, which is an error here."""
    found = programme.foreseen(load.load(DEFAULT, [f"mission.epoch={day}T19:18:00Z"]))
    assert fields(found) == ["mission.epoch"] * is_said


def test_the_default_programme_fits(scenario):
    assert programme.foreseen(scenario) == ()


@pytest.mark.parametrize(
    "name", ["shefex2_woomera", "shefex2_no_precession", "rexus_like", "orbit", "night_sky"]
)
def test_programmes_of_the_package_fit(name):
    assert programme.foreseen(load.load(ROOT / "scenarios" / f"{name}.yaml")) == ()


@pytest.mark.parametrize(
    ("name", "overrides", "method"),
    [
        ("shefex2_as_flown", (), "pyramid"),
        ("shefex2_as_flown", ("star_tracker.enabled=false",), None),
        (
            "shefex2_as_flown",
            (f"{ACCEPTANCE}=verified", "star_tracker.identification.cosine_error=null"),
            None,
        ),
        ("shefex2_andoya", (), None),
        ("bright_three_star", (), "brightness"),
    ],
)
def test_attitudes_that_nobody_verifies_are_told(name, overrides, method):
    """One line, with the key; nothing where each is verified, or where the star tracker does not fly."""
    scenario = load.load(ROOT / "scenarios" / f"{name}.yaml", overrides)
    found = [one for one in programme.foreseen(scenario) if one.field[-1] == "acceptance"]
    assert fields(found) == [ACCEPTANCE] * (method is not None)
    for one in found:
        assert f"method {method!r} is accepted as its paper does" in one.text
        assert "wrong attitudes are believed" in one.text and "\n" not in one.text


def test_a_flatter_launch_is_told(flat):
    """The camera is to look at stars while the vehicle is below 100 km: by the trajectory, not by events."""
    scenario, flight = flat
    found = programme.warnings(scenario, programme.of_flight(flight))
    assert fields(found) == [
        "programme.pointing.until", "programme.entry_slew.from", "programme.entry_slew.at",
        "vehicle.spin_motors.at", "star_tracker.off",
    ]  # fmt: skip
    trajectory, earth = flight.trajectory, prepare.earth_rotation(scenario)

    def height_km(t_s):
        k = int(np.searchsorted(trajectory.t_s, t_s))
        r_e, _ = frames.ecef_from_inertial(earth, trajectory.t_s[k], trajectory.r_i[k], trajectory.v_i[k])
        return wgs84.geodetic_from_ecef(r_e)[2] / 1e3

    below_s = next(t_s for t_s in np.arange(300.0, 372.0, 0.1) if height_km(t_s) < 100.0)
    text = found[0].text
    assert f"372 s is {372.0 - below_s:.1f} s after the entry" in text or (
        f"372 s is {372.05 - below_s:.1f} s after the entry" in text
    )
    assert f"at {height_km(372.0):.1f} km" in text


def test_a_programme_that_is_shifted_fits():
    assert programme.foreseen(load.load(DEFAULT, SHIFTED)) == ()


def test_a_flight_that_stays_in_the_air_is_told():
    overrides = ["launch.elevation=78 deg", "programme.pointing=null", "programme.entry_slew=null",
                 "vehicle.spin_motors=null"]  # fmt: skip
    found = programme.foreseen(load.load(DEFAULT, overrides))
    assert "programme.slew" in fields(found)
    assert "stays in the air, its apogee is 58.6 km" in found[0].text
    fields_named = "launch.elevation (78 deg) or programme.precession.elevation (8.58 deg)"
    assert f"; a larger {fields_named} raises it" in found[0].text


def test_a_steeper_burn_brings_the_vehicle_out_of_the_air():
    """The warning names the second burn's elevation; with a larger one the same launch is good."""
    low = ["launch.elevation=80 deg"]
    found = programme.foreseen(load.load(DEFAULT, low))
    assert "programme.precession.elevation (8.58 deg) raises it" in found[0].text
    assert programme.foreseen(load.load(DEFAULT, [*low, "programme.precession.elevation=45 deg"])) == ()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            [],
            "; a larger launch.elevation (86.43 deg) or programme.precession.elevation (8.58 deg) raises it",
        ),
        (["launch.elevation=90 deg"], "; a larger programme.precession.elevation (8.58 deg) raises it"),
        (
            ["launch.elevation=90 deg", "programme.precession=null"],
            "; it burns straight up: it takes more impulse of the motors, or less mass or drag",
        ),
        (  # a turn after the burn makes nobody higher
            ["vehicle.stages.S44.ignition=66 s", "programme.damping=null"],
            "; a larger launch.elevation (86.43 deg) raises it",
        ),
    ],
)
def test_only_what_helps_is_named(overrides, words):
    assert programme._steeper(load.load(DEFAULT, overrides), 95.0) == words


def test_an_elevation_that_cannot_help_is_not_named():
    """A throw at 84 deg reaches 1.1 % less than one straight up, with 15 deg of bending 15 %."""
    steep = load.load(DEFAULT, ["launch.elevation=84 deg", "programme.precession=null"])
    gained = 1.0 / math.sin(math.radians(84.0 - 15.0)) ** 2
    assert 1.14 < gained < 1.15
    assert "launch.elevation (84 deg) raises it" in programme._steeper(steep, 100.1 / gained)
    for top_km in (99.9 / gained, 15.6):
        said = programme._steeper(steep, top_km)
        assert "not even a burn straight up would reach 100 km" in said
        assert "more impulse" in said and "elevation" not in said


OF_OUTAGES = "lift_off", "burn_out_1", "separation_1", "ignition_2", "burn_out_2"  # of the GPS receiver


def flown(*events, end_s=500.0, astray_deg=0.2):
    made = [Event(t_s, name, 1e3 * height_km, "") for t_s, name, height_km in events]
    given = {event.name for event in made}
    made += [Event(1.0, name, 1e3, "") for name in OF_OUTAGES if name not in given]
    return programme.Flown(tuple(made), astray_deg, end_s)


USUAL = (
    (235.0, "slew_start", 174.0),
    (262.0, "apogee", 177.0),
    (398.0, "entry", 100.0),
    (497.0, "impact", 0.0),
)


@pytest.mark.parametrize(
    ("events", "field", "words"),
    [
        ([(120.0, "slew_start", 90.0), *USUAL[1:]], "programme.slew.from", "on the way up, at 90.0 km"),
        ([*USUAL, (240.0, "burn_out_2", 175.0)], "programme.slew", "while S44 burns, T+149.2 to +240.0 s"),
        (
            [*USUAL, (300.0, "cold_gas_empty", 170.0)],
            "vehicle.cold_gas.propellant",
            "8 kg are used up at T+300.0 s",
        ),
        (
            [*USUAL[:2], (340.0, "entry", 100.0), (360.0, "impact", 0.0)],
            "programme.entry_slew.from",
            "after the impact",
        ),
    ],
)
def test_what_does_not_fit(scenario, events, field, words):
    end_s = max(t_s for t_s, *_ in events)
    found = {dotted(one.field): one.text for one in programme.warnings(scenario, flown(*events, end_s=end_s))}
    assert words in found[field]


def test_a_flight_that_never_leaves_the_air_is_told_of_its_slew(scenario):
    """No entry that the time could be counted from: a first motor that is misaligned, an apogee of 92 km."""
    low = (235.0, "slew_start", 91.0), (262.0, "apogee", 92.0), (330.0, "altitude_60km", 60.0)
    found = programme.warnings(scenario, flown(*low, (420.0, "impact", 0.0)))
    words = {dotted(one.field): one.text for one in found}
    assert "405 s is on the way down, below 60 km" in words["programme.entry_slew.at"]
    found = programme.warnings(scenario, flown(*low, (390.0, "impact", 0.0)))
    words = {dotted(one.field): one.text for one in found}
    assert "405 s is after the impact, T+390.0 s" in words["programme.entry_slew.at"]


def test_an_attitude_that_is_lost_is_told(scenario):
    found = programme.warnings(scenario, flown(*USUAL, astray_deg=44.25))
    assert fields(found) == ["programme"] and "up to 44.2 deg off" in found[0].text
    assert not programme.warnings(scenario, flown(*USUAL, astray_deg=0.7))


class Samples(NamedTuple):
    """Of truth or of the attitude control."""

    t_s: np.ndarray
    phase: np.ndarray | None = None
    pointing_error: np.ndarray | None = None


def test_pointing_errors_count_while_pointing():
    """Of the phase POINTING alone, the whole angle."""
    phase = np.array([int(Phase.MANOEUVRE), int(Phase.POINTING)])
    truth = Samples(np.array([0.0, 1.0]), phase)
    error = np.radians([[50.0, 0.0, 0.0], [3.0, 4.0, np.nan]])
    assert programme.astray_deg(Samples(truth.t_s, None, error), truth) == pytest.approx(5.0)
    assert programme.astray_deg(Samples(np.zeros(0), None, np.zeros((0, 3))), truth) == 0.0
    assert programme.astray_deg(None, truth) == 0.0


def test_the_slew_before_pointing_does_not_count_in_a_thinned_log():
    """Truth at 10 Hz, control at 100 Hz; the phase begins at 1 s, until then the vehicle turns."""
    t_s = np.arange(0.0, 2.0, 0.1)
    truth = Samples(t_s, np.where(t_s < 0.999, int(Phase.MANOEUVRE), int(Phase.POINTING)))
    times = np.arange(0.0, 1.9, 0.01)
    error = np.zeros((len(times), 3))
    error[:, 1] = np.radians(np.where(times < 0.999, 60.0, 0.5))
    assert programme.astray_deg(Samples(times, None, error), truth) == pytest.approx(0.5)


def test_nothing_is_said_of_what_was_not_seen(flat):
    scenario, flight = flat
    seen = [event for event in flight.events if event.t_s < 340.0]
    assert programme.warnings(scenario, programme.Flown(tuple(seen), 0.3, 340.0)) == ()


@pytest.fixture(scope="module")
def data(flat):
    """RunData of that flight: its events and its truth once a second."""
    scenario, flight = flat
    true = flight.trajectory
    every = TruthSample(
        *(true.t_s, true.phase.astype(np.int64), true.r_i, true.v_i, true.q_ib, true.omega_ib_b),
        *(true.f_b, true.angle_of_attack),
    )
    builder = RunDataBuilder(prepare.mission(scenario, 1, true))
    for record in rows(every)[::400]:
        builder.add(record)
    for event in flight.events:
        builder.add(event)
    return builder.build()


def test_result_table_and_page_tell(flat, data):
    scenario, flight = flat
    summary = metrics.summarise(data)
    wanted = programme.warnings(scenario, programme.of_flight(flight))
    assert summary["warnings"] == [{"field": dotted(one.field), "text": one.text} for one in wanted]
    assert metrics.summarise(data, scenario=scenario)["warnings"] == summary["warnings"]
    lines = dict(table.rows(summary))["warnings"]
    assert [name for name, _ in lines] == fields(wanted)
    text = page.page(data).replace("<wbr>", "")
    assert "The scenario does not fit the flight" in text and "programme.entry_slew.at" in text


def test_table_and_page_name_what_the_computer_is_told_otherwise(flat, data):
    """Of a run as `check` does of a scenario: figures, and what a wrong calibration does to stars."""
    assert metrics.summarise(data)["told_otherwise"] == []
    told = {"imu.gyro.bias": "3 deg/h", "star_camera.optics.focal_length": "25.2 mm"}
    scenario = load.load("shefex2_andoya", [f"navigation.told.{key}={value}" for key, value in told.items()])
    summary = metrics.summarise(data, scenario=scenario)
    assert [one["field"] for one in summary["told_otherwise"]] == [
        *(f"navigation.told.{key}" for key in told),
        "navigation.told.star_camera.optics",
    ]
    (bias, _), (_, length), (_, stars) = dict(table.rows(summary))["told otherwise"]
    assert bias == "imu.gyro.bias" and length == "25.2 mm, the truth is 24.95 mm"
    corner_px = math.hypot(658, 493) / 2 * (25.2 / 24.95 - 1)
    assert stars.startswith(f"stars are up to {corner_px:.2f} pixels from where they are expected")


def test_a_log_whose_scenario_cannot_be_read_is_not_judged(data):
    text = data._replace(mission=data.mission._replace(scenario_text="mission: {name: x}"))
    summary = metrics.summarise(text)
    assert summary["warnings"] is None and summary["told_otherwise"] is None


def test_check_names_file_and_line(command, tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        f"extends: {DEFAULT}\nlaunch:\n  elevation: 84 deg\nvehicle:\n  spin_motors:\n    at: 390 s\n"
    )
    result = command("check", mine)
    assert result.code == 0 and result.out == f"{mine}: good, with 5 warnings\n"
    *lines, seen = result.err.splitlines()
    assert len(lines) == 5 and all(line.startswith("warning: ") for line in lines)
    assert seen.startswith("star_camera: a field of view of ")
    motors = next(line for line in lines if "spin_motors" in line)
    assert motors.startswith(f"warning: {mine}:6:9: vehicle.spin_motors.at: 390 s is ")
    assert f"{DEFAULT}:" in lines[0] and f"change it in {mine}" in lines[0]


def test_check_refuses_a_flight_that_cannot_be(command, tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"extends: {DEFAULT}\nlaunch:\n  elevation: 75 deg\n")
    result = command("check", mine)
    assert result.code == 2 and result.out == ""
    assert "vehicle.yo_yo.at: the vehicle hits the ground at T+" in result.err
    assert result.err.startswith(f"{DEFAULT}:") and f"change it in {mine}" in result.err
    assert len(result.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("override", "field"),
    [
        ("vehicle.yo_yo.cord_length=60 m", "vehicle.yo_yo.cord_length"),
        ("vehicle.payload.mass=3000 kg", "vehicle.yo_yo.at"),
        ("programme.damping.from=0.1 s", "programme.damping.from"),
    ],
)
def test_what_cannot_be_flown_names_the_key_that_asks_for_it(command, override, field):
    result = command("check", "shefex2_andoya", "--set", override)
    assert result.code == 2 and f"{field}: " in result.err, result.err


def test_simulated_seconds_say_from_when(data):
    summary = metrics.summarise(data)
    start_s = summary["simulated_from_s"]
    assert start_s == pytest.approx(-10.0, abs=0.01) and math.isfinite(summary["simulated_s"])
    shown = dict(dict(table.rows(summary))["run"])["simulated"]
    assert shown.startswith(f"{summary['simulated_s']:.1f} s, from T-10.0 s to T+")


def test_a_warning_about_an_item_of_a_list_names_it(monkeypatch):
    warned = metrics.programme.Warned(("vehicle", "pressure_station", 10), "far off")
    monkeypatch.setattr(metrics.programme, "of_data", lambda data: None)
    monkeypatch.setattr(metrics.programme, "warnings", lambda scenario, flown: [warned])
    found = metrics._warnings(None, object())
    assert found == [{"field": "vehicle.pressure_station.10", "text": "far off"}]


@pytest.mark.parametrize(
    ("name", "overrides", "field", "words"),
    [
        ("shefex2_andoya", ("star_tracker.on=100 s",), "star_tracker.on",
         "100 s is on the way up, at 92.9 km: the star camera looks into the air"),
        ("rexus_like", ("star_tracker.enabled=true", "star_tracker.on=60 s", "star_tracker.off=120 s"),
         "star_tracker.enabled", "the vehicle stays in the air, its apogee is 80.6 km: the star camera"),
    ],
)  # fmt: skip
def test_a_star_tracker_that_is_on_in_the_air_before_the_apogee(name, overrides, field, words):
    """Its pictures would show stars through air that they do not know."""
    (text,) = [
        one.text for one in programme.foreseen(load.load(name, overrides)) if dotted(one.field) == field
    ]
    assert text.startswith(words)


def test_a_star_tracker_that_is_switched_on_above_the_air_is_right():
    """From where `check` says; the spin there is another matter."""
    spun = "star_tracker.highest_rate=600 deg/s"
    (early,) = programme.foreseen(load.load(DEFAULT, [spun, "star_tracker.on=100 s"]))
    at = early.text.partition("from T+")[2].partition(" s on")[0]
    assert programme.foreseen(load.load(DEFAULT, [spun, f"star_tracker.on={at} s"])) == ()
