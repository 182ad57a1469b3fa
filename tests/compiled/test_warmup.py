"""Kernels are compiled before they are needed, and people are told."""

import json
import os
import subprocess
import sys

import pytest

from shefex_nav.scenario import load
from shefex_nav.scenario.block import choices

ROTATION = "shefex_nav.geometry.rotation"
CALL = f"import numpy as np; from {ROTATION} import quat_conjugate as f; f(np.ones(4)); f(np.ones(8)[::2])"


def python(code, cache, *folders):
    """Run code with an empty cache. -> what it said on stderr"""
    paths = {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": os.pathsep.join(map(str, folders))}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env={**os.environ, **paths}, capture_output=True, text=True, check=True)
    return done.stderr


def test_what_a_scenario_chooses(default_scenario):
    found = choices(load.load(default_scenario))
    assert {"launch", "navigation.gps=loose", "star_tracker.frames=rendered", "programme.task=spin"} <= found
    assert "orbit" not in found and not any("shefex2" in one for one in found)  # no names
    tight = choices(load.load(default_scenario.with_name("tight.yaml")))
    changed = {one for one in found ^ tight if one.startswith("navigation.gps")}
    assert changed == {"navigation.gps=loose", "navigation.gps=tight"}


def test_after_a_mission_its_kernels_are_there(default_run, default_scenario, command):
    done = command("warmup", default_scenario, "--json")
    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["compiled"] == 0 and result["kernels"] > 50 and not done.err


def test_warmup_of_a_broken_scenario_is_one_message(command, tmp_path):
    broken = tmp_path / "broken.yaml"
    broken.write_text("mission: 3\n", encoding="utf-8")
    done = command("warmup", broken)
    assert done.code == 2 and "broken.yaml" in done.err and "Traceback" not in done.err


def test_the_first_kernel_that_was_not_foreseen_is_told_once(tmp_path):
    said = python(f"from shefex_nav import warmup; warmup.get_ready(()); {CALL}", tmp_path)
    assert said.count("compiling kernels that this needs for the first time") == 1


def test_compiling_ahead_is_told(tmp_path):
    code = (
        "from shefex_nav import warmup\n"
        "from shefex_nav.compiled import ahead\n"
        f"small = [one for one in ahead.entries() if one.kernel == '{ROTATION}:quat_conjugate'][:1]\n"
        "warmup.compile_listed(small, 1)\n"
        "assert not ahead.without_file(small)\n"
    )
    assert python(code, tmp_path / "cache").splitlines() == [
        "compiling a kernel for this machine; later runs load what is compiled"
    ]
    other = tmp_path / "site" / "shefex_nav_kernels"
    (other / "cpython-39-numba0.1").mkdir(parents=True)
    other.joinpath("__init__.py").write_text("", encoding="utf-8")
    said = python(code, tmp_path / "new", tmp_path / "site").splitlines()
    assert len(said) == 2 and "shefex-nav-kernels are for cpython-39-numba0.1; here is cpython-" in said[0]


def test_nothing_is_compiled_ahead_that_could_not_be_kept(tmp_path):
    folder = tmp_path / "file"
    folder.write_text("no folder", encoding="utf-8")
    code = "from shefex_nav import warmup; warmup.get_ready({'command=solve_centroids'})"
    said = python(code, folder).splitlines()
    assert len(said) == 1 and "cannot be kept in" in said[0]  # and not: compiling 6 kernels


def test_warmup_without_a_folder_is_an_error(process, tmp_path):
    folder = tmp_path / "file"
    folder.write_text("no folder", encoding="utf-8")
    done = process("warmup", NUMBA_CACHE_DIR=str(folder))
    assert done.code == 2 and "ready" not in done.out and "Traceback" not in done.err
    assert "cannot be kept in" in done.err and "kernels are missing" in done.err


def test_a_process_that_fails_is_told_and_the_job_goes_on(monkeypatch, capsys):
    from shefex_nav import warmup
    from shefex_nav.compiled import ahead

    def fail(wanted, workers=None):
        raise ahead.CompilerFailed("a.b: TypingError: no\na.c: TypingError: no")

    monkeypatch.setattr(warmup, "compile_listed", fail)
    monkeypatch.setattr(warmup, "_done", set())
    warmup.get_ready(())
    (line,) = capsys.readouterr().err.splitlines()
    assert "(a.b: TypingError: no, and 1 more)" in line and "when called" in line


def test_a_job_goes_on_with_an_old_list(tmp_path, monkeypatch, capsys):
    from shefex_nav import warmup
    from shefex_nav.compiled import ahead, numba_hooks
    from shefex_nav.compiled.store import Store

    stale = ahead.Entry(f"{ROTATION}:quat_conjugate", ["float64"], [frozenset()])
    monkeypatch.setattr(ahead, "entries", lambda: [stale])
    monkeypatch.setattr(numba_hooks, "_STORE", Store("kind", tmp_path))
    monkeypatch.setattr(warmup, "_done", set())
    warmup.get_ready(())
    assert "quat_conjugate: TypingError" in capsys.readouterr().err.splitlines()[-1]


def test_warmup_tells_what_could_not_be_compiled(command, tmp_path, monkeypatch):
    from shefex_nav.compiled import ahead, numba_hooks
    from shefex_nav.compiled.store import Store

    stale = ahead.Entry(f"{ROTATION}:quat_conjugate", ["float64"], [])
    monkeypatch.setattr(ahead, "entries", lambda: [stale])
    monkeypatch.setattr(numba_hooks, "_STORE", Store("kind", tmp_path))
    done = command("warmup")
    assert done.code == 2 and "ready" not in done.out and "Traceback" not in done.err
    assert done.err.count("quat_conjugate: TypingError") == 1


def test_warmup_counts_what_is_kept(command, tmp_path, monkeypatch):
    """A disk may become full meanwhile."""
    from shefex_nav.compiled import ahead, numba_hooks
    from shefex_nav.compiled.store import Store

    monkeypatch.setattr(ahead, "compile_all", lambda wanted, workers, step: None)
    monkeypatch.setattr(numba_hooks, "_STORE", Store("kind", tmp_path))
    done = command("warmup")
    assert done.code == 2 and "ready" not in done.out
    assert "kernels are missing" in done.err and "kept" in done.err


@pytest.mark.parametrize("setting", ["NUMBA_CPU_NAME", "OPENBLAS_CORETYPE", "OMP_NUM_THREADS"])
def test_what_the_user_has_set_stays(setting):
    from shefex_nav.compiled import target

    ours = "NUMBA", "OPENBLAS", "OMP"
    clean = {name: text for name, text in os.environ.items() if not name.startswith(ours)}
    wanted = {
        "NUMBA_CPU_NAME": target.baseline().kernels,
        "OPENBLAS_CORETYPE": target.baseline().algebra,
        "OMP_NUM_THREADS": "1",
    }
    code = f"import os, shefex_nav; print(os.environ.get({setting!r}))"
    for own, expected in (({}, wanted[setting]), ({setting: "mine"}, "mine")):
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env={**clean, **own}, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == str(expected)
