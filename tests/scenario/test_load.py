"""Good scenarios: what is loaded, how files extend each other, overrides, the text kept, the schema."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from shefex_nav.scenario.load import json_schema, load
from shefex_nav.scenario.schema import Scenario

SCENARIOS = Path(__file__).parents[2] / "scenarios"
DEFAULT = SCENARIOS / "shefex2_andoya.yaml"
TEXT = DEFAULT.read_text(encoding="utf-8")
DEG = math.pi / 180.0


@pytest.fixture(scope="module")
def default():
    return load(DEFAULT)


def leaves(values, path=()):
    """(path, value) of every single value of nested dicts and lists."""
    items = values.items() if isinstance(values, dict) else enumerate(values)
    for key, value in items:
        if isinstance(value, dict | list | tuple):
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key), value


def differences(a, b):
    """Paths at which two scenarios differ."""
    one, two = dict(leaves(a.model_dump())), dict(leaves(b.model_dump()))
    return {".".join(map(str, path)) for path in one.keys() | two.keys() if one.get(path) != two.get(path)}


def test_default_values_in_si(default):
    assert default.mission.epoch == "2012-06-22T19:18:00"
    assert default.mission.start == -10.0
    assert default.launch.latitude == pytest.approx(69.2942 * DEG)
    assert default.earth.pole_x == pytest.approx(0.0787 / 3600.0 * DEG)
    assert [stage.name for stage in default.vehicle.stages] == ["S40M", "S44"]
    assert default.vehicle.stages[1].propellant.mass == 814.0
    assert default.programme.entry_spin == pytest.approx(2.0 * math.pi)  # written as 1 Hz
    assert default.imu.gyro.scale_factor_roll == pytest.approx(30e-6)
    assert default.star_camera.detector.pixel_size == pytest.approx(9.9e-6)
    assert default.star_camera.detector.columns == 659
    assert default.star_tracker.enabled is True
    assert default.star_tracker.exposure.gain == 24.0


def test_default_states_every_value():
    """Nothing is left to a default but the overrides of what the filter knows of the sensors."""
    given = load(DEFAULT).model_dump(exclude_unset=True)
    every = load(DEFAULT).model_dump()
    left = {path for path, _ in leaves(every)} - {path for path, _ in leaves(given)}
    assert {path[:2] for path in left} == {("navigation", "sensors")}


def test_variants_differ_from_the_default_in_one_thing(default):
    names = {"mission.name", "mission.description"}
    assert differences(default, load(SCENARIOS / "imu_300ppm.yaml")) == names | {"imu.gyro.scale_factor_roll"}
    assert differences(default, load(SCENARIOS / "no_star_tracker.yaml")) == names | {"star_tracker.enabled"}


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_scenario_loads_and_has_the_name_of_its_file(path):
    assert load(path).mission.name == path.stem


def test_extends_through_two_files_and_folders(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "base.yaml").write_text(TEXT, encoding="utf-8")
    (tmp_path / "sub" / "middle.yaml").write_text(
        "extends: ../base.yaml\ngps:\n  latency: 0.3 s\n  max_pdop: 6\n", encoding="utf-8"
    )
    top = tmp_path / "top.yaml"
    top.write_text("extends: sub/middle.yaml\ngps:\n  latency: 0.1 s\n", encoding="utf-8")
    scenario = load(top)
    assert (scenario.gps.latency, scenario.gps.max_pdop, scenario.gps.range_noise) == (0.1, 6.0, 1.5)
    names = [Path(name).name for name, _ in scenario.files]
    assert names == ["top.yaml", "middle.yaml", "base.yaml"]
    assert dict(scenario.files)[str(top)] == top.read_text(encoding="utf-8")


def test_a_list_replaces_a_list(tmp_path):
    path = tmp_path / "calm.yaml"
    path.write_text(f"extends: {DEFAULT}\ngps:\n  outages: []\n", encoding="utf-8")
    assert load(path).gps.outages == []


def test_overrides(default):
    overrides = [
        "star_tracker.rate='5 Hz'",
        "gps.antenna.lever_arm.1=7 cm",
        "gps.antenna.blind_nose=10 deg",
        "vehicle.stages.0.motor.burn_time = 55 s",
        "gps.outages=[]",
        "navigation.sensors.gyro_bias=1 deg/h",
        "star_tracker.enabled=false",
    ]
    scenario = load(DEFAULT, overrides)
    assert scenario.star_tracker.rate == 5.0
    assert scenario.gps.antenna.lever_arm == pytest.approx((0.6, 0.07, -0.03))
    assert scenario.vehicle.stages[0].motor.burn_time == 55.0
    assert scenario.gps.outages == []
    assert scenario.navigation.sensors.gyro_bias == pytest.approx(DEG / 3600.0)
    changed = {name.split("=")[0].strip() for name in overrides} - {"gps.outages"}
    changed |= {
        ".".join(map(str, path))
        for path, _ in leaves({"gps": {"outages": default.model_dump()["gps"]["outages"]}})
    }
    assert differences(default, scenario) == changed


def test_the_last_override_holds():
    assert load(DEFAULT, ["gps.latency=0.1 s", "gps.latency=0.3 s"]).gps.latency == 0.3


@pytest.mark.parametrize("name", ["shefex2_andoya", "imu_300ppm"])
def test_the_text_kept_loads_to_the_same_scenario(tmp_path, name):
    scenario = load(SCENARIOS / f"{name}.yaml", ["imu.gyro.range=unlimited", "star_tracker.rate=5 Hz"])
    path = tmp_path / "kept.yaml"
    path.write_text(scenario.source, encoding="utf-8")
    again = load(path)
    assert differences(scenario, again) == set()
    assert again.source == scenario.source
    assert "extends" not in scenario.source


def test_yaml_1_2_words_stay_words(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text(
        TEXT.replace("name: shefex2_andoya", "name: off").replace("0.1 arcsec", "off"), encoding="utf-8"
    )
    scenario = load(path)
    assert scenario.mission.name == "off"
    assert scenario.imu.gyro.quantum == 0.0


def test_schema_knows_every_field():
    schema = json_schema()
    fields = set(schema["$defs"]["Scenario"]["properties"])
    assert fields == set(Scenario.model_fields) | {"extends"}
    rate = schema["$defs"]["StarTracker"]["properties"]["rate"]
    assert rate["type"] == "string"
    assert rate["examples"] == ["10 Hz"]
    assert "frames a second" in rate["description"]
    assert schema["$defs"]["Gyro"]["properties"]["range"]["examples"] == ["1000 deg/s", "unlimited"]


def test_schema_holds_together():
    """Every reference leads somewhere; a file that extends another may leave out anything."""
    schema = json_schema()
    blocks = schema["$defs"]

    def references(node):
        if isinstance(node, dict):
            for key, value in node.items():
                if key == "$ref":
                    yield value
                else:
                    yield from references(value)
        elif isinstance(node, list):
            for item in node:
                yield from references(item)

    for name, block in blocks.items():
        for reference in references(block):
            assert reference.removeprefix("#/$defs/") in blocks
            assert reference.endswith(".partial") == name.endswith(".partial")
        assert block["additionalProperties"] is False
        assert name.endswith(".partial") is not ("required" in block) or name == "SensorOverrides"
    assert set(blocks["Scenario"]["required"]) == set(Scenario.model_fields)


def test_loading_waits_for_nothing_heavy():
    """The command line checks a scenario without compiled kernels, viewers or ephemerides."""
    heavy = ["numba", "scipy", "astropy.coordinates", "erfa", "rerun", "foxglove", "filterpy"]
    code = (
        "import sys; from shefex_nav.scenario.load import load; assert 'astropy' not in sys.modules; "
        f"load({str(DEFAULT)!r}); print([name for name in {heavy} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
