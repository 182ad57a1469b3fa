"""What is missing is compiled in several processes; the list of kernels is that of the program."""

import json
import os
import subprocess
import sys
import time

import pytest

from shefex_nav.compiled import ahead, digest, signature

SMALL = "shefex_nav.geometry.rotation:quat_conjugate", "shefex_nav.geometry.rotation:quat_normalise"


@pytest.fixture(scope="module")
def listed():
    return ahead.entries()


def test_every_listed_kernel_is_there_with_these_arguments(listed):
    """Types that were read are those that were written: the JSON of both is the same."""
    assert len(listed) > 60
    for one in listed:
        types = [signature.decode(text) for text in one.signature]
        assert [signature.encode(kind) for kind in types] == one.signature
        signature.find(one.kernel)


def test_a_mission_calls_no_kernel_that_is_not_listed(default_run, listed):
    """Else `uv run python benchmarks/kernel_list.py` makes the list anew."""
    used = [json.loads(line) for line in default_run.kernels.read_text(encoding="utf-8").splitlines()]
    features = set(next(line for line in used if all(isinstance(one, str) for one in line)))
    foreseen = {(one.kernel, json.dumps(one.signature)) for one in listed if one.is_needed(features)}
    called = {(line[0], json.dumps(line[1])) for line in used if isinstance(line[-1], list)}
    assert called and not called - foreseen
    assert len(foreseen - called) < 0.2 * len(called)  # nor is much compiled that it does not need


@pytest.mark.parametrize("processes", [1, 2, 3, 8])
def test_shares_hold_everything_once_and_are_equal(listed, processes):
    shares = ahead.share_out(listed, processes)
    assert sorted(map(str, (one for share in shares for one in share))) == sorted(map(str, listed))
    work = [
        sum(map(digest.weight, set().union(*(digest.closure(signature.find(one.kernel)) for one in share))))
        for share in shares
    ]
    largest = max(sum(map(digest.weight, digest.closure(signature.find(one.kernel)))) for one in listed)
    assert max(work) <= max(1.1 * sum(work) / processes, 1.01 * largest)


def test_two_processes_fill_an_empty_cache(listed, tmp_path):
    code = (
        "from shefex_nav.compiled import ahead\n"
        f"wanted = ahead.without_file(one for one in ahead.entries() if one.kernel in {SMALL})\n"
        "done = []\n"
        "ahead.compile_all(wanted, 2, done.append)\n"
        "left = ahead.without_file(wanted)\n"
        "print(len(wanted), sorted(done) == sorted(one.kernel for one in wanted), left)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    count, same, left = done.stdout.split()
    assert int(count) >= 2 and (same, left) == ("True", "[]")


def test_a_process_that_fails_is_told(listed):
    wrong = listed[0]._replace(kernel="shefex_nav.geometry.rotation:quat_conjugate", signature=["float64"])
    with pytest.raises(ahead.CompilerFailed, match="TypingError"):
        ahead.compile_all([wrong], 2)


@pytest.mark.skipif(os.name != "posix", reason="asks for a process by its number")
def test_processes_end_with_the_one_that_wanted_them(tmp_path):
    """Its standard input is closed when that one ends, however it ends."""
    code = (
        "import os\n"
        "from queue import SimpleQueue\n"
        "from shefex_nav.compiled import ahead\n"
        "wanted = [one for one in ahead.entries() if one.kernel.endswith('solve_kernel')]\n"
        "print(ahead._Process(wanted, SimpleQueue()).process.pid, flush=True)\n"
        "os._exit(9)\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    pid = int(subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True).stdout)
    until = time.monotonic() + 60.0
    while _is_alive(pid) and time.monotonic() < until:
        time.sleep(0.1)
    assert not _is_alive(pid)


def _is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_kernel_that_the_program_no_longer_has_is_left_out():
    gone = ahead.Entry("shefex_nav.geometry.rotation:nothing", ["float64"], [])
    assert not ahead._has_no_file(gone)
    with pytest.raises(signature.UnknownType, match="no shefex_nav"):
        signature.find(gone.kernel)
