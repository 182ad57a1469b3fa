"""Tables in files: what a scenario takes from them, whose folder counts, what is said about bad ones."""

import math

import numpy as np
import pytest
from broken import DEFAULT, TEXT, messages, the_message

from shefex_nav.scenario import params, rasp, tables
from shefex_nav.scenario.load import load
from shefex_nav.scenario.tables import BadTable

WIND = """# Andoya, made up
height_m, speed_m_s, from_deg

0,      5, 270   # on the ground
1000,  12, 280
10e3, 30.5, -90
"""
MOTOR = """; made up
;
Maxi 120 900 0-3-7 8.0 14.5 Works and Sons
   0.05 2400.0
   2.00 2000.0 ; regressive
   7.50 1500.0
   8.00 0.0
;
"""
PROPELLANT = """burnt_percent, station_m, inertia_roll_kg_m2, inertia_pitch_kg_m2
0, 9.2, 577, 7100
50, 9.3, 357, 3600
100, 9.4, 0, 0
"""
AERO = """mach, alpha_deg, axial, normal_slope, pressure_station_m, drag
0, 0, 0.4, 2.0, 1.0, 0
0, 20, 0.41, 2.1, 1.1, 0
5, 0, 0.2, 1.0, 1.2, 0.01
5, 20, 0.21, 1.1, 1.3, 0.01
2, 0, 0.6, 3.0, 1.4, 0.02
2, 20, 0.61, 3.1, 1.5, 0.02
"""
CALM = "wind:\n  file: wind.csv\n"


def scenario_file(folder, text):
    """A scenario in `folder` that extends the default by `text`."""
    path = folder / "top.yaml"
    path.write_text(f"extends: {DEFAULT}\n{text}", encoding="utf-8")
    return path


def test_wind(tmp_path):
    """A wind from the west blows to the east."""
    (tmp_path / "wind.csv").write_text(WIND, encoding="utf-8")
    scenario = load(scenario_file(tmp_path, CALM))
    assert scenario.wind.height == [0.0, 1000.0, 10000.0]
    assert scenario.wind.direction == pytest.approx([1.5 * math.pi, math.radians(280.0), -0.5 * math.pi])
    wind = params.flight_params(scenario).wind
    np.testing.assert_allclose(wind[0], [0.0, 0.0, 5.0], atol=1e-12)
    np.testing.assert_allclose(wind[2], [10000.0, 0.0, 30.5], atol=1e-12)
    assert wind[1, 1] == pytest.approx(-12.0 * math.cos(math.radians(280.0)))
    assert params.flight_params(load(DEFAULT)).wind.shape == (0, 3)


def test_the_text_kept_needs_no_file(tmp_path):
    """A run is reproducible from its log, where nothing but that text is."""
    folder = tmp_path / "data"
    folder.mkdir()
    for name, text in (("wind.csv", WIND), ("m.eng", MOTOR), ("p.csv", PROPELLANT), ("a.csv", AERO)):
        (folder / name).write_text(text, encoding="utf-8")
    begin, end = TEXT.index("      propellant:\n"), TEXT.index("    S44:")
    stage = (
        "      propellant: {mass: 8 kg, file: data/p.csv}\n"
        "      motor: {file: data/m.eng, exit_area: 0.005 m2, exit_station: 12 m}\n"
        "      aerodynamics: {area: 1 m2, diameter: 1 m, file: data/a.csv, damping_mach: [0, 9], "
        "pitch_damping: [-9, -8], roll_damping: [-1, -1]}\n"
    )
    text = (TEXT[:begin] + stage + TEXT[end:]).replace("wind: none", "wind: {file: data/wind.csv}")
    text = text.replace("mass: 980 kg", "mass: 8 kg").replace("mass: 487.5 kg", "mass: 9 kg")
    text = text.replace("mass: 200 kg", "mass: 9 kg").replace("mass: 814 kg", "mass: 9 kg")
    path = tmp_path / "top.yaml"
    path.write_text(text, encoding="utf-8")
    scenario = load(path)
    assert [name for name, _ in scenario.files] == [
        str(path),
        *(str(folder / name) for name in ("wind.csv", "p.csv", "m.eng", "a.csv")),
    ]
    assert dict(scenario.files)[str(folder / "m.eng")] == MOTOR
    assert "file:" not in scenario.source
    alone = tmp_path / "elsewhere" / "kept.yaml"
    alone.parent.mkdir()
    alone.write_text(scenario.source, encoding="utf-8")
    again = load(alone)
    assert again.model_dump() == scenario.model_dump()
    assert again.source == scenario.source
    one, two = params.flight_params(scenario), params.flight_params(again)
    np.testing.assert_array_equal(one.wind, two.wind)
    np.testing.assert_array_equal(one.stages[0].motor.vacuum_thrust_n, two.stages[0].motor.vacuum_thrust_n)


def test_the_folder_of_the_file_that_names_it_counts(tmp_path):
    """A base reads its own data, whoever extends it and wherever from."""
    base, top = tmp_path / "base", tmp_path / "top"
    base.mkdir()
    top.mkdir()
    scenario_file(base, CALM)
    (base / "wind.csv").write_text(WIND, encoding="utf-8")
    (top / "wind.csv").write_text("not this one\n", encoding="utf-8")
    path = top / "x.yaml"
    path.write_text("extends: ../base/top.yaml\n", encoding="utf-8")
    assert load(path).wind.height == [0.0, 1000.0, 10000.0]
    path.write_text(f"extends: ../base/top.yaml\n{CALM}", encoding="utf-8")
    assert the_message(path).startswith(f"{top / 'wind.csv'}:1:1: ")


def test_a_file_from_the_command_line_is_relative_to_where_one_is(tmp_path, monkeypatch):
    (tmp_path / "w.csv").write_text(WIND, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert load(DEFAULT, ["wind={file: w.csv}"]).wind.speed == [5.0, 12.0, 30.5]
    said = the_message(DEFAULT, ["wind={file: v.csv}"])
    assert said == "--set wind: wind.file: 'v.csv' there is no such file"


def test_a_missing_table(tmp_path):
    path = scenario_file(tmp_path, CALM)
    said = the_message(path)
    assert said == f"{path}:3:9: wind.file: '{tmp_path / 'wind.csv'}' there is no such file"


def test_values_and_a_file_at_once(tmp_path):
    (tmp_path / "wind.csv").write_text(WIND, encoding="utf-8")
    path = scenario_file(tmp_path, f"{CALM}  speed: [3 m/s]\n")
    assert the_message(path).startswith(
        f"{path}:4:3: wind.speed: does not go with file; take one of the two away"
    )


# kind: (text of the table with "@" before the place complained about, words)
BAD_WIND = {
    "empty": ("@", "the file is empty; expected a line with the columns height_m, speed_m_s, from_deg"),
    "no rows": ("@height_m,speed_m_s,from_deg\n", "there is no row below the names of the columns"),
    "no names": (
        "@0,5,270\n",
        "expected a line with the columns height_m, speed_m_s, from_deg, got '0, 5, 270'",
    ),
    "misspelt column": (
        "height_m, @speed, from_deg\n0,5,270\n",
        "'speed' is no column of this table; did you mean",
    ),
    "column twice": ("height_m,speed_m_s,@height_m\n0,5,270\n", "there is a column of this name already"),
    "column missing": (
        "@height_m,from_deg\n0,270\n",
        "column speed_m_s is missing; expected height_m, speed_m_s",
    ),
    "semicolons": (
        "@height_m;speed_m_s;from_deg\n0;5;270\n",
        "columns are separated by commas, not by semicolons",
    ),
    "no number": (
        "height_m,speed_m_s,from_deg\n0, @calm, 270\n",
        "speed_m_s: expected a number such as 12.5, got 'calm'",
    ),
    "NaN": (
        "height_m,speed_m_s,from_deg\n0, 3, @nan\n",
        "from_deg: expected a number such as 12.5, got 'nan'",
    ),
    "unit": (
        "height_m,speed_m_s,from_deg\n@0 m, 3, 0\n",
        "height_m: expected a number such as 12.5, got '0 m'",
    ),
    "hole": (
        "height_m,speed_m_s,from_deg\n0, @, 0\n",
        "speed_m_s: expected a number such as 12.5, got nothing",
    ),
    "short row": ("height_m,speed_m_s,from_deg\n# x\n0,@3\n", "expected 3 numbers, one for each of height_m"),
    "long row": ("height_m,speed_m_s,from_deg\n0,3,@9,1\n", "expected 3 numbers, one for each of height_m"),
    "upside down": (
        "height_m,speed_m_s,from_deg\n10, 3, 0\n@5, 3, 0\n",
        "wind.height.1: heights must increase: 5 m follows 10 m",
    ),
    "negative": (
        "height_m,speed_m_s,from_deg\n10, @-3, 0\n",
        "wind.speed.0: must not be negative, got '-3 m/s'",
    ),
    "fast": (
        "height_m,speed_m_s,from_deg\n0, 5, 0\n10, @900, 0\n",
        "wind.speed.1: 900 m/s at 10 m is no wind of the Earth; expected at most 300 m/s",
    ),
    "twice one height": (
        "height_m,speed_m_s,from_deg\n10, 3, 0\n@10, 3, 90\n",
        "wind.height.1: heights must increase: 10 m follows 10 m",
    ),
    "underscore": (
        "height_m,speed_m_s,from_deg\n0, @1_0, 0\n",
        "speed_m_s: expected a number such as 12.5, got '1_0'",
    ),
    "angle": (
        "height_m,speed_m_s,from_deg\n10, 3, @400\n",
        "wind.from.0: must be at most 360 deg, got '400 deg'",
    ),
}


def place(marked):
    """(line, column) of the @ in a text."""
    before = marked[: marked.index("@")]
    return before.count("\n") + 1, len(before) - before.rfind("\n")


@pytest.mark.parametrize("kind", BAD_WIND)
def test_a_bad_table_is_complained_about_where_it_is_bad(tmp_path, kind):
    marked, words = BAD_WIND[kind]
    table = tmp_path / "wind.csv"
    table.write_text(marked.replace("@", ""), encoding="utf-8")
    said = the_message(scenario_file(tmp_path, CALM))
    line, column = place(marked)
    assert said.startswith(f"{table}:{line}:{column}: "), said
    assert words in said


def test_errors_of_table_and_scenario_together(tmp_path):
    table = tmp_path / "wind.csv"
    table.write_text("height_m,speed_m_s,from_deg\n0,x,0\n1,2,y\n", encoding="utf-8")
    said = messages(scenario_file(tmp_path, f"{CALM}gps:\n  latency: 1\n"))
    assert [line.split(": ")[0].rsplit("/")[-1] for line in said] == [
        "top.yaml:5:12",
        "wind.csv:2:3",
        "wind.csv:3:5",
    ]


def test_a_table_that_is_wrong_throughout_is_not_listed_throughout(tmp_path):
    (tmp_path / "wind.csv").write_text("height_m,speed_m_s,from_deg\n" + "0,x,0\n" * 100, encoding="utf-8")
    said = messages(scenario_file(tmp_path, CALM))
    assert len(said) == tables.MOST_ERRORS + 1
    assert said[-1].endswith("and 95 more errors of this kind")


def test_rasp():
    motor = rasp.read(MOTOR, "m.eng")
    assert (motor.name, motor.propellant_kg.value, motor.total_kg.value) == ("Maxi", 8.0, 14.5)
    assert [cell.value for cell in motor.t_s] == [
        0.0,
        0.05,
        2.0,
        7.5,
        8.0,
    ]  # ignition is left out in the file
    assert [cell.value for cell in motor.thrust_n] == [0.0, 2400.0, 2000.0, 1500.0, 0.0]
    assert str(motor.thrust_n[2].mark) == "m.eng:5:9"


BAD_MOTORS = {
    "empty": ("@", "the file is empty; expected a header (name diameter_mm"),
    "comments": ("@; nothing\n", "the file is empty"),
    "short header": ("@M 120 900 0 8.0 14.5\n0.1 5\n1 0\n", "expected a header of 7 words"),
    "no header": ("@0.1 2400\n1 0\n", "expected a header of 7 words"),
    "word for a mass": (
        "M 120 900 0 @eight 14.5 W\n0.1 5\n1 0\n",
        "propellant_kg: expected a number such as 12.5, got 'eight'",
    ),
    "no propellant": (
        "M 120 900 0 @0 14.5 W\n0.1 5\n1 0\n",
        "propellant_kg: must be greater than zero, got 0",
    ),
    "masses swapped": (
        "M 120 900 0 14.5 @8 W\n0.1 5\n1 0\n",
        "total_kg: 8 kg must be more than the propellant, 14.5 kg",
    ),
    "diameter": (
        "M @1e300 900 0 8 14.5 W\n0.1 5\n1 0\n",
        "diameter_mm: must be at most 100000, got 1e300",
    ),
    "thinner than a hair": (
        "M @0.001 900 0 8 14.5 W\n0.1 5\n1 0\n",
        "diameter_mm: must be at least 1, got 0.001",
    ),
    "too many points": (
        "M 120 900 0 8 14.5 W\n" + "1 5\n" * 19_999 + "@1 5\n" + "1 5\n" * 9,
        "has 20009 points of thrust; expected at most 20000",
    ),
    "other digits": (
        "M 120 900 0 8 14.5 W\n0.1 @１２\n1 0\n",
        "thrust: expected a number such as 12.5, got '１２'",
    ),
    "no curve": ("@M 120 900 0 8 14.5 W\n", "there is no thrust below the header"),
    "no end": ("M 120 900 0 8 14.5 W\n0.1 5\n1 @3\n", "thrust: must end with zero, ends with 3 N"),
    "time back": ("M 120 900 0 8 14.5 W\n0.5 5\n@0.4 6\n1 0\n", "time: must increase, 0.4 s follows 0.5 s"),
    "time before ignition": (
        "M 120 900 0 8 14.5 W\n@-0.5 5\n1 0\n",
        "time: must not be negative, got -0.5 s",
    ),
    "negative thrust": ("M 120 900 0 8 14.5 W\n0.5 @-5\n1 0\n", "thrust: must not be negative, got -5 N"),
    "one number": ("M 120 900 0 8 14.5 W\n@0.5\n1 0\n", "expected a pair of time and thrust, got 1 words"),
    "second motor": (
        "M 120 900 0 8 14.5 W\n0.5 5\n1 0\n@N 120 900 0 8 14.5 W\n0.5 5\n1 0\n",
        "nothing may follow the zero thrust that ends a curve; keep one motor in a file",
    ),
}


@pytest.mark.parametrize("kind", BAD_MOTORS)
def test_a_bad_motor_file(kind):
    marked, words = BAD_MOTORS[kind]
    with pytest.raises(BadTable) as caught:
        rasp.read(marked.replace("@", ""), "m.eng")
    ((mark, text),) = caught.value.errors
    assert words in text
    assert (mark.line, mark.column) == place(marked)


def engine(folder, mass, *, extra=""):
    """The default vehicle, made light, on the motor of MOTOR."""
    (folder / "m.eng").write_text(MOTOR, encoding="utf-8")
    begin, end = TEXT.index("      motor:\n"), TEXT.index("      aerodynamics: # both")
    motor = "      motor: {file: m.eng, exit_area: 0.005 m2, exit_station: 12 m" + extra + "}\n"
    text = (TEXT[:begin] + motor + TEXT[end:]).replace("mass: 980 kg", "mass: 8 kg")
    text = text.replace("mass: 487.5 kg", "mass: 9 kg").replace("mass: 200 kg", "mass: 9 kg")
    text = text.replace("mass: 814 kg", "mass: 9 kg").replace("mass: 4240 kg", f"mass: {mass} kg")
    path = folder / "motor.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_thrust_of_a_motor_file(tmp_path):
    """Vacuum adds the pressure on the exit wherever there is thrust; the impulse makes the speed."""
    motor = params.flight_params(load(engine(tmp_path, 8))).stages[0].motor
    lost = 101325.0 * 0.005
    np.testing.assert_allclose(motor.t_s, [0.0, 0.05, 2.0, 7.5, 8.0])
    np.testing.assert_allclose(motor.vacuum_thrust_n, [0.0, 2400 + lost, 2000 + lost, 1500 + lost, 0.0])
    assert motor.exhaust_speed == pytest.approx(np.trapezoid(motor.vacuum_thrust_n, motor.t_s) / 8.0)
    vacuum = params.flight_params(load(engine(tmp_path, 8, extra=", measured_at: vacuum"))).stages[0].motor
    np.testing.assert_allclose(vacuum.vacuum_thrust_n, [0.0, 2400, 2000, 1500, 0.0])


def test_specific_impulse_of_a_motor_file(tmp_path):
    """Given, it must nearly agree; then the thrust is scaled so that it does."""
    impulse = np.trapezoid([0, 2400, 2000, 1500, 0], [0, 0.05, 2, 7.5, 8])
    near = round(impulse / 8.0 / 9.80665 * 1.01, 3)
    extra = f", measured_at: vacuum, specific_impulse: {near} s"
    motor = params.flight_params(load(engine(tmp_path, 8, extra=extra))).stages[0].motor
    assert motor.exhaust_speed == pytest.approx(near * 9.80665)
    assert np.trapezoid(motor.vacuum_thrust_n, motor.t_s) == pytest.approx(8.0 * near * 9.80665)
    assert motor.vacuum_thrust_n[1] == pytest.approx(2400 * 1.01, rel=1e-4)
    said = the_message(engine(tmp_path, 8, extra=", specific_impulse: 120 s"))
    assert (
        ".motor.specific_impulse: 120 s does not agree within 2 %: the thrust curve has 18264 N s in vacuum"
        in said
    )


def test_propellant_against_the_header_of_the_motor_file(tmp_path):
    said = the_message(engine(tmp_path, 9))
    assert (
        "vehicle.stages.S40M.propellant.mass: 9 kg does not agree within 2 % with 8 kg in the header" in said
    )
    assert said.endswith(f"{tmp_path / 'm.eng'}:3")


def test_an_error_in_a_motor_file_names_its_line(tmp_path):
    path = engine(tmp_path, 8)
    (tmp_path / "m.eng").write_text(MOTOR.replace("1500.0", "fast"), encoding="utf-8")
    assert the_message(path) == (
        f"{tmp_path / 'm.eng'}:6:9: thrust: expected a number such as 12.5, got 'fast'"
    )
