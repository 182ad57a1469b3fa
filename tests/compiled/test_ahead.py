"""What is missing is compiled in several processes; the list of kernels is that of the program."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace

import pytest

from shefex_nav.compiled import ahead, digest, numba_hooks, signature
from shefex_nav.compiled.store import Store

SMALL = "shefex_nav.geometry.rotation:quat_conjugate", "shefex_nav.geometry.rotation:quat_normalise"

NOISY = """
from shefex_nav.compiled import kernel
print("a line of a user's module")
@kernel
def half(x):
    return 0.5 * x
"""


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


def test_every_listed_kernel_has_as_many_arguments(listed):
    """Else `uv run python benchmarks/kernel_list.py` makes the list anew."""
    stale = [
        f"{one.kernel}: {len(one.signature)} arguments in the list, {number} in the program"
        for one in listed
        if (number := ahead.n_arguments(signature.find(one.kernel))) != len(one.signature)
    ]
    assert not stale


def test_a_kernel_with_other_arguments_now_is_left_until_it_is_called(tmp_path):
    """It cannot be compiled for those that are listed; each start would try again."""
    code = (
        "from shefex_nav.compiled import ahead\n"
        f"one = next(one for one in ahead.entries() if one.kernel == {SMALL[0]!r})\n"
        "others = [one._replace(signature=one.signature + one.signature), one._replace(signature=[])]\n"
        "print(len(ahead.without_file([one])), ahead.without_file(others))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.split() == ["1", "[]"], done.stderr


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


def test_a_kernel_that_cannot_be_compiled_is_told_and_the_others_are_compiled(tmp_path, monkeypatch):
    """With a folder around that holds a file of the name of a module, and a module that prints."""
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "json.py").write_text("raise SystemExit('another module')", encoding="utf-8")
    (tmp_path / "noisy.py").write_text(NOISY, encoding="utf-8")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("SHEFEX_NAV_KERNELS_USED", str(tmp_path / "used"))
    wanted, done = [ahead.Entry("noisy:half", [text], []) for text in ("unicode_type", "float64")], []
    with pytest.raises(ahead.CompilerFailed, match=r"^noisy:half: TypingError: [^\n]+$"):
        ahead.compile_all(wanted, 1, done.append)
    assert done == ["noisy:half"] * 2
    assert [path.name.startswith("noisy.half") for path in tmp_path.rglob("*.kernel")] == [True]
    assert not (tmp_path / "used").exists()  # by a job


def test_a_process_that_ends_early_is_told(listed, tmp_path, monkeypatch):
    (tmp_path / "breaks.py").write_text("raise SystemExit('no more memory')", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(ahead, "WORKER", "breaks")
    with pytest.raises(ahead.CompilerFailed, match="ended with code 1: no more memory"):
        ahead.compile_all(listed[:1], 2)


def test_an_end_that_was_told_is_no_stop(tmp_path, monkeypatch):
    """A fault must not be lost between the last word of a process and the end of the thread that reads it."""
    (tmp_path / "breaks.py").write_text("raise SystemExit('no more memory')", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(ahead, "WORKER", "breaks")

    class Slow(SimpleQueue):
        def put(self, item):
            super().put(item)
            time.sleep(0.5)

    finished = Slow()
    process = ahead._Process([], finished)
    assert finished.get() is None
    assert "no more memory" in process.end()


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
    other = gone._replace(kernel="shefex_nav.geometry.rotation:quat_conjugate", signature=["nonsense"])
    no_kernel = gone._replace(kernel="shefex_nav.geometry.rotation:np")
    assert not ahead.without_file([gone, other, no_kernel])
    with pytest.raises(signature.UnknownType, match="no shefex_nav"):
        signature.find(gone.kernel)


@pytest.fixture
def small_store(tmp_path, monkeypatch):
    """A Store with files, though empty ones, of two kernels, which are all that are listed."""
    own = Store(numba_hooks.store().kind, tmp_path)
    few = [one for one in ahead.entries() if one.kernel in SMALL]
    monkeypatch.setattr(numba_hooks, "_STORE", own)
    monkeypatch.setattr(ahead, "entries", lambda: [one._replace(needs=[frozenset()]) for one in few])
    for one in few:
        args = tuple(signature.decode(text) for text in one.signature)
        own.save(signature.find(one.kernel)._cache.name(args), b"")
    return own


def _asked(monkeypatch, features=("command=run",)):
    """Kernels that are missing, and how many files had to be named for that."""
    named = []
    with monkeypatch.context() as patch:
        file = ahead._file
        patch.setattr(ahead, "_file", lambda *given: named.append(given) or file(*given))
        return [one.kernel for one in ahead.missing(set(features))], len(named)


def test_files_are_named_once(small_store, monkeypatch):
    missing, first = _asked(monkeypatch)
    assert not missing and first >= len(SMALL)
    assert _asked(monkeypatch) == ([], 0)
    assert _asked(monkeypatch, ["command=replay"]) == ([], first)


def test_files_are_named_again_when_the_program_is_another(small_store, monkeypatch):
    _asked(monkeypatch)
    monkeypatch.setattr(ahead, "__version__", "another")
    assert _asked(monkeypatch)[1] >= len(SMALL)


def test_a_source_that_is_written_anew_counts(small_store, monkeypatch):
    before, stat = ahead._sources(()), os.stat
    later = ahead.__file__

    def touched(path, **more):
        found = stat(path, **more)
        return SimpleNamespace(st_mtime_ns=found.st_mtime_ns + (str(path) == later), st_size=found.st_size)

    monkeypatch.setattr(ahead.os, "stat", touched)
    assert ahead._sources(()) != before


def test_a_kernel_that_has_gone_is_missing(small_store, monkeypatch):
    _asked(monkeypatch)
    gone = next(Path(small_store.own).glob("*quat_conjugate*.kernel"))
    gone.unlink()
    assert set(_asked(monkeypatch)[0]) == {SMALL[0]}


@pytest.mark.parametrize("content", [b"", b"foreign", None])
def test_names_that_are_damaged_are_found_anew(small_store, monkeypatch, content):
    """Empty, somebody else's, cut off."""
    _asked(monkeypatch)
    kept = next(Path(small_store.own).glob(f"{ahead.COMPLETE}-*"))
    whole = kept.read_bytes()
    kept.write_bytes(whole[:-5] if content is None else content)
    assert _asked(monkeypatch)[1] >= len(SMALL)
    assert kept.read_bytes() == whole and _asked(monkeypatch) == ([], 0)
