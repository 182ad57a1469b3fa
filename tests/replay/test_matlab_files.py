"""Matlab files as NaveGo saves them: their fields in SI; what is no column, and what is damaged, is named."""

import numpy as np
import pytest
from scipy.io import savemat

from shefex_nav.geometry import wgs84
from shefex_nav.replay import dataset, navego
from shefex_nav.scenario.data_table import DataError


def navego_files(folder, **changes):
    """Paths of small files as NaveGo saves them."""
    t = np.arange(5) / 100.0
    imu = {"t": t, "wb": np.tile([1.0, 2.0, 3.0], (5, 1)), "fb": np.tile([0.0, 0.0, -9.8], (5, 1))}
    place = {"lat": np.full(5, 0.5), "lon": np.full(5, 0.2), "h": np.full(5, 30.0), "vel": np.ones((5, 3))}
    gnss = {
        "t": t,
        **place,
        "stdm": np.array([5.0, 5.0, 10.0]),
        "stdv": np.full(3, 0.1),
        "larm": np.zeros((3, 1)),
    }
    angles = {name: np.full(5, value) for name, value in (("roll", 0.1), ("pitch", 0.2), ("yaw", 0.3))}
    parts = {"imu": imu, "gnss": gnss, "truth": {"t": t, **place, **angles}}
    for name, part in parts.items():
        savemat(folder / f"{name}.mat", {name: part | changes.get(name, {})})
    return {name: str(folder / f"{name}.mat") for name in parts}


def test_navego(tmp_path):
    imu, gnss, truth = navego.read(None, navego_files(tmp_path))
    np.testing.assert_array_equal(imu.gyro[4], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(gnss.sigma_r_n[2], [5.0, 5.0, 10.0])
    np.testing.assert_allclose(gnss.v_e[0], wgs84.dcm_en(0.5, 0.2) @ np.ones(3), atol=1e-12)
    np.testing.assert_allclose(truth.angles[3], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(navego.lever_arm(str(tmp_path / "gnss.mat")), np.zeros(3))


def test_navego_without_a_field(tmp_path):
    files = navego_files(tmp_path)
    savemat(files["imu"], {"imu": {"t": np.arange(3.0), "wb": np.ones((3, 3)), "fbs": np.ones((3, 3))}})
    with pytest.raises(DataError, match=r"imu\.mat: field 'fb' is missing; did you mean 'fbs'\?"):
        navego.read(None, files)


@pytest.mark.parametrize("arm", [[1.0, 2.0], [0.1, 0.0, 1e308], [np.nan, 0.0, 0.0]])
def test_a_lever_arm_that_is_none_is_refused(arm, tmp_path):
    files = navego_files(tmp_path, gnss={"larm": np.array(arm)})
    with pytest.raises(
        DataError, match=r"gnss\.mat: field larm: got .*, expected three lengths of 1000 m at most"
    ):
        dataset._same_lever_arm(None, files["gnss"])


def test_navego_with_fields_that_differ_in_length(tmp_path):
    files = navego_files(tmp_path, imu={"wb": np.ones((4, 3))})
    with pytest.raises(DataError, match=r"fields differ in length: t 5, wb\.0 4"):
        navego.read(None, files)


@pytest.mark.parametrize(
    ("name", "shape", "words"),
    [
        ("wb", (5,), "N x 3 numbers, a row a sample, got 5"),
        ("wb", (5, 2), "N x 3 numbers, a row a sample, got 5 x 2"),
        ("fb", (3, 12_000), "N x 3 numbers, a row a sample, got 3 x 12000"),  # rows and columns exchanged
        ("t", (5, 2), "N numbers, a row a sample, got 5 x 2"),
    ],
)
def test_navego_with_a_field_of_other_columns(tmp_path, name, shape, words):
    files = navego_files(tmp_path, imu={name: np.ones(shape)})
    with pytest.raises(DataError, match=rf"imu\.mat: field {name}: expected {words}$"):
        navego.read(None, files)


def test_a_text_is_no_matlab_file(tmp_path):
    (tmp_path / "imu.mat").write_text("t,wx\n")
    with pytest.raises(DataError, match=r"imu\.mat: cannot be read as a Matlab file"):
        navego.read_structure(str(tmp_path / "imu.mat"), ("t",))


@pytest.mark.parametrize("seed", [46, 80, 246, 384, 1000, 1001])  # the first four crash scipy 1.17
def test_a_damaged_matlab_file_is_refused_or_read(tmp_path, seed):
    path = tmp_path / "imu.mat"
    savemat(path, {"imu": {"t": np.arange(5.0), "wb": np.ones((5, 3)), "fb": np.ones((5, 3))}})
    content, rng = bytearray(path.read_bytes()), np.random.default_rng(seed)
    for _ in range(1 + rng.integers(4)):
        content[rng.integers(124, len(content))] = rng.integers(256)
    path.write_bytes(content)
    try:
        table, _ = navego.read_structure(str(path), ("t", "wb", "fb"), vectors=("wb", "fb"))
    except DataError as error:
        assert str(path) in str(error)
    else:
        assert np.isfinite(table.stack(("t", "wb.0", "fb.2"))).all()


@pytest.mark.parametrize(
    ("value", "got"),
    [(np.zeros((5, 0)), "none"), (1.0, "a single one"), ("text", "'str"), (np.ones((2, 2, 2)), "3 dim")],
)
def test_a_field_that_is_no_column_is_refused(tmp_path, value, got):
    path = tmp_path / "imu.mat"
    savemat(path, {"imu": {"t": value, "wb": np.ones((5, 3))}})
    with pytest.raises(DataError, match=rf"imu\.mat: field t: expected a column of numbers, got {got}"):
        navego.read_structure(str(path), ("t", "wb"))


def test_no_other_file_is_read_than_the_one_that_is_named(tmp_path):
    savemat(tmp_path / "imu.mat", {"imu": {"t": np.arange(5.0)}})
    with pytest.raises(DataError, match="imu: cannot be read as a Matlab file"):
        navego.read_structure(str(tmp_path / "imu"), ("t",))


def test_a_crash_of_the_reader_is_a_message(tmp_path, monkeypatch):
    child = tmp_path / "child.py"
    child.write_text("import os\nos.abort()\n")
    monkeypatch.setattr(navego, "CHILD", child)
    with pytest.raises(DataError, match=r"imu\.mat: is damaged, or no Matlab file: .* crashed"):
        navego.read_structure(str(tmp_path / "imu.mat"), ("t",))
