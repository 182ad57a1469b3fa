"""All mistakes of a scenario at once, and none that another mistake only seems to make."""

import pytest
from broken import DEFAULT, messages

from shefex_nav.scenario import document, partial
from shefex_nav.scenario.load import Scenario, ScenarioError, load
from shefex_nav.scenario.messages import WITHOUT


def fields_of(path, overrides=()):
    """Fields that are complained about, in any order."""
    return {line.split(": ")[1] for line in messages(path, overrides)}


def written(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: {DEFAULT}\n{text}", encoding="utf-8")
    return path


def test_values_against_each_other_are_checked_beside_single_wrong_values(tmp_path):
    text = """mission: {epoch: 2012-06-22, start: -10.05 s}
log: {rate: 30 Hz}
star_tracker: {rate: 7 Hz, off: 100 s}
gps: {latency: 2}
imu: {vibration: {boost: [1 gee]}}
launch: {elevaton: 3 deg}
vehicle: {stages: {S40M: {ignition: 1}}}
"""
    assert fields_of(written(tmp_path, text)) == {
        "mission.epoch", "mission.start", "log.rate", "star_tracker.rate", "star_tracker.off", "gps.latency",
        "imu.vibration.boost", "launch.elevaton", "vehicle.stages.S40M.ignition",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "field"),
    [
        # the programme needs a cold-gas system, which is there under a misspelt name
        ("vehicle: {cold_gas: null, cold_gass: {thrust: 1 N}}", "vehicle.cold_gass"),
        # off must be later than on, which is not known
        ("star_tracker: {on: 900, off: 385 s}", "star_tracker.on"),
        # a start that is misspelt is none that is missing
        ("launch: null\nlaunsh: {elevation: 80 deg}", "launsh"),
        # nor is a model of the star tracker that cannot be read
        ("star_tracker: {frames: statistical, model: nowhere.json}", "star_tracker.model"),
        # tasks of a programme with one whose kind is misspelt
        ("programme: {slew: {task: trun}}", "programme.slew.task"),
        # a table that cannot be read has no heights that could decrease
        ("wind: {file: nowhere.csv}", "wind.file"),
    ],
)  # fmt: skip
def test_what_is_not_known_is_not_blamed_on_others(tmp_path, text, field):
    said = messages(written(tmp_path, text))
    assert all(f" {field}" in line for line in said), said


def test_every_pair_of_a_wrong_value_and_a_contradiction_is_told(tmp_path):
    """A value without its unit anywhere hides no contradiction elsewhere."""
    path = written(tmp_path, "log: {rate: 30 Hz}\n")
    for override in (
        "gps.latency=2",
        "star_camera.optics.focal_length=25",
        "wind=3",
        "orbit=3",
        "dispersions=3",
        "vehicle.stages.S40M.aerodynamics.mach=[{a: 1}, {a: 2}]",
    ):
        found = fields_of(path, [override])
        assert "log.rate" in found and len(found) > 1, override


def test_what_is_left_of_a_good_scenario_is_the_scenario():
    from shefex_nav.scenario.checks import check_what_is_known
    from shefex_nav.scenario.load import Scenario, with_saturation
    from shefex_nav.scenario.partial import validated

    scenario = load(DEFAULT)
    tree = with_saturation(document.parse(scenario.source, "source").tree)
    tree["mission"]["epoch"] = "2012-06-22T19:18:00Z"
    whole = validated(Scenario, tree, [])
    part = validated(Scenario, tree, [("gps", "latency")])
    assert whole.model_dump() == scenario.model_dump()
    assert part.star_tracker == scenario.star_tracker and part.gps.max_pdop == scenario.gps.max_pdop
    assert not hasattr(part.gps, "latency")
    assert check_what_is_known(part) == []


def test_dispersions_are_judged_when_the_fields_are_good(tmp_path):
    path = written(tmp_path, "dispersions: {launch.elevatoin: {normal: 1 deg}}\n")
    with pytest.raises(ScenarioError, match="did you mean 'elevation'"):
        load(path)


def test_a_section_that_is_there_for_one_value_of_it_is_said_to_be_new():
    """In one line with all that it needs, before what is wrong in it; not where it was given as a whole."""
    said = messages(DEFAULT, ["magnetometer.noise=1"])
    assert said[:2] == (
        "--set magnetometer.noise: magnetometer: the scenario has no magnetometer yet; a section needs all "
        "of its required fields, for example 'magnetometer: {rate: 10 Hz, hard_iron: 500 nT, noise: 50 nT}'",
        "--set magnetometer.noise: 1 has no unit; write it with one, for example '1 nT' or '1 T'",
    )
    assert not any("is missing" in line for line in said)
    first = messages(DEFAULT, ["programme.wait.from=3 s"])[0]
    assert "the scenario has no programme.wait yet" in first and "'wait: {task: damp}'" in first
    said = messages(DEFAULT, ["magnetometer.noise=1", "magnetometer={noise: 50 nT, rate: 10 Hz}"])
    assert any("magnetometer.hard_iron: is missing; expected for example" in line for line in said)


def test_a_section_that_was_replaced_in_part_is_one_line():
    """A dict in the place of a section takes all the rest away, which its author seldom wants."""
    said = messages(DEFAULT, ["imu.vibration={}", "gps.clock={bias: 2 us}", "imu.gyro={bias: 3 deg/h}"])
    (gyro,) = [line for line in said if "gyro" in line]
    assert gyro.startswith("--set imu.gyro: this replaces the whole section, and in_run_bias, ")
    assert gyro.endswith("quantum are missing; to change single values give each by its own path, as in "
                         "'imu.gyro.bias'")  # fmt: skip
    assert not any("gps.clock" in line for line in said)  # its fields have defaults


def test_an_outage_at_given_times_is_shown_its_place():
    for given in ("gps.outages=[{from: 10 s, until: 20 s}]", "gps.outage={from: 10 s, until: 20 s}"):
        (said,) = messages(DEFAULT, [given])
        assert "an outage at given times is a fault: 'faults: {gps: [" in said


def test_a_check_that_needs_what_is_not_there_ends_without_a_word():
    part = partial.validated(Scenario, {"mission": {"start": 5}}, [("mission", "start")])

    def check():
        yield "before"
        yield part.mission.start
        yield "after"

    assert partial.known(check()) == ["before"]


def test_a_check_that_is_broken_is_not_taken_for_one_that_needs_what_is_not_there():
    scenario = load(DEFAULT)

    def check():
        yield scenario.mission.strat

    with pytest.raises(AttributeError, match="strat"):
        partial.known(check())


def test_items_of_a_list_hide_nothing_of_each_other(tmp_path):
    """Faults with wrong words beside faults whose times contradict each other, in several units."""
    text = """faults:
  imu:
    - {fault: dead, sensor: gyro, axis: w, from: 200 s, until: 100 s}
    - {fault: deaf, sensor: gyro, axis: x, from: 100 s, until: 200 s}
    - {fault: dropout, from: 90 s, until: 80 s}
  gps:
    - {fault: outage, from: 5000 s, until: 6000 s}
    - {fault: outage, from: 1, until: 2 s}
  star_tracker: 3
gps:
  only:
    - {from: 5 s, until: 3 s, satellites: x}
    - {from: 9 s, until: 7 s, satellites: 3}
"""
    assert fields_of(written(tmp_path, text)) == {
        "faults.imu.0.axis", "faults.imu.0.until", "faults.imu.1.fault", "faults.imu.2.until",
        "faults.gps.0.from", "faults.gps.1.from", "faults.star_tracker", "gps.only.0.satellites",
        "gps.only.0.until", "gps.only.1.until",
    }  # fmt: skip


def test_contradictions_of_one_fault_are_told_together(tmp_path):
    text = "faults: {gps: [{fault: outage, from: 5000 s, until: 4000 s}]}\n"
    assert fields_of(written(tmp_path, text)) == {"faults.gps.0.from", "faults.gps.0.until"}


@pytest.mark.parametrize(
    ("section", "how"),
    [("gps", "fault: outage"), ("star_tracker", "star_tracker.enabled: false"),
     ("star_camera", "star_tracker.enabled: false"), ("imu", "")],
)  # fmt: skip
def test_a_section_taken_away_says_how_to_fly_without(section, how):
    (line,) = messages(DEFAULT, [f"{section}=null"])
    assert line.startswith(f"--set {section}=null") or f" {section}: is missing" in line
    assert "this section is required" in line and how in line
    assert ("; without" in line) == bool(how)


def test_the_outage_that_is_told_is_a_good_scenario():
    text = WITHOUT["gps",].partition("'faults: {gps: ")[2].removesuffix("}'")
    (fault,) = load("orbit", [f"faults.gps={text}"]).faults.gps
    assert (fault.fault, fault.start) == ("outage", 0.0)


def test_a_trajectory_that_is_wrong_hides_what_a_vehicle_needs(tmp_path):
    """Whether vehicle and programme are missing is not known; the rest is told."""
    path = tmp_path / "flight.yaml"
    path.write_text("extends: given_trajectory\ntrajectory: 385 s\nlog: {rate: 30 Hz}\n")
    lines = messages(path)
    assert len(lines) == 2, lines
    assert "trajectory: expected" in lines[0] and "log.rate: 30 Hz is not offered" in lines[1]
