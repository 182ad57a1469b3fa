"""Runs of a characterisation in workers: killed ones, failed ones, trouble of the machine, a full disk."""

import errno
import json
import os
import signal
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

import kept_runs
import pytest
from typer.testing import CliRunner

from shefex_nav import files, simulate
from shefex_nav.campaign import engine
from shefex_nav.campaign.characterise import flying, judge, running
from shefex_nav.campaign.characterise.fit import FitError
from shefex_nav.campaign.characterise.records import Records
from shefex_nav.campaign.running import prepared
from shefex_nav.commands.app import app
from shefex_nav.scenario.load import load

CAMPAIGN = Path(__file__).parents[2] / "scenarios" / "shefex2_dispersed.yaml"
RENDERED = ["star_tracker.frames=rendered", "star_tracker.model=null"]
RUNS = 4


@pytest.fixture(scope="module")
def planned():
    plan, sampler = prepared(load(CAMPAIGN, RENDERED), 12, 5)
    return plan, [sampler.job(run) for run in range(RUNS)]


def once(folder, job):
    """Whether a run is flown for the first time, in whatever process."""
    marker = Path(folder) / f"{job.run}.flown"
    first = not marker.exists()
    marker.touch()
    return first


class Killed(BaseException):
    """The worker of this run is killed."""


class Here:
    """Flies in this process, at once; of a run that is Killed it says what a pool says."""

    capacity = 1

    def __init__(self, plan, function, prepare):
        self._function = function
        prepare(plan)

    def submit(self, job):
        future = Future()
        try:
            future.set_result(self._function(job))
        except Killed:
            future.set_exception(BrokenProcessPool("a child process terminated abruptly"))
        except Exception as error:
            future.set_exception(error)
        return future

    def renew(self):
        pass

    def stop(self, at_once=False):
        pass


@pytest.fixture
def here(monkeypatch):
    monkeypatch.setattr(engine, "ProcessLane", Here)


def of_all_kinds(folder, job):
    """Run 1 kills its worker once, run 2 breaks, run 3 has no memory once."""
    first = once(folder, job)
    if first and job.run == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if job.run == 2:
        raise ValueError(f"run {job.run} breaks")
    if first and job.run == 3:
        raise MemoryError("8 GB wanted")
    return job.run * 10


@pytest.mark.slow
def test_in_processes_a_killed_worker_costs_its_run_a_second_flight_and_nothing_else(planned, tmp_path):
    plan, jobs = planned
    kept, said = [], []
    over = flying.fly(plan, 2, partial(of_all_kinds, str(tmp_path)), jobs, said.append, "some", kept.append)
    assert over == ({0: 0, 1: 10, 3: 30}, [(2, "ValueError: run 2 breaks")], [])
    assert sorted(kept) == [0, 10, 30] and len(said) == RUNS
    assert "some run 2 failed: ValueError: run 2 breaks" in said


def troubled(folder, job):
    """Run 0 has no memory at first, run 1 no disk at first, run 2 never has memory, run 3 always kills."""
    first = once(folder, job)
    if job.run == 2 or (first and job.run == 0):
        raise MemoryError("8 GB wanted")
    if first and job.run == 1:
        raise OSError(errno.ENOSPC, "No space left on device")
    if job.run == 3:
        raise Killed
    return job.run


def all_killed(job):
    raise Killed


def broken(job):
    raise ValueError("broken")


def test_trouble_of_the_machine_is_no_failed_run_and_what_never_comes_back_is_lost(planned, here, tmp_path):
    said = []
    over = flying.fly(planned[0], 1, partial(troubled, str(tmp_path)), planned[1], said.append, "some")
    assert over.results == {0: 0, 1: 1} and over.failed == []
    assert sorted(over.lost) == [
        engine.Lost(2, "MemoryError: 8 GB wanted, in each of 3 attempts"),
        engine.Lost(3, "its worker was killed, in each of 3 attempts", deadly=True),
    ]
    assert "some run 3 is lost: its worker was killed, in each of 3 attempts" in said


def test_workers_that_all_die_end_it(planned, here):
    with pytest.raises(engine.EngineError, match=r"9 attempts one after the other.*its worker was killed"):
        flying.fly(planned[0], 1, all_killed, planned[1], str, "some")


# ---- the whole of it, flights replaced ---------------------------------------------------------------------


def rendered(folder, job):
    """Run 1 breaks, run 3 always kills its worker; who was flown is noted."""
    with (Path(folder) / "flown").open("a") as notes:
        notes.write(f"{job.run}\n")
    if job.run == 1:
        raise ValueError("odd")
    if job.run == 3 and not (Path(folder) / "mended").exists():
        raise Killed
    return kept_runs.flown(job.run)


def statistical(content, job):
    if job.run == 7:
        raise MemoryError("8 GB wanted")
    return f"fixes of {job.run}"


@pytest.fixture
def short(here, monkeypatch, tmp_path):
    """`characterise` with 8 runs that take no time, and a fit of nothing. -> folder of notes"""
    folder = tmp_path / "notes"
    folder.mkdir()
    monkeypatch.setattr(simulate, "warm_up", lambda scenario: None)
    monkeypatch.setattr(flying, "rendered", partial(rendered, str(folder)))
    monkeypatch.setattr(flying, "statistical", statistical)
    monkeypatch.setattr(running, "_fitted", _fitted)
    monkeypatch.setattr(running, "_judged", _judged)
    return folder


def _fitted(scenario, fitted, held, without, seed):
    return {"fitted": [one.run for one in fitted], "without": list(map(len, without))}, None


def _judged(scenario, sightings, held, statistical):
    """A test whose value says which runs judged."""
    assert statistical == [f"fixes of {one.run}" for one in held]
    return [judge.Test(str([one.run for one in held]), 1.0, 0.0, 2.0, 1)]


def flown(folder):
    """Runs that were flown, with pictures, since this was asked last."""
    notes = (folder / "flown").read_text().split()
    (folder / "flown").write_text("")
    return sorted(map(int, notes))


def test_lost_runs_are_told_and_flown_by_the_same_command_what_is_kept_is_not(short, tmp_path):
    scenario, records = load(CAMPAIGN, RENDERED), tmp_path / "records"
    first = running.characterise(scenario, 8, 5, workers=2, folder=records)
    assert [one.run for one in first.failed] == [1]
    assert sorted((one.run, one.deadly) for one in first.lost) == [(3, True), (7, False)]
    assert first.content["fitted"] == [0, 2, 4, 6] and first.content["without"] == [1, 1]
    assert [test.what for test in first.tests][1] == "[5]"  # run 7 was lost, so that it cannot judge
    assert flown(short) == [0, 1, 2, 3, 3, 3, 4, 5, 6, 7]
    (short / "mended").touch()
    again = running.characterise(scenario, 8, 5, workers=1, folder=records)
    assert flown(short) == [1, 3]
    assert [one.run for one in again.lost] == [7] and again.tests[1].what == "[3, 5]"


def test_the_command_writes_the_file_and_prints_what_was_fitted_and_judged(short, monkeypatch, tmp_path):
    """Fitted is what is shipped; one figure is inside its limits, one has too few runs to say so."""
    shipped = json.loads((CAMPAIGN.parent / "data" / "star_tracker_shefex2.json").read_text())
    inside = judge.Test("inside", 1.0, 0.0, 2.0, 100, error=0.1, runs=4)
    unsure = judge.Test("unsure", 1.0, 0.9, 1.1, 100, error=0.1, runs=4)
    monkeypatch.setattr(running, "_fitted", lambda *given: (dict(shipped), None))
    monkeypatch.setattr(running, "_judged", lambda *given: [inside, unsure])
    (short / "mended").touch()
    out = tmp_path / "model.json"
    done = CliRunner().invoke(app, ["characterise", str(CAMPAIGN), "--runs", "8", "--out", str(out)])
    assert done.exit_code == 1, done.output
    written = json.loads(out.read_text())
    assert written["sightings"] == shipped["sightings"]
    assert [test["what"] for test in written["tests"]][-2:] == ["inside", "unsure"]
    words = " ".join(done.output.replace("│", " ").split())
    assert f"--runs {running.to_judge(unsure.deciding)}" in words and "would decide" in words


def test_a_full_disk_of_records_ends_the_command_with_one_message_and_keeps_what_is_there(
    short, monkeypatch, tmp_path
):
    """The third run does not fit; what was written before is read by the same command."""
    (short / "mended").touch()
    whole, written = files.whole, []

    def full(path):
        if path.suffix == ".npz":
            written.append(path)
            if len(written) == 3:
                raise OSError(errno.ENOSPC, "No space left on device")
        return whole(path)

    monkeypatch.setattr(files, "whole", full)
    arguments = ["characterise", str(CAMPAIGN), "--runs", "8", "--seed", "5", "--workers", "1"]
    arguments += ["--records", str(tmp_path / "records"), "--out", str(tmp_path / "model.json")]
    done = CliRunner().invoke(app, arguments)
    words = " ".join(done.output.replace("│", " ").split())
    assert done.exit_code == 2 and "No space left on device" in words and "Traceback" not in words
    assert not (tmp_path / "model.json").exists()
    kept = Records(tmp_path / "records", prepared(load(CAMPAIGN, RENDERED), 8, 5)[0])
    assert [run for run in range(8) if kept.read(run)] == [0, 2]  # run 1 failed
    flown(short)
    monkeypatch.setattr(files, "whole", whole)
    running.characterise(load(CAMPAIGN, RENDERED), 8, 5, workers=1, folder=tmp_path / "records")
    assert flown(short) == [1, 3, 4, 5, 6, 7]


def test_workers_that_all_die_are_one_message_of_the_command(short, monkeypatch, tmp_path):
    monkeypatch.setattr(flying, "rendered", all_killed)
    arguments = ["characterise", str(CAMPAIGN), "--runs", "6", "--workers", "1"]
    done = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "model.json")])
    words = " ".join(done.output.replace("│", " ").split())
    assert done.exit_code == 2 and "9 attempts one after the other without a result" in words, words
    assert "--workers" in words and not (tmp_path / "model.json").exists()


def test_nothing_flown_is_nothing_fitted(short, monkeypatch):
    monkeypatch.setattr(flying, "rendered", broken)
    with pytest.raises(FitError, match="no rendered run of 6 came to its end; the first: ValueError: broken"):
        running.characterise(load(CAMPAIGN, RENDERED), 6, 5, workers=1)
