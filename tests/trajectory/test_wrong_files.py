"""What is wrong with a trajectory is told in one message, with the file and the line."""

import json

import numpy as np
import pytest
from given_flight import ALONG, EXAMPLE, ORIGIN, in_orbit, scenario
from made import AEM, OEM, csv, rocket, satellite, write_ccsds
from made import EXAMPLE as FILE
from refusals import COLUMNS, refused

from shefex_nav import prepare
from shefex_nav.errors import UserError
from shefex_nav.report import programme
from shefex_nav.scenario.load import ScenarioError


def changed(tmp_path, line, text):
    """The example's section with another text in a line of its file, counted from one."""
    lines = FILE.read_text().splitlines()
    lines[line - 1] = text(lines[line - 1]) if callable(text) else text
    (tmp_path / "changed.csv").write_text("\n".join(lines))
    return COLUMNS | {"file": tmp_path / "changed.csv"}


def cell(k, value):
    """Puts a value into a column of a line."""

    def put(line):
        cells = line.split(",")
        cells[k] = value
        return ",".join(cells)

    return put


def warned(trajectory, *overrides):
    """Warnings of `check` about the file of a trajectory."""
    return [one.text for one in programme.of_trajectory(scenario(trajectory, *overrides))]


def test_good_rows_are_not_warned_of():
    assert warned(COLUMNS) == []


@pytest.mark.parametrize(
    "line, text, words",
    [
        (50, cell(0, "nan"), "changed.csv:50: t_s: must be a finite number"),
        (50, cell(2, "12,5"), "changed.csv:50"),
        (50, cell(3, "high"), "changed.csv:50: up_m: expected a number such as 12.5, got 'high'"),
        (
            50,
            cell(0, "4.6"),
            "changed.csv:50: time 4.600000 s does not follow on 4.600000 s in the row before",
        ),
        (50, cell(7, "3.0"), "changed.csv:50: the quaternion has the length 3"),
        (
            2,
            lambda line: line.replace("north_m", "nord_m"),
            "changed.csv:2: column 'north_m' is missing; did",
        ),
    ],
)
def test_rows_that_are_none(tmp_path, line, text, words):
    assert words in refused(changed(tmp_path, line, text))


@pytest.mark.parametrize(
    "more, words",
    [
        ({"velocity_unit": "km/h"}, "they fit with velocity_unit: m/s"),
        ({"position_unit": "ft"}, "they fit with velocity_unit: ft/s or position_unit: m"),
        ({"velocity_frame": "ecef"}, "they fit with velocity_frame: enu"),
        ({"velocity_frame": "inertial"}, "velocities differ from the change of the positions by"),
        ({"position_frame": "ecef"}, "km from the centre of the Earth; check position_frame and its unit"),
        ({"position_frame": "geodetic"}, "is no latitude in the unit given"),
        ({"lift_off": "300 s"}, "within a second of mission.start, -10 s; is lift_off or the epoch right?"),
        ({"pad": "2 s"}, "its first row is at T+0.000 s, and mission.start is -10 s; pad: 10 s lets"),
    ],
)
def test_units_frames_and_clocks(more, words):
    assert words in refused(COLUMNS | more)


def test_a_first_row_that_moves(tmp_path):
    lines = FILE.read_text().splitlines()
    (tmp_path / "late.csv").write_text("\n".join([*lines[:2], *lines[40:]]))
    words = refused(COLUMNS | {"file": tmp_path / "late.csv", "pad": "20 s"})
    assert "late.csv:3: the first row moves with" in words and "a pad is for a vehicle that stands" in words


def test_contradictions_have_their_place():
    def said(more, *overrides):
        with pytest.raises(ScenarioError) as caught:
            scenario(COLUMNS | more, *overrides)
        return str(caught.value)

    assert "trajectory.file: 'no.csv' there is no such file" in said({"file": "no.csv"})
    assert "trajectory.format: 'cvs' is not known; choose from: csv, rocketpy" in said({"format": "cvs"})
    assert "trajectory.origin: is missing; launch_enu needs it" in said({"origin": None})
    assert "trajectory.velocity_frame: is missing; choose from: ned" in said({"velocity_frame": None})
    assert "trajectory.attitude" in said({"attitude": None})
    acceleration = {"acceleration": ["ve_m_s", "vn_m_s", "vu_m_s"], "velocity_frame": "ned"}
    assert "axes that turn with the place" in said(acceleration)
    assert "separations.1: times must increase: 3 s follows 4 s" in said({"separations": ["4 s", "3 s"]})
    assert "left-handed" in said({"attitude": COLUMNS["attitude"] | {"axes": ["x", "-y", "z"]}})
    for override, words in (
        ("attitude=prescribed", "attitude: the attitude is that of the trajectory"),
        ("wind={height: [0 m], speed: [3 m/s], from: [0 deg]}", "wind: the wind has done its work"),
        ("imu.vibration.boost=[1 gee, 2 gee]", "2 values for 1 stage"),
        ("gps.outages=[{event: burn_out_9, shortest: 0 s, longest: 1 s}]", "is no event of this flight"),
        ("dispersions={wind.speed: {sigma: 1 m/s}}", "wind"),
        ("launch={latitude: 1 deg, longitude: 1 deg, height: 0 m, azimuth: 0 deg, elevation: 80 deg, "
         "roll: 0 deg, rail_length: 5 m}", "not from launch"),
    ):  # fmt: skip
        assert words in said({}, override)


def test_a_vehicle_is_of_no_use(tmp_path):
    base, section = EXAMPLE.parent / "shefex2_andoya.yaml", json.dumps(COLUMNS, default=str)
    (tmp_path / "own.yaml").write_text(f"extends: {base}\nlaunch: null\ntrajectory: {section}\n")
    with pytest.raises(ScenarioError) as caught:
        prepare.load.load(tmp_path / "own.yaml")
    assert "vehicle: a flight along a trajectory does not use it; null takes away" in str(caught.value)
    assert "programme: a flight along a trajectory does not use it" in str(caught.value)


def test_what_no_trajectory_needs_is_still_needed(command, tmp_path):
    (tmp_path / "own.yaml").write_text(f"extends: {EXAMPLE.parent}/shefex2_andoya.yaml\nvehicle: null\n")
    result = command("check", tmp_path / "own.yaml")
    assert result.code == 2 and "vehicle: is missing; this section is required" in result.err


def test_a_file_that_has_changed(tmp_path):
    (tmp_path / "a.csv").write_bytes(FILE.read_bytes())
    one = scenario(COLUMNS | {"file": tmp_path / "a.csv"})
    (tmp_path / "a.csv").write_text(FILE.read_text().replace("70.000000", "70.100000"))
    with pytest.raises(UserError, match="is not the file that this scenario was read with"):
        prepare.fly_vehicle(one, 1)


def test_a_command_says_it_in_one_message(command, tmp_path):
    told = changed(tmp_path, 50, cell(0, "nan"))
    override = f"trajectory={json.dumps(told | {'pad': '10 s'}, default=str)}"
    for name in ("check", "run"):
        result = command(
            name, EXAMPLE, "--set", override, *(("--out", tmp_path / "x.mcap") if name == "run" else ())
        )
        assert result.code == 2 and "changed.csv:50: t_s: must be a finite number" in result.err
        assert "Traceback" not in result.err
    assert not (tmp_path / "x.mcap").exists()


def test_odd_rows_are_warned_of(tmp_path):
    step = changed(tmp_path, 300, lambda line: line)
    lines = (tmp_path / "changed.csv").read_text().splitlines()
    for k in range(300, len(lines)):
        cells = lines[k].split(",")
        cells[3] = f"{float(cells[3]) + 40.0:.6f}"
        lines[k] = ",".join(cells)
    (tmp_path / "changed.csv").write_text("\n".join(lines))
    (said,) = [one for one in warned(step) if "steps" in one]
    assert "changed.csv:301: the position steps by 40 m beside its velocity" in said


def test_single_precision_is_warned_of(tmp_path):
    """Written with all digits of a double, so that nothing tells that most of them mean nothing."""
    path = rocket(until_s=30.0, step_s=0.01)
    names = ("t_s", "east_m", "north_m", "up_m", "ve_m_s", "vn_m_s", "vu_m_s", "qw", "qx", "qy", "qz")
    for kind, found in ((np.float32, 1), (float, 0)):
        r_l = path.r_l.astype(kind).astype(float)
        csv(tmp_path / "rows.csv", names, (path.t_s, r_l, path.v_l, path.q_lb), 15)
        said = warned(COLUMNS | {"file": tmp_path / "rows.csv"})
        assert sum("scatter about the way of their velocities" in one for one in said) == found, said


@pytest.mark.slow
def test_coarse_rows_and_turns_are_warned_of(tmp_path):
    few = slice(None, None, 25)
    path = rocket()
    names = ("t_s", "east_m", "north_m", "up_m", "ve_m_s", "vn_m_s", "vu_m_s", "qw", "qx", "qy", "qz")
    csv(tmp_path / "few.csv", names, (path.t_s[few], path.r_l[few], path.v_l[few], path.q_lb[few]), 6)
    (said,) = warned(COLUMNS | {"file": tmp_path / "few.csv"})
    assert "few.csv:" in said and "rows 2.5 s apart are too coarse" in said
    spins = np.array([[np.cos(a), np.sin(a), 0.0, 0.0] for a in np.radians(45.0) * np.arange(len(path.t_s))])
    csv(tmp_path / "spin.csv", names, (path.t_s, path.r_l, path.v_l, spins), 6)
    said = warned(COLUMNS | {"file": tmp_path / "spin.csv"})
    assert any("the attitude turns by 90 deg from the row before" in one for one in said)
    spins = np.array([[np.cos(a), np.sin(a), 0.0, 0.0] for a in np.radians(80.0) * np.arange(len(path.t_s))])
    csv(tmp_path / "spin.csv", names, (path.t_s, path.r_l, path.v_l, spins), 6)
    words = refused(COLUMNS | {"file": tmp_path / "spin.csv"})
    assert "the attitude is 160 deg from that of the row before" in words


def test_an_attitude_the_wrong_way_round_and_a_late_lift_off():
    told = COLUMNS["attitude"] | {"sense": "frame_to_body"}
    assert any("check sense, frame and axes" in one for one in warned(COLUMNS | {"attitude": told}))
    late = COLUMNS | {"lift_off": "-3 s", "pad": "13 s"}
    assert any("the file shows the lift-off at T+3.13 s" in one for one in warned(late))


# messages of CCSDS, exports


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("CCSDS_OEM_VERS", "<?xml", "XML is not read, write it as KVN"),
        ("CENTER_NAME = EARTH", "CENTER_NAME = MOON", "CENTER_NAME: expected EARTH, got 'MOON'"),
        ("REF_FRAME = EME2000", "REF_FRAME = RTN", "frame 'RTN' is not read; one of: EME2000"),
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM = SCLK", "TIME_SYSTEM: 'SCLK' is not read"),
        (
            "T19:18:10.000000 ",
            "T19:18:10.000000 x ",
            "a.oem:16: expected an epoch and 6 or 9 numbers, got 8 words",
        ),
        (
            "T19:18:20.000000 ",
            "T19:18:10.000000 ",
            "a.oem:17: time 10.000000 s does not follow on 10.000000 s in the row before",
        ),
        (
            "T19:18:20.000000 ",
            "T19:18:2O.000000 ",
            "a.oem:17: expected an epoch such as 2026-06-26T12:00:00 or, in all rows, 2026-177T12:00:00, "
            "got '2012-06-22T19:18:2O.000000'",
        ),
        ("2012-06-22T19:18:20.000000 ", "2012-174T19:18:20.000000 ", "a.oem:17: expected an epoch such as"),
        ("REF_FRAME = EME2000\n", "", "a.oem: REF_FRAME is missing; expected such as 'REF_FRAME = EME2000'"),
        (
            "REF_FRAME = EME2000",
            "REF_FRAME = TEME\nREF_FRAME_EPOCH = 2012-06-22T00:00:00",
            "a.oem:13: REF_FRAME_EPOCH: a frame of a fixed epoch is not read, got '2012-06-22T00:00:00'",
        ),
        (
            "CENTER_NAME = EARTH",
            "CENTER_NAME EARTH",
            "a.oem:11: expected 'KEY = value' or META_STOP, got 'CEN",
        ),
        ("META_STOP\n", "", "a.oem:14: expected 'KEY = value' or META_STOP, got '2012-06-22T19:18:00"),
        (
            "ORIGINATOR =",
            "ORIGINATOR",
            "a.oem:3: expected 'KEY = value' or META_START, got 'ORIGINATOR TEST'",
        ),
        (
            "META_STOP\n",
            "META_STOP\nCOVARIANCE_START\n",
            "a.oem:14: COVARIANCE_START: expected COVARIANCE_STOP",
        ),
        ("T19:18:10.000000 ", "T19:18:10.000000 = ", "a.oem:16: expected an epoch and 6 or 9 numbers"),
    ],
)
def test_messages_that_are_not_read(tmp_path, old, new, words):
    text = OEM.read_text()
    assert old in text
    (tmp_path / "a.oem").write_text(text.replace(old, new, 1))
    told = {"file": tmp_path / "a.oem", "format": "oem", "attitude": {"aem": str(AEM)}}
    assert words in refused(told, fly=in_orbit)


def in_two(path, old="", new="", repeated=lambda line: line):
    """Text of a message in two segments; row 15 is the last of one and the first of the other.

    old, new : what the metadata of the second has in another way; repeated : changes its first row
    """
    lines = path.read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("2012-"))
    meta = "\n".join(lines[lines.index("META_START") : first])
    assert old in meta
    seam = first + 14
    parts = [
        *lines[: seam + 1],
        *([lines[-1]] if lines[-1] == "DATA_STOP" else []),
        meta.replace(old, new, 1),
    ]
    return "\n".join([*parts, repeated(lines[seam]), *lines[seam + 1 :]]) + "\n"


def pair(tmp_path, oem=None, aem=None):
    """Section of a scenario about the committed pair, with another text in the place of one."""
    (tmp_path / "a.oem").write_text(oem or OEM.read_text())
    (tmp_path / "a.aem").write_text(aem or AEM.read_text())
    return {"file": tmp_path / "a.oem", "format": "oem", "attitude": {"aem": str(tmp_path / "a.aem")}}


def test_two_segments_are_one_flight(tmp_path):
    """The row at their seam stands in both, and counts once."""
    one = in_orbit({"file": OEM, "format": "oem", "attitude": {"aem": str(AEM)}})[0].trajectory
    both = in_orbit(pair(tmp_path, in_two(OEM), in_two(AEM)))[0].trajectory
    assert np.array_equal(one.r_i, both.r_i) and np.array_equal(one.q_ib, both.q_ib)
    default = in_two(AEM, "ATTITUDE_DIR = A2B\n").replace("QUATERNION_TYPE = LAST\n", "", 1)
    assert np.array_equal(one.q_ib, in_orbit(pair(tmp_path, None, default))[0].trajectory.q_ib)


@pytest.mark.parametrize(
    "path, old, new, words",
    [
        (
            OEM,
            "= EARTH",
            "= MOON",
            "a.oem:36: CENTER_NAME: all segments must have that of the first, 'EARTH'",
        ),
        (OEM, "CENTER_NAME = EARTH\n", "", "a.oem:30: CENTER_NAME: all segments must have that of the first"),
        (OEM, "= EME2000", "= TEME", "a.oem:37: REF_FRAME: all segments"),
        (OEM, "= UTC", "= TAI", "a.oem:33: TIME_SYSTEM: all segments"),
        (
            OEM,
            "REF_FRAME = EME2000",
            "REF_FRAME = EME2000\nREF_FRAME_EPOCH = 2012-06-22T00:00:00",
            "a.oem:38: REF_FRAME_EPOCH: a frame of a fixed epoch is not read",
        ),
        (AEM, "= A2B", "= B2A", "ATTITUDE_DIR: all segments must have that of the first, 'A2B', got 'B2A'"),
        (AEM, "= LAST", "= FIRST", "QUATERNION_TYPE: all segments must have that of the first, 'LAST'"),
        (AEM, "= QUATERNION\n", "= SPIN\n", "ATTITUDE_TYPE: all segments must have"),
        (AEM, "= SC_BODY_1", "= SC_BODY_2", "REF_FRAME_B: all segments must have"),
    ],
)
def test_segments_that_differ(tmp_path, path, old, new, words):
    key = "oem" if path == OEM else "aem"
    assert words in refused(pair(tmp_path, **{key: in_two(path, old, new)}), fly=in_orbit)


@pytest.mark.parametrize("key, other", [("ATTITUDE_DIR", "B2A"), ("QUATERNION_TYPE", "FIRST")])
def test_a_key_of_the_second_segment_alone(tmp_path, key, other):
    """Left out in the first it is A2B and LAST there."""
    usual = {"ATTITUDE_DIR": "A2B", "QUATERNION_TYPE": "LAST"}[key]
    text = in_two(AEM, f"{key} = {usual}", f"{key} = {other}").replace(f"{key} = {usual}\n", "", 1)
    words = f"{key}: all segments must have that of the first, '{usual}', got '{other}'"
    assert words in refused(pair(tmp_path, None, text), fly=in_orbit)
    (tmp_path / "b").mkdir()
    odd = AEM.read_text().replace(f"{key} = {usual}", f"{key} = ODD")
    words = refused(pair(tmp_path / "b", None, odd), fly=in_orbit)
    assert f"{key}: expected {usual} or {other}, got 'ODD'" in words


def test_blocks_of_a_second_segment_that_do_not_end(tmp_path):
    """Rows in them would be lost."""
    text = in_two(OEM, "META_STOP\n", "")
    assert "expected 'KEY = value' or META_STOP, got '2012-06-22T19:20:20" in refused(
        pair(tmp_path, text), fly=in_orbit
    )
    covariance = "COVARIANCE_START\nEPOCH = 2012-06-22T19:18:10\n1e-3\n"
    text = in_two(OEM, "META_START", covariance + "META_START")
    words = refused(pair(tmp_path, text), fly=in_orbit)
    assert "a.oem:30: COVARIANCE_START: expected COVARIANCE_STOP before META_START in line 33" in words
    words = refused(pair(tmp_path, OEM.read_text() + covariance), fly=in_orbit)
    assert "COVARIANCE_START: expected COVARIANCE_STOP before the end of the file" in words
    assert len(in_orbit(pair(tmp_path, OEM.read_text() + covariance + "COVARIANCE_STOP\n"))[0].trajectory.t_s)


def test_a_seam_with_other_numbers(tmp_path):
    text = in_two(OEM, repeated=lambda line: line[:-1] + ("1" if line[-1] != "1" else "2"))
    words = refused(pair(tmp_path, text), fly=in_orbit)
    assert "a.oem:40: is at the epoch of the last row of the segment before, with other numbers" in words
    lines = in_two(OEM).splitlines()
    lines.insert(20, lines[19])
    words = refused(pair(tmp_path, "\n".join(lines)), fly=in_orbit)
    assert "a.oem:21: time 50.000000 s does not follow on 50.000000 s in the row before" in words


def test_an_attitude_message_of_another_kind(tmp_path):
    (tmp_path / "a.aem").write_text(AEM.read_text().replace("= QUATERNION\n", "= SPIN\n", 1))
    told = {"file": OEM, "format": "oem", "attitude": {"aem": str(tmp_path / "a.aem")}}
    assert "ATTITUDE_TYPE: expected QUATERNION" in refused(told, fly=in_orbit)
    write_ccsds(
        tmp_path / "b.oem", tmp_path / "a.aem", satellite(60.0)._replace(t_s=np.arange(7) * 10.0 + 30.0)
    )
    assert "a.aem: begins at T+30.000 s, after the positions" in refused(told, fly=in_orbit)


def test_exports_with_other_columns(tmp_path):
    path = rocket(20.0)
    origin = {"format": "openrocket", "origin": ORIGIN, "attitude": ALONG, "file": tmp_path / "or.csv"}
    names = (
        "# Time (s)",
        "Altitude (furlong)",
        "Position East of launch (m)",
        "Position North of launch (m)",
    )
    csv(tmp_path / "or.csv", names, (path.t_s, path.r_l[:, [2, 0, 1]]))
    assert "or.csv:1: Altitude: unit 'furlong' is not known; one of: s, sec, m" in refused(origin)
    csv(
        tmp_path / "or.csv",
        ("# Time (s)", "Altitude (m)", "x (m)", "y (m)"),
        (path.t_s, path.r_l[:, [2, 0, 1]]),
    )
    assert "or.csv:1: column 'Position East of launch' is missing; there are: Time" in refused(origin)
    names = ["# Time (s)", "X (m)", "Y (m)", "Z (m)", "E0", "E1", "E2", "E3"]
    csv(tmp_path / "or.csv", names, (path.t_s, path.r_l, path.v_l, path.q_lb))
    words = refused({"format": "rocketpy", "origin": ORIGIN, "file": tmp_path / "or.csv"})
    assert "or.csv:2: 11 values, but 8 names of columns in line 1" in words
