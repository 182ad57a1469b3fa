"""Instruments in files of their own: `imu: {use: NAME}`, what comes on top, and what is said of mistakes."""

import json
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from broken import SCENARIO_FOLDER, messages, the_message

from shefex_nav.commands.app import main
from shefex_nav.replay import load as replays
from shefex_nav.scenario import document, instruments, shipped
from shefex_nav.scenario.differences import of_texts
from shefex_nav.scenario.instruments import SECTIONS
from shefex_nav.scenario.json_schema import json_schema
from shefex_nav.scenario.load import Pattern, ScenarioError, load, load_as
from shefex_nav.scenario.sensors import Imu

GRADES = {"hg9900": "navigation", "ln_200s": "tactical", "adis16470": "industrial MEMS",
          "icm_42688_p": "consumer MEMS"}  # fmt: skip
LISTED = instruments.listed()
NAMES = [one.name for one in LISTED]
ASSUMED = "[E] assumed"
TO_SIGMA = {"CEP": 1.0 / 1.17741, "RMS": 1.0 / 2.0**0.5, "2DRMS": 1.0 / 8.0**0.5, "1SIGMA": 1.0}
DEG_H = 3.14159265358979 / 180.0 / 3600.0
BASE = "extends: shefex2_andoya\n"


@pytest.fixture
def written(tmp_path, monkeypatch):
    """The current folder is empty; written("a.yaml", text) puts a file there and returns its path."""
    monkeypatch.chdir(tmp_path)

    def write(name, text):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return name

    return write


def plain(model):
    return model.model_dump(by_alias=True)


def file_of(one):
    """What the file of an instruments.Shipped holds."""
    return load_as(lambda provided: SECTIONS[one.instrument,], one.file)[0]


def test_what_comes_with_the_program():
    """Four grades of IMU, each better than the next in what tells grades apart."""
    kinds = [one.instrument for one in LISTED]
    assert kinds.count("imu") >= 12 and kinds.count("gps") >= 6 and kinds.count("star_camera") >= 8
    assert {one.name: one.grade for one in LISTED if one.name in GRADES} == GRADES
    grades = [load("shefex2_andoya", [f"imu.use={name}"]).imu for name in GRADES]
    for better, worse in pairwise(grades):
        for triad in ("gyro", "accelerometer"):
            for key in ("bias", "scale_factor", "misalignment"):
                assert getattr(getattr(better, triad), key) <= getattr(getattr(worse, triad), key)


@pytest.mark.parametrize("one", LISTED, ids=NAMES)
def test_each_says_its_unit_its_source_and_what_is_assumed(one):
    text, loaded = Path(one.file).read_text(encoding="utf-8"), file_of(one)
    head, body = text.split(f"instrument: {one.instrument}")
    assert loaded.grade == one.grade and loaded.source and loaded.unit.split(",")[0].split()[-1] in head
    assert ASSUMED in head and ASSUMED in body
    for line in body.splitlines():  # the mark is always written so
        assert ("[E]" in line) == (ASSUMED in line), line


@pytest.mark.parametrize("one", [one for one in LISTED if one.instrument == "gps"], ids=lambda one: one.name)
def test_noise_of_a_receiver_follows_from_the_accuracy_of_its_data_sheet(one):
    """sqrt(2) times the sigma of north and of east, which is the share of the figure that its kind says."""
    said = file_of(one)
    sigma = said.accuracy.position * TO_SIGMA[said.accuracy.position_is]
    assert said.range_noise == pytest.approx(2.0**0.5 * sigma, rel=0.01)
    sigma = said.accuracy.velocity * TO_SIGMA[said.accuracy.velocity_is]
    assert said.range_rate_noise == pytest.approx(2.0**0.5 * sigma, rel=0.01)
    assert said.rate <= said.highest_rate


def test_kinds_of_accuracy_by_drawing_errors():
    """CEP holds half of the errors north and east, 2DRMS is twice their root mean square together."""
    rng = np.random.default_rng(4)
    off = np.hypot(*rng.standard_normal((2, 400_000)))
    rms = np.sqrt(np.mean(off**2))
    drawn = {"CEP": np.median(off), "RMS": rms, "2DRMS": 2.0 * rms}
    for kind, value in drawn.items():
        assert value * TO_SIGMA[kind] == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("one", [one for one in LISTED if one.instrument == "gps"], ids=lambda one: one.name)
def test_a_receiver_replaces_what_is_its_own_and_leaves_the_vehicle(written, one):
    base = load("shefex2_andoya", ["gps.highest_speed=1 m/s"])
    own = load(written("a.yaml", f"{BASE}gps:\n  use: {one.name}\n  latency: 0.3 s\n")).gps
    said = file_of(one)
    own_keys = "range_noise", "range_rate_noise", "highest_speed", "highest_height", "clock", "reacquisition"
    for key in own_keys:
        assert getattr(own, key) == getattr(said, key)
    assert own.latency == 0.3 and base.gps.highest_speed == 1.0
    assert (own.antenna, own.spin, own.outages) == (base.gps.antenna, base.gps.spin, base.gps.outages)


@pytest.mark.parametrize(
    "one", [one for one in LISTED if one.instrument == "star_camera"], ids=lambda one: one.name
)
def test_a_camera_replaces_optics_and_detector_and_leaves_mounting_and_sky(written, one):
    """With the exposure and the identification that suit it: a scenario of its own is not made by `use`."""
    said = file_of(one)
    sets = ["star_tracker.rate=2 Hz", f"star_tracker.detection.saturation={2**said.detector.bits - 1} DN"]
    sets += ["star_tracker.detection.scan=streaks"] if said.detector.shutter == "rolling" else []
    own = load(written("a.yaml", f"{BASE}star_camera: {{use: {one.name}}}\n"), sets).star_camera
    base = load("shefex2_andoya").star_camera
    assert own.detector == said.detector and own.optics.focal_length == said.optics.focal_length
    assert own.optics.zero_magnitude_flux > 1e6
    for key in ("mounting", "stars", "artefacts", "stray_light"):
        assert getattr(own, key) == getattr(base, key)


def test_of_an_old_unit_nothing_is_left(written):
    """Not even what the new one does not give: an instrument of one's own without reacquisition."""
    text = Path(instruments.files()["max_m10s"]).read_text(encoding="utf-8")
    written("mine.yaml", text[: text.index("reacquisition:")])
    written("a.yaml", f"{BASE}gps: {{use: max_m10s}}\n")
    assert load("a.yaml").gps.reacquisition is not None
    assert load(written("b.yaml", "extends: a.yaml\ngps: {use: mine}\n")).gps.reacquisition is None


def test_an_instrument_replaces_what_the_extended_file_says(written):
    path = written("a.yaml", f"{BASE}imu:\n  use: ln_200s\n")
    base, own = load("shefex2_andoya"), load(path)
    unit, _, _ = load_as(lambda provided: SECTIONS["imu",], instruments.files()["ln_200s"])
    assert own.imu.gyro == unit.gyro and own.imu.accelerometer == unit.accelerometer
    assert own.imu.vibration == base.imu.vibration
    changed = {path for path, _, _ in of_texts(base.source, own.source)}
    assert changed and all(one[:2] in {("imu", "gyro"), ("imu", "accelerometer")} for one in changed)
    assert load(written("again.yaml", own.source)).imu == own.imu  # what a log keeps needs no other file
    assert [Path(name).name for name, _ in own.files][-1] == "ln_200s.yaml"


def test_values_beside_it_come_on_top_key_by_key(written):
    path = written("a.yaml", f"{BASE}imu:\n  use: ln_200s\n  gyro:\n    bias: 3 deg/h\n")
    gyro = load(path).imu.gyro
    assert gyro.bias == pytest.approx(3.0 * DEG_H) and gyro.scale_factor == pytest.approx(100e-6)
    assert load(path, ["imu.gyro.bias=5 deg/h"]).imu.gyro.bias == pytest.approx(5.0 * DEG_H)


def test_a_file_that_extends_wins_with_values_and_with_another_instrument(written):
    written("a.yaml", f"{BASE}imu:\n  use: ln_200s\n  gyro:\n    bias: 3 deg/h\n")
    value = load(written("b.yaml", "extends: a.yaml\nimu:\n  gyro:\n    bias: 4 deg/h\n")).imu.gyro
    assert value.bias == pytest.approx(4.0 * DEG_H) and value.scale_factor == pytest.approx(100e-6)
    other = load(written("c.yaml", "extends: b.yaml\nimu:\n  use: hg9900\n")).imu.gyro
    assert other.bias == pytest.approx(0.0035 * DEG_H)  # of the new unit: the old one's went with it


def test_where_each_value_was_written(written):
    path = written("a.yaml", f"{BASE}imu:\n  use: ln_200s\n  gyro:\n    bias: 3 deg/h\n")
    loaded = load(path)
    assert loaded.place(("imu", "gyro", "bias")) == "a.yaml:5:11"
    place, line, _ = loaded.place(("imu", "gyro", "range")).rsplit(":", 2)
    assert Path(place).read_text(encoding="utf-8").splitlines()[int(line) - 1].strip().startswith("range:")


@pytest.mark.parametrize("name", ["mine", "mine.yaml", "./mine.yaml"])
def test_a_file_of_ones_own_beside_the_scenario(written, name, monkeypatch, tmp_path):
    text = Path(instruments.files()["ln_200s"]).read_text(encoding="utf-8")
    written("there/mine.yaml", text.replace("bias: 1 deg/h", "bias: 2 deg/h"))
    written("there/a.yaml", f"{BASE}imu: {{use: {name}}}\n")
    assert load("there/a.yaml").imu.gyro.bias == pytest.approx(2.0 * DEG_H)
    monkeypatch.chdir(tmp_path / "there")
    assert load("shefex2_andoya", [f"imu.use={name}"]).imu.gyro.bias == pytest.approx(2.0 * DEG_H)
    found = {Path(one).name for one in shipped.with_what_it_names("a.yaml")}
    assert found == {"a.yaml"} | ({"mine.yaml"} if name != "mine" else set())


@pytest.mark.parametrize("base", ["ln_200s", instruments.files()["ln_200s"], "there/own.yaml"])
def test_an_instrument_may_extend_another(written, base):
    written("there/own.yaml", "extends: ln_200s\nunit: another of them\n")
    written("mine.yaml", f"extends: {base}\nunit: LN-200S, s/n 7\ngyro: {{bias: 2 deg/h}}\n")
    gyro = load(written("a.yaml", f"{BASE}imu: {{use: mine.yaml}}\n")).imu.gyro
    assert gyro.bias == pytest.approx(2.0 * DEG_H) and gyro.scale_factor == pytest.approx(100e-6)
    written("mine.yaml", "extends: ln_20s\n")
    assert the_message("a.yaml").startswith("mine.yaml:1:10: extends: there is no file 'ln_20s'")


def test_set_takes_an_instrument_before_the_values_beside_it():
    sets = ["imu.gyro.bias=7 deg/h", "imu.use=ln_200s"]
    for given in (sets, sets[::-1]):
        gyro = load("shefex2_andoya", given).imu.gyro
        assert gyro.bias == pytest.approx(7.0 * DEG_H) and gyro.scale_factor == pytest.approx(100e-6)
    vibration = load("shefex2_andoya").imu.vibration
    whole = "imu={use: ln_200s, gyro: {bias: 7 deg/h}, vibration: {boost: [7 gee, 3.5 gee], coast: 0.02 gee, "
    whole += "angular: 0.3 deg/s/gee, lowest_frequency: 20 Hz, highest_frequency: 2 kHz}}"
    loaded = load("shefex2_andoya", [whole]).imu
    assert loaded.gyro == gyro and loaded.vibration == vibration


def test_a_campaign_disperses_its_values(written):
    text = f"{BASE}imu: {{use: ln_200s}}\ndispersions:\n  imu.gyro.bias: {{log_normal: 20 %}}\n"
    loaded = load(written("a.yaml", text))
    pattern = Pattern(loaded.source, "a.yaml")
    assert pattern.with_draws({"imu.gyro.bias": 2.0}).imu.gyro.bias == pytest.approx(2.0 * DEG_H)
    assert loaded.dispersions.keys() == {"imu.gyro.bias"}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("ln200s", "did you mean ln_200s?"),
        ("navigation", "did you mean hg9900?"),
        ("zzz", "there are adis16465_1 (industrial MEMS), adis16470 (industrial MEMS)"),
        ("there/zzz.yaml", "there is no such file"),
        ("rexus_like.yaml", "no instrument 'rexus_like' comes with the program"),
        ("[1]", "expected the name of an instrument or of its file; there are adis16465_1"),
        ("", "expected the name of an instrument or of its file"),
    ],
)
def test_a_name_that_means_none(written, given, words):
    said = the_message(written("a.yaml", f"{BASE}imu:\n  use: {given}\n"))
    assert said.startswith("a.yaml:3:") and ": imu.use: " in said and words in said
    if given:
        said = the_message("shefex2_andoya", [f"imu.use={given}"])
        assert said.startswith("--set imu.use: ") and words in said


def test_files_that_are_no_such_instrument(written):
    scenario = written("a.yaml", f"{BASE}imu: {{use: b.yaml}}\n")
    written("b.yaml", "mission: {name: x}\n")
    assert "a.yaml:2:12: imu.use: 'b.yaml' is no file of an instrument" in the_message(scenario)
    written("b.yaml", "instrument: gps\nunit: x\n")
    assert "'b.yaml' is an instrument for the section gps, not for imu" in the_message(scenario)
    written("b.yaml", "extends: b.yaml\n")
    assert "extends itself in a circle" in the_message(scenario)
    written("b.yaml", "instrument: [")
    assert "b.yaml:1:" in the_message(scenario)


def test_mistakes_in_its_file_are_told_there(written):
    text = Path(instruments.files()["ln_200s"]).read_text(encoding="utf-8")
    text = text.replace("bias: 1 deg/h", "bias: 1 m").replace("range: 40 gee", "rnge: 40 gee")
    written("mine.yaml", text)
    said = messages(written("a.yaml", f"{BASE}imu: {{use: mine}}\n"))
    lines = text.splitlines()
    bias, rnge = (1 + next(k for k, one in enumerate(lines) if word in one) for word in ("bias: 1 m", "rnge"))
    assert said == (
        f"mine.yaml:{bias}:9: gyro.bias: '1 m' is a length, expected an angular rate such as '0.5 deg/h'",
        f"mine.yaml:{rnge}:3: accelerometer.rnge: unknown key; did you mean 'range'?",
    )


def test_mistakes_in_its_file_hide_none_of_the_scenario(written):
    """Each once: not again as a value of the section, nor of a second section that uses the same file."""
    text = Path(instruments.files()["ln_200s"]).read_text(encoding="utf-8")
    written("mine.yaml", text.replace("bias: 1 deg/h", "bias: 1 m").replace("range: 40 gee", "rnge: 40 gee"))
    use = "{use: mine}"
    more = f"gps: {{latency: 2}}\nnavigation: {{told: {{imu: {use}}}}}\nlog: {{rate: 30 Hz}}\n"
    said = messages(written("a.yaml", f"{BASE}imu: {use}\n{more}"))
    assert [line.split(": ")[1] for line in said] == [
        "gps.latency", "log.rate", "gyro.bias", "accelerometer.rnge",
    ]  # fmt: skip
    said = messages("shefex2_andoya", ["imu.use=mine", "imu.gyro.bias=1 deg/h", "gps.latency=2"])
    assert ["--set" in line for line in said] == [True, False, False]  # wrong in the file, although not used
    with pytest.raises(ScenarioError) as refused:
        replays.load("csv_example", ["imu.use=mine", "gnss.latency=2"])
    lines = refused.value.messages
    assert lines[0].startswith("--set gnss.latency: 2 has no unit")
    assert [line.split(": ")[1] for line in lines[1:]] == ["gyro.bias", "accelerometer.rnge"]


def test_a_value_of_it_that_does_not_fit_the_scenario_is_told_where_to_change_it(written, monkeypatch):
    """As a value of an extended file: the file of the instrument is not the user's to edit."""
    text = Path(instruments.files()["ln_200s"]).read_text(encoding="utf-8")
    written("mine.yaml", text)
    written("a.yaml", f"{BASE}imu: {{use: mine}}\n")
    words = "must not be so"
    line = load("a.yaml").line_about(("imu", "gyro", "bias"), words)
    assert line.startswith("mine.yaml:") and line.endswith(
        "(set in mine.yaml; change it in a.yaml, which uses it)"
    )


def test_null_takes_away_and_what_is_missing_is_told(written):
    said = the_message(written("a.yaml", f"{BASE}imu:\n  use: ln_200s\n  gyro:\n    range: null\n"))
    assert said == "a.yaml:4:3: imu.gyro.range: is missing; expected for example 'range: 1000 deg/s'"
    said = the_message(written("a.yaml", f"{BASE}imu: {{use: null}}\n"))
    assert "a.yaml:2:7: imu.use: null takes away" in said
    said = the_message(written("a.yaml", f"{BASE}imu:\n  usee: ln_200s\n"))
    assert "a.yaml:3:3: imu.usee: unknown key; did you mean 'use'?" == said


def test_an_instrument_where_a_scenario_was_expected():
    path = instruments.files()["ln_200s"]
    words = f"{path}: is an instrument; a scenario takes its values with `imu: {{use: {path}}}`"
    assert the_message(path) == words


def test_a_scenario_without_a_base_may_use_one(written):
    """And leave out what the instrument gives, for the schema of editors too."""
    jsonschema = pytest.importorskip("jsonschema")
    shutil.copytree(SCENARIO_FOLDER / "data", "data")
    text = (SCENARIO_FOLDER / "shefex2_andoya.yaml").read_text(encoding="utf-8")
    begin, end = text.index("\n  gyro:\n"), text.index("\n  vibration:")
    own = written("a.yaml", f"{text[:begin]}\n  use: ln_200s{text[end:]}")
    assert load(own).imu.gyro.bias == pytest.approx(DEG_H)
    validator = jsonschema.Draft202012Validator(json_schema())
    tree = document.parse(Path(own).read_text(encoding="utf-8"), own).tree
    assert validator.is_valid(tree)
    tree["imu"].pop("use")
    assert not validator.is_valid(tree)


def test_a_text_that_cannot_name_files():
    """The key is no value of a scenario: where nobody has read the file it is refused."""
    loaded = load("shefex2_andoya")
    with pytest.raises(ValueError, match="names an instrument"):
        Imu.model_validate({**plain(loaded.imu), "use": "ln_200s"})


def test_the_list_of_what_comes_with_the_program_has_them(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    command = shefex_nav(monkeypatch, capsys)
    assert [one["name"] for one in json.loads(command("scenarios", "--json"))["instruments"]] == NAMES
    table = command("scenarios")
    assert all(name in table and grade in table for name, grade in GRADES.items())
    path = Path(instruments.files()["ln_200s"])
    assert command("scenarios", "ln_200s") == path.read_text(encoding="utf-8")
    command("scenarios", "ln_200s", "--copy", "mine")
    assert Path("mine/ln_200s.yaml").read_bytes() == path.read_bytes()


def shefex_nav(monkeypatch, capsys):
    """The command line in this process: function of its words -> what it prints."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["shefex-nav", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        assert ended.value.code == 0, printed.err
        return printed.out

    return call
