"""Commands say that a limit of the shell leaves too little memory: libraries crash, or wait for ever."""

import subprocess
import sys

import pytest

from shefex_nav.commands import shell

resource = pytest.importorskip("resource")


@pytest.mark.parametrize("words", [("check", "night_sky"), ("campaign", "night_sky"), ("schema",)])
def test_too_little_memory_is_told(tmp_path, words):
    most = shell.LEAST // 2
    done = subprocess.run(
        [sys.executable, "-m", "shefex_nav", *words],
        capture_output=True, text=True, timeout=100, cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
    )  # fmt: skip
    assert done.returncode == 2 and list(tmp_path.iterdir()) == []
    assert done.stderr.splitlines()[-1].startswith(f"memory is limited to {most >> 10} kB; expected at least")


def test_memory_that_is_not_there_is_told(monkeypatch, command):
    def full():
        raise MemoryError("Unable to allocate 74 GiB")

    monkeypatch.setattr(shell, "check", full)
    done = command("schema")
    assert done.code == 2 and done.err == "there is not enough memory: Unable to allocate 74 GiB\n"
