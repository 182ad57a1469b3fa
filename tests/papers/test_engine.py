"""The engine: the number of workers changes nothing, timing runs alone, nothing is left behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import toy

from shefex_nav.papers import engine


def values(outcome):
    return np.concatenate([values for _, values in outcome.results])


def processes(outcome):
    return {process for process, _ in outcome.results}


def test_the_number_of_workers_changes_nothing():
    one, two = (engine.run(toy.NORMAL, samples=150, seed=3, workers=n) for n in (1, 2))
    np.testing.assert_array_equal(values(one), values(two))
    assert one.rows[0] == two.rows[0]
    assert len(values(one)) == 150 and [len(v) for _, v in one.results] == [40, 40, 40, 30]
    assert processes(one) == {os.getpid()} and os.getpid() not in processes(two)


def test_chunks_and_seeds_are_different_streams():
    outcome = engine.run(toy.NORMAL, samples=160, seed=3, workers=1)
    first, second = outcome.results[0][1], outcome.results[1][1]
    assert not np.isin(first, second).any()
    assert not np.isin(values(outcome), values(engine.run(toy.NORMAL, samples=160, seed=4, workers=1))).any()


def test_more_samples_begin_with_the_same_ones():
    few, many = (values(engine.run(toy.NORMAL, samples=n, seed=3, workers=1)) for n in (80, 160))
    np.testing.assert_array_equal(few, many[:80])


def test_a_timed_experiment_has_one_process():
    outcome = engine.run(toy.NORMAL._replace(timed=True), samples=120, seed=3, workers=2)
    assert processes(outcome) == {os.getpid()}


def test_progress_adds_up():
    done = []
    engine.run(toy.NORMAL, samples=130, seed=1, workers=2, progress=done.append)
    assert sum(done) == 130


def test_a_fault_of_a_worker_is_the_fault_of_the_run():
    with pytest.raises(ArithmeticError, match="no result"):
        engine.run(toy.NORMAL._replace(measure=toy.fail), samples=200, seed=1, workers=2)


# a shell that runs the tests in the background has its children ignore the interrupt
SCRIPT = """
import signal
import sys
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {folder!r})
import toy
from shefex_nav.papers import engine
if __name__ == "__main__":
    engine.run(toy.NORMAL._replace(measure=toy.wait_long), samples=200, seed=1, workers=2)
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_interrupted_or_killed_it_leaves_no_process_behind(how, tmp_path):
    script = tmp_path / "run.py"
    script.write_text(SCRIPT.format(folder=str(Path(__file__).parent)))
    signs = tmp_path / "signs"
    signs.mkdir()
    environment = {**os.environ, "SIGN_OF_LIFE": str(signs)}
    parent = subprocess.Popen(
        [sys.executable, script], env=environment, stderr=subprocess.PIPE, start_new_session=True
    )
    workers = []
    try:
        until = time.monotonic() + 60.0
        while len(workers) < 2 and time.monotonic() < until:
            workers = [int(sign.name) for sign in signs.iterdir()]
            time.sleep(0.05)
        assert len(workers) == 2
        parent.send_signal(how)
        _, error = parent.communicate(timeout=30.0)
        if how == signal.SIGINT:
            assert b"KeyboardInterrupt" in error
        until = time.monotonic() + 30.0
        while any(_alive(pid) for pid in workers) and time.monotonic() < until:
            time.sleep(0.05)
        assert not any(_alive(pid) for pid in workers)
    finally:
        for pid in [parent.pid, *workers]:
            if _alive(pid):
                os.kill(pid, signal.SIGKILL)


def _alive(pid):
    """Does the process run? One that has ended and waits to be collected does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
