"""Runs that no worker brings to an end: tried again, told, and a failed row if they always kill it."""

import json
from concurrent.futures.process import BrokenProcessPool

import keeping
import pytest
from keeping import rows
from short_campaign import HereLane, Show, fly, request, write
from typer.testing import CliRunner

from shefex_nav.campaign import engine, flight, results, running, store, summary
from shefex_nav.commands.app import app
from shefex_nav.scenario import load

RUNS = 4


class Deadly(HereLane):
    """Its worker dies of certain runs, so many times."""

    def __init__(self, plan, deaths):
        super().__init__(plan)
        self.deaths = dict(deaths)

    def submit(self, job):
        """Future of a run, or of a worker that is gone."""
        future = super().submit(job)
        if self.deaths.get(job.run, 0):
            self.deaths[job.run] -= 1
            future = type(future)()
            future.set_exception(BrokenProcessPool("a child process terminated abruptly"))
        return future


def test_a_killed_worker_costs_nothing_unless_it_is_killed_again_and_again(whole, scenario, tmp_path):
    plan, sampler = running.prepared(scenario, RUNS, 1)
    lane = Deadly(plan, {0: 1, 2: 2})
    with store.Store(tmp_path / "some") as folder:
        engine.fly((sampler.job(run) for run in range(RUNS)), [lane], folder.keep)
        assert lane.renewed == 3
        assert folder.tabulate().digest == whole[1].digest
    with store.Store(tmp_path / "all") as folder:
        jobs = (sampler.job(run) for run in range(RUNS))
        lost = engine.fly(jobs, [Deadly(plan, {1: 3})], folder.keep)
        folder.tabulate()
    assert lost == [engine.Lost(1, "its worker was killed, in each of 3 attempts", deadly=True)]
    assert [row["run"] for row in rows(tmp_path / "all")] == [
        0,
        2,
        3,
    ]  # no result: it is flown when the campaign goes on


def deadly(scenario, folder, deaths, runs=RUNS, **kept):
    """A campaign whose workers die of certain runs. -> Ended"""
    with store.Store(folder) as open_store:
        return running.fly(
            request(scenario, runs, **kept), open_store, Show(lambda text: None),
            crew=lambda plan, count: [Deadly(plan, deaths)],
        )  # fmt: skip


def test_a_run_that_kills_its_workers_in_two_sessions_has_failed(whole, scenario, tmp_path):
    """Three of them, on one worker: nothing else is flown in the second session."""
    killers = {run: 3 for run in (0, 2, 3)}
    first = deadly(scenario, tmp_path, killers)
    assert [one.run for one in first.lost] == [0, 2, 3] and all(one.deadly for one in first.lost)
    assert [row["run"] for row in rows(tmp_path)] == [1]
    second = deadly(scenario, tmp_path, killers)
    assert second.lost == () and [row["run"] for row in rows(tmp_path)] == list(range(RUNS))
    before = keeping.state(tmp_path)
    failed = [row for row in rows(tmp_path) if row["status"] == "failed"]
    assert [row["run"] for row in failed] == [0, 2, 3]
    assert {row["reason"] for row in failed} == {"its worker was killed, in each of 3 attempts of 2 sessions"}
    assert failed[0]["draw.ground.latitude"] == rows(whole[0])[0]["draw.ground.latitude"]
    assert deadly(scenario, tmp_path, killers).digest == second.digest
    assert keeping.state(tmp_path) == before  # they are done, and not flown again


def test_a_spoilt_run_that_kills_its_workers_now_has_failed_as_well(scenario, tmp_path):
    """Its old record stands, without series, until there is another one."""
    fly(scenario, tmp_path, 1)
    keeping.spoil(tmp_path, 0)
    first = deadly(scenario, tmp_path, {0: 3}, runs=1)
    assert [one.run for one in first.lost] == [0] and rows(tmp_path)[0]["status"] == "succeeded"
    second = deadly(scenario, tmp_path, {0: 3}, runs=1)
    assert second.lost == () and rows(tmp_path)[0]["reason"].endswith("3 attempts of 2 sessions")


def test_a_run_that_outlives_its_second_session_is_a_result(whole, scenario, tmp_path):
    assert [one.run for one in deadly(scenario, tmp_path, {1: 3}).lost] == [1]
    found = results.open_campaign(tmp_path)
    assert found.lost == {1: "its worker was killed, in each of 3 attempts"}
    told = summary.summary_object(found)
    assert (told["runs"], told["asked"], told["lost"]) == (RUNS - 1, RUNS, 1)
    assert deadly(scenario, tmp_path, {1: 2}).digest == whole[1].digest
    assert results.open_campaign(tmp_path).lost == {}


def test_trouble_now_and_then_is_no_fault_of_the_run(scenario, tmp_path):
    """Killed twice, and once without memory: however often that comes, the run is not blamed."""

    class Poor(Deadly):
        def submit(self, job):
            future = super().submit(job)
            if job.run == 0 and future.exception() is None:
                future = type(future)()
                future.set_exception(flight.MachineError("MemoryError: no room"))
            return future

    for _ in range(3):
        with store.Store(tmp_path) as folder:
            ended = running.fly(
                request(scenario, 1),
                folder,
                Show(lambda text: None),
                crew=lambda plan, n: [Poor(plan, {0: 2})],
            )
        (lost,) = ended.lost
        assert not ended.done and not lost.deadly
        assert lost.reason.startswith("3 attempts: its worker was killed; its worker was killed; MemoryError")


def test_a_log_that_could_not_be_had_is_no_lost_run(whole, scenario, tmp_path, monkeypatch):
    """The campaign is complete; what is said is of the log."""
    fly(scenario, tmp_path, RUNS)
    ended = deadly(scenario, tmp_path, {run: 3 for run in range(RUNS)}, keep=(running.Keep("worst", 1),))
    (without,) = ended.unlogged
    assert ended.lost == () and ended.digest == whole[1].digest
    monkeypatch.setattr(running, "_lanes_here", lambda r, p, n: [Deadly(p, {run: 3 for run in range(RUNS)})])
    arguments = ["campaign", str(write(tmp_path)), "--runs", str(RUNS), "--out", str(tmp_path), "--json"]
    told = CliRunner().invoke(app, [*arguments, "--keep", "worst:1"])
    assert told.exit_code == 0, told.output
    assert f"run {without.run} has no log: its worker was killed, in each of 3 attempts" in told.stderr
    assert "lost" not in told.stderr


def test_a_run_that_fails_before_its_first_record_has_no_log_and_that_is_told(tmp_path):
    (tmp_path / "step.csv").write_text("step_s\n0.02\n0.06\n")  # the second is longer than the longest
    more = "  star_tracker.exposure.start: {table: {file: step.csv, column: step_s, unit: s}}\n"
    breaks = load.load(write(tmp_path, more), ["star_tracker.exposure.shortest=10 ms"])
    ended = fly(breaks, tmp_path / "kept", 2, keep=(running.Keep("failed"),))
    assert rows(tmp_path / "kept")[1]["status"] == "failed"
    (without,) = ended.unlogged
    assert without.run == 1 and without.reason.startswith("it failed before its first record: ")
    assert rows(tmp_path / "kept")[1]["reason"] in without.reason


def test_lost_runs_are_in_the_object_also_where_there_is_nothing_else(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "_lanes_here", lambda request, plan, runs: [Deadly(plan, {0: 3})])
    arguments = ["campaign", str(write(tmp_path)), "--out", str(tmp_path / "c"), "--json"]
    alone = CliRunner().invoke(app, [*arguments, "--runs", "1"])
    found = json.loads(alone.stdout)
    assert alone.exit_code == 1 and "run 0 was lost: its worker was killed" in alone.stderr
    assert (found["runs"], found["asked"], found["lost"], found["requirements"]) == (0, 1, 1, [])
    both = CliRunner().invoke(app, [*arguments, "--runs", "2"])
    found = json.loads(both.stdout)
    assert both.exit_code == 1 and (found["runs"], found["asked"], found["failed"]) == (2, 2, 1)


def test_workers_that_all_die_end_the_campaign(scenario):
    plan, sampler = running.prepared(scenario, 100, 1)
    lane = Deadly(plan, {run: 3 for run in range(100)})
    lane._pilot = type("Idle", (), {"fly": lambda self, job: None})()
    with pytest.raises(
        engine.EngineError, match="attempts one after the other without a result; last: its worker was killed"
    ):
        engine.fly((sampler.job(run) for run in range(100)), [lane], lambda flown: None)
