"""Sections `dispersions` and `campaign`: what is drawn reaches its field, and what cannot be is refused."""

import json
import math

import pytest
from broken import DEFAULT, messages, the_message

from shefex_nav.scenario import dispersions, load
from shefex_nav.scenario.json_schema import json_schema

RAIL = "paths: [launch.elevation, launch.azimuth]"


def pattern(*overrides, path=DEFAULT):
    scenario = load.load(path, overrides)
    return load.Pattern(scenario.source, "test")


def flown(draw, *overrides):
    """Scenario of a run that has drawn {path: value}."""
    return pattern(*overrides).with_draws(draw)


def test_what_is_drawn_is_added_in_its_own_unit():
    drawn = flown({"launch.elevation": 6.0}, "dispersions.launch.elevation={normal: 3 arcmin}")
    assert drawn.launch.elevation == pytest.approx(math.radians(86.53), abs=1e-12)
    nominal = load.load(DEFAULT)
    assert drawn.launch.azimuth == nominal.launch.azimuth
    assert drawn.dispersions == {}


def test_a_pattern_keeps_the_scenario_as_it_was_written():
    """Neither defaults that draws need in the tree nor the draws themselves get into it."""
    scenario = load.load(DEFAULT, ["dispersions.vehicle.stages.S40M.motor.misalignment.1={normal: 1 mrad}"])
    made = load.Pattern(scenario.source, "test")
    made.with_draws({"vehicle.stages.S40M.motor.misalignment.1": 2.0})
    assert made.scenario.model_dump() == load.load_text(scenario.source, "test").model_dump()
    assert made.scenario.source == scenario.source


def test_the_number_that_is_written_is_the_number_that_is_drawn():
    """In the field's unit nothing is rounded on the way: text -> number -> text."""
    drawn = flown({"launch.height": 0.1}, "dispersions.launch.height={normal: 1 m}")
    assert drawn.launch.height == 10.0 + 0.1


VALUES = {
    "vehicle.payload.mass={normal: 2 %, apply: scale}": (
        3.0, lambda s: s.vehicle.payload.mass, 487.5 * 1.03),
    "vehicle.payload.mass={log_normal: 10 %}": (1.1, lambda s: s.vehicle.payload.mass, 487.5 * 1.1),
    "vehicle.payload.mass={uniform: [480 kg, 500 kg], apply: replace}": (
        481.5, lambda s: s.vehicle.payload.mass, 481.5),
    "atmosphere.density={normal: 3 %}": (-2.0, lambda s: s.atmosphere.density, 0.98),
    "star_camera.artefacts.false_objects={normal: 20}": (
        10.6, lambda s: s.star_camera.artefacts.false_objects, 261),
    "star_camera.artefacts.spikes_per_frame={log_normal: 10 %}": (
        1.5, lambda s: s.star_camera.artefacts.spikes_per_frame, 0.3),
    "vehicle.stages.S40M.motor.misalignment.1={normal: 1 mrad}": (  # a default that the file does not give
        2.0, lambda s: s.vehicle.stages["S40M"].motor.misalignment, (0.0, 0.002)),
    "vehicle.stages.S40M.aerodynamics.axial={log_normal: 10 %}": (  # a whole list
        2.0, lambda s: s.vehicle.stages["S40M"].aerodynamics.axial[:2], [0.9, 0.9]),
    "gps.outages.1.longest={uniform: [-5 s, 20 s]}": (2.5, lambda s: s.gps.outages[1].longest, 22.5),
    "imu.gyro.quantum={choice: [off, 1 mrad]}": ("off", lambda s: s.imu.gyro.quantum, 0.0),
    "atmosphere.model={choice: [us76, msis]}": ("msis", lambda s: s.atmosphere.model, "msis"),
    "star_tracker.exposure.gain={normal: 1 dB}": (0.5, lambda s: s.star_tracker.exposure.gain, 24.5),
    "star_camera.stars.faintest={uniform: [-1 mag, 0.5 mag]}": (
        -0.5, lambda s: s.star_camera.stars.faintest, 6.5),
    "mission.epoch={uniform: [-5 min, 5 min]}": (1.5, lambda s: s.mission.epoch, "2012-06-22T19:19:30"),
}  # fmt: skip


@pytest.mark.parametrize("override", VALUES)
def test_reaches_its_field(override):
    value, field, expected = VALUES[override]
    path = override.partition("=")[0]
    drawn = field(flown({path: value}, f"dispersions.{override}"))
    assert drawn == (expected if isinstance(expected, str) else pytest.approx(expected, rel=1e-12))


def test_a_value_out_of_range_is_refused_like_that_of_a_file():
    made = pattern("dispersions.launch.elevation={normal: 1 deg}")
    with pytest.raises(
        load.ScenarioError, match=r"drawn: launch.elevation: must be at most 90 deg, got '90\.9"
    ):
        made.with_draws({"launch.elevation": 4.5})


def test_fields_that_contradict_each_other_are_refused_run_by_run():
    made = pattern("dispersions.vehicle.payload.mass={choice: [487.5 kg, 90000 kg]}")
    made.with_draws({"vehicle.payload.mass": 487.5})
    with pytest.raises(load.ScenarioError, match="would not lift off"):
        made.with_draws({"vehicle.payload.mass": 90000.0})


def test_a_table_of_a_file(tmp_path):
    (tmp_path / "runs.csv").write_text("run, elevation_deg\n0, 86.1\n1, 86.2 # later\n")
    scenario = tmp_path / "one.yaml"
    scenario.write_text(
        f"extends: {DEFAULT}\ndispersions:\n  launch.elevation:\n    table: "
        "{file: runs.csv, column: elevation_deg, unit: deg}\n"
    )
    (one,) = pattern(path=scenario).dispersed
    assert [one.law.draw(0.5, run) for run in (0, 1)] == [86.1, 86.2]
    (tmp_path / "runs.csv").write_text("run, elevation_deg\n0, 86.1\n1, 95\n")
    with pytest.raises(load.ScenarioError, match=r"must be at most 90 deg, got '95\.0 deg'"):
        load.load(scenario)


def of_table(folder, unit="deg", column="az"):
    """Scenario whose azimuth comes from a table with words beside it."""
    (folder / "t.csv").write_text("label, az, el, el\nfirst, 10, x, y\nsecond, 20, x, y\n")
    path = folder / "one.yaml"
    table = f"{{file: t.csv, column: {column}, unit: {unit}}}"
    path.write_text(f"extends: {DEFAULT}\ndispersions:\n  launch.azimuth: {{table: {table}}}\n")
    return path


def test_other_columns_of_a_table_may_hold_anything(tmp_path):
    """They neither stop a table nor hide what is wrong in the column that is asked for."""
    (one,) = pattern(path=of_table(tmp_path)).dispersed
    assert one.law.values == (10.0, 20.0)
    message = the_message(of_table(tmp_path, unit="m"))
    words = "dispersions.launch.azimuth.table.0: '10 m' is a length"
    assert message.startswith(f"{tmp_path}/t.csv:2:8: {words}")
    (tmp_path / "other").mkdir()
    path = of_table(tmp_path / "other")
    (tmp_path / "other" / "t.csv").write_text("label, az\nfirst, 10\nsecond, ten\nthird, 30, 4\n")
    words = [line.partition("t.csv:")[2] for line in messages(path)]
    assert words[0] == "3:9: az: expected a number such as 12.5, got 'ten'"
    assert "expected 2 values, one for each of label, az, got 3" in words[1]


def test_a_column_that_is_missing_is_told_with_those_that_are_there(tmp_path):
    path = of_table(tmp_path, column="azi")
    words = f"'{tmp_path}/t.csv' has no column 'azi'; did you mean 'az'? its columns are label, az, el, el"
    assert the_message(path) == f"{path}:3:49: dispersions.launch.azimuth.table.column: {words}"
    assert the_message(of_table(tmp_path, column="zzz")).endswith("'zzz'; its columns are label, az, el, el")
    assert "there is a column of this name already" in the_message(of_table(tmp_path, column="el"))


def test_a_group_of_covariance_is_that_of_sigma_and_correlation():
    by_sigma = pattern(
        f"dispersions.rail={{{RAIL}, sigma: [12 arcmin, 0.5 deg], correlation: [[1, 0.6], [0.6, 1]]}}"
    ).dispersed
    by_covariance = pattern(
        f"dispersions.rail={{{RAIL}, units: [arcmin, deg], covariance: [[144, 3.6], [3.6, 0.25]]}}"
    ).dispersed
    for a, b in zip(by_sigma, by_covariance, strict=True):
        assert (a.name, a.unit, a.group) == (b.name, b.unit, b.group)
        assert a.law.sigma == pytest.approx(b.law.sigma) and a.factors == pytest.approx(b.factors)
    assert by_sigma[1].factors == pytest.approx((0.6, 0.8))


def test_covariances_are_as_large_as_their_units_make_them():
    light = "paths: [star_camera.optics.zero_magnitude_flux, star_camera.detector.read_noise]"
    (flux, noise) = pattern(
        f"dispersions.light={{{light}, units: [electron/s, electron], covariance: [[4e10, 0], [0, 1]]}}"
    ).dispersed
    assert flux.law.sigma == pytest.approx(2e5) and noise.law.sigma == pytest.approx(1.0)
    (flux, _) = pattern(
        f"dispersions.light={{{light}, units: [electron/s, electron], covariance: [[1e-42, 0], [0, 1]]}}"
    ).dispersed
    assert flux.law.sigma == pytest.approx(1e-21)  # what may be written as a sigma


def test_perfect_correlation_is_possible():
    group = f"{{{RAIL}, sigma: [0.1 deg, 0.5 deg], correlation: [[1, 1], [1, 1]]}}"
    assert pattern(f"dispersions.rail={group}").dispersed[1].factors == pytest.approx((1.0, 0.0))


BAD = {
    "gps.clock_offset={normal: 5 %, apply: scale}": (
        "gps.clock_offset would be the same in every run: any share of 0 is 0; write what is to be added"
    ),
    "gps.clock_offset={log_normal: 20 %}": "any share of 0 is 0",
    "vehicle.payload.centre_of_mass_offset={normal: 10 %, apply: scale}": "any share of 0 is 0",
    "star_camera.artefacts.false_objects={uniform: [-0.4, 0.4]}": "rounds to one and the same whole number",
    "star_camera.artefacts.false_objects={normal: 0.1}": "what may be drawn rounds to one and the same",
    "launch.elevation={normal: 2 m}": "dispersions.launch.elevation.normal: '2 m' is a length, expected",
    "launch.elevation={normal: 5 %}": "a share of the value of the scenario needs apply: scale",
    "launch.elevation={normal: 2 deg}": "must be at most 90 deg, got '92.43 deg', 3 sigma away",
    "launch.elevation={normal: -1 deg}": "must be greater than zero, got -1",
    "launch.elevation={normal: 0.2}": "0.2 has no unit; write it with one",
    "launch.elevation={norml: 1 deg}": "unknown key; did you mean 'normal'?",
    "launch.elevation={normal: 0.1 deg, uniform: [-1 deg, 1 deg]}": "does not go with uniform",
    "launch.elevation={truncated_normal: 1 deg}": "needs low, high or both; without them write normal",
    "launch.elevation={uniform: [2 deg, 1 deg]}": "the lower bound comes first",
    "launch.elevation={truncated_normal: 1 mdeg, low: 11 deg}": (
        "low: '11 deg' cuts off all but what is more than 10000 standard deviations from the mean"
    ),
    "launch.elevation={truncated_normal: 1 mdeg, high: -11 deg}": "high: '-11 deg' cuts off all but what",
    "launch.elevation={choice: [80 deg, 95 deg]}": "must be at most 90 deg, got '95.0 deg'",
    "launch.elevation={choice: [80 deg, 85 deg], weights: [1]}": "1 weights for 2 values; give one for each",
    "launch.elevation={log_normal: 2e6 %}": "must be at most 1000 %, got '2e6 %'",
    "launch.elevation={log_normal: 5}": "5 has no unit; write it with one, for example '5 %'",
    "launch.elevation={table: {file: nope.csv, column: x}}": "'nope.csv' there is no such file",
    "launch.elevation={table: {file: nope.csv}}": "column: is missing",
    "launch.elevation=0.2 deg": "expected a section with keys of its own, got '0.2 deg'",
    "launch.elevatoin={normal: 1 deg}": "there is no 'elevatoin' in launch; did you mean 'elevation'?",
    "orbit.node={normal: 1 deg}": "orbit is not given, so there is nothing that could differ",
    "launch={normal: 1 deg}": "launch is a section; name a value in it",
    "gps.outages.7.longest={normal: 1 s}": "gps.outages is a list, its items are 0 to 4, got '7'",
    "attitude={normal: 1 deg}": "is 'flown', which is no number; only a choice can be in its place",
    "imu.gyro.quantum={choice: [off, 1 m]}": "'1 m' is a length, expected an angle",
    "mission.epoch={normal: 1 deg}": "'1 deg' is an angle, expected a time",
    "campaign.series={normal: 1 Hz}": "campaign says how runs differ and cannot differ itself",
    f"x={{{RAIL}, sigma: [1 arcmin, 1 deg]}}": "needs correlation",
    f"x={{{RAIL}, sigma: [1 arcmin, 1 deg], correlation: [[1, 0.5], [0.4, 1]]}}":
        "must be symmetric, but has 0.4 and 0.5",
    f"x={{{RAIL}, covariance: [[1, 5], [5, 1]], units: [arcmin, deg]}}":
        "its correlations contradict each other (eigenvalue -4)",
    f"x={{{RAIL}, covariance: [[1, 0], [0, 1]], units: [arcmin, m]}}":
        "'1 m' is a length, expected an angle",
}  # fmt: skip


@pytest.mark.parametrize("override", BAD)
def test_one_message_that_says_what_is_wrong(override):
    message = the_message(DEFAULT, [f"dispersions.{override}"])
    assert message.startswith(f"--set dispersions.{override.partition('=')[0]}:")
    assert BAD[override] in message


def test_a_message_names_file_line_and_field(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text(f"extends: {DEFAULT}\ndispersions:\n  launch.height: {{normal: 1 deg}}\n")
    words = "'1 deg' is an angle, expected a length such as '10 m'"
    assert the_message(path) == f"{path}:3:27: dispersions.launch.height.normal: {words}"


def test_a_value_is_dispersed_once():
    group = f"{{{RAIL}, sigma: [0.1 deg, 1 deg], correlation: [[1, 0], [0, 1]]}}"
    twice = ["dispersions.launch.elevation={normal: 0.1 deg}", f"dispersions.rail={group}"]
    assert "launch.elevation is dispersed by 'launch.elevation' already" in the_message(DEFAULT, twice)
    nested = ["dispersions.vehicle.imu={normal: 1 mm}", "dispersions.vehicle.imu.0={normal: 1 mm}"]
    assert "vehicle.imu.0 is dispersed by 'vehicle.imu' already" in the_message(DEFAULT, nested)


@pytest.mark.parametrize(
    "paths",
    [("launch.elevation", "launch.elevation"), ("vehicle.imu", "vehicle.imu.0")],
)
def test_a_group_names_a_value_once(paths, tmp_path):
    sigma = {"launch.elevation": "0.1 deg"}.get(paths[0], "1 mm")
    path = tmp_path / "twice.yaml"
    path.write_text(
        f"extends: {DEFAULT}\ndispersions:\n  twins:\n    paths: [{', '.join(paths)}]\n"
        f"    sigma: [{sigma}, {sigma}]\n    correlation: [[1, 0], [0, 1]]\n"
    )
    words = f"{paths[1]} is in this group already, as '{paths[0]}'; keep one of them"
    column = len(f"    paths: [{paths[0]}, ") + 1
    assert the_message(path) == f"{path}:4:{column}: dispersions.twins.paths.1: {words}"


def test_a_shared_flight_cannot_be_dispersed():
    flight = ["launch.elevation={normal: 0.1 deg}", "star_camera.mounting.boresight.0={normal: 0.1}"]
    flight += [f"rail={{{RAIL}, sigma: [0.1 deg, 1 deg], correlation: [[1, 0], [0, 1]]}}"]
    for one in flight:
        said = messages(DEFAULT, ["campaign.flight=shared", f"dispersions.{one}"])
        assert all("changes the flight, which campaign.flight: shared flies once" in line for line in said)
    load.load(DEFAULT, ["campaign.flight=shared", "dispersions.imu.gyro.bias={log_normal: 20 %}"])


@pytest.mark.parametrize("rate", ["3 Hz", "20 Hz"])
def test_series_have_a_rate_that_the_covariance_is_logged_at(rate):
    said = the_message(DEFAULT, [f"campaign.series={rate}"])
    assert said.startswith(f"--set campaign.series: {rate} is not offered; take 10 Hz")


def test_set_reaches_into_a_dispersion():
    base = "dispersions.launch.elevation={normal: 0.1 deg}"
    (one,) = pattern(base, "dispersions.launch.elevation.normal=0.3 deg").dispersed
    assert one.law.sigma == 0.3
    assert pattern(base, "dispersions.launch.elevation=null").dispersed == []
    (one,) = pattern("dispersions.launch.elevation.normal=0.2 deg").dispersed
    assert one.law.sigma == 0.2


@pytest.mark.parametrize("key", sorted(dispersions.KEYS))
def test_a_setting_may_be_called_like_a_key_of_dispersions(key, tmp_path):
    """--set then means the setting where its value is a dispersion, else the key of a dispersion."""
    said = messages(DEFAULT, [f"dispersions.navigation.aa.{key}={{normal: 1 m}}"])
    assert [line.partition(": ")[0] for line in said] == [f"--set dispersions.navigation.aa.{key}"]
    assert "there is no 'aa' in navigation" in said[0]
    given = "dispersions.launch.elevation={normal: 0.1 deg}"
    said = messages(DEFAULT, [given, f"dispersions.launch.elevation.{key}={{normal: 1 m}}"])
    assert f"there is no '{key}'" in said[0] or "is dispersed by" in said[0]


def test_a_table_of_a_file_can_be_set(tmp_path):
    (tmp_path / "runs.csv").write_text("elevation_deg\n86.1\n86.2\n")
    column = f"{{file: {tmp_path / 'runs.csv'}, column: elevation_deg, unit: deg}}"
    (one,) = pattern(f"dispersions.launch.elevation.table={column}").dispersed
    assert one.law.values == (86.1, 86.2)


def test_the_schema_of_editors_knows_the_section():
    text = json.dumps(json_schema())
    assert "truncated_normal" in text and "latin_hypercube" in text
