"""Slips of the hand in a new scenario: what is told names the slip, not its consequences."""

import pytest
from broken import the_message

from shefex_nav.scenario.load import ScenarioError, load
from shefex_nav.scenario.tables import BadTable, read


def lines(tmp_path, text):
    """Lines about a file that extends rexus_like, without its name."""
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: rexus_like\n{text}", encoding="utf-8")
    try:
        load(path)
    except ScenarioError as error:
        return [line.replace(f"{path}:", "") for line in error.messages]
    return []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("vehicle: {payload: {mass: 56,0 kg, station: 1,2 m}}",
         ["2:27: vehicle.payload.mass: '56,0 kg' has a comma, which stands between keys; write 56.0 kg",
          "2:45: vehicle.payload.station: '1,2 m' has a comma, which stands between keys; write 1.2 m"]),
        ("vehicle: {payload: {mass: 56, 0 kg}}",
         ["2:27: vehicle.payload.mass: '56,0 kg' has a comma, which stands between keys; write 56.0 kg"]),
        ("imu: {vibration: {boost: [7,5 gee]}}",
         ["2:27: imu.vibration.boost: '7,5 gee' has a comma, which stands between values; write 7.5 gee"]),
        ("launch: {elevation: 85 deg}\nlog: {rate: 10 Hz}", []),
        ("vehicle: {imu: [-1 m,0 m,0 m]}", []),
    ],
)  # fmt: skip
def test_a_decimal_comma_in_braces_or_brackets(tmp_path, text, said):
    assert lines(tmp_path, text) == said


def test_a_decimal_comma_anywhere_else(tmp_path):
    """A pair of numbers is none: a position is not told to be one number."""
    (said,) = lines(tmp_path, "launch:\n  height: 300,5 m\n")
    assert said.endswith("; write 300.5 m: numbers have a point")
    for several in ("1,2,3 m", "1.000,5 m"):  # write 1.000.5 m would be no number
        (said,) = lines(tmp_path, f"launch:\n  height: {several}\n")
        assert "point" not in said


def test_a_comma_may_stand_between_thousands(tmp_path):
    """Who is told to write 1.000 m of a thousand metres has a thousandth of them."""
    for written, meant in (("1,000 m", "1.000 m or, if thousands are meant, 1000 m"), ("0,300 m", "0.300 m")):
        (said,) = lines(tmp_path, f"launch:\n  height: {written}\n")
        assert said.endswith(f"; write {meant}: numbers have a point")


def test_tables_of_spreadsheets_in_other_languages():
    with pytest.raises(BadTable, match="separated by commas, not by semicolons, and numbers have a point"):
        read("mach;axial\n0;0,4\n", "a.csv", ("mach", "axial"))
    with pytest.raises(BadTable, match="separated by commas, not by tabs"):
        read("mach\taxial\n0\t0.4\n", "a.csv", ("mach", "axial"))
    with pytest.raises(BadTable, match="got 3; numbers have a point, not a comma"):
        read("mach,axial\n0,0,4\n", "a.csv", ("mach", "axial"))


def test_a_missing_file_is_told_with_one_like_it(tmp_path):
    for name in ("motor.eng", "motor.csv", "wind.csv", "nordlys.yaml"):
        (tmp_path / name).write_text("", encoding="utf-8")
    (said,) = lines(tmp_path, "wind: {file: winds.csv}")
    assert said.endswith("there is no such file; did you mean 'wind.csv'?")
    (said,) = lines(tmp_path, "wind: {file: humidity.csv}")
    assert said.endswith("there is no such file")
    (said,) = lines(tmp_path, "wind: {file: data/wind.csv}")
    assert said.endswith(f"there is no such file; there is no folder '{tmp_path / 'data'}'")
    (said,) = lines(tmp_path, "vehicle: {stages: {Orion: {motor: {file: moter.eng}}}}")
    assert said.endswith("; did you mean 'motor.eng'?")
    assert the_message(tmp_path / "nordlis.yaml").endswith("; did you mean 'nordlys.yaml'?")


def test_a_bare_name_is_told_with_a_file_like_it(tmp_path, monkeypatch):
    (tmp_path / "nordlys.yaml").write_text("", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert f"no such file in {tmp_path}; did you mean 'nordlys.yaml'?, and" in the_message("nordlis")


STAGE = """
vehicle:
  stages:
{nulls}    Mine:
      ignition: 200 s
      dry: {{mass: 50 kg, station: 4.6 m, inertia_roll: 0.6 kg m2, inertia_pitch: 70 kg m2}}
      propellant: {{mass: 90 kg, station: 4.2 m, length: 1 m, outer_radius: 16 cm, inner_radius: 3 cm}}
      motor: {{specific_impulse: 230 s, burn_time: 8 s, rise: 0.1 s, tail_off: 1 s, level_ratio: 0.8,
        exit_area: 250 cm2, exit_station: 5.2 m}}
      aerodynamics: {{area: 0.0995 m2, diameter: 0.356 m, mach: [0, 2], axial: [0.4, 0.4],
        normal_slope: [9, 9], pressure_station: [4.5 m, 4.5 m],
        pitch_damping: [-9, -9], roll_damping: [-9, -9]}}
imu: {{vibration: {{boost: [{boost}]}}}}
"""


def test_stages_of_the_extended_file_are_named_where_they_do_not_go_with_ones_own(tmp_path):
    """The first line says where they are from; what it says to write helps."""
    said = lines(tmp_path, STAGE.format(nulls="", boost="7 gee"))
    assert any("1 value for 2 stages (Orion, Mine)" in line for line in said)
    hints = [line for line in said if "Orion comes from " in line]
    assert len(hints) == 1 and "rexus_like.yaml: 'Orion: null' under vehicle.stages leaves out" in hints[0]
    said = lines(tmp_path, STAGE.format(nulls="    Orion: null\n", boost="7 gee"))
    assert not any("stages (" in line or "comes from" in line for line in said)


def test_nothing_is_said_of_stages_where_all_are_inherited(tmp_path):
    (said,) = lines(tmp_path, "imu: {vibration: {boost: [7 gee, 8 gee]}}")
    assert "2 values for 1 stage (Orion)" in said and "comes from" not in said
