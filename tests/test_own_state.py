"""A block of states of a plug-in in a mission: flown, logged, run again and smoothed like any other."""

import csv
import re
from pathlib import Path

import numpy as np
import plugin_tables
import pytest

from shefex_nav import instruments, plugins, prepare
from shefex_nav.log import reader
from shefex_nav.onboard.navigation.blocks import ImuMean
from shefex_nav.report import programme
from shefex_nav.scenario import aboard
from shefex_nav.scenario.load import ScenarioError, load

ROOT = Path(__file__).parent.parent
TEXT = """# Drift.
extends: rexus_like.yaml
plugins: [gyro_drift.py]
mission: {name: drift}
navigation:
  states: STATES
  gyro_drift: {drift: 1e-3 deg/s2}
"""


@pytest.fixture(autouse=True)
def forgotten(monkeypatch, tmp_path):
    """Nothing that a test loads, or consents to, is there in the next one."""
    (tmp_path / "config").mkdir()  # astropy warns of one that is not there
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(plugins.CONSENT, "")
    with plugin_tables.restored():
        yield


@pytest.fixture
def code(tmp_path):
    """The example of the pages, as its readers copy it."""
    page = (ROOT / "docs" / "how-to" / "state.md").read_text()
    path = tmp_path / "gyro_drift.py"
    path.write_text(re.search(r"```python\n# gyro_drift.py\n(.*?)```", page, re.DOTALL)[1])
    return path


def scenario(folder, states="automatic", text=TEXT):
    path = folder / "drift.yaml"
    path.write_text(text.replace("STATES", states))
    return path


def message(path):
    with pytest.raises(ScenarioError) as caught:
        load(str(path), trust=True)
    return str(caught.value)


def named(folder):
    """Block and unit of each row of the table of states."""
    with open(folder / "nav_states.csv", newline="") as file:
        return [(row["block"], row["unit"]) for row in csv.DictReader(file)]


@pytest.mark.slow
def test_it_is_a_block_like_any_other(tmp_path, code, command):
    """Table of states, log, tables, the same filter again, another filter, the smoother."""
    path, log = scenario(tmp_path), tmp_path / "a.mcap"
    said = command("check", path, "--trust")
    assert said.code == 0 and "navigation.gyro_drift is given" in said.out, said.err
    flown = command("run", path, "--until", "60s", "--seed", 1, "--out", log)
    assert flown.code == 0, flown.err
    data = reader.read(log)
    assert data.covariance.states[-1].split()[-1] == "gyro_drift"
    sigma = np.array([row[-3:] for row in data.covariance.sigmas])
    assert sigma[0] == pytest.approx(np.full(3, np.radians(1e-3)), rel=1e-3)
    assert sigma[-1][0] < 0.8 * sigma[0][0] and np.all(sigma[-1] < sigma[0])  # GPS alone sees little of it
    assert command("export", log, "--csv", tmp_path / "tables").code == 0
    assert named(tmp_path / "tables")[-3:] == [("gyro_drift", "rad/s2")] * 3
    again = command("replay", log, "--log", tmp_path / "b.mcap")
    assert again.code == 0, again.err
    once_more = reader.read(tmp_path / "b.mcap")
    np.testing.assert_array_equal(once_more.nav.q_ib, data.nav.q_ib)
    np.testing.assert_array_equal(once_more.covariance.sigmas[-1], data.covariance.sigmas[-1])
    without = command("replay", log, "--set", "navigation.states=[gyro_scale]", "--log", tmp_path / "c.mcap")
    assert without.code == 0, without.err
    assert reader.read(tmp_path / "c.mcap").covariance.states[-1] == "gyro_scale"
    smoothed = command("smooth", log, "--out", tmp_path / "d.mcap")
    assert smoothed.code == 0, smoothed.err
    last = reader.read(tmp_path / "d.mcap").covariance
    assert last.states[-1].split()[-1] == "gyro_drift"
    assert last.sigmas[0][-3] < 0.8 * sigma[0][0]


def test_a_log_is_read_by_somebody_without_the_plugin(tmp_path, code, command):
    path, log = scenario(tmp_path), tmp_path / "a.mcap"
    assert command("run", path, "--trust", "--until", "1s", "--seed", 1, "--out", log).code == 0
    plugins._LOADED.clear()
    instruments.OWN_STATES.clear()
    code.unlink()
    assert reader.read(log).covariance.states[-1].split()[-1] == "gyro_drift"
    assert command("export", log, "--csv", tmp_path / "tables").code == 0
    assert named(tmp_path / "tables")[-4:] == [("accel_rectification", "m/s2"), *[("gyro_drift", "")] * 3]


def test_what_is_known_at_the_start_has_to_be_said(tmp_path, code):
    """A list that names the block needs its section; `automatic` without one leaves the block out."""
    without = TEXT.replace("  gyro_drift: {drift: 1e-3 deg/s2}\n", "")
    said = message(scenario(tmp_path, "[mounting, gyro_drift]", without))
    assert "drift.yaml:6:" in said and "navigation.states.1: " in said
    assert "Give section navigation.gyro_drift" in said
    loaded = load(str(scenario(tmp_path, "automatic", without)), trust=True)
    assert "gyro_drift" not in prepare.settled(loaded).navigation.states
    loaded = load(str(scenario(tmp_path, "[gyro_drift]")), trust=True)
    (block,) = prepare.build_world(loaded, 1).computer.nav.own_blocks
    assert np.allclose(np.sqrt(np.diag(block.P)), np.radians(1e-3))
    sensed = ImuMean(7.0, np.zeros(3), np.zeros(3))
    np.testing.assert_array_equal(block.drives(sensed), np.vstack([7.0 * np.eye(3), np.zeros((3, 3))]))


def test_a_section_that_no_filter_looks_at_is_told(tmp_path, code):
    """A list of states without the block: it was left out without a word."""
    path = scenario(tmp_path, "[gyro_roll_column, mounting]")
    (one,) = aboard.unused_blocks(load(str(path), trust=True))
    assert one[0] == ("navigation", "gyro_drift")
    assert one[1].endswith("write [gyro_roll_column, mounting, gyro_drift]")
    assert one in [tuple(warned) for warned in programme._by_itself(load(str(path), trust=True))]
    for states in ("automatic", "[gyro_drift]"):
        assert not list(aboard.unused_blocks(load(str(scenario(tmp_path, states)), trust=True)))


def test_its_section_is_checked_as_any_other(tmp_path, code):
    wrong = TEXT.replace("1e-3 deg/s2", "1e-3 deg/s")
    assert "navigation.gyro_drift.drift" in message(scenario(tmp_path, text=wrong))


WRONG = (  # text of the file, what stands in its place, what is said
    ('OwnState("gyro_drift"', 'OwnState("Gyro drift"', "must be lower case"),
    ('OwnState("gyro_drift"', 'OwnState("gravity"', "the program has that name already"),
    ('OwnState("gyro_drift"', 'OwnState("release"', "navigation.release is a setting of the program"),
    ('OwnState("gyro_drift", 3', 'OwnState("gyro_drift", 0', "size must be a number of errors, got 0"),
    ("GyroDrift, block)", "7, block)", "settings must be a class of Settings, got 7"),
    ("GyroDrift, block)", "GyroDrift, 7)", "its block must be a function, got 7"),
    ('"5e-5 deg/s2", "of', '"5e-5 deg", "of', "setting drift of GyroDrift: its example or default"),
)


@pytest.mark.parametrize(("old", "new", "words"), WRONG)
def test_what_is_wrong_with_its_description_is_one_line(tmp_path, code, old, new, words):
    assert old in code.read_text()
    code.write_text(code.read_text().replace(old, new, 1))
    said = message(scenario(tmp_path))
    assert words in said and "plugins.0: " in said
    assert len(said.splitlines()) == 1


FAULTS = (  # likewise, of what shows when it flies only
    # variances of 1e-12: symmetry counts by their size
    (
        "settings.drift**2 * np.eye(3)",
        "settings.drift**2 * np.triu(np.ones((3, 3)))",
        "P must be a covariance",
    ),
    ('Block("gyro_drift"', 'Block("drift"', "block must give a Block of that name"),
    ("settings.drift**2 * np.eye(3)", "-np.eye(3)", "P must be a covariance, got [[-1.0"),
    ("settings.drift**2 * np.eye(3)", "np.full((3, 3), np.nan)", "P must be numbers, shape (3, 3), got some"),
    ("walk=np.zeros(3)", "walk=-np.ones(3)", "walk must not be negative"),
    ("walk=np.zeros(3)", "walk='none'", "walk must be numbers, got 'none'"),
    ("np.eye(3), walk", "np.eye(2), walk", "P must be numbers, shape (3, 3), got shape (2, 2)"),
    ("walk=np", "F=-20.0 * np.eye(3), walk=np", "elements of a row of F must add up to at most 10 /s"),
    ("    return Block(", "    settings.nothing\n    return Block(", "has no attribute 'nothing'"),
    ("np.zeros((3, 3))])", "np.zeros((2, 3))])", "must be numbers, shape (6, 3)"),
    ("since_s * np.eye(3)", "np.nan * np.eye(3)", "must be numbers, shape (6, 3)"),
)


def test_check_asks_for_the_block(tmp_path, code, command):
    code.write_text(code.read_text().replace("walk=np.zeros(3)", "walk=-np.ones(3)"))
    done = command("check", scenario(tmp_path), "--trust")
    assert done.code == 2 and "block of states 'gyro_drift': walk must not be negative" in done.err


def test_two_blocks_of_one_name_are_refused(tmp_path, code):
    text = code.read_text()
    one = text[text.index("OwnState(", text.index("PROVIDES")) : text.rindex("]")]
    code.write_text(text.replace(one, f"{one}, {one}"))
    assert "there is a 'gyro_drift' already" in message(scenario(tmp_path))


FAULTS_OF_FLIGHT = [*FAULTS[:3], *(pytest.param(*one, marks=pytest.mark.slow) for one in FAULTS[3:])]


@pytest.mark.parametrize(("old", "new", "words"), FAULTS_OF_FLIGHT)
def test_code_that_goes_wrong_in_flight_is_named(old, new, words, tmp_path, code, command):
    text = code.read_text()
    assert old in text
    code.write_text(text.replace(old, new, 1))
    flown = command("run", scenario(tmp_path), "--trust", "--until", "1s", "--out", tmp_path / "a.mcap")
    assert flown.code != 0
    assert words in flown.err and "block of states 'gyro_drift'" in flown.err, flown.err
