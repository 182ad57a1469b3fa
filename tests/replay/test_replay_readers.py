"""Files of others: what is in them comes out in SI, in our frames; what is wrong is named with its line."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.geometry import wgs84
from shefex_nav.replay import csv_folder, kf_gins, schema_data, series
from shefex_nav.scenario.data_table import DataError

IMU = "t_ms,wx,wy,wz,fx,fy,fz\n# a comment\n0,1,2,3,0.1,0.2,-1\n\n5,4,5,6,0.3,0.4,-1.5\n"
COLUMNS = {
    "file": "imu.csv",
    "rate": "200 Hz",
    "time": "t_ms",
    "time_unit": "ms",
    "gyro": ["wx", "wy", "wz"],
    "gyro_unit": "deg/s",
    "accelerometer": ["fx", "fy", "fz"],
    "accelerometer_unit": "gee",
}
GNSS = {"file": "g.csv", "time": "t", "position": ["lat", "lon", "h"]}
FIXES = "t,lat,lon,h\n0,48,11,500\n1,48,11,500\n"


def read_csv(folder, imu=IMU, gnss=FIXES, columns=COLUMNS, gnss_columns=GNSS, truth=None, truth_columns=None):
    """Series of a folder with these texts."""
    (folder / "imu.csv").write_text(imu, encoding="utf-8")
    (folder / "g.csv").write_text(gnss, encoding="utf-8")
    files = {"imu": str(folder / "imu.csv"), "gnss": str(folder / "g.csv"), "truth": None}
    if truth is not None:
        (folder / "truth.csv").write_text(truth, encoding="utf-8")
        files["truth"] = str(folder / "truth.csv")
    data = schema_data.CsvData(format="csv", imu=columns, gnss=gnss_columns, truth=truth_columns)
    return csv_folder.read(data, files)[:3]


def test_units_of_a_csv(tmp_path):
    imu, gnss, truth = read_csv(tmp_path)
    np.testing.assert_allclose(imu.t_s, [0.0, 0.005])
    np.testing.assert_allclose(imu.gyro[1], np.radians([4.0, 5.0, 6.0]))
    np.testing.assert_allclose(imu.accelerometer[1], 9.80665 * np.array([0.3, 0.4, -1.5]))
    assert imu.kind == "rate" and truth is None and gnss.v_e is None and gnss.valid.all()
    r_e = wgs84.ecef_from_geodetic(np.radians(48.0), np.radians(11.0), 500.0)
    np.testing.assert_allclose(gnss.r_e[0], r_e, rtol=1e-15)


def test_a_unit_of_angle_says_that_rows_are_increments(tmp_path):
    columns = COLUMNS | {"gyro_unit": "arcsec", "accelerometer_unit": "mm/s"}
    imu, _, _ = read_csv(tmp_path, columns=columns)
    assert imu.kind == "increment"
    np.testing.assert_allclose(imu.gyro[0], np.radians(np.array([1.0, 2.0, 3.0]) / 3600.0))
    np.testing.assert_allclose(imu.accelerometer[0], [1e-4, 2e-4, -1e-3])


@pytest.mark.parametrize("separator", [";", "\t", "  "])
def test_other_separators(separator, tmp_path):
    imu, _, _ = read_csv(tmp_path, IMU.replace(",", separator))
    assert imu.gyro.shape == (2, 3)


def test_columns_may_stand_in_any_order_among_others(tmp_path):
    text = "name,h,lon,lat,t\nfirst,500,11,48,0\nsecond,500,11,48,1\n"
    _, gnss, _ = read_csv(tmp_path, gnss=text)
    _, same, _ = read_csv(tmp_path)
    np.testing.assert_array_equal(gnss.r_e, same.r_e)


def test_velocities_in_three_frames(tmp_path):
    """Two m/s to the north, one to the east, three up, said in three ways."""
    C_en = wgs84.dcm_en(np.radians(48.0), np.radians(11.0))
    v_e = C_en @ [2.0, 1.0, -3.0]
    said = {"ned": "2,1,-3", "enu": "1,2,3", "ecef": ",".join(map(repr, v_e.tolist()))}
    for frame, values in said.items():
        text = f"t,lat,lon,h,a,b,c,f\n0,48,11,500,{values},1\n1,48,11,500,{values},0\n"
        columns = GNSS | {"velocity": ["a", "b", "c"], "velocity_frame": frame, "valid": "f"}
        _, gnss, _ = read_csv(tmp_path, gnss=text, gnss_columns=columns)
        np.testing.assert_allclose(gnss.v_e[0], v_e, atol=1e-12)
        assert gnss.valid.tolist() == [True, False]


WRONG = {
    "a word": (IMU.replace("4,5,6", "4,five,6"), "imu.csv:5: wy: expected a number such as 12.5, got 'five'"),
    "nothing": (IMU.replace("4,5,6", "4,,6"), "imu.csv:5: wy: expected a number such as 12.5, got nothing"),
    "a short row": (IMU.replace(",0.4,-1.5", ""), "imu.csv:5: 5 values, but 7 names of columns"),
    "not a number": (IMU.replace("4,5,6", "4,nan,6"), "imu.csv:5: wy: must be a finite number"),
    "a name": (IMU.replace("wy", "wyy"), "imu.csv:1: column 'wy' is missing; did you mean 'wyy'?"),
    "twice": (IMU.replace("wy", "wx"), "imu.csv:1: column 'wx' is there 2 times; keep one of them"),
    "no rows": ("t_ms,wx,wy,wz,fx,fy,fz\n", "imu.csv:1: there is no row below the names"),
    "empty": ("\n", "imu.csv: the file is empty"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_in_a_csv_is_named_with_its_line(kind, tmp_path):
    text, words = WRONG[kind]
    with pytest.raises(DataError) as caught:
        read_csv(tmp_path, text)
    assert words in str(caught.value)


def test_degrees_taken_for_radians_are_noticed(tmp_path):
    with pytest.raises(DataError, match=r"g\.csv:2: lat: a latitude of 48 is beyond the poles"):
        read_csv(tmp_path, gnss_columns=GNSS | {"angle_unit": "rad"})


def test_a_longitude_of_more_than_a_turn_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"g\.csv:3: lon: a longitude of 1e\+308 is more than a turn"):
        read_csv(tmp_path, gnss=FIXES[:-7] + "1e308,500\n")


def test_numbers_in_quotes(tmp_path):
    """As spreadsheets write them, also beside a text with the separator in it."""
    text = 'note,"t_ms",wx,wy,wz,fx,fy,"fz"\n"a, b","0",1,2,3,0.1,0.2, "-1"\nc,"5",4,5,6,0.3,0.4,"-1.5"\n'
    imu, _, _ = read_csv(tmp_path, text)
    same, _, _ = read_csv(tmp_path)
    np.testing.assert_array_equal(imu.accelerometer, same.accelerometer)
    np.testing.assert_array_equal(imu.t_s, same.t_s)


def test_a_decimal_comma_is_named_once(tmp_path):
    for text in (
        IMU.replace(",", ";").replace(".", ","),
        IMU.replace("0.1", '"0,1"').replace("0.3", '"0,3"'),
    ):
        with pytest.raises(DataError) as caught:
            read_csv(tmp_path, text)
        assert str(caught.value).endswith(
            f"imu.csv:3: fx: '0,1' has a decimal comma; write 0.1, with a point; 1 more line likewise, "
            f"the last in {tmp_path / 'imu.csv'}:5"
        )
    with pytest.raises(
        DataError, match=r"imu\.csv:3: 9 values, but 7 names of columns; the commas seem to be in"
    ):
        read_csv(tmp_path, IMU.replace(".", ","))  # between commas: which belongs to which?


@pytest.mark.parametrize("row", ["5,4,5,6,0,3,0,4,-1,5", "5,4,5,6,0.3,0.4,-1.5,7", "5,4,5,6,0.4,-1.5"])
def test_a_row_with_more_or_fewer_values_than_names_is_refused(row, tmp_path):
    """In any line: of a shifted row all values that are read are numbers."""
    end = f"{IMU}10,1,2,3,0.1,0.2,-1,,\n"  # as written by spreadsheets: empty cells beyond the last name
    with pytest.raises(DataError) as caught:
        read_csv(tmp_path, end.replace("5,4,5,6,0.3,0.4,-1.5", row))
    count = row.count(",") + 1
    comma = "; the commas seem to be in the numbers (decimal comma): write points" if "." not in row else ""
    assert str(caught.value).endswith(f"imu.csv:5: {count} values, but 7 names of columns{comma}")
    imu, _, _ = read_csv(tmp_path, end)
    assert imu.t_s.tolist() == [0.0, 0.005, 0.01]


def test_empty_cells_at_the_ends_of_rows_between_tabs(tmp_path):
    """Before the first value and behind the last one, with a column of words that begins with a mark."""
    rows = "note,t_ms,wx,wy,wz,fx,fy,fz,#sat\n,0,1,2,3,0.1,0.2,-1,\n9,5,4,5,6,0.3,0.4,-1.5,7\n"
    imu, _, _ = read_csv(tmp_path, rows.replace(",", "\t"))
    np.testing.assert_allclose(imu.accelerometer, 9.80665 * np.array([[0.1, 0.2, -1.0], [0.3, 0.4, -1.5]]))
    with pytest.raises(DataError, match=r"imu\.csv:5: 8 values, but 7 names of columns$"):
        read_csv(tmp_path, IMU.replace("-1.5", "-1.5,7"))  # one value more is no decimal comma


def test_a_row_of_another_width_in_a_table_without_names(tmp_path):
    (tmp_path / "i.txt").write_text("0 1 1 1 2 2 2\n1 1 1 1 2 2 2\n2 1 1 9 1 2 2 2\n3 1 1 1 2 2 2\n")
    with pytest.raises(DataError, match=r"i\.txt:3: 8 values, but 7 in the first row$"):
        kf_gins.read_columns(tmp_path / "i.txt", ("time", *kf_gins.TURN, *kf_gins.GAIN))


TORN = {
    "cells": ("10,1,2,3,0.1", "imu.csv:6: the last line was not written to its end; read to line 5"),
    "half a number": ("10,1,2,3,0.1,0.2,-", "imu.csv:6: the last line was not written to its end; read to"),
    "nulls": ("\0" * 512, "imu.csv:5: the file ends in 512 null characters; read to line 5"),
    "nulls after half a line": (
        "10,1,2,3,0.1,0.2,-1.2" + "\0" * 9,
        "imu.csv:6: the file ends in 9 null characters and the last line was not written to its end",
    ),
}


@pytest.mark.parametrize("kind", TORN)
def test_an_end_that_was_not_written_is_left_out_and_told(kind, tmp_path):
    rest, words = TORN[kind]
    imu, _, _ = read_csv(tmp_path, IMU + rest)
    assert imu.t_s.tolist() == [0.0, 0.005] and words in imu.table.torn


def test_a_last_line_without_its_newline_is_read(tmp_path):
    imu, _, _ = read_csv(tmp_path, IMU + "10,1,2,3,0.1,0.2,-1")
    assert len(imu.t_s) == 3 and imu.table.torn == ""


@pytest.mark.parametrize("text", [IMU + "10,1,2\n", IMU.replace("0,1,2,3,0.1", "0,1,\0"), IMU + "\0\n10,1"])
def test_only_the_end_may_be_torn(text, tmp_path):
    with pytest.raises(DataError, match=r"imu\.csv:"):
        read_csv(tmp_path, text)


def test_rows_marked_as_no_fix_are_not_read(tmp_path):
    """Whatever stands in them: nothing, NaN, words, places that cannot be, times of a clock not yet set."""
    head = "t,lat,lon,h,u,v,w,fix,n\n"
    columns = GNSS | {"velocity": ["u", "v", "w"], "valid": "fix", "satellites": "n"}
    good = "0,48,11,500,1,1,1,1,7\n1,48,11,500,1,1,1,1,7\n"
    none = "2,,,,,,,0,\n3,nan,nan,nan,nan,1,1,0,nan\n4,none,-,x,1e99,1,1,0,0\n5,999,0,1e99,1,1,1,0,0\n"
    late = "1980,0,0,0,0,0,0,0,0\n,0,0,0,0,0,0,0,0\n6,48,11,500,1,1,1,1,7\n"
    _, gnss, _ = read_csv(tmp_path, gnss=head + good + none + late, gnss_columns=columns)
    assert gnss.t_s.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert gnss.valid.tolist() == [True, True, False, False, False, False, True]
    assert np.isfinite(gnss.satellites).all() and np.isfinite(gnss.r_e[gnss.valid]).all()
    for wrong in ("2,,11,500,1,1,1,1,7\n", "2,48,11,nan,1,1,1,1,7\n", "2,999,11,500,1,1,1,1,7\n"):
        with pytest.raises(DataError, match=r"g\.csv:4: (lat|h): "):
            read_csv(tmp_path, gnss=head + good + wrong, gnss_columns=columns)


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "km"), (1e2, "cm"), (1e3, "mm")])
def test_positions_in_another_unit(factor, unit, tmp_path):
    r_e = factor * wgs84.ecef_from_geodetic(np.radians(48.0), np.radians(11.0), 500.0)
    rows = "".join(f"{t},{','.join(map(repr, r_e.tolist()))}\n" for t in (0, 1))
    columns = GNSS | {"position": ["x", "y", "z"], "position_frame": "ecef"}
    with pytest.raises(
        DataError, match=rf"g\.csv:2: x, y, z: a position .*; they fit in {unit}: give them in m"
    ):
        read_csv(tmp_path, gnss="t,x,y,z\n" + rows, gnss_columns=columns)


def test_what_no_receiver_says_is_refused(tmp_path):
    for row, words in (
        ("1,48,11,1e99,1,1,1,1", "h: a height of 1e.99 m is nowhere near the Earth"),
        ("1,48,11,500,1e99,1,1,1", "u, v, w: a speed of .* m/s is faster than any"),
        ("1,48,11,500,1,1,1,1e99", "a sigma must be greater than zero and below 1e.09, got 1e.99"),
    ):
        columns = GNSS | {"velocity": ["u", "v", "w"], "velocity_sigma": ["s"] * 3}
        text = f"t,lat,lon,h,u,v,w,s\n0,48,11,500,1,1,1,1\n{row}\n"
        with pytest.raises(DataError, match=rf"g\.csv:3: {words}"):
            read_csv(tmp_path, gnss=text, gnss_columns=columns)


def test_a_file_of_the_wrong_kind_is_not_listed_line_by_line(tmp_path):
    rows = "\n".join(["a,b,c,d,e,f,g"] * 999) + "\n"
    with pytest.raises(DataError) as caught:
        read_csv(tmp_path, "t_ms,wx,wy,wz,fx,fy,fz\n" + rows)
    (said,) = str(caught.value).splitlines()
    assert "imu.csv:2: t_ms: expected a number such as 12.5, got 'a'; 998 more lines likewise" in said


def kf_gins_files(folder, gnss):
    """Paths of KF-GINS files."""
    (folder / "imu.txt").write_text("100.0 1e-5 2e-5 3e-5 0.01 0.02 -0.05\n100.005 0 0 0 0 0 0\n")
    (folder / "gnss.txt").write_text(gnss)
    (folder / "nav.txt").write_text(
        "2000 100.0 30.5 114.4 20 1 2 3 10 -5 270\n2000 101 30.5 114.4 20 1 2 3 10 -5 270\n"
    )
    return {
        name: str(folder / f"{file}.txt")
        for name, file in (("imu", "imu"), ("gnss", "gnss"), ("truth", "nav"))
    }


@pytest.mark.parametrize("long", [False, True])
def test_kf_gins(long, tmp_path):
    velocity, noise = (" 1 2 3", " 0.01 0.02 0.03") if long else ("", "")
    row = f" 30.5 114.4 20{velocity} 0.1 0.2 0.3{noise}\n"
    imu, gnss, truth = kf_gins.read(None, kf_gins_files(tmp_path, "100.0" + row + "101.0" + row))
    assert imu.kind == "increment"
    np.testing.assert_allclose(imu.gyro[0], [1e-5, 2e-5, 3e-5])
    np.testing.assert_allclose(gnss.sigma_r_n[1], [0.1, 0.2, 0.3])
    C_en = wgs84.dcm_en(np.radians(30.5), np.radians(114.4))
    np.testing.assert_allclose(truth.v_e[0], C_en @ [1.0, 2.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(truth.angles[0], np.radians([10.0, -5.0, 270.0]))
    np.testing.assert_allclose(truth.r_e, gnss.r_e)
    if long:
        np.testing.assert_allclose(gnss.v_e[0], truth.v_e[0])
        np.testing.assert_allclose(gnss.sigma_v_n[0], [0.01, 0.02, 0.03])
    else:
        assert gnss.v_e is None


@pytest.mark.parametrize("week", ["-1e308", "2000.5", "1e300", "-1"])
def test_kf_gins_with_a_week_that_cannot_be(tmp_path, week):
    files = kf_gins_files(tmp_path, "100.0 30.5 114.4 20 0.1 0.2 0.3\n101.0 30.5 114.4 20 0.1 0.2 0.3\n")
    text = (tmp_path / "nav.txt").read_text()
    (tmp_path / "nav.txt").write_text(text.replace("\n2000", f"\n{week}"))
    with pytest.raises(DataError, match=r"nav\.txt:2: week: expected a whole number of 0 to 10000, got"):
        kf_gins.read(None, files)


def test_kf_gins_with_too_few_columns(tmp_path):
    with pytest.raises(DataError, match=r"gnss\.txt:1: expected 7 columns \(time, latitude.*, got 4"):
        kf_gins.read(None, kf_gins_files(tmp_path, "100.0 30 114 20\n"))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("frame", ["ned", "ecef"])
def test_a_speed_of_1e308_is_refused_without_a_warning(frame):
    given = np.array([[1.0, 2.0, 3.0], [1e308, 1e308, 0.0]])
    rows = SimpleNamespace(stack=lambda names: given, place=lambda row: f"g.csv:{row + 2}")
    with pytest.raises(DataError, match=r"^g\.csv:3: a, b, c: a speed of 1e\+300 m/s is faster than any"):
        series.velocities(rows, ("a", "b", "c"), frame, np.full((2, 3), 6.4e6))


@pytest.mark.parametrize("cell", ["\u0660.\u0665", "\uff11", "1_0"])
def test_digits_of_other_scripts_and_parted_ones_are_named(tmp_path, cell):
    """Python's float() takes them, a reader of tables does not."""
    words = rf"imu\.csv:3: wy: expected a number such as 12\.5, got '{cell}'$"
    for written in (cell, f'"{cell}"'):
        imu = f"t_ms,wx,wy,wz,fx,fy,fz\n0,1,2,3,0.1,0.2,-1\n5,4,{written},6,0.3,0.4,-1.5\n"
        with pytest.raises(DataError, match=words):
            read_csv(tmp_path, imu=imu)


def test_of_many_columns_some_are_told(tmp_path):
    names = [f"c{k}" for k in range(12_000)] + ["c" * 100_000]
    imu = f"{','.join(names[::-1])}\n" + ",".join("1" for _ in names)
    with pytest.raises(DataError) as caught:
        read_csv(tmp_path, imu=imu)
    (first, *_) = str(caught.value).splitlines()
    assert "imu.csv:1: column 't_ms' is missing; there are: cccc" in first
    assert first.endswith("c11972, c11971 and 11971 more") and len(first) < 500


def test_a_sigma_of_zero_is_refused(tmp_path):
    text = "t,lat,lon,h,sn,se,sd\n0,48,11,500,1,1,1\n1,48,11,500,1,0,1\n"
    with pytest.raises(DataError, match=r"g\.csv:3: a sigma must be greater than zero"):
        read_csv(tmp_path, gnss=text, gnss_columns=GNSS | {"position_sigma": ["sn", "se", "sd"]})


def test_round_trip_of_a_place():
    r_e = np.array([wgs84.ecef_from_geodetic(0.3, -1.2, 900.0)])
    v_e = series.to_ecef(np.array([[1.0, 2.0, 3.0]]), r_e)
    np.testing.assert_allclose(v_e[0], wgs84.dcm_en(0.3, -1.2) @ [1.0, 2.0, 3.0], atol=1e-12)
