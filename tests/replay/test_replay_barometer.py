"""Data of others with a barometer, a magnetometer, a receiver that says latitude and longitude alone."""

from pathlib import Path

import numpy as np
import pytest
from magnetic_elements import field_n

from shefex_nav import records
from shefex_nav.environment import atmosphere, magnetic_field
from shefex_nav.geometry import euler
from shefex_nav.instruments import barometer
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.replay import external, load
from shefex_nav.replay import replayed as replay_result
from shefex_nav.report.navigation_errors import navigation_errors, normalised_errors
from shefex_nav.scenario.data_table import DataError
from shefex_nav.scenario.load import ScenarioError

EXAMPLE = Path(__file__).parents[2] / "scenarios" / "replay" / "csv_example.yaml"
FOLDER = EXAMPLE.with_suffix("")
GNSS = """    file: level.csv
    time: t_ms
    time_unit: ms
    position: [latitude, longitude]
    height: 360 m
    height_error: 3 m
"""
BAROMETER = """  barometer:
    file: pressure.csv
    time: t_ms
    time_unit: ms
    {column}
"""
SENSOR = """barometer:
  rate: 10 Hz
  bias: 100 Pa
  noise: 5 Pa
"""
COLUMNS = {
    "pressure": "pressure: p\n    pressure_unit: hPa",
    "height": "height: h",
}


def write(folder, column="pressure", gnss=GNSS, sensor=SENSOR, states="[baro_bias, baro_scale]"):
    """The example without height and velocity of GNSS, and with a barometer. -> path of its scenario"""
    rng = np.random.default_rng(3)
    rows = [line.split(",") for line in (FOLDER / "truth.csv").read_text().split()]
    place = [rows[0].index(name) for name in ("t_ms", "height")]
    lines = ["t_ms,p,h"]
    for row in rows[1:]:
        t_ms, height = (float(row[k]) for k in place)
        pressure = atmosphere.us76(height - 20.0)[1] + 80.0 + 5.0 * rng.standard_normal()
        altitude = replay_result.pressure_altitude(np.array([pressure]))[0]
        lines.append(f"{t_ms:.1f},{pressure / 100.0:.4f},{altitude:.3f}")
    (folder / "pressure.csv").write_text("\n".join(lines) + "\n")
    rows = [line.split(",") for line in (FOLDER / "gnss.csv").read_text().split()]
    place = [rows[0].index(name) for name in ("t_ms", "latitude", "longitude")]
    told = [row for row in rows if row[-1] != "0"]
    (folder / "level.csv").write_text("\n".join(",".join(row[k] for k in place) for row in told) + "\n")
    for name in ("imu.csv", "truth.csv"):
        (folder / name).write_text((FOLDER / name).read_text())
    text = EXAMPLE.read_text(encoding="utf-8").replace("folder: csv_example ", f"folder: {folder} ")
    begin, end = text.index("    file: gnss.csv"), text.index("  truth: #")
    text = text[:begin] + gnss + BAROMETER.format(column=COLUMNS[column]) + text[end:]
    text = text.replace(
        "  latency: 0.2 s\n", f"  latency: 0.2 s\n  position_noise: [3 m, 3 m, 1 m]\n{sensor}"
    )
    text = text.replace("navigation:\n", f"navigation:\n  states: {states}\n")
    path = folder / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def replayed(path):
    replay = external.prepare(*load.load(path))
    builder = RunDataBuilder(external.mission(replay))
    for record in external.run(replay, external.Clock()):
        builder.add(record)
    return builder.build()


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return replayed(write(tmp_path_factory.mktemp("data")))


def test_a_student_rocket_is_navigated_by_pressure_and_two_coordinates(data):
    gates = {
        sensor: [g for g in data.gates if g.sensor == sensor] for sensor in ("barometer", "gps_position")
    }
    assert {gate.dof for gate in gates["gps_position"]} == {2}
    assert all(gate.accepted for gate in gates["gps_position"])
    assert len([gate for gate in gates["barometer"] if gate.accepted]) > 150
    errors = navigation_errors(data)
    _, nees, _ = normalised_errors(data, errors)
    assert np.linalg.norm(errors.position_i, axis=1).max() < 30.0
    assert 0.5 < nees.mean() < 20.0  # of 9
    sigma = np.sqrt(np.einsum("nii->n", data.covariance.P[:, :3, :3]))
    assert sigma.max() < 60.0


def test_a_height_above_the_start_is_no_better_than_the_start(data):
    """Where fixes tell heights, both ends have errors of their own; else that of the start is in both."""
    arrays = data.readings["barometer"]
    readings = [records.row(arrays, k) for k in range(len(arrays.t_valid_s))]
    start = data.alignment._replace(sigma_r=40.0)
    without = replay_result.highest(readings, start, data)["sigma_height_m"]
    told = data._replace(gps=[fix._replace(horizontal=False) for fix in data.gps])
    found = replay_result.highest(readings, start, told)["sigma_height_m"]
    assert found == pytest.approx(np.hypot(40.0, without))


def test_a_pressure_altitude_is_the_pressure_that_it_stands_for(data, tmp_path):
    again = replayed(write(tmp_path, column="height"))
    np.testing.assert_allclose(
        again.readings["barometer"].pressure, data.readings["barometer"].pressure, atol=0.02
    )
    np.testing.assert_allclose(again.nav.r_i[-1], data.nav.r_i[-1], atol=0.05)


def test_the_height_of_the_start_is_known_as_well_as_it_is_said(tmp_path):
    worse = write(tmp_path, gnss=GNSS.replace("3 m", "40 m"))
    replay = external.prepare(*load.load(worse))
    assert replay.alignment.sigma_r == pytest.approx(40.0)
    assert all(fix.horizontal for fix in replay.data.fixes)


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"gnss": GNSS.replace("    height: 360 m\n", "")}, "data.gnss.height", "fixes say no height"),
        (
            {"gnss": GNSS.replace("longitude]", "longitude]\n    position_frame: ecef")},
            "position",
            "ecef has three",
        ),
        (
            {"gnss": GNSS + "    position_sigma: [a, b, c]\n"},
            "position_sigma",
            "3 columns for a position of 2",
        ),
        ({"gnss": GNSS + "    velocity: [a, b, c]\n"}, "data.gnss.velocity", "used without velocity"),
        ({"gnss": GNSS.replace("[latitude, longitude]", "[latitude]")}, "data.gnss.position", "2"),
        ({"sensor": "", "states": "[]"}, "data", "give both or none"),
        ({"states": "[baro_scale]"}, "navigation.states", "needs the state of its bias"),
    ],
)
def test_what_is_refused(tmp_path, changes, field, words):
    with pytest.raises(ScenarioError) as caught:
        load.load(write(tmp_path, **changes))
    assert any(field in line and words in line for line in caught.value.messages), caught.value.messages


def test_a_rate_that_is_not_the_files_and_a_pressure_that_is_none_are_refused(tmp_path):
    path = write(tmp_path, sensor=SENSOR.replace("10 Hz", "25 Hz"))
    with pytest.raises(DataError, match=r"pressure.csv: has 10 readings a second, barometer.rate says 25"):
        external.prepare(*load.load(path))
    path = write(tmp_path)
    text = (tmp_path / "pressure.csv").read_text().split("\n")
    text[5] = text[5].split(",")[0] + ",0.0,0.0"
    (tmp_path / "pressure.csv").write_text("\n".join(text))
    with pytest.raises(
        DataError, match=r"pressure.csv:6: p: a static pressure is greater than zero and below 1e9 Pa, got 0"
    ):
        external.prepare(*load.load(path))


def with_magnetometer(folder):
    """The example with a magnetometer, in micro-tesla along forward, left and up. -> path of its scenario"""
    text = (FOLDER / "truth.csv").read_text().split()
    names, rng, harmonics = text[0].split(","), np.random.default_rng(4), magnetic_field.load(2011.145)
    place = [
        names.index(name) for name in ("t_ms", "latitude", "longitude", "height", "roll", "pitch", "heading")
    ]
    lines = ["t_ms,mx,my,mz"]
    for row in text[1:]:
        t_ms, *angles = (float(row.split(",")[k]) for k in place)
        latitude, longitude = np.radians(angles[:2])
        b_n = field_n(harmonics, latitude, longitude, angles[2])
        b_b = euler.dcm_from_euler(*np.radians(angles[3:])).T @ b_n + [3e-8, -2e-8, 4e-8]
        field = 1e6 * (b_b + 5e-8 * rng.standard_normal(3)) * [1.0, -1.0, -1.0]
        lines.append(",".join([f"{t_ms:.1f}", *(f"{x:.5f}" for x in field)]))
    (folder / "field.csv").write_text("\n".join(lines) + "\n")
    text = EXAMPLE.read_text(encoding="utf-8").replace("folder: csv_example ", f"folder: {folder} ")
    for name in ("imu.csv", "truth.csv", "gnss.csv"):
        (folder / name).write_text((FOLDER / name).read_text())
    columns = (
        "file: field.csv\n    time: t_ms\n    time_unit: ms\n    field: [mx, my, mz]\n    field_unit: uT"
    )
    text = text.replace("  truth: #", f"  magnetometer:\n    {columns}\n  truth: #")
    sensor = "magnetometer:\n  rate: 10 Hz\n  hard_iron: 50 nT\n  noise: 50 nT\n"
    text = text.replace("alignment:\n", f"{sensor}alignment:\n").replace(
        "navigation:\n", "navigation:\n  states: [hard_iron]\n"
    )
    path = folder / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_magnetometer_in_the_axes_of_the_file_finds_the_heading(tmp_path, data):
    """Gyros find north to 2 deg there; with the field of the Earth it is known to a fraction of that."""
    found = replayed(with_magnetometer(tmp_path))
    gates = [gate for gate in found.gates if gate.sensor == "magnetometer"]
    assert len(gates) > 200 and all(gate.accepted for gate in gates)
    after, before = (
        np.degrees(np.linalg.norm(navigation_errors(one).attitude_b[200:300], axis=1))
        for one in (found, data)
    )
    assert after.max() < 0.5 * before.mean()
    _, nees, _ = normalised_errors(found, navigation_errors(found))
    assert 0.5 < nees.mean() < 20.0


def test_a_replay_that_ended_early_says_where_also_without_truth(data):
    """What is made of such a log, as by the smoother, must not look as if it went on to its end."""
    cut = data._replace(ended_early=True, last_t_s=np.nan)
    assert cut.cut_s == data.nav.t_s[-1]


def test_pressure_altitudes_of_a_file_are_those_of_the_table():
    """Geopotential, as altimeters have them: ISO 2533, table 5, 5, 11 and 20 km."""
    altitudes = np.array([0.0, 5000.0, 11000.0, 20000.0])
    pressures = barometer.of_heights(altitudes)
    assert np.allclose(pressures, [101325.0, 54019.9, 22632.0, 5474.87], rtol=1e-5)
    assert np.allclose(replay_result.pressure_altitude(pressures), altitudes, atol=0.2)
    assert not barometer.of_heights(np.array([1e7]))[0] > 0.0  # refused by its column
