"""Workers of a campaign: whose plan they fly by, what is no fault of a run, interrupts, threads."""

import os
import sys
from concurrent.futures import Future

import keeping
import pytest
from short_campaign import HereLane, fly, write

from shefex_nav import stopping
from shefex_nav.campaign import engine, flight, running
from shefex_nav.compiled import target
from shefex_nav.scenario import load

RUNS = 3


def test_a_worker_of_two_campaigns_flies_each_run_by_its_own_plan(scenario, tmp_path, monkeypatch):
    """As on a scheduler that two of them share: the same dispersed paths, another scenario."""
    monkeypatch.setattr(flight, "_pilots", {})
    for name in flight.ONE_THREAD:
        monkeypatch.setenv(name, "1")
    other = load.load(write(tmp_path), ["gps.range_noise=30 m"])
    a, of_a = running.prepared(scenario, 1, 1)
    b, of_b = running.prepared(other, 1, 1)
    assert a.digest != b.digest and a._replace(flight=b"some").digest == a.digest
    expected = [
        flight.Pilot(plan).fly(s.job(0)).record["series_sha256"] for plan, s in ((a, of_a), (b, of_b))
    ]
    assert expected[0] != expected[1]
    flight.prepare_worker(a)
    flight.prepare_worker(b)
    assert [flight.fly(s.job(0)).record["series_sha256"] for s in (of_a, of_b)] == expected
    flight.dismiss(b)
    assert flight.fly(of_a.job(0)).record["series_sha256"] == expected[0]
    with pytest.raises(flight.WorkerError, match="was not told"):
        flight.fly(of_b.job(0))


@pytest.mark.parametrize("trouble", [MemoryError("no room"), OSError(28, "No space left on device")])
def test_trouble_of_the_machine_is_no_result(whole, scenario, tmp_path, monkeypatch, trouble):
    """The run is lost this time, told, and flown when the campaign goes on."""
    mission = flight.Pilot._mission

    def troubled(self, job):
        if job.run == 1:
            raise trouble
        return mission(self, job)

    monkeypatch.setattr(flight.Pilot, "_mission", troubled)
    ended = fly(scenario, tmp_path, RUNS)
    assert [row["run"] for row in keeping.rows(tmp_path)] == [0, 2]
    (lost,) = ended.lost
    assert lost.run == 1 and type(trouble).__name__ in lost.reason and "in each of 3 attempts" in lost.reason
    monkeypatch.undo()
    again = fly(scenario, tmp_path, RUNS)
    assert again.lost == () and again.digest == whole[1].digest


class Gone(HereLane):
    """A scheduler that ends after its first run."""

    def submit(self, job):
        """Future of a run, cancelled but for the first."""
        if job.run == 0:
            return super().submit(job)
        future = Future()
        future.cancel()
        future.set_running_or_notify_cancel()  # as distributed does
        return future


def test_a_scheduler_that_ends_is_no_fault_of_the_runs(scenario):
    plan, sampler = running.prepared(scenario, RUNS, 1)
    taken = []
    with pytest.raises(engine.EngineError, match=r"the Dask scheduler gave up run 1: .* goes on$"):
        engine.fly((sampler.job(run) for run in range(RUNS)), [Gone(plan)], taken.append)
    assert [flown.record["run"] for flown in taken] == [0]


def test_what_is_over_is_taken_before_the_end(scenario):
    """Ctrl-C while a run comes in: it is kept."""
    plan, sampler = running.prepared(scenario, RUNS, 1)
    taken = []
    with pytest.raises(engine.Interrupted):
        engine.fly((sampler.job(run) for run in range(RUNS)), [HereLane(plan)], taken.append, lambda: True)
    assert [flown.record["run"] for flown in taken] == [0]


def test_ctrl_c_is_answered_at_once(capfd):
    with stopping.stopping() as stop:
        assert not stop()
        os.kill(os.getpid(), stopping.signal.SIGINT)
        assert stop()
        assert "stopping after this step" in capfd.readouterr().err
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), stopping.signal.SIGINT)


def test_threads_that_are_set_too_late_are_not_claimed(monkeypatch):
    """NumPy has been imported here: its BLAS has its threads already, and the check has to see that."""
    found = {}
    target.choose(found)
    assert not set(found) & set(target.ONE_THREAD)
    monkeypatch.delitem(sys.modules, "numpy")
    target.choose(found)
    assert all(found[name] == "1" for name in target.ONE_THREAD)


def test_one_thread_is_the_workers_affair_alone(monkeypatch):
    """What the caller's process had set it keeps, and so do the processes that it starts later."""
    first, *others = target.ONE_THREAD
    monkeypatch.setenv(first, "4")
    for name in others:
        monkeypatch.delenv(name, raising=False)
    lane = engine.ProcessLane("plan", function=os.getenv, prepare=len)
    try:
        told = [lane.submit(name).result() for name in target.ONE_THREAD]
    finally:
        lane.stop()
    assert told == ["1"] * len(told)
    assert [os.environ.get(name) for name in target.ONE_THREAD] == ["4"] + [None] * len(others)
