"""Files of another kind in the place of a scenario: one line says what it is and which command takes it."""

import pytest
from broken import DEFAULT, the_message

from shefex_nav.replay import load as replays
from shefex_nav.replay.schema import ReplayScenario
from shefex_nav.scenario import kind
from shefex_nav.scenario.load import Scenario, ScenarioError

SCENARIOS = DEFAULT.parent
EXAMPLE = SCENARIOS / "replay" / "csv_example.yaml"
STARTS = {  # first bytes of a file, and what is said of it
    b"\x89MCAP0\r\n\xff\xfe": "is a log, expected a scenario file; `shefex-nav report`",
    b"\x89PNG\r\n\x1a\n": "is a picture, expected a scenario file; `shefex-nav solve`",
    b"\xff\xd8\xff\xe0": "is a picture",
    b"PK\x03\x04\xff": "is an archive",
    b"\xfe\xff\x00": "is not UTF-8 text",
}


@pytest.mark.parametrize("start", STARTS)
def test_what_holds_no_text_is_named(tmp_path, start):
    path = tmp_path / "mission.yaml"
    path.write_bytes(start)
    assert the_message(path).startswith(f"{path}: {STARTS[start]}")


def test_a_replay_scenario_has_its_own_command(tmp_path):
    assert the_message(EXAMPLE).startswith(f"{EXAMPLE}: is a replay scenario, ")
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"extends: {EXAMPLE}\ngnss: {{latency: 0.1 s}}\n", encoding="utf-8")
    assert f"`shefex-nav replay {mine}` runs" in the_message(mine)


@pytest.mark.parametrize("name", ["orbit", "night_sky", "tight", "shefex2_dispersed"])
def test_a_flight_is_nothing_to_replay(name):
    path = SCENARIOS / f"{name}.yaml"
    with pytest.raises(ScenarioError) as refused:
        replays.load(path)
    (said,) = refused.value.messages
    assert said.startswith(f"{path}: is a scenario of a flight; `shefex-nav run {path}` flies it")


def test_the_files_of_others_commands_are_named(tmp_path):
    statistics = SCENARIOS / "data" / "star_tracker_shefex2.json"
    assert the_message(statistics).startswith(f"{statistics}: holds the statistics of a star tracker")
    head = tmp_path / "campaign.json"
    head.write_text('{"format": 2, "digest": "a", "source": "b", "sampling": "random"}', encoding="utf-8")
    assert f"`shefex-nav report {tmp_path}` reads" in the_message(head)
    assert the_message(tmp_path).startswith(f"{tmp_path}: is the folder of a campaign, expected a scenario")


def test_a_file_without_most_sections_was_to_extend_another(tmp_path):
    path = tmp_path / "part.yaml"
    path.write_text("launch: {elevation: 80 deg}\n", encoding="utf-8")
    said = the_message(path)
    assert said.startswith(f"{path}:1:1: mission, earth, vehicle, ")
    assert said.endswith("such as 'extends: shefex2_andoya.yaml'")


def test_which_sections_are_of_one_kind_alone():
    assert set(Scenario.keys()) - set(ReplayScenario.keys()) == set(kind.OF_FLIGHTS)
    assert set(ReplayScenario.keys()) - set(Scenario.keys()) == set(kind.REPLAY)


def test_a_section_of_the_other_kind_is_said_to_be_one():
    said = "is a section of replay scenarios (`shefex-nav replay`), this is one of a flight"
    assert the_message(DEFAULT, ["data.axes=1"]) == f"--set data.axes: data: {said}"
    assert the_message(DEFAULT, ["gnss.latency=1 s"]).endswith(f"gnss: {said}; did you mean 'gps'?")
    with pytest.raises(ScenarioError) as refused:
        replays.load(EXAMPLE, ["vehicle.payload=3", "pad_alignment={}"])
    said = "is a section of scenarios of flights (`shefex-nav run`), this is one of a replay"
    assert refused.value.messages == (
        f"--set pad_alignment: {said}; did you mean 'alignment'?",
        f"--set vehicle.payload: vehicle: {said}",
    )
