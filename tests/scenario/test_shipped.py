"""The scenarios that the package brings: found by name from anywhere, told where one is not, copied whole."""

import json
import sys
from pathlib import Path

import pytest
from broken import the_message

from shefex_nav import Scenario
from shefex_nav.commands.app import main
from shefex_nav.replay import load as replays
from shefex_nav.scenario import load, shipped

ROOT = Path(__file__).parents[2]
SCENARIOS = ROOT / "scenarios"
FLIGHTS = sorted(path.stem for path in SCENARIOS.glob("*.yaml"))
REPLAYS = sorted(path.stem for path in (SCENARIOS / "replay").glob("*.yaml"))
DATA_OF_OTHERS = {"navego", "hedy"}  # which bring none


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """An empty folder, the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def shefex_nav(monkeypatch, capsys):
    """The command line in this process: shefex_nav("check", name) -> (exit code, stdout, stderr)."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["shefex-nav", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return call


@pytest.mark.parametrize("name", FLIGHTS)
def test_every_flight_is_found_by_its_name(name, empty):
    """And loads: tests/test_wheel.py, from an empty folder, without the checkout."""
    for told in (name, f"{name}.yaml"):
        assert Path(load.file_of(told)) == SCENARIOS / f"{name}.yaml"


def test_replays_are_found_by_their_names(empty):
    for name in set(REPLAYS) - DATA_OF_OTHERS:
        _, files = replays.load(name)
        assert all(Path(file).is_file() for file in files.values() if file)
    for name in DATA_OF_OTHERS:
        with pytest.raises(load.ScenarioError, match="--data says in which folder"):
            replays.load(name)


def test_where_they_are(tmp_path, monkeypatch):
    assert shipped.folder() == str(SCENARIOS)
    (tmp_path / "scenarios").mkdir()
    monkeypatch.setattr(shipped, "PACKAGE", str(tmp_path))  # as installed
    assert shipped.folder() == str(tmp_path / "scenarios")


def test_names_are_unique():
    assert list(shipped.files()) == [*FLIGHTS, *REPLAYS]
    assert len({*FLIGHTS, *REPLAYS}) == len(FLIGHTS) + len(REPLAYS)


@pytest.mark.parametrize("name", ["orbit", "orbit.yaml"])
def test_a_file_of_ones_own_comes_first(name, empty):
    (empty / "orbit.yaml").write_text("extends: rexus_like\nmission: {name: mine}\n", encoding="utf-8")
    assert Scenario.load(name).mission.name == "mine"
    assert Scenario.load(SCENARIOS / "orbit.yaml").mission.name == "orbit"


def test_a_folder_is_no_scenario(empty):
    (empty / "orbit").mkdir()
    (empty / "mine").mkdir()
    assert Scenario.load("orbit").mission.name == "orbit"
    assert the_message("mine") == "mine: is a directory, expected a scenario file"


@pytest.mark.parametrize("base", ["shefex2_andoya", "shefex2_andoya.yaml"])
def test_ones_own_file_extends_one_of_the_package(base, empty):
    (empty / "below").mkdir()
    (empty / "below" / "mine.yaml").write_text(f"extends: {base}\n", encoding="utf-8")
    given = ["star_tracker.frames=statistical"]  # the statistics stand in a file beside the one extended
    whole = Scenario.load("below/mine.yaml", given).model_dump()
    assert whole == Scenario.load("shefex2_andoya", given).model_dump()
    (empty / "below" / "shefex2_andoya.yaml").write_text("extends: orbit\n", encoding="utf-8")
    assert Scenario.load("below/mine.yaml").orbit is not None


def test_only_bare_names_are_looked_up(empty):
    for name in ("./orbit.yaml", "below/orbit", str(empty / "orbit.yaml")):
        folder = "; there is no folder 'below'" if name.startswith("below") else ""
        assert the_message(name) == f"{name}: there is no such file{folder}"


def test_an_unknown_name_is_told_with_places_and_guesses(empty):
    said = the_message("shefex2_andoja")
    assert said.startswith(
        f"shefex2_andoja: there is no such file in {empty}, and no scenario 'shefex2_andoja'"
    )
    assert f"(in {SCENARIOS}); did you mean shefex2_andoya" in said
    assert said.endswith("`shefex-nav scenarios` lists all")
    assert the_message("xyz").endswith(f"there are {', '.join([*FLIGHTS, *REPLAYS])}")
    mine = empty / "mine.yaml"
    mine.write_text("extends: orbitt\n", encoding="utf-8")
    said = the_message(mine)
    assert said.startswith(
        f"{mine}:1:10: extends: '{empty / 'orbitt'}' there is no such file, and no scenario"
    )
    assert "did you mean orbit?" in said


@pytest.mark.parametrize(
    "words",
    [
        ("run", "shefex2_andoja"),
        ("check", "shefex2_andoja"),
        ("check", "orbit", "--against", "shefex2_andoja"),
        ("campaign", "shefex2_andoja", "--runs", "3"),
        ("characterise", "shefex2_andoja", "--runs", "6", "--out", "x.json"),
        ("verify", "bound", "shefex2_andoja"),
        ("verify", "consistency", "shefex2_andoja"),
        ("replay", "shefex2_andoja"),
        ("scenarios", "shefex2_andoja"),
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_every_command_refuses_an_unknown_name(words, empty, shefex_nav):
    code, out, err = shefex_nav(*words)
    assert code == 2 and not out
    assert "shefex2_andoja: " in err and "did you mean shefex2_andoya" in err and err.count("\n") == 1
    assert not list(empty.iterdir())


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("ln200s", "did you mean the instrument ln_200s? `shefex-nav scenarios` lists all"),
        ("shefex2_andoja", "did you mean shefex2_andoya or "),
        ("xyz", "and the instruments adis16465_1, adis16470, "),
    ],
)
def test_a_name_of_neither_scenario_nor_instrument(name, words, empty, shefex_nav):
    code, _, err = shefex_nav("scenarios", name)
    assert code == 2 and words in err and err.startswith(f"{name}: no scenario or instrument '{name}' comes")


def test_the_list_has_a_sentence_for_each(empty, shefex_nav):
    code, out, _ = shefex_nav("scenarios", "--json")
    listed = json.loads(out)["scenarios"]
    assert code == 0 and [one["name"] for one in listed] == [*FLIGHTS, *REPLAYS]
    assert {one["command"] for one in listed if one["name"] in FLIGHTS} == {"run"}
    assert {one["command"] for one in listed if one["name"] in REPLAYS} == {"replay"}
    for one in listed:
        start = Path(one["file"]).read_text(encoding="utf-8").replace("\n# ", " ")
        assert start.startswith(f"# {one['description']}"), one
        assert 30 < len(one["description"]) < 250 and one["description"].count("(") == one[
            "description"
        ].count(")")
    code, out, _ = shefex_nav("scenarios")
    assert code == 0 and all(one["name"] in out for one in listed)


def test_one_is_printed_as_it_is(empty, shefex_nav):
    assert shefex_nav("scenarios", "orbit") == (0, (SCENARIOS / "orbit.yaml").read_text(encoding="utf-8"), "")


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_copy_needs_nothing_else(name, empty, monkeypatch):
    given = ["star_tracker.frames=statistical"] if name == "shefex2_dispersed" else []
    before = load.load(name, given).model_dump()
    paths = shipped.with_what_it_names(shipped.files()[name])
    for path in paths:
        target = empty / "copy" / Path(path).relative_to(SCENARIOS)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(Path(path).read_bytes())
    (empty / "nowhere" / "data").mkdir(parents=True)
    (empty / "nowhere" / "data" / "instruments").symlink_to(SCENARIOS / "data" / "instruments")  # by name
    monkeypatch.setattr(shipped, "folder", lambda: str(empty / "nowhere"))
    after = load.load(empty / "copy" / f"{name}.yaml", given).model_dump()
    if before["trajectory"] is not None:  # its file is named where it is, with its content
        was, now = before["trajectory"].pop("file"), after["trajectory"].pop("file")
        assert Path(now) == empty / "copy" / Path(was).relative_to(SCENARIOS)
    assert after == before


def test_copies_overwrite_nothing(empty, shefex_nav):
    assert shefex_nav("scenarios", "csv_example", "--copy", "mine")[0] == 0
    made = sorted(path.relative_to(empty / "mine").as_posix() for path in (empty / "mine").rglob("*.*"))
    assert made == ["csv_example.yaml", *(f"csv_example/{name}.csv" for name in ("gnss", "imu", "truth"))]
    replays.load(empty / "mine" / "csv_example.yaml")
    assert shefex_nav("scenarios", "csv_example", "--copy", "mine") == (0, "", "")  # the same is there
    (empty / "mine" / "csv_example.yaml").unlink()
    (empty / "mine" / "csv_example" / "gnss.csv").write_text("mine", encoding="utf-8")
    code, _, err = shefex_nav("scenarios", "csv_example", "--copy", "mine")
    assert code == 2 and "gnss.csv exists already" in err
    assert not (empty / "mine" / "csv_example.yaml").exists()
    (empty / "file").touch()
    code, _, err = shefex_nav("scenarios", "orbit", "--copy", "file")
    assert code == 2 and err.startswith("--copy: file") and err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--copy", "x"), "--copy: needs the NAME of a scenario"),
        (("orbit", "--json"), "--json: is for the list"),
    ],
)
def test_what_does_not_go_together_is_refused(words, said, empty, shefex_nav):
    code, _, err = shefex_nav("scenarios", *words)
    assert code == 2 and err.startswith(said)
