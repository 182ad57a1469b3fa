"""Axes that are told wrongly, against the attitude of a truth: refused where gravity at rest shows it, else
warned of by the solution; sensors whose readings never change are warned of too.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from shefex_nav.replay import dataset, load, replayed, said
from shefex_nav.replay.series import ImuSeries
from shefex_nav.scenario.data_table import DataError

EXAMPLES = Path(__file__).parents[2] / "scenarios" / "replay"
LIFT_OFF_MS = 15000.0
SWAPPED = "data.axes=[x, y, z]"  # they are [x, -y, -z]


def copied(folder, file="truth.csv", change=lambda columns: columns):
    """The example with a changed file: its path. change : of {name: (N,)} -> the same, or fewer rows"""
    shutil.copytree(EXAMPLES / "csv_example", folder / "csv_example")
    shutil.copy(EXAMPLES / "csv_example.yaml", folder)
    path = folder / "csv_example" / file
    head, *rows = [line for line in path.read_text().splitlines() if line[:1] != "#"]
    names = head.split(",")
    columns = dict(zip(names, np.array([row.split(",") for row in rows], dtype=float).T, strict=True))
    changed = np.column_stack([change(columns)[name] for name in names])
    lines = [",".join(f"{value:.12g}" for value in row) for row in changed]
    path.write_text("\n".join([head, *lines]) + "\n")
    return folder / "csv_example.yaml"


def warnings(path, *overrides):
    scenario, files = load.load(path, overrides)
    return replayed.of_data(scenario, files, -np.inf, None)["warnings"]


def in_flight(columns):
    """Rows from well after lift-off on."""
    late = columns["t_ms"] > LIFT_OFF_MS + 1000.0
    return {name: column[late] for name, column in columns.items()}


def test_gravity_at_rest_shows_axes_that_thrust_hides(tmp_path):
    """A rail of 70 deg: half a turn about the nose tilts gravity by 40 deg, and thrust not at all."""
    with pytest.raises(DataError) as info:
        warnings(copied(tmp_path), SWAPPED)
    said = str(info.value)
    assert "data.axes: in axes [x, y, z] the specific force points 40 deg from where the truth has it" in said
    assert "at rest" in said and "it fits in [x, -y, -z]" in said


def test_a_truth_that_no_axes_fit_at_rest_is_warned_of(tmp_path):
    """Its roll is off by 65 deg before lift-off alone, by 21 deg of gravity: the axes are right in flight."""

    def change(columns):
        return columns | {"roll": columns["roll"] + np.where(columns["t_ms"] < LIFT_OFF_MS, 65.0, 0.0)}

    (one,) = [one for one in warnings(copied(tmp_path, change=change)) if one["field"] == "data.axes"]
    assert "(at rest, median of 1" in one["text"] and one["text"].endswith("it fits in no other axes")


@pytest.mark.parametrize(
    ("change", "overrides", "about_deg"),
    [
        (in_flight, [SWAPPED], 180.0),
        (lambda columns: in_flight(columns | {"roll": columns["roll"] + 120.0}), [], 120.0),
    ],
)
def test_a_solution_that_contradicts_the_truth_is_warned_of(tmp_path, change, overrides, about_deg):
    """Truth in flight alone does not show the axes at rest, and thrust is along the nose."""
    (one,) = warnings(copied(tmp_path, change=change), *overrides)
    assert one["field"] == "data.axes" and "times its sigma" in one["text"]
    told = float(one["text"].split("the attitude is ")[1].split(" deg")[0])
    assert told == pytest.approx(about_deg, abs=12.0)
    assert "data.axes" in one["text"] and "the truth's roll, pitch and heading" in one["text"]


def test_the_right_axes_and_a_truth_in_flight_alone_are_not_warned_of(tmp_path):
    assert warnings(copied(tmp_path, change=in_flight)) == []


def test_without_covariance_and_without_truth_nothing_is_judged(tmp_path):
    class Nothing:
        truth = nav = covariance = None

    assert list(said.contradiction(Nothing)) == []
    empty = type("Table", (), {"t_s": np.zeros(0)})
    other = type("Data", (), {"truth": empty, "nav": empty, "covariance": empty})
    assert list(said.contradiction(other)) == []


def imu(gyro, n=100):
    rng = np.random.default_rng(1)
    force = rng.standard_normal((n, 3))
    return ImuSeries(None, np.arange(n) / 100.0, gyro(rng.standard_normal((n, 3))), force, "rate")


def test_axes_that_never_change_are_named():
    names = type("Columns", (), {"gyro": ("a", "b", "c"), "accelerometer": ("d", "e", "f")})
    assert list(dataset.still_axes(imu(lambda turn: turn), names)) == []
    ((field, words),) = dataset.still_axes(imu(lambda turn: 0.0 * turn), names)
    assert field == "data.imu.gyro" and words.startswith("a, b, c: the same value in all 100 rows")
    ((field, words),) = dataset.still_axes(imu(lambda turn: turn * [1.0, 0.0, 1.0]), "imu.txt")
    assert field == "data.imu" and words.startswith("gyro y: the same value")
    assert list(dataset.still_axes(imu(lambda turn: 0.0 * turn, n=5), names)) == []


def test_gyros_that_are_zero_throughout_are_in_the_warnings(command, tmp_path):
    nothing = {name: 0.0 for name in ("wx", "wy", "wz")}
    path = copied(
        tmp_path,
        "imu.csv",
        lambda columns: columns | {name: 0.0 * columns[name] for name in nothing},
    )
    result = command("replay", path, "--json")
    assert result.code == 0, result.err
    said = {one["field"]: one["text"] for one in json.loads(result.out)["warnings"]}
    assert said["data.imu.gyro"].startswith("wx, wy, wz: the same value in all 7000 rows")
    assert "wx, wy, wz: the same value" in command("replay", path).out
