"""benchmarks/walk.py: how it counts files and moves, and how far a star frame may walk."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent.parent / "benchmarks" / "walk.py"
FRAME, SAMPLES = (27, 108), (20, 132)  # files, moves: no more than on the day they were last shortened


@pytest.fixture
def walk(monkeypatch):
    monkeypatch.syspath_prepend(str(SCRIPT.parent))
    spec = importlib.util.spec_from_file_location("walk", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_calls_and_moves_are_counted(walk):
    """a calls a, then b, which calls c; both return: three files, and there and back twice."""
    one = walk.Walk()
    for name in ("a.py", "a.py", "b.py", "c.py"):
        one.enter(str(walk.PACKAGE / name))
    for _ in range(4):
        one.leave()
    found = one.figures()
    assert (found["files"], found["calls"], found["moves"]) == (3, 4, 4)
    there = {("a.py", "b.py"): 1, ("b.py", "c.py"): 1}
    assert dict(one.moves) == there | {(y, x): 1 for x, y in there}


@pytest.mark.slow
def test_a_frame_walks_no_further():
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--only", "compiled", "--json"], stdout=subprocess.PIPE, check=True
    )
    found = json.loads(done.stdout)["compiled"]
    for what, (files, moves) in {"frame": FRAME, "samples": SAMPLES}.items():
        whole = found[what]["all"]
        assert whole["files"] <= files and whole["moves"] <= moves, what
