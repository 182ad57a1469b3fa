"""Folders whose records hold what no campaign writes: refused with run, column, value and the way out."""

import json
import sqlite3
import zlib
from contextlib import closing

import pytest
import synthetic_campaign

from shefex_nav import runs
from shefex_nav.campaign import checking, results, runs_file, store, table
from shefex_nav.report import metrics
from shefex_nav.scenario.load import load

NAVIGATION = ("summary", "navigation")


@pytest.fixture
def folder(tmp_path):
    return synthetic_campaign.write(tmp_path / "campaign", 4, with_series=False)


def edit(folder, path, value, run=2):
    """Write a value into a record."""
    with closing(sqlite3.connect(folder / "runs.sqlite")) as db, db:
        (packed,) = db.execute("SELECT record FROM records WHERE run = ?", (run,)).fetchone()
        record = tree = json.loads(zlib.decompress(packed))
        for key in path[:-1]:
            tree = tree[key]
        if path:
            tree[path[-1]] = value
        else:
            record = value
        packed = zlib.compress(json.dumps(record).encode())
        db.execute("UPDATE records SET record = ? WHERE run = ?", (packed, run))


@pytest.mark.parametrize(("path", "value", "words"), [
    ((*NAVIGATION, "position_error_m", "rms"), -1.0, "position_error_m.rms: got -1.0, expected a number"),
    ((*NAVIGATION, "position_error_m", "rms"), "x", "position_error_m.rms: got 'x', expected a number"),
    ((*NAVIGATION, "position_error_m", "rms"), True, "rms: got True, expected a number from 0"),
    ((*NAVIGATION, "position_error_m", "rms"), {"a": 1}, "rms.a: got 1, expected a number in place of"),
    ((*NAVIGATION, "position_error_m", "rms"), float("nan"), "rms: got nan"),
    ((*NAVIGATION, "position_error_m", "rms"), 10**400, "rms: got a huge number"),
    ((*NAVIGATION, "integrity", "position", "usable_h"), -5.0, "usable_h: got -5.0"),
    ((*NAVIGATION, "integrity", "position", "usable_h"), float("inf"), "usable_h: got inf"),
    ((*NAVIGATION, "integrity", "misleading_share"), 7.0, "got 7.0, expected a share from 0 to 1"),
    ((*NAVIGATION, "integrity", "position", "misleading_events"), 0.5, "got 0.5, expected a whole number"),
    (("summary", "star_tracker", "solved"), -4, "solved: got -4, expected a whole number, 0 or more"),
    (("summary", "star_tracker", "wrong"), 10**6, "got 1000000, expected at most"),
    (("summary", "warnings"), [{"field": "gps"}], "summary.warnings: got .*, expected a list of objects"),
    (("summary", "warnings"), {"gps": "late"}, "summary.warnings: got .*, expected a list of objects"),
    (("draws", "launch.elevation"), 10**400, "draw.launch.elevation: got a huge number"),
    (("status",), "perfect", "status: got 'perfect', expected 'succeeded' or 'failed'"),
    (("run",), 77, "run: got 77, expected 2"),
    (("seed",), -1, "seed: got -1"),
    (("draws",), [], r"draws: got \[\], expected an object"),
    ((), [1], "got a list, expected an object"),
])  # fmt: skip
def test_a_record_that_no_campaign_writes_is_refused(path, value, words, folder):
    edit(folder, path, value)
    again = r".*`shefex-nav repeat \S+ 2 --keep` flies it again"
    with pytest.raises(store.StoreError, match=rf"runs\.sqlite: the record of run 2: .*{words}{again}"):
        results.open_campaign(folder)
    with pytest.raises(runs_file.SpoiltError, match=words):  # so that it is flown again
        store.Store(folder).record(2)
    assert store.Store(folder).record(1)["run"] == 1


TEXTS = (  # and the doubts at entry
    "version", "scenario", "seed", "failure", "flight.of", "warnings", "navigation.nees.why",
)  # fmt: skip


def test_each_figure_of_a_flight_has_a_rule_that_it_meets():
    """The tree of rules is that of the summary: of a name that is misspelt in it nothing would be asked."""
    scenario = load("tight", ["star_tracker.frames=statistical"])
    row = table.row({"run": 0, "summary": metrics.summarise(runs.fly(scenario).data)})
    assert checking.row_fault(row) is None and row["summary.navigation.at_entry.nees"] > 0.0
    free = [name for name in row if name.startswith("summary.") and checking.rule(name) is checking.ANYTHING]
    assert {name for name in free if not name.endswith(".doubt")} <= {f"summary.{name}" for name in TEXTS}


@pytest.mark.parametrize("name", ["max", "rms", "samples", "doubts", "fixes", "sigma_x", "low_share"])
def test_an_instrument_of_a_plug_in_may_have_any_name(name):
    used = {"readings": 12, "used": 7}
    summary = {"navigation": {"instruments": {name: used}}, "software": {name: "mine.py:Mine"}}
    assert checking.row_fault(table.row({"run": 0, "summary": summary})) is None
    wrong = {"navigation": {"instruments": {name: used | {"used": 0.5}}}}
    assert checking.row_fault(table.row({"run": 0, "summary": wrong}))[0].endswith(f"{name}.used")


def test_a_window_may_have_more_ticks_than_there_are_frames():
    """Ticks without a frame count in it, if both neighbours do (`metrics`)."""
    counts = {"frames": 100, "in_window": 104, "solved": 99, "fixes": 99, "wrong": 0}
    changes = {"": {}, "wrong": {"wrong": 100}, "fixes": {"fixes": 101}, "solved": {"solved": 105}}
    for column, change in changes.items():
        row = table.row({"run": 0, "summary": {"star_tracker": counts | change}})
        fault = checking.row_fault(row)
        assert fault is None if not column else fault[0] == f"summary.star_tracker.{column}"


def test_warnings_are_objects_with_their_texts():
    import pyarrow as pa

    good = {"run": 0, "summary": {"warnings": [{"field": "gps", "text": "late", "more": 1}]}}
    assert checking.row_fault(table.row(good)) is None
    text = table.row(good)[table.WARNINGS]
    assert not checking.is_faulty(table.WARNINGS, pa.array([text, None, text]))
    for wrong in ("junk", "3", "[3]", '[{"field": "gps"}]', '[{"field": "gps", "text": 3}]'):
        assert checking.is_faulty(table.WARNINGS, pa.array([text, None, wrong]))


def test_draws_of_numbers_are_numbers():
    for value in ("abc", None, [1, 2]):
        row = table.row({"run": 0, "draws": {"gps.range_noise": value}})
        assert checking.row_fault(row, ["gps.range_noise"])[0] == "draw.gps.range_noise"
    assert checking.row_fault(table.row({"run": 0, "draws": {"a": "fit"}})) is None


def test_a_table_of_such_values_is_refused_where_it_is_read(folder):
    campaign = results.open_campaign(folder)
    rows = [*campaign.rows()]
    rows[3]["summary.navigation.at_entry.position_error_m"] = -1.0
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = folder / "other.parquet"
    pq.write_table(pa.Table.from_pylist(rows), path)
    column = table.Columns(table.File(path))
    assert column["summary.star_tracker.solved"].shape == (4,)
    with pytest.raises(table.TableError, match=r"run 3: .*position_error_m: got -1\.0"):
        column["summary.navigation.at_entry.position_error_m"]


@pytest.mark.parametrize("change", [
    "DROP TABLE records; CREATE VIEW records AS WITH RECURSIVE c(x) AS "
    "(SELECT 0 UNION ALL SELECT x + 1 FROM c) SELECT x AS run, zeroblob(9) AS record FROM c",
    "CREATE TRIGGER t AFTER INSERT ON runs BEGIN DELETE FROM series; END",
    "CREATE VIRTUAL TABLE v USING fts5(words)",
    "DROP TABLE lost",
])  # fmt: skip
def test_a_file_of_other_tables_is_not_read(change, folder):
    """The endless view would be read for ever."""
    with closing(sqlite3.connect(folder / "runs.sqlite")) as db:
        db.executescript(change)
    with pytest.raises(store.StoreError, match=r"runs\.sqlite: (holds .CREATE|lacks a table)"):
        results.open_campaign(folder)


@pytest.mark.parametrize("values", ["-5, 0, 1.0, 1.0", "90000000000, 0, 1.0, 1.0", "9, 0, 'bad', 1.0"])
def test_rows_of_runs_are_numbers(values, folder):
    with closing(sqlite3.connect(folder / "runs.sqlite")) as db, db:
        db.execute(f"INSERT INTO runs VALUES ({values})")
    with pytest.raises(store.StoreError, match="table runs: got run "):
        results.open_campaign(folder)


def test_a_source_that_is_no_yaml_is_told(folder):
    head = json.loads((folder / "campaign.json").read_text())
    (folder / "campaign.json").write_text(json.dumps(head | {"source": "mission: ["}))
    with pytest.raises(store.StoreError, match=r"campaign\.json: is damaged: source: line 1: not valid YAML"):
        results.open_campaign(folder)
