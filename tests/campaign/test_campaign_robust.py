"""What goes wrong around a campaign: disks, memory, other campaigns, an impatient user. Nothing is lost."""

import json
import math
import os
import re
import sqlite3
import subprocess
import sys
from contextlib import closing

import failing_machine
import keeping
import numpy as np
import pytest
from short_campaign import HereLane, fly, write
from typer.testing import CliRunner

from shefex_nav import files
from shefex_nav.campaign import flight, results, running, store, table
from shefex_nav.campaign import head as heads
from shefex_nav.campaign import plan as planning
from shefex_nav.commands.app import app
from shefex_nav.errors import called
from shefex_nav.scenario import load

RUNS = 3


# ---- files -----------------------------------------------------------------------------------------------


def spoil(path):
    path.write_bytes(path.read_bytes()[:-1] + b"?")


@pytest.mark.parametrize(
    "harm", [lambda content: content[:-1] + b"?", lambda content: b"", lambda content: None]
)
def test_a_run_whose_series_are_spoilt_is_flown_again(whole, scenario, tmp_path, harm):
    fly(scenario, tmp_path, RUNS)
    keeping.spoil(tmp_path, 1, harm(keeping.content(tmp_path, 1)))
    flown = []
    again = fly(scenario, tmp_path, RUNS, before=flown.append)
    assert [job.run for job in flown] == [1] and again.digest == whole[1].digest
    assert keeping.content(tmp_path, 1) == keeping.content(whole[0], 1)


def repeat_as_told(error, monkeypatch):
    """The command that an error names, run here. -> result of CliRunner"""
    (words,) = re.findall("`shefex-nav (.*?)`", str(error))
    monkeypatch.setattr(running.mend, "__kwdefaults__", {"lane": HereLane})
    return CliRunner().invoke(app, words.split())


def test_a_session_looks_at_the_first_runs_alone(whole, scenario, tmp_path, monkeypatch):
    """Those whose series a report reads; of the others it is told when they are read, with what to do."""
    monkeypatch.setattr(running, "CHECKED", 1)
    fly(scenario, tmp_path, RUNS)
    keeping.spoil(tmp_path, 0)
    keeping.spoil(tmp_path, 2)
    flown = []
    fly(scenario, tmp_path, RUNS, before=lambda job: flown.append(job.run))
    assert flown == [0]
    with pytest.raises(KeyError, match="the series of run 2 are spoilt") as told:
        results.open_campaign(tmp_path).series(2)
    before = keeping.record(tmp_path, 2)
    done = repeat_as_told(told.value, monkeypatch)
    assert done.exit_code == 0 and "run 2 is kept" in done.stderr, done.output
    assert keeping.content(tmp_path, 2) == keeping.content(whole[0], 2)
    assert keeping.record(tmp_path, 2) == before  # with the times of its first flight
    assert results.open_campaign(tmp_path).digest == whole[1].digest


@pytest.mark.parametrize("checked", [0, RUNS])
def test_a_record_that_a_disk_spoilt_is_told_and_flown_again(whole, scenario, tmp_path, monkeypatch, checked):
    """By the next session if it is one of the first runs, else by the command that is told."""
    monkeypatch.setattr(running, "CHECKED", checked)
    fly(scenario, tmp_path, RUNS)
    keeping.say(tmp_path, "UPDATE records SET record = x'00' WHERE run = 1")
    keeping.say(tmp_path, "PRAGMA user_version = 77")  # the table is older: it would be made of the records
    with pytest.raises(store.StoreError, match="the record of run 1 is spoilt; `shefex-nav repeat") as told:
        results.open_campaign(tmp_path)
    if checked:
        fly(scenario, tmp_path, RUNS)
    else:
        assert repeat_as_told(told.value, monkeypatch).exit_code == 0
    assert fly(scenario, tmp_path, RUNS).digest == whole[1].digest


def test_a_good_run_that_now_comes_out_otherwise_is_left(scenario, tmp_path, monkeypatch):
    fly(scenario, tmp_path, 2)
    keeping.change(tmp_path, 1, errs)
    before = keeping.record(tmp_path, 1), keeping.content(tmp_path, 1)
    done = repeat_as_told(f"`shefex-nav repeat {tmp_path} 1 --keep`", monkeypatch)
    assert done.exit_code == 1 and "run 1 is left as it was" in done.stderr
    assert (keeping.record(tmp_path, 1), keeping.content(tmp_path, 1)) == before
    with store.Store(tmp_path):
        done = repeat_as_told(f"`shefex-nav repeat {tmp_path} 1 --keep`", monkeypatch)
        assert done.exit_code == 2 and "another campaign is at work in this folder" in done.stderr
    monkeypatch.setattr(planning, "versions", lambda: {"code": "other"})
    done = repeat_as_told(f"`shefex-nav repeat {tmp_path} 1 --keep`", monkeypatch)
    assert done.exit_code == 2 and "results would be mixed" in done.stderr


def test_a_run_that_failed_through_its_machine_is_flown_again(whole, scenario, tmp_path, monkeypatch):
    fly(scenario, tmp_path, RUNS)
    _, sampler = running.prepared(scenario, RUNS, 1)
    with store.Store(tmp_path) as folder:
        folder.keep(flight.given_up(sampler.job(2), "its worker was killed, in each of 3 attempts"))
    assert fly(scenario, tmp_path, RUNS).failed == 1
    done = repeat_as_told(f"`shefex-nav repeat {tmp_path} 2 --keep`", monkeypatch)
    assert done.exit_code == 0 and "run 2 is kept" in done.stderr
    assert fly(scenario, tmp_path, RUNS).digest == whole[1].digest


def test_series_that_were_deleted_are_not_flown_again(whole, scenario, tmp_path):
    digest = fly(scenario, tmp_path, RUNS).digest
    keeping.without_series(tmp_path)
    flown = []
    assert fly(scenario, tmp_path, RUNS, before=flown.append).digest == digest and not flown


def test_a_table_that_cannot_be_read_or_is_old_is_made_of_the_records(whole, scenario, tmp_path):
    digest = fly(scenario, tmp_path, RUNS).digest
    path = tmp_path / "results.parquet"
    kept = path.read_bytes()
    for content in (b"", kept[: len(kept) // 2], b"PAR1" + b"\0" * 100 + b"PAR1"):
        path.write_bytes(content)
        assert results.open_campaign(tmp_path).digest == digest
    path.write_bytes(kept)
    assert results.open_campaign(tmp_path)._path == path  # nothing has changed since: it is read
    keeping.change(tmp_path, 0, errs)
    assert results.open_campaign(tmp_path).digest != digest
    keeping.forget(tmp_path, 2)
    assert len(results.open_campaign(tmp_path)) == RUNS - 1
    (tmp_path / "runs.sqlite").unlink()  # where the table alone was kept, it counts
    assert results.open_campaign(tmp_path).digest == digest


def errs(record):
    record["summary"]["navigation"]["position_error_m"]["rms"] += 1.0


FILL = """
import sys
from pathlib import Path
from shefex_nav.campaign import flight, plan, store
with store.Store(Path(sys.argv[1])) as folder:
    folder.runs._db.execute("PRAGMA wal_autocheckpoint = 4")
    record = flight.given_up(plan.Job(0, 1, {}, ""), "")[0] | {"status": "succeeded"}
    for run in range(1000):
        folder.keep(flight.Flown(record | {"run": run}, run.to_bytes(2, "big") * 5000))
        print(run, flush=True)
"""


def test_a_killed_process_loses_no_run_that_counted_as_done(tmp_path):
    """kill -9 at any instant, also of a checkpoint: what it had said is there, the rest is whole or not."""
    command = [sys.executable, "-c", FILL, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        said = [process.stdout.readline() for _ in range(30)]
        process.kill()
        said += process.stdout.readlines()
    runs = store.Store(tmp_path).runs
    last = int(said[-1])
    assert runs.done() in (set(range(last + 1)), set(range(last + 2)))
    for run in runs.done():
        assert runs.record(run)["run"] == run and runs.series(run) == run.to_bytes(2, "big") * 5000
    assert keeping.sound(tmp_path)


def test_a_disk_that_is_full_is_one_message(tmp_path):
    """SQLite's own words; what was kept before is there, and there is room again."""
    with store.Store(tmp_path) as folder:
        folder.keep(flight.Flown({"run": 0}, None))
        pages = folder.runs._one("PRAGMA page_count")
        folder.runs._db.execute(f"PRAGMA max_page_count = {pages}")
        with pytest.raises(
            store.StoreError, match="database or disk is full; what is there is kept, the same"
        ):
            folder.keep(flight.Flown({"run": 1}, bytes(10**6)))
        assert folder.runs.done() == {0}
        folder.runs._db.execute(f"PRAGMA max_page_count = {pages + 100}")
        folder.keep(flight.Flown({"run": 1}, bytes(10**6)))
    assert keeping.done(tmp_path) == 2


@pytest.mark.skipif(sys.platform != "linux", reason="no limit of the size of files")
def test_a_disk_that_refuses_to_write_is_one_message(tmp_path):
    code = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))\n" + FILL
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert "StoreError: cannot use" in last and last.endswith("kept, the same command goes on"), done.stderr
    assert keeping.done(tmp_path) == len(done.stdout.splitlines()) > 0 and keeping.sound(tmp_path)


@pytest.fixture(scope="module")
def failing(once):
    """Function that gives the environment of a process whose disk or clock fails."""
    made = once("failing_machine", failing_machine.library) / "failing.so"
    return lambda **settings: os.environ | failing_machine.environment(made, **settings)


@failing_machine.needed
@pytest.mark.parametrize("file", ["runs.sqlite-wal", "runs.sqlite"])
@pytest.mark.parametrize("call", ["EIO_WRITE", "EIO_SYNC"])
def test_a_disk_that_fails_takes_no_run_that_counted_as_done(call, file, failing, tmp_path):
    """After 40 calls that go well: then none does any more, until the disk is mended."""
    done = subprocess.run([sys.executable, "-c", FILL, str(tmp_path)], capture_output=True, text=True,
                          env=failing(GOES_WELL=40, **{call: file}))  # fmt: skip
    last = done.stderr.splitlines()[-1]
    assert "StoreError: cannot use" in last and last.endswith("kept, the same command goes on"), done.stderr
    said = len(done.stdout.splitlines())
    assert said > 0 and keeping.done(tmp_path) in (said, said + 1) and keeping.sound(tmp_path)
    with store.Store(tmp_path) as folder:
        assert all(folder.runs.series(run) == run.to_bytes(2, "big") * 5000 for run in range(said))


READ = """
import sys
from shefex_nav.campaign import over_time, parts, results, summary
campaign = results.open_campaign(sys.argv[1])
summary.summary_object(campaign)
parts.parts(campaign, over_time.read(campaign))
"""


@failing_machine.needed
@pytest.mark.parametrize(("name", "well", "told"), [
    ("runs.sqlite", 0, "runs.sqlite: disk I/O error; what is there is kept, the same command goes on"),
    ("runs.sqlite", 5, "or its disk fails (database disk image is malformed); copy it to another disk"),
    ("results.parquet", 8, "results.parquet'"),
])  # fmt: skip
def test_a_disk_that_cannot_be_read_is_told(name, well, told, whole, failing):
    """Not as runs without series, nor as a campaign without runs."""
    done = subprocess.run([sys.executable, "-c", READ, whole[0]], capture_output=True, text=True,
                          env=failing(GOES_WELL=well, EIO_READ=name))  # fmt: skip
    last = done.stderr.splitlines()[-1]
    assert ("StoreError" in last or "Input/output error" in last) and told in last, done.stderr


@failing_machine.needed
def test_a_clock_that_is_set_back_changes_nothing(whole, scenario, failing, tmp_path):
    """By more than a year, in campaign and worker a second after each began, and before it goes on."""
    folder = tmp_path / "campaign"
    words = "campaign", str(write(tmp_path)), "--runs", "2", "--workers", "1", "--out", str(folder)
    done = subprocess.run([sys.executable, "-m", "shefex_nav", *words], capture_output=True, text=True,
                          env=failing(CLOCK_BACK=40_000_000))  # fmt: skip
    assert done.returncode == 0, done.stderr
    for path in folder.iterdir():  # written by the clock as it was
        os.utime(path, (path.stat().st_mtime + 4e7,) * 2)
    flown = []
    assert fly(scenario, folder, RUNS, before=lambda job: flown.append(job.run)).digest == whole[1].digest
    assert flown == [2] and 0.0 < heads.read_head(folder)["wall_s"] < 1e4
    assert len(results.open_campaign(folder)) == RUNS


@pytest.mark.parametrize("where", [0, 20_000])
def test_a_file_that_is_damaged_or_of_another_program_is_one_message(scenario, tmp_path, where):
    fly(scenario, tmp_path, RUNS)
    path = tmp_path / "runs.sqlite"
    content = path.read_bytes()
    path.write_bytes(content[:where] + b"\xff" * 40_000 + content[where + 40_000 :])
    with pytest.raises(store.StoreError, match=r"runs\.sqlite: is damaged, or no file of runs, or its disk"):
        fly(scenario, tmp_path, RUNS)
    path.unlink()
    with closing(sqlite3.connect(path)) as other:
        other.execute("CREATE TABLE runs (name)")
    with pytest.raises(store.StoreError, match=r"runs\.sqlite: is another program's"):
        fly(scenario, tmp_path, RUNS)


def test_a_report_reads_while_a_campaign_writes(scenario, tmp_path):
    """Before and after a transaction, and while one is open."""
    with store.Store(tmp_path) as folder:
        folder.keep(flight.Flown({"run": 0}, b"series"))
        reader = store.Store(tmp_path)
        with reader.runs.unchanged():
            assert reader.runs.done() == {0}
            folder.keep(flight.Flown({"run": 1}, b"series"))
            assert reader.runs.done() == {0}
        assert reader.runs.done() == {0, 1}
    reader.runs.close()
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun" / "runs.sqlite").touch()  # as it is for an instant when a campaign begins
    assert keeping.done(tmp_path / "begun") == 0


def test_a_folder_that_cannot_be_written_can_be_read(scenario, tmp_path):
    """After a session the runs are one file, without a journal beside it."""
    fly(scenario, tmp_path, RUNS)
    assert sorted(path.name for path in tmp_path.glob("runs*")) == ["runs.sqlite"]
    assert (tmp_path / "runs.sqlite").read_bytes()[18:20] == b"\x01\x01"  # version of the format: no WAL


def test_what_json_cannot_hold_is_a_failed_run(scenario, tmp_path, monkeypatch):
    """A figure that is not a number is a fault of the run that has it, not the end of the campaign."""
    mission = flight.Pilot._mission

    def infinite(self, job):
        summary, series = mission(self, job)
        return (summary | {"odd": math.inf} if job.run == 1 else summary), series

    monkeypatch.setattr(flight.Pilot, "_mission", infinite)
    ended = fly(scenario, tmp_path, 2)
    rows = keeping.rows(tmp_path)
    assert [row["status"] for row in rows] == ["succeeded", "failed"] and ended.failed == 1
    assert rows[1]["reason"].startswith("ValueError: Out of range float values")
    plan, sampler = running.prepared(scenario, 1, 1)
    job = sampler.job(0)
    endless = job._replace(draws=job.draws | {"imu.gyro.bias": math.inf})
    record = flight.Pilot(plan).fly(endless).record
    assert record["status"] == "failed" and record["draws"]["imu.gyro.bias"] == "inf"
    json.dumps(record, allow_nan=False)


def test_a_shared_flight_that_is_spoilt_is_made_again(tmp_path):
    path = write(tmp_path)
    path.write_text(path.read_text().replace("  ground.latitude: {uniform: [-1 deg, 1 deg]}\n", ""))
    shared, folder = load.load(path, ["campaign.flight=shared"]), tmp_path / "campaign"
    fly(shared, folder, 1)
    flown = (folder / "flight.npz").read_bytes()
    spoil(folder / "flight.npz")
    fly(shared, folder, 2)
    assert (folder / "flight.npz").read_bytes() == flown
    with store.Store(folder) as kept:
        spoil(folder / "flight.npz")
        with pytest.raises(store.StoreError, match="is not what the runs flew"):
            kept.flight(lambda: b"another")


def test_a_head_of_another_kind_is_refused(tmp_path):
    (tmp_path / "campaign.json").write_text("[1, 2]")
    with pytest.raises(store.StoreError, match="its format is None, expected 2"):
        heads.read_head(tmp_path)
    with pytest.raises(store.StoreError, match="is a file; expected the folder of a campaign"):
        heads.read_head(tmp_path / "campaign.json")


def larger(record):
    record["summary"]["navigation"]["velocity_error_m_s"]["max"] += 1e-9


def test_a_log_is_kept_only_of_a_run_that_is_as_its_row(whole, scenario, tmp_path):
    fly(scenario, tmp_path, 1)
    keeping.change(tmp_path, 0, larger)
    said = []
    fly(scenario, tmp_path, 1, keep=(running.Keep("worst", 1),), say=said.append)
    assert (
        "run 0: no log, it differs from its row in 1 columns: summary.navigation.velocity_error_m_s.max"
        in said
    )
    assert not list((tmp_path / "logs").glob("*.mcap"))


def test_a_log_that_cannot_be_written_is_no_failed_run(scenario, tmp_path):
    plan, sampler = running.prepared(scenario, 1, 1)
    job = sampler.job(0)._replace(log=str(tmp_path / "nowhere" / "run.mcap"))
    with pytest.raises((flight.MachineError, flight.import_module("shefex_nav.log.topics").LogError)):
        flight.Pilot(plan).fly(job)


@pytest.mark.parametrize("cause", [MemoryError(), OSError(28, "No space left on device")])
def test_code_of_a_user_without_memory_or_disk_is_no_failed_run(cause, scenario, monkeypatch):
    """It would count as a flight that failed."""
    plan, sampler = running.prepared(scenario, 1, 1)

    def measure(*_):
        raise cause

    monkeypatch.setattr(flight.Pilot, "_mission", lambda *_: called("instrument 'mine': measure", measure))
    with pytest.raises(flight.MachineError, match="instrument 'mine': measure"):
        flight.Pilot(plan).fly(sampler.job(0))


def test_an_exit_of_code_of_a_user_is_a_failed_run(scenario, monkeypatch):
    """The whole campaign would end by it, and as if all were done."""
    plan, sampler = running.prepared(scenario, 1, 1)
    monkeypatch.setattr(flight.Pilot, "_mission", lambda *_: sys.exit(0))
    assert flight.Pilot(plan).fly(sampler.job(0)).record["reason"] == "SystemExit: 0"


# ---- digests ---------------------------------------------------------------------------------------------


def test_the_digest_of_series_is_of_numbers_not_of_their_packing():
    arrays = {"b": np.arange(4.0), "a": np.ones((2, 3), np.int8)}
    first = flight._arrays_digest(arrays)
    assert first == flight._arrays_digest({name: arrays[name].copy() for name in ("a", "b")})
    assert first == flight._arrays_digest(arrays | {"b": np.arange(4.0, dtype=">f8")})
    for other in ({"b": np.arange(4.0) + 1e-15}, {"b": np.arange(4)}, {"a": np.ones((3, 2), np.int8)}):
        assert first != flight._arrays_digest(arrays | other)


def test_a_column_of_words_and_numbers_has_one_digest(tmp_path):
    rows = [{"run": k, "draw.x": value} for k, value in enumerate(("auto", 5.0, 5, "5", True, None))]
    rows = [{name: None for name in table.HEAD} | row for row in rows]
    made = list(table.unmixed([dict(row) for row in rows], table.kinds(rows)))
    assert [row["draw.x"] for row in made] == ['"auto"', "5.0", "5", '"5"', "true", None]
    table.save(made, tmp_path / "results.parquet")
    assert table.digest(list(table.load(tmp_path / "results.parquet"))) == table.digest(made)


def test_a_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / "one"
    with pytest.raises(RuntimeError), files.whole(path) as part:
        part.write_text("half")
        raise RuntimeError
    assert not list(tmp_path.iterdir())


def test_the_table_of_another_campaign_is_not_replaced(scenario, tmp_path):
    (tmp_path / "results.parquet").write_bytes(b"precious")
    with pytest.raises(store.StoreError, match=r"there is results\.parquet of another campaign"):
        fly(scenario, tmp_path)
    assert (tmp_path / "results.parquet").read_bytes() == b"precious"
