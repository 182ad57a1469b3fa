"""Rows, columns and digest of a campaign's table."""

import copy
import json
import math
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet
import pytest
import synthetic_campaign

from shefex_nav.campaign import head as heads
from shefex_nav.campaign import store, table
from shefex_nav.campaign.plan import FORMAT
from shefex_nav.campaign.results import Campaign, open_campaign


def records(n=6, **options):
    made = (synthetic_campaign.one_record(k, np.random.default_rng(k), **options) for k in range(n))
    return [json.loads(json.dumps(one)) for one in made]


def test_scalars_and_short_vectors_are_columns():
    row = table.row(records(1)[0])
    assert row["run"] == 0 and row["status"] == "succeeded" and row["seed"] == 1000
    assert 450.0 < row["draw.vehicle.payload.mass"] < 520.0
    assert row["draw.star_tracker.detection.centroid"] in ("fit", "weighted")
    assert row["summary.star_tracker.error_arcsec.mean.2"] == 3.0
    assert row["summary.navigation.integrity.at_entry.usable"] is True
    assert not any("by_rate" in name or "flight.events" in name or name.endswith(".log") for name in row)


def test_every_list_that_was_drawn_is_a_column():
    drawn = {
        "texts": ["0 deg", "9 deg"], "numbers": [1, 2.5], "many": [1, 2, 3, 4, 5, 6, 7], "none": [],
        "section": {"rows": [[1, 2]], "word": "x"},
    }  # fmt: skip
    row = table.row({"run": 0, "draws": drawn, "summary": {"texts": ["0 deg", "9 deg"]}})
    found = {name: value for name, value in row.items() if name not in table.HEAD}
    assert found == {
        "draw.texts": '["0 deg", "9 deg"]', "draw.numbers.0": 1, "draw.numbers.1": 2.5,
        "draw.many": "[1, 2, 3, 4, 5, 6, 7]", "draw.none": "[]",
        "draw.section.rows": "[[1, 2]]", "draw.section.word": "x",
    }  # fmt: skip


def test_what_a_clock_measured_is_timing():
    row = table.row(records(1)[0])
    timing = {name for name in row if name.startswith("timing.")}
    assert timing == {
        "timing.wall_s", "timing.summary.wall_s", "timing.summary.setup_s", "timing.summary.real_time_factor",
        "timing.summary.star_tracker.chain_ms.median", "timing.summary.star_tracker.chain_ms.p99",
    }  # fmt: skip


def test_digest_is_of_results_in_any_order_and_of_nothing_measured():
    rows = [table.row(record) for record in records()]
    first = table.digest(rows)
    slower = copy.deepcopy(rows)
    for row in slower:
        row.update({name: 99.0 for name in row if name.startswith("timing.")})
    backwards = [dict(reversed(row.items())) for row in reversed(slower)]
    assert table.digest(backwards) == first
    for name, value in (
        ("seed", 7),
        ("draw.imu.gyro.bias", 0.5),
        ("summary.navigation.at_entry.t_s", 430.0000001),
    ):
        other = copy.deepcopy(rows)
        other[3][name] = value
        assert table.digest(other) != first, name
    assert table.digest(rows[:-1]) != first


def test_parquet_gives_back_the_same_digest(tmp_path):
    rows = [table.row(record) for record in records(8, breaks=True)]
    rows[2]["seed"] = 2**63 + 11  # a seed that no float and no int64 holds
    rows[1]["summary.flight.apogee_km"] = 177  # whole numbers and others in one column
    table.save(rows, tmp_path / "results.parquet", state="7 8")
    again = list(table.load(tmp_path / "results.parquet"))
    assert [row["run"] for row in again] == list(range(8))
    assert table.digest(again) == table.digest(rows)
    assert table.made(tmp_path / "results.parquet") == (8, table.digest(rows), "7 8")


def test_more_rows_than_a_batch_are_the_same_table(tmp_path, monkeypatch):
    """A kind that comes in the last batch alone counts for all of them."""
    rows = [table.row(record) for record in records(7)]
    rows[6]["draw.imu.gyro.bias"] = "none"
    path = tmp_path / "results.parquet"
    table.save([dict(row) for row in rows], path)
    whole = list(table.load(path)), table.made(path)
    assert whole[0][0]["draw.imu.gyro.bias"] == json.dumps(rows[0]["draw.imu.gyro.bias"])
    monkeypatch.setattr(table, "BATCH", 2)
    table.save([dict(row) for row in rows], path)
    assert pyarrow.parquet.ParquetFile(path).num_row_groups == 4
    assert (list(table.load(path)), table.made(path)) == whole


def test_columns_of_numbers_with_gaps_and_of_words(tmp_path):
    rows = [{"run": 0, "a": 1, "w": "x"}, {"run": 1, "a": None, "w": None}, {"run": 2, "a": 2.5}]
    table.save(rows, tmp_path / "table.parquet")
    found = table.Columns(table.File(tmp_path / "table.parquet"))
    assert found["run"].dtype == np.int64
    assert found["a"][0] == 1.0 and math.isnan(found["a"][1])
    assert found["w"].tolist() == ["x", None, None]


def peak_mb(ask):
    """(answer, most memory of Python's and NumPy's objects that it took, MB)."""
    tracemalloc.start()
    try:
        answer = ask()
        return answer, tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def test_texts_of_all_runs_are_never_in_memory_together(tmp_path, monkeypatch):
    """Of 3000 runs with 1 kB each 200 at a time: what grows are the numbers of the runs, 40 bytes each."""
    monkeypatch.setattr(table, "BATCH", 200)
    rows = (
        {"run": run, "status": "failed", "reason": f"at T+{run} s: {'x' * 1000}",
         table.WARNINGS: json.dumps([{"field": "f", "text": f"{run} s: {'y' * 1000}"}])}
        for run in range(3000)
    )  # fmt: skip
    table.save(list(rows), tmp_path / "table.parquet")
    campaign = Campaign(SimpleNamespace(folder=tmp_path), {}, tmp_path / "table.parquet")
    for ask in (campaign.warnings, campaign.causes):
        ask()  # imports what it needs
        (cause,), peak = peak_mb(ask)
        assert len(cause.runs) == 3000 and peak < 1.2
    assert peak_mb(lambda: table.WARNINGS in campaign.columns and "no" not in campaign.columns)[1] < 0.1
    assert peak_mb(lambda: campaign[table.WARNINGS])[1] > 3.0  # what it would take otherwise


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return synthetic_campaign.write(tmp_path_factory.mktemp("campaign") / "one", 30, breaks=True)


def test_an_unfinished_campaign_opens_and_the_finished_one_is_the_same(folder):
    before = open_campaign(folder)
    digest = store.Store(folder).tabulate().digest
    after = open_campaign(folder)
    assert len(before) == len(after) == 30
    assert before.digest == after.digest == digest
    assert before.draws.keys() == after.draws.keys()
    assert before.columns.keys() == after.columns.keys()
    for name, values in before.columns.items():
        assert values.dtype == after[name].dtype, name
        assert np.array_equal(values, after[name], equal_nan=values.dtype.kind == "f"), name
    assert before.failures() == after.failures()
    assert np.array_equal(before.judgements.passed, after.judgements.passed)
    assert np.array_equal(before.judgements.severity, after.judgements.severity)


def test_a_table_that_lacks_runs_is_not_believed(folder):
    rows = [table.row(record) for record in store.Store(folder).runs.records()][:20]
    table.save(rows, folder / "results.parquet")
    assert len(open_campaign(folder)) == 30


def test_rows_that_a_disk_has_spoilt_are_told_with_the_file(tmp_path):
    """Its head is whole, so that it is opened: what is read first of its rows says so, and what helps."""
    folder = synthetic_campaign.write(tmp_path / "one", 6)
    store.Store(folder).tabulate()
    path = folder / "results.parquet"
    content = bytearray(path.read_bytes())
    head = int.from_bytes(content[-8:-4], "little") + 8
    content[4:-head] = bytes(one ^ 0x5A for one in content[4:-head])
    path.write_bytes(content)
    with pytest.raises(table.TableError, match=r"results\.parquet: spoilt: .*; delete it, it is made of"):
        open_campaign(folder).table()
    path.unlink()
    assert len(open_campaign(folder)) == 6


@pytest.mark.parametrize("error", [pyarrow.lib.ArrowMemoryError, pyarrow.lib.ArrowCancelled])
def test_what_the_machine_lacks_does_not_spoil_a_table(tmp_path, error):
    with pytest.raises(error, match="of the machine"), table._reading(tmp_path / "results.parquet"):
        raise error("of the machine")


def test_a_table_alone_is_not_to_be_deleted(tmp_path):
    """Where the records are gone nothing makes it again."""
    path = tmp_path / "results.parquet"
    with pytest.raises(table.TableError, match=r"results\.parquet: spoilt: bad page$"), table._reading(path):
        raise OSError("bad page")
    (tmp_path / "runs.sqlite").touch()
    with pytest.raises(table.TableError, match="bad page; delete it"), table._reading(path):
        raise OSError("bad page")


def test_series_and_summary_of_one_run(folder):
    campaign = open_campaign(folder)
    run = int(campaign.runs[campaign.succeeded][3])
    series = campaign.series(run)
    assert series["position_error_i"].shape == (synthetic_campaign.T, 3)
    assert campaign.summary(run)["star_tracker"]["by_rate"] == [{"from_deg_s": 0.0}]
    for ask in (campaign.summary, campaign.series, campaign.times):
        for none in (30, 77, -1):
            with pytest.raises(KeyError, match=f"there is no run {none}; the campaign has runs 0 to 29"):
                ask(none)
    with pytest.raises(KeyError, match=r"did you mean summary\.flight\.apogee_km"):
        campaign["summary.flight.apogee_m"]


def test_failures_are_named_and_grouped_by_what_they_say(folder):
    campaign = open_campaign(folder)
    failed = campaign.runs[~campaign.succeeded].tolist()
    assert failed and [failure.run for failure in campaign.failures()] == failed
    assert all(failure.traceback for failure in campaign.failures())
    (cause,) = campaign.causes()  # they differ by their numbers alone
    assert cause.runs == tuple(failed) and "more than the thrust can lift" in cause.words
    masses = campaign.draws["vehicle.payload.mass"]
    assert masses[~campaign.succeeded].min() > synthetic_campaign.BROKEN_MASS


def test_what_is_no_campaign_is_refused(tmp_path):
    with pytest.raises(store.StoreError, match=r"no campaign\.json"):
        open_campaign(tmp_path)
    (tmp_path / "campaign.json").write_text("{")
    with pytest.raises(store.StoreError, match="cannot be read"):
        open_campaign(tmp_path)
    (tmp_path / "campaign.json").write_text(json.dumps({"format": FORMAT}))
    with pytest.raises(store.StoreError, match="damaged or another program's, scenario, source, seed, runs"):
        open_campaign(tmp_path)
    (tmp_path / "campaign.json").write_text(json.dumps({"format": FORMAT - 1}))  # with two files a run
    with pytest.raises(
        store.StoreError, match=r"campaign\.json: its format is 1, expected 2; fly it in another"
    ):
        open_campaign(tmp_path)
    head = {name: types[0]() for name, types in heads.HEAD.items()}
    head |= {"sampling": "random", "flight": "shared", "rate": 1.0}
    head |= {"format": FORMAT, "runs": 3, "source": "mission: {}"}
    (tmp_path / "campaign.json").write_text(json.dumps(head))
    with pytest.raises(store.StoreError, match="no run"):
        open_campaign(tmp_path)
