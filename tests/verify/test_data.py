"""Finding and reading the published trajectories, with small files written for these tests."""

import numpy as np
import pytest

from shefex_nav.verify import data


@pytest.fixture
def write(tmp_path):
    """write("a/b.csv", text) below a temporary folder, which it returns."""

    def put(name, text=""):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return tmp_path

    return put


def test_files_are_found_in_any_layout(write):
    write("Atmospheric_checkcases/Atmos_04_DroppedSphereRoundNonRotation/Atmos_04_sim_06.csv")
    write("Atmospheric_checkcases/Atmos_04_DroppedSphereRoundNonRotation/Atmos_04_sim_02.csv")
    write("Atmospheric_checkcases/Atmos_13p2_SubsonicAirspeedChangeF16/Atmos_13p2_sim_05.csv")
    write("Atmos_17/Atmos_17_sim_06.csv")
    write("Orbit_06A_SphereFixedDrag/Orbit_06a_sim_B.csv")
    write("Atmos_02/Atmos_02_sim_01_si_units.csv")  # other columns in other units: not one of them
    files = data.search(write("All_models/two-stage_package/twostage_aero.dml"))
    assert sorted(files.trajectories) == ["04", "13p2", "17", "Orbit 06a"]
    assert sorted(files.trajectories["04"]) == ["02", "06"]
    assert data.model_path(files, "twostage_aero.dml").name == "twostage_aero.dml"
    with pytest.raises(data.NescDataError, match="brick_aero"):
        data.model_path(files, "brick_aero.dml")


def test_a_folder_without_trajectories_is_an_error(write):
    with pytest.raises(data.NescDataError, match="no trajectory"):
        data.search(write("notes.txt"))
    with pytest.raises(data.NescDataError, match="no such folder"):
        data.search("/nowhere/at/all")


def test_rows_are_met_by_their_times(write):
    """One simulator writes every 0.01 s, its times in single precision, and one of its columns twice."""
    single = [float(np.float32(0.01 * k)) for k in range(21)]
    lines = [f"{t},{10 * t},{-t},{10 * t}" for t in single]
    folder = write("a.csv", "time,altitudeMsl_ft, mach,altitudeMsl_ft\n" + "\n".join(lines) + "\n")
    series = data.read_series(folder / "a.csv")
    found = data.on_grid(series, np.array([0.0, 0.1, 0.2, 0.3]), "altitudeMsl_ft")
    assert found[:3] == pytest.approx([0.0, 1.0, 2.0], abs=1e-6)
    assert np.isnan(found[3])
    assert data.on_grid(series, np.array([0.1]), "mach") == pytest.approx([-0.1])
    assert data.on_grid(series, np.array([0.1]), "gravity") is None
    assert np.isnan(data.on_grid(series, np.array([0.105]), "mach")[0])


def test_an_empty_cell_is_no_value(write):
    series = data.read_series(write("a.csv", "time,mach\n0.0,\n0.1,1.5\n") / "a.csv")
    assert np.isnan(series.columns["mach"][0])
    assert series.columns["mach"][1] == 1.5


@pytest.mark.parametrize(
    "text", ["", "time,mach\n", "time,mach\n0.0,1\n", "mach,time\n0,0\n1,1\n", "time,mach\n0,1\n1,fast\n",
             "time,mach\n0,1,2\n1,1,2\n", "time,mach\n0,1\n1\n"]
)  # fmt: skip
def test_a_broken_trajectory_is_an_error_that_names_the_file(write, text):
    path = write("a.csv", text) / "a.csv"
    with pytest.raises(data.NescDataError, match=r"a\.csv"):
        data.read_series(path)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("0,1\n1,x\n", "3: mach: expected a number such as 12.5, got 'x'"),
        ("0,1\n1,2,3\n", "3: 3 values, but 2 titles"),
        ("0,1\n2,1\n1,1\n", "4: time: got 1, expected one not before that of the row above"),
        ("0,1\n,1\n", "3: time: got nothing, expected"),
        ("0,1\n1,1e16\n", r"3: mach: expected a number below 1e\+15, got 1e16"),
    ],
)
def test_what_cannot_be_is_told_with_its_line(write, rows, words):
    with pytest.raises(data.NescDataError, match=f"a.csv:{words}"):
        data.read_series(write("a.csv", f"time,mach\n{rows}") / "a.csv")


def test_two_rows_may_have_one_time(write):
    assert len(data.read_series(write("a.csv", "time,mach\n0,1\n0,2\n1,3\n") / "a.csv").t_s) == 3
