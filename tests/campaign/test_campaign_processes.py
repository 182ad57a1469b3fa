"""Campaigns in processes that are interrupted and killed: results are those of one that was left alone."""

import importlib.util
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import keeping
import pytest
from short_campaign import fly, write

from shefex_nav.campaign import engine, running, store
from shefex_nav.scenario import load

ROOT = Path(__file__).parents[2]
RUNS = 4
PATIENCE_S = 600.0  # on a machine with much else to do


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """The short mission."""
    return write(tmp_path_factory.mktemp("scenario"))


@pytest.fixture(scope="module")
def digest(path, tmp_path_factory):
    """Of its campaign, flown in this process."""
    return fly(load.load(path), tmp_path_factory.mktemp("whole"), RUNS).digest


def started(*arguments, threads=1):
    """A process of this Python; `threads` as a user's profile may set them for linear algebra."""
    threads = {f"{name}_NUM_THREADS": str(threads) for name in ("OMP", "OPENBLAS", "MKL")}
    return subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **threads, "COLUMNS": "100"},
        cwd=ROOT,
    )


def campaign(path, folder, *more, **how):
    """The command, running."""
    fixed = ("-m", "shefex_nav", "campaign", path, "--runs", RUNS, "--out", folder, "--json")
    return started(*fixed, *more, **how)


def wait_for(what, process, folder):
    """Until so many runs are done; the process must live."""
    end = time.monotonic() + PATIENCE_S
    while keeping.done(folder) < what:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)


def children(process):
    """Processes that it has started: list of int; only where /proc is."""
    found = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    return [int(word) for word in found.read_text().split()] if found.exists() else []


def gone(pid):
    """Whether a process has ended, or is about to."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except FileNotFoundError:
        return True


def test_interrupted_then_killed_then_finished(path, digest, tmp_path):
    """Ctrl-C leaves a table and says how to go on; after kill -9 the workers end; nothing is lost."""
    folder = tmp_path / "campaign"
    first = campaign(path, folder, "--workers", 1)
    wait_for(1, first, folder)
    first.send_signal(signal.SIGINT)
    _, said = first.communicate(timeout=PATIENCE_S)
    assert first.returncode == 130
    done = len(keeping.rows(folder))
    assert f"interrupted; {done} of {RUNS} runs are kept, the same command goes on from there" in said
    if done < RUNS - 1:
        second = campaign(path, folder, "--workers", 1)
        wait_for(done + 1, second, folder)
        workers = children(second)
        second.kill()
        second.communicate()
        end = time.monotonic() + 30.0
        while not all(gone(pid) for pid in workers):
            assert time.monotonic() < end
            time.sleep(0.05)
    assert fly(load.load(path), folder, RUNS).digest == digest


def test_two_workers_of_which_one_is_killed(path, digest, tmp_path):
    """Whatever it had is flown again."""
    plan, sampler = running.prepared(load.load(path), RUNS, 1)
    lanes = [engine.ProcessLane(plan), engine.ProcessLane(plan)]
    killed = []
    with store.Store(tmp_path) as kept:

        def take(flown):
            kept.keep(flown)
            if not killed:  # the other one is at work, or about to be
                killed.extend(process.pid for process in lanes[1]._pool.processes)
                for pid in killed:
                    os.kill(pid, signal.SIGKILL)

        engine.fly((sampler.job(run) for run in range(RUNS)), lanes, take)
        made = kept.tabulate()
    assert len(killed) == 1
    assert [row["status"] for row in keeping.rows(tmp_path)] == ["succeeded"] * RUNS
    assert made.digest == digest


def free_port():
    """A port of this machine that nobody uses."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.mark.slow
def test_threads_of_the_user_change_nothing(path, digest, tmp_path):
    """Many profiles set OMP_NUM_THREADS: the campaign, its logs and `repeat` fly with one all the same."""
    folder = tmp_path / "campaign"
    wanted = "--workers", 1, "--keep", "worst:1"
    printed, said = campaign(path, folder, *wanted, threads=8).communicate(timeout=PATIENCE_S)
    assert json.loads(printed)["results_digest"] == digest, said
    assert len(list((folder / "logs").glob("*.mcap"))) == 1 and "no log" not in said
    again = started("-m", "shefex_nav", "repeat", folder, 2, "--log", tmp_path / "2.mcap", threads=8)
    printed, said = again.communicate(timeout=PATIENCE_S)
    assert again.returncode == 0 and "run 2: succeeded; the same as its row" in printed, said
    assert (tmp_path / "2.mcap").stat().st_size > 10_000 and not list(tmp_path.glob("*.part"))


@pytest.mark.slow
def test_two_campaigns_on_a_dask_cluster_of_which_a_worker_is_killed(path, digest, tmp_path):
    """A scheduler and two workers, started apart on the loopback; needs the extra `cluster`.

    Each campaign gets the results of its own scenario, and no run is lost with the worker.
    """
    if importlib.util.find_spec("distributed") is None:
        pytest.skip("distributed is not installed: uv sync --extra cluster")
    noisy = "gps.range_noise=30 m"
    expected = digest, fly(load.load(path, [noisy]), tmp_path / "here", RUNS).digest
    port, folders = free_port(), (tmp_path / "one", tmp_path / "two")
    scheduler = started(
        *("-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", port),
        *("--no-dashboard", "--no-show"),
    )
    worker = ("-m", "distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}", "--nthreads", 1, "--no-nanny")
    workers = [started(*worker, "--no-dashboard", "--local-directory", tmp_path / name) for name in "ab"]
    engine = ("--engine", f"dask://127.0.0.1:{port}")
    try:
        both = [campaign(path, folders[0], *engine), campaign(path, folders[1], *engine, "--set", noisy)]
        wait_for(1, both[0], folders[0])
        workers[0].kill()
        ended = [flying.communicate(timeout=PATIENCE_S) for flying in both]
    finally:
        for process in (*both, *workers, scheduler):
            process.kill()
            process.communicate()
    for flying, (printed, said), wanted in zip(both, ended, expected, strict=True):
        assert flying.returncode == 0, said
        assert json.loads(printed)["results_digest"] == wanted
    assert expected[0] != expected[1]


def test_a_scheduler_that_is_not_there(path, tmp_path):
    """One message, also where dask is not installed, and no folder."""
    out = tmp_path / "campaigns" / "new"
    if importlib.util.find_spec("distributed") is None:
        flying = campaign(path, out, "--engine", "dask://127.0.0.1:1")
        _, said = flying.communicate(timeout=PATIENCE_S)
        assert flying.returncode == 2 and "needs the extra 'cluster' (distributed is not installed)" in said
        assert not out.parent.exists()
        return
    impatient = "from shefex_nav.campaign import cluster; cluster.CONNECT_S = 1.0"
    command = f"{impatient}; from shefex_nav.commands.main import main; main()"
    address = f"dask://127.0.0.1:{free_port()}"
    flying = started("-c", command, "campaign", path, "--runs", 1, "--out", out, "--engine", address)
    _, said = flying.communicate(timeout=PATIENCE_S)
    assert flying.returncode == 2
    assert re.search(r"dask://127\.0\.0\.1:\d+: no scheduler with a worker answers", said), said
    assert "Traceback" not in said and not out.parent.exists()
