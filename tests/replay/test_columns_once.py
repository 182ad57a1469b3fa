"""A column of a file is one quantity: one that is named twice is refused, with its line and field;
so is what is no file.
"""

import pytest
from replay_files import CSV, scenario

from shefex_nav.replay import load
from shefex_nav.scenario.load import ScenarioError


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("columns")
    for name in ("imu", "gnss", "truth"):
        (folder / f"{name}.csv").touch()
    return scenario(folder, CSV.format(rate=50.0))


def refused(path, *overrides):
    with pytest.raises(ScenarioError) as info:
        load.load(path, overrides)
    return str(info.value)


@pytest.mark.parametrize(
    ("field", "columns"),
    [
        ("imu.gyro", "wx, wx, wx"),
        ("imu.accelerometer", "fx, fy, fx"),
        ("gnss.position", "lat, lat, h"),
        ("gnss.velocity", "vn, vn, vd"),
        ("truth.position", "lat, h, h"),
        ("truth.velocity", "vd, vd, vd"),
        ("truth.attitude", "roll, pitch, pitch"),
    ],
)
def test_twice_in_one_vector(path, field, columns):
    said = refused(path, f"data.{field}=[{columns}]")
    names = columns.split(", ")
    n = max(map(names.count, names))
    (twice,) = {name for name in names if names.count(name) > 1}
    assert f"data.{field}: {columns} name the column '{twice}' {n} times; expected 3 different ones" in said


def test_the_line_is_told(path, tmp_path):
    text = path.read_text().replace("[wx, wy, wz]", "[wx, wy, wy]")
    for name in ("imu", "gnss", "truth"):
        (tmp_path / f"{name}.csv").touch()
    (tmp_path / "s.yaml").write_text(text)
    line = 1 + text.splitlines().index("    gyro: [wx, wy, wy]")
    assert f"s.yaml:{line}:11: data.imu.gyro: " in refused(tmp_path / "s.yaml")


@pytest.mark.parametrize(
    ("field", "columns", "other"),
    [
        ("imu.accelerometer", "[fx, fy, wx]", "imu.gyro"),
        ("imu.gyro", "[t, wy, wz]", "imu.time"),
        ("truth.attitude", "[roll, pitch, h]", "truth.position"),
    ],
)
def test_of_two_quantities(path, field, columns, other):
    said = refused(path, f"data.{field}={columns}")
    assert f"is that of data.{other}; expected another one" in said


def test_columns_of_an_instrument(path):
    columns = "{file: imu.csv, time: t, field: [mx, mx, mz]}"
    assert "data.magnetometer.field: mx, mx, mz name the column 'mx' 2 times" in refused(
        path, f"data.magnetometer={columns}"
    )


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("/dev/zero", "/dev/zero is a device, expected a file"),
        ("..", " is a folder, expected a file"),
        ("none.csv", "there is no file "),
    ],
)
def test_what_is_no_file_is_told(path, file, words):
    said = refused(path, f"data.imu.file={file}")
    assert words in said and ("--data" in said) is (file == "none.csv")


def test_sigmas_may_share_a_column_and_so_may_validity(path):
    """A receiver that tells one sigma of all axes, and 0 satellites where there is no fix."""
    load.load(
        path,
        [
            "data.gnss.position_sigma=[s, s, sd]",
            "data.gnss.velocity_sigma=[sv, sv, sv]",
            "data.gnss.valid=n",
            "data.gnss.satellites=n",
        ],
    )
