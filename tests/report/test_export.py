"""Tables and maps read back as what was written."""

import csv
import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import synthetic_run
from made_up import MISSION, gathered, of_records
from typer.testing import CliRunner

from shefex_nav import records as rec
from shefex_nav.commands.app import app
from shefex_nav.geometry.frames import ecef_from_inertial, inertial_from_ecef
from shefex_nav.geometry.wgs84 import ecef_from_geodetic
from shefex_nav.log import topics
from shefex_nav.log.writer import LogWriter
from shefex_nav.report import export, geography
from shefex_nav.report.navigation_errors import navigation_errors

OPTIONS = synthetic_run.Options(start_s=228.0, end_s=258.0, frame_pixels=False)
KML = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture(scope="module")
def data():
    return gathered(OPTIONS)


@pytest.fixture(scope="module", params=export.KINDS)
def written(request, data, tmp_path_factory):
    """{name: pyarrow Table} of one kind."""
    folder = tmp_path_factory.mktemp(request.param)
    paths = export.write(data, folder, request.param)
    read = pyarrow.csv.read_csv if request.param == "csv" else pyarrow.parquet.read_table
    return {path.stem: read(path) for path in paths if path.name != export.COLUMNS}


def told(result):
    """What a command printed, without the frame and the line ends of its terminal."""
    return " ".join(result.output.replace("│", " ").split())


def column(table, name):
    return table.column(name).to_numpy(zero_copy_only=False)


def test_every_table_starts_with_the_time_and_reads_back_equal(data, written):
    tables = export.tables(data)
    assert set(written) == set(tables)
    for name, columns in tables.items():
        assert written[name].column_names == [one.name for one in columns]
        assert written[name].column_names[0] == "t_s"
        assert len(set(written[name].column_names)) == len(columns), name
        for one in columns:
            read = column(written[name], one.name)
            if one.values.dtype.kind == "U":
                assert [value or "" for value in read] == one.values.tolist()
            else:
                np.testing.assert_array_equal(read.astype(one.values.dtype), one.values, err_msg=one.name)


def test_tables_hold_the_arrays_of_the_run(data, written):
    truth = written["truth"]
    np.testing.assert_array_equal(column(truth, "r_i_m_y"), data.truth.r_i[:, 1])
    np.testing.assert_array_equal(column(truth, "q_ib_w"), data.truth.q_ib[:, 0])
    assert column(truth, "phase")[0] == rec.Phase(data.truth.phase[0]).name.lower()
    np.testing.assert_array_equal(column(written["imu"], "dv_b_m_s_3_z"), data.imu.dv_b[:, 2, 2])
    np.testing.assert_array_equal(column(written["gps"], "R_r_e_m2_1_2"), [f.R_r_e[0, 1] for f in data.gps])
    expected = navigation_errors(data)
    np.testing.assert_array_equal(column(written["errors"], "t_s"), expected.t_s)
    np.testing.assert_array_equal(
        column(written["errors"], "attitude_error_rad_z"), expected.attitude_b[:, 2]
    )
    np.testing.assert_array_equal(
        column(written["errors"], "position_error_i_m_x"), expected.position_i[:, 0]
    )
    assert [str(name) for name in column(written["gates"], "sensor")] == [gate.sensor for gate in data.gates]


def test_what_differs_in_length_has_a_row_for_each_element(data, written):
    objects = written["star_fix_objects"]
    assert objects.num_rows == sum(len(fix.hip) for fix in data.star_fixes)
    number, hip = column(objects, "number"), column(objects, "hip")
    fix = data.star_fixes[5]
    np.testing.assert_array_equal(hip[number == fix.number], fix.hip)
    x = column(objects, "xy_px_x")[number == fix.number]
    np.testing.assert_array_equal(x, fix.detections.xy_px[:, 0])
    ranges = written["gps_ranges"]
    first = column(ranges, "t_s") == data.gps_ranges[0].t_valid_s
    np.testing.assert_array_equal(column(ranges, "pseudorange_m")[first], data.gps_ranges[0].pseudorange)
    np.testing.assert_array_equal(column(ranges, "element")[first], np.arange(first.sum()) + 1)
    states = written["nav_states"]
    assert states.num_rows == 6 * len(data.covariance.t_s)
    assert column(states, "block").tolist()[:6] == ["gyro_roll_column"] * 3 + ["mounting"] * 3
    assert column(states, "unit").tolist()[:6] == [""] * 3 + ["rad"] * 3


def test_stars_used_by_themselves_have_a_table_of_their_own(data):
    stars = rec.StarVectors(
        np.array([11, 12]),
        np.eye(3)[:2],
        np.tile(np.eye(2), (2, 1, 1)),
        np.eye(3)[1:],
        np.zeros(2),
        np.eye(3),
    )
    first, second = data.star_fixes[:2]
    fixes = [first._replace(stars=rec.NO_STARS), second._replace(stars=stars)]
    tables = export.tables(data._replace(star_fixes=fixes))
    named = {one.name: one.values for one in tables["star_vectors"]}
    assert named["star_hip"].tolist() == [11, 12] and named["number"].tolist() == [fixes[1].number] * 2
    assert named["star_u_i_y"].tolist() == [1.0, 0.0]
    objects = {one.name for one in tables["star_fix_objects"]}
    assert "hip" in objects and not any(name.startswith("star_") for name in objects)


def test_a_list_says_what_every_column_is(data, tmp_path):
    export.write(data, tmp_path, "csv")
    with (tmp_path / export.COLUMNS).open(newline="") as file:
        listed = [(row["table"], row["column"]) for row in csv.DictReader(file) if row["comment"]]
    assert listed == [(name, one.name) for name, columns in export.tables(data).items() for one in columns]
    export.write(data, tmp_path, "parquet")
    field = pyarrow.parquet.read_schema(tmp_path / "nav.parquet").field("v_e_m_s_x")
    assert b"relative to the Earth" in field.metadata[b"comment"]


def test_a_list_says_the_names_as_they_stand_in_a_column(data):
    """It said `NONE when there is` of a column that says `none`."""
    for table, column, first in (("star_fixes", "reason", "none"), ("nav", "doubt_attitude", "none")):
        found = next(one for one in export.tables(data)[table] if one.name == column)
        names = found.comment.rpartition(": ")[2].split(", ")
        assert names[0] == first and set(found.values) <= set(names)


def test_a_log_without_records_has_no_tables(tmp_path):
    assert export.write(of_records(MISSION, []), tmp_path, "csv") == [tmp_path / export.COLUMNS]


@pytest.mark.parametrize("kind", export.KINDS)
def test_no_table_of_another_flight_is_left(data, tmp_path, kind):
    """One without stars, written over one that has some: none of their tables is taken for its own."""
    for name in ("mine.csv", "mine.parquet", "truth.txt"):
        (tmp_path / name).write_text("mine")
    was = export.write(data, tmp_path, kind)
    less = data._replace(star_fixes=[], gps=[])
    again = export.write(less, tmp_path, kind)
    assert {path.stem for path in was} - {path.stem for path in again} >= {"gps", "star_fixes"}
    found = {path.name for path in tmp_path.iterdir()} - {"mine.csv", "mine.parquet", "truth.txt"}
    assert found == {path.name for path in again}
    assert len(list(tmp_path.glob("mine.*"))) == 2
    (tmp_path / export.COLUMNS).write_text("name,unit,note\nmine,m,\n")  # somebody's own list of columns
    export.write(less, tmp_path, kind)
    assert len(list(tmp_path.glob("mine.*"))) == 2


@pytest.fixture(scope="module")
def flight():
    """The whole made-up flight, one sample a second."""
    truth = [synthetic_run.truth_at(MISSION, t) for t in np.arange(-10.0, 496.0)]
    return of_records(MISSION, [*truth, *synthetic_run._events(MISSION)])


def _ecef(coordinates):
    longitude, latitude, height = coordinates
    return ecef_from_geodetic(np.radians(latitude), np.radians(longitude), height)


def _places_e(flight):
    """{name: place} of launch and impact in frame e, from the records alone."""
    out = {"lift off": ecef_from_geodetic(MISSION.launch_latitude, MISSION.launch_longitude, 10.0)}
    end = synthetic_run.truth_at(MISSION, 495.0)
    turned, _ = inertial_from_ecef(MISSION.earth, 495.0, np.eye(3)[0], np.zeros(3))
    angle = MISSION.earth.angle_0 + MISSION.earth.rate * 495.0
    np.testing.assert_allclose(turned, [np.cos(angle), np.sin(angle), 0.0], atol=1e-12)
    c, s = np.cos(angle), np.sin(angle)
    out["impact"] = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ end.r_i
    return out


def test_columns_say_when_samples_are_and_in_which_order():
    """The rows of a tick of the IMU: when the last ends, and that the first is the oldest."""
    fields = {one.name: one.comment for one in topics.of_record(rec.ImuBlock).fields}
    assert "end of the last sample" in fields["t_valid_s"]
    assert "oldest sample first" in fields["dtheta_b_rad"]


def test_geojson_has_launch_and_impact_where_they_were(flight):
    found = json.loads(geography.geojson(flight))
    assert found["type"] == "FeatureCollection"
    points = {
        f["properties"]["name"]: f["geometry"] for f in found["features"] if f["geometry"]["type"] == "Point"
    }
    for name, place in _places_e(flight).items():
        assert np.linalg.norm(_ecef(points[name]["coordinates"]) - place) < 0.01
    line = next(f for f in found["features"] if f["geometry"]["type"] == "LineString")
    assert line["properties"]["name"] == "truth"
    coordinates = np.array(line["geometry"]["coordinates"])
    assert coordinates.shape == (506, 3) and (np.abs(coordinates[:, 0]) <= 180.0).all()
    assert np.linalg.norm(_ecef(coordinates[0]) - _places_e(flight)["lift off"]) < 0.01
    assert np.linalg.norm(_ecef(coordinates[-1]) - _places_e(flight)["impact"]) < 0.01


def test_kml_parses_and_holds_the_same(flight):
    root = ElementTree.fromstring(geography.kml(flight))
    assert root.tag == f"{KML}kml"
    places = {}
    for mark in root.iter(f"{KML}Placemark"):
        kind = "Point" if mark.find(f"{KML}Point") is not None else "LineString"
        shape = mark.find(f"{KML}{kind}")
        assert shape.find(f"{KML}altitudeMode").text == "absolute"
        rows = [[float(x) for x in row.split(",")] for row in shape.find(f"{KML}coordinates").text.split()]
        places[mark.find(f"{KML}name").text] = rows
    for name, place in _places_e(flight).items():
        assert np.linalg.norm(_ecef(places[name][0]) - place) < 0.01
    assert len(places["truth"]) == 506
    wanted = {
        mark.find(f"{KML}styleUrl").text
        for mark in root.iter(f"{KML}Placemark")
        if mark.find(f"{KML}styleUrl") is not None
    }
    assert wanted <= {f"#{style.get('id')}" for style in root.iter(f"{KML}Style")}


def _without_truth(*, lies_s):
    """RunData of the flight as a solution alone, which lies still at the end for some seconds."""
    rng, solution = np.random.default_rng(3), []
    for t_s in np.arange(-10.0, 495.0 + lies_s):
        truth = synthetic_run.truth_at(MISSION, min(t_s, 495.0))
        if t_s >= 495.0:
            r_e, _ = ecef_from_inertial(MISSION.earth, 495.0, truth.r_i, truth.v_i)
            r_i, v_i = inertial_from_ecef(MISSION.earth, t_s, r_e, np.zeros(3))
            truth = truth._replace(t_s=t_s, r_i=r_i, v_i=v_i)
        solution.append(synthetic_run._navigation(MISSION, truth, rng))
    start = rec.Event(-10.0, "replay_start", 10.0, "csv data")
    return of_records(MISSION, [start, *solution])


def test_a_map_without_truth_has_lift_off_apogee_and_landing(flight):
    """Where the solution has them; no landing of data that end in the air."""
    data = _without_truth(lies_s=10.0)
    _, places = geography.lines_and_places(data)
    assert [one.name for one in places] == ["replay start", "lift off", "apogee", "landing"]
    _, lift, top, land = places
    assert [one.detail for one in places[1:]] == ["as estimated"] * 3
    truth = flight.truth
    height = np.linalg.norm(truth.r_i, axis=1)
    assert abs(lift.t_s) <= 1.0 and land.t_s == 495.0
    assert abs(top.t_s - truth.t_s[np.argmax(height)]) <= 10.0
    for place, wanted in ((lift, "lift off"), (land, "impact")):
        assert np.linalg.norm(_ecef(place.point) - _places_e(flight)[wanted]) < 100.0
    _, places = geography.lines_and_places(_without_truth(lies_s=0.0))
    assert [one.name for one in places] == ["replay start", "lift off", "apogee"]
    vague = data._replace(nav=data.nav._replace(sigma_v_e=data.nav.sigma_v_e.copy()))
    vague.nav.sigma_v_e[400:] = 200.0  # whether it moves is not known
    _, places = geography.lines_and_places(vague)
    assert [one.name for one in places] == ["replay start", "lift off", "apogee"]
    _, places = geography.lines_and_places(flight)  # the truth's events are its own
    assert not [one for one in places if one.detail == "as estimated"]


def test_texts_of_a_log_do_not_break_a_map(flight):
    bad = "</name><x>&\"'"
    hostile = flight._replace(
        mission=flight.mission._replace(scenario=bad),
        events=[event._replace(name=bad, detail=bad) for event in flight.events],
    )
    names = [one.text for one in ElementTree.fromstring(geography.kml(hostile)).iter(f"{KML}name")]
    assert names.count(bad) == len(flight.events)
    assert json.loads(geography.geojson(hostile))["features"][0]["properties"]["scenario"] == bad


def test_a_line_across_the_antimeridian_is_cut_on_it():
    geometry = geography._line_geometry(
        [(170.0, 0.0, 0.0), (178.0, 8.0, 80.0), (-178.0, 12.0, 120.0), (-170.0, 20.0, 200.0)]
    )
    assert geometry["type"] == "MultiLineString"
    first, second = geometry["coordinates"]
    assert first[-1] == pytest.approx([180.0, 10.0, 100.0]) and second[0] == pytest.approx(
        [-180.0, 10.0, 100.0]
    )
    assert first[0] == [170.0, 0.0, 0.0] and second[-1] == [-170.0, 20.0, 200.0]
    back = geography._line_geometry([(-179.0, 0.0, 0.0), (179.0, 2.0, 20.0)])["coordinates"]
    assert back[0][-1] == pytest.approx([-180.0, 1.0, 10.0]) and back[1][0] == pytest.approx(
        [180.0, 1.0, 10.0]
    )


def test_the_command_checks_everything_before_it_writes_anything(tmp_path):
    log = tmp_path / "run.mcap"
    with LogWriter(log, MISSION, synthetic_run.NO_PIXELS) as writer:
        for record in synthetic_run.simulate(
            synthetic_run.Options(start_s=-10.0, end_s=-9.5, frame_pixels=False)
        ):
            writer.write(record)
    run = CliRunner().invoke
    nothing = run(app, ["export", str(log)])
    assert nothing.exit_code == 2 and "nothing to write" in told(nothing)
    for option, value in (("--format", "png"), ("--every", "2")):
        alone = run(app, ["export", str(log), "--csv", str(tmp_path / "c"), option, value])
        assert alone.exit_code == 2 and f"{option}: goes with --frames DIR" in told(alone), option
    full = tmp_path / "full"
    full.mkdir()
    (full / "mine.txt").write_text("mine")
    refused = run(app, ["export", str(log), "--kml", str(tmp_path / "a.kml"), "--csv", str(full)])
    assert refused.exit_code == 2 and "is not empty" in told(refused)
    assert not (tmp_path / "a.kml").exists()
    missing = run(app, ["export", str(log), "--parquet", str(tmp_path / "no" / "x")])
    assert missing.exit_code == 2 and "there is no folder" in told(missing)
    options = ["--csv", str(tmp_path / "c"), "--parquet", str(tmp_path / "p")]
    options += ["--kml", str(tmp_path / "a.kml"), "--geojson", str(tmp_path / "a.geojson")]
    done = run(app, ["export", str(log), *options])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "c" / "truth.csv").exists() and (tmp_path / "p" / "truth.parquet").exists()
    assert run(app, ["export", str(log), *options]).exit_code == 2
    assert run(app, ["export", str(log), *options, "--force"]).exit_code == 0
