"""Good scenarios: what is loaded, how files extend each other, overrides, the text kept, the schema."""

import math
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from shefex_nav.scenario import document, layers
from shefex_nav.scenario.json_schema import json_schema
from shefex_nav.scenario.load import Scenario, ScenarioError, load, load_text

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
    assert list(default.vehicle.stages) == ["S40M", "S44"]
    assert default.vehicle.stages["S44"].propellant.mass == 814.0
    assert default.vehicle.stages["S40M"].motor.thrust_factor == 1.0  # left to its default, 100 %
    assert [name for name, _ in default.tasks] == list(default.programme)
    assert default.programme["precession"].at == 149.2
    assert load(DEFAULT, ["programme.despin.rate=1 Hz"]).programme["despin"].rate == pytest.approx(
        2.0 * math.pi
    )
    assert (default.wind, default.orbit, default.ground) == ("none", None, None)
    assert default.imu.gyro.scale_factor_roll == pytest.approx(30e-6)
    assert default.star_camera.detector.pixel_size == pytest.approx(9.9e-6)
    assert default.star_camera.detector.columns == 659
    assert default.star_tracker.enabled is True
    assert default.star_tracker.exposure.gain == 24.0


def test_what_the_default_leaves_out():
    """The filter's own knowledge of the sensors, what this flight has not, imperfections."""
    given = load(DEFAULT).model_dump(exclude_unset=True)
    every = load(DEFAULT).model_dump()
    left = {path for path, _ in leaves(every)} - {path for path, _ in leaves(given)}
    sensors = {path for path in left if path[:2] in {("navigation", "sensors"), ("navigation", "told")}}
    assert {path[-1] if isinstance(path[-1], str) else path[-2] for path in left - sensors} == {
        *("orbit", "ground", "trajectory", "parachute", "angle_of_attack", "damping_mach", "drag"),
        *("centre_of_mass_offset", "principal_axis_tilt", "aerodynamics", "separation", "spent"),
        *("thrust_factor", "misalignment", "offset", "axial_factor", "normal_factor"),
        *("faintest_south", "line_time", "gradient", "software", "deepest"),
        *("highest_speed", "highest_height"),
        *("f_number", "aperture", "transmission", "quantum_efficiency", "principal_point", "distortion"),
        *("hot_pixel_smear", "upsets_per_frame", "trails_per_frame", "trail_longest"),
        *("particle_weakest", "particle_strongest"),
        *("moving_objects", "moving_slowest", "moving_fastest"),
        *("boresight_rate", "cross_rate", "cross_period", "cross_phase", "ramp"),
        *("almanac", "bias", "drift", "h_0", "h_minus_2", "reacquisition"),  # of the GPS receiver
        *("satellite", "ionosphere", "troposphere", "multipath"),
        *("gps", "stars", "wrong_star_fix", "rejections", "duration"),  # navigation
        *("angular_acceleration", "thrust_change"),
        *(
            "barometer",
            "sun_sensor",
            "used",
            "up_to",
            "unused_mach",
            "flow_error",
            "flow_memory",
            "lag_error",
            "chance",
            "fastest",
        ),
        *("use", "clock_offset"),  # of the IMU: an instrument; of the GPS receiver
        *("model", "sampling", "flight", "series"),  # of the star tracker's statistics, of campaigns
        *("apogee", "cold_gas", "pointing_error", "protection_at_entry", "while_pointing"),  # not required
        *("magnetometer", "rows", "model_error", "memory"),
        "fix",  # of the GPS receiver
        *("acceptance", "cosine_error", "reference_magnitude"),  # of identifications as published
        *("probability", "confidence"),  # of requirements
    }


def test_variants_differ_from_the_default_in_one_thing(default):
    names = {"mission.name", "mission.description"}
    assert differences(default, load(SCENARIOS / "imu_300ppm.yaml")) == names | {"imu.gyro.scale_factor_roll"}
    assert differences(default, load(SCENARIOS / "no_star_tracker.yaml")) == names | {
        "star_tracker.enabled",
        "requirements.star_fixes",  # there are none
        "requirements.wrong_star_fixes",
    }


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


def test_a_folded_text_is_one_line():
    """No mark is left where it was folded."""
    tree = document.parse("mission:\n  name: >-\n    one\n    line # this too\n", "a.yaml").tree
    assert tree == {"mission": {"name": "one line # this too"}}


def test_overrides(default):
    overrides = [
        "star_tracker.rate='5 Hz'",
        "gps.antenna.lever_arm.1=7 cm",
        "gps.antenna.blind_nose=10 deg",
        "vehicle.stages.S40M.motor.burn_time = 55 s",
        "gps.outages=[]",
        "navigation.sensors.gyro_bias=1 deg/h",
        "star_tracker.enabled=false",
    ]
    scenario = load(DEFAULT, overrides)
    assert scenario.star_tracker.rate == 5.0
    assert scenario.gps.antenna.lever_arm == pytest.approx((0.6, 0.07, -0.03))
    assert scenario.vehicle.stages["S40M"].motor.burn_time == 55.0
    assert scenario.gps.outages == []
    assert scenario.navigation.sensors.gyro_bias == pytest.approx(DEG / 3600.0)
    changed = {name.split("=")[0].strip() for name in overrides} - {"gps.outages"}
    changed |= {
        ".".join(map(str, path))
        for path, _ in leaves({"gps": {"outages": default.model_dump()["gps"]["outages"]}})
    }
    assert differences(default, scenario) == changed


@pytest.mark.parametrize("name, most, more", [
    ("gyro", "360 deg", "1e308 arcsec"), ("accelerometer", "1 km/s", "1e300 m/s"),
])  # fmt: skip
def test_a_count_has_a_size(name, most, more):
    """Beyond, its square is no number any more."""
    key = f"imu.{name}.quantum"
    assert load(DEFAULT, [f"{key}={most}"]).imu.gyro.quantum > 0.0
    with pytest.raises(ScenarioError, match=f"{key}: must be at most {most}, got '{more}'"):
        load(DEFAULT, [f"{key}={more}"])


def test_null_takes_away(tmp_path):
    """What a base gives and a variant has not; on the command line too."""
    path = tmp_path / "calm.yaml"
    path.write_text(
        f"extends: {DEFAULT}\nprogramme:\n  precession: null\nvehicle:\n  yo_yo: ~\n  spin_motors: null\n",
        encoding="utf-8",
    )
    scenario = load(path, ["vehicle.cold_gas=null", "attitude=prescribed"])
    assert list(scenario.programme) == ["damping", "despin", "slew", "pointing", "entry_slew"]
    assert (scenario.vehicle.yo_yo, scenario.vehicle.spin_motors, scenario.vehicle.cold_gas) == (
        None,
        None,
        None,
    )
    again = tmp_path / "again.yaml"
    again.write_text(scenario.source, encoding="utf-8")
    assert differences(scenario, load(again)) == set()
    assert "yo_yo" not in scenario.source


def test_a_form_replaces_another_when_its_keys_are_taken_away(tmp_path):
    path = tmp_path / "curve.yaml"
    nulls = "".join(f"        {key}: null\n" for key in ("burn_time", "rise", "tail_off", "level_ratio"))
    path.write_text(
        f"extends: {DEFAULT}\nvehicle:\n  stages:\n    S44:\n      motor:\n{nulls}"
        "        thrust: {time: [0 s, 1 s, 67 s, 68 s], force: [0 kN, 33.6 kN, 33.6 kN, 0 kN]}\n",
        encoding="utf-8",
    )
    assert load(path).vehicle.stages["S44"].motor.thrust.force[1] == 33600.0


def test_tasks_are_flown_in_order_of_time(tmp_path):
    """A variant may add a task anywhere."""
    path = tmp_path / "more.yaml"
    path.write_text(
        f"extends: {DEFAULT}\nprogramme:\n  rest: {{task: hold, from: 146 s, until: 148 s}}\n",
        encoding="utf-8",
    )
    names = [name for name, _ in load(path).tasks]
    assert names == ["damping", "precession", "rest", "despin", "slew", "pointing", "entry_slew"]


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


def test_a_text_loads_without_a_file_and_is_blamed_by_its_name():
    source = load(DEFAULT).source
    scenario = load_text(source, "run.mcap: scenario.yaml", ["navigation.history=0.4 s"])
    assert differences(load(DEFAULT), scenario) == {"navigation.history"}
    with pytest.raises(ScenarioError, match=r"^run\.mcap: scenario\.yaml:1:1: log: is missing"):
        load_text(source[: source.index("navigation:")], "run.mcap: scenario.yaml")
    with pytest.raises(ScenarioError, match=r"^--set navigation\.histori: unknown key"):
        load_text(source, "run.mcap: scenario.yaml", ["navigation.histori=0.4 s"])


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
            # for imu: {use: NAME} and the like
            kinds = ("Imu", "Gps", "StarCamera")
            of_use = name == "Scenario" and reference in {f"#/$defs/{kind}.partial" for kind in kinds}
            assert reference.endswith(".partial") == name.endswith(".partial") or of_use
        others = {"type": "null"} if name.endswith(".partial") else False  # of another form, taken away
        assert block["additionalProperties"] == others
        optional = {"SensorOverrides", "Atmosphere", "Faults", "Integrity", "Requirements", "Campaign"}
        optional |= {"Clock", "RangeErrors", "SatelliteErrors"}  # of GPS
        optional |= {"BarometerUse", "Computer", "Day", "DriftWatch", "MagnetometerUse", "Use"}
        optional |= {"Position", "Velocity", "Attitude"}  # of the requirements
        optional |= {one for one in blocks if one.startswith("Told")}  # in place of what is true
        assert name.endswith(".partial") is not ("required" in block) or name in optional
    needed = {name for name, field in Scenario.model_fields.items() if field.is_required()}
    assert set(blocks["Scenario"]["required"]) == needed


def test_schema_shows_every_form_of_a_section():
    """An editor offers all of them, and the keys that the file has."""
    blocks = json_schema()["$defs"]
    motor = blocks["Stage"]["properties"]["motor"]
    offered = {option["$ref"].rpartition("/")[2] for option in motor["oneOf"]}
    assert offered == {"ShapedMotor", "MeasuredMotor", "MotorFile"}
    assert {"from", "until", "task"} <= set(blocks["Turn"]["required"])
    assert blocks["ShapedMotor"]["properties"]["thrust_factor"]["default"] == "100 %"
    tasks = blocks["Scenario"]["properties"]["programme"]
    assert "oneOf" in str(tasks) and "Dwell" in str(tasks) and "Unknown" not in str(blocks.keys())


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.yaml")), ids=lambda path: path.stem)
def test_schema_accepts_the_scenarios(path):
    """As an editor would say; and what it would say of a misspelt key."""
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    read = document.parse(path.read_text(encoding="utf-8"), path.name)
    tree = read.tree
    for gone in read.removed:  # `null`, which an editor sees
        layers.node(tree, gone[:-1])[gone[-1]] = None
    validator.validate(tree)
    tree["programme"] = {**(tree.get("programme") or {}), "damping": None}
    assert validator.is_valid(tree) == ("extends" in tree)
    tree["programme"]["damping"] = {"task": "damp", "from": "65 s", "untill": "70 s"}
    assert not validator.is_valid(tree)


def test_schema_lets_a_file_take_away_what_another_one_gives():
    """Also a dispersion, and keys of the kind of task that was there; a misspelt key is still none."""
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    turned = {"task": "turn_with_orbit", "from": "0 s", "until": "9 s", "cross_rate": None}
    for part in ({"dispersions": {"launch.elevation": None}}, {"programme": {"pointing": turned}}):
        assert validator.is_valid({"extends": "shefex2_dispersed", **part}), part
    wrong = {"dispersions": {"launch.elevation": 1}}, {"gps": {"rrate": "1 Hz"}}, {"gpss": {}}
    assert not any(validator.is_valid({"extends": "shefex2_dispersed", **part}) for part in wrong)


def test_a_scenario_goes_to_another_process_and_still_knows_its_lines(default):
    again = pickle.loads(pickle.dumps(default))
    assert again.model_dump() == default.model_dump()
    field = ("programme", "pointing", "until")
    assert again.line_about(field, "words") == default.line_about(field, "words")
    assert "shefex2_andoya.yaml:" in again.line_about(field, "words")


def test_loading_waits_for_nothing_heavy():
    """The command line checks a scenario without compiled kernels, viewers or ephemerides."""
    heavy = ["numba", "scipy", "astropy", "erfa", "rerun", "foxglove", "filterpy"]
    code = (
        "import sys; from shefex_nav.scenario.load import load; "
        f"load({str(DEFAULT)!r}); print([name for name in {heavy} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
