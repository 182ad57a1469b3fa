"""Experiments that are kept: interrupted and continued they give the same, and foreign files are refused."""

import contextlib
import signal

import numpy as np
import pytest
from typer.testing import CliRunner

from shefex_nav import progress
from shefex_nav.commands.app import app
from shefex_nav.papers import engine, keep, registry
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.verdict import Verdict

CALLS = []


def measure(samples, seed, first):
    CALLS.append(first)
    numbers = first + np.arange(samples)
    return {"number": numbers, "value": np.random.default_rng(seed).standard_normal(samples)}


def conclude(results):
    values = np.concatenate([result["value"] for result in results])
    return [Row("mean", "", 0.0, float(values.mean()), None, Verdict.REPRODUCED, 0.1)]


def draw(figure, results, rows):
    figure.subplots().plot(np.concatenate([result["value"] for result in results]))


KEPT = Experiment(
    100, "numbers", 10, measure, conclude, draw, title="kept numbers", designed=True, kept=("keep",)
)


class Interruption(Exception):
    pass


def outcome(folder, samples=95, seed=3, progress=lambda n: None, experiment=KEPT):
    CALLS.clear()
    return engine.run(
        experiment, samples=samples, seed=seed, workers=1, progress=progress,
        store=keep.store(experiment, seed, folder),
    )  # fmt: skip


def interrupted_after(chunks):
    done = []

    def progress(n):
        done.append(n)
        if len(done) == chunks:
            raise Interruption

    return progress


def test_interrupted_and_continued_is_as_uninterrupted(tmp_path):
    whole = engine.run(KEPT, samples=95, seed=3, workers=1)
    with pytest.raises(Interruption):
        outcome(tmp_path, progress=interrupted_after(4))
    assert len(list(tmp_path.iterdir())) == 4
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    again = outcome(tmp_path)
    assert CALLS == [0, 40, 50, 60, 70, 80, 90]  # the first one warms up; four chunks were there
    assert again.rows == whole.rows
    for one, other in zip(again.results, whole.results, strict=True):
        assert one.keys() == other.keys()
        for name in one:
            np.testing.assert_array_equal(one[name], other[name], strict=True)
    np.testing.assert_array_equal(np.concatenate([r["number"] for r in again.results]), np.arange(95))
    assert all(path.read_bytes() == content for path, content in before.items())
    outcome(tmp_path)
    assert CALLS == []  # nothing was left to do, not even to compile
    assert not list(tmp_path.glob("*.part"))


def test_a_larger_sample_goes_on_from_a_smaller_one(tmp_path):
    outcome(tmp_path, samples=40)
    larger = outcome(tmp_path, samples=80)
    assert CALLS == [0, 40, 50, 60, 70]
    assert larger.rows == engine.run(KEPT, samples=80, seed=3, workers=1).rows


def test_seeds_have_files_of_their_own(tmp_path):
    outcome(tmp_path, samples=20, seed=3)
    outcome(tmp_path, samples=20, seed=4)
    assert len(list(tmp_path.iterdir())) == 4


@pytest.mark.parametrize(
    ("key", "value", "says"), [("code", "0123", "code: 0123 there"), ("seed", 8, "seed: 8 there")]
)
def test_a_foreign_file_is_refused(key, value, says, tmp_path):
    store = keep.store(KEPT, 3, tmp_path)
    foreign = keep.Store(tmp_path, store.head | {key: value}, KEPT.chunk)
    foreign.save(1, 10, measure(10, 5, 10))
    foreign.path(1).rename(store.path(1)) if foreign.path(1) != store.path(1) else None
    with pytest.raises(keep.StoreError, match=says):
        outcome(tmp_path)


def test_the_last_chunk_of_another_size_is_refused(tmp_path):
    outcome(tmp_path, samples=95)
    with pytest.raises(keep.StoreError, match=r"samples: 5 there, 10 here.* multiple of 10, a whole chunk"):
        outcome(tmp_path, samples=200)
    keep.store(KEPT, 3, tmp_path).path(9).unlink()  # as the message says
    assert outcome(tmp_path, samples=200).rows == engine.run(KEPT, samples=200, seed=3, workers=1).rows


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"not an archive at all" * 20])
def test_a_damaged_file_is_refused_and_stays(content, tmp_path):
    path = keep.store(KEPT, 3, tmp_path).path(2)
    path.write_bytes(content)
    with pytest.raises(keep.StoreError, match="damaged"):
        outcome(tmp_path)
    assert path.read_bytes() == content


def test_a_cut_file_is_refused(tmp_path):
    outcome(tmp_path)
    path = keep.store(KEPT, 3, tmp_path).path(5)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(keep.StoreError, match="damaged"):
        outcome(tmp_path)


def test_nothing_is_overwritten(tmp_path):
    store = keep.store(KEPT, 3, tmp_path)
    store.save(0, 10, {"value": np.zeros(10)})
    with pytest.raises(keep.StoreError, match="another run"):
        store.save(0, 10, {"value": np.ones(10)})
    np.testing.assert_array_equal(store.load(0, 10)["value"], 0.0)


def test_the_fingerprint_follows_the_code(monkeypatch, tmp_path):
    """One byte of a file in a copy of the package, of the same length and under the same name."""
    copy = tmp_path / "shefex_nav"
    for name in ("papers/keep.py", "papers/engine.py", "onboard/startracker/streaks.py", "records.py"):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).write_bytes((keep.PACKAGE / name).read_bytes())
    monkeypatch.setattr(keep, "PACKAGE", copy)
    monkeypatch.setattr(keep, "WORLD", ("records.py", "onboard"))
    before = keep.code_digest(("keep",))
    assert before == keep.code_digest(("keep",)) != keep.code_digest(("keep", "engine"))
    for name, counts in (
        ("papers/keep.py", True), ("onboard/startracker/streaks.py", True), ("records.py", True),
        ("papers/engine.py", False),
    ):  # fmt: skip
        content = (copy / name).read_bytes()
        (copy / name).write_bytes(content[:100] + bytes([content[100] ^ 1]) + content[101:])
        assert (keep.code_digest(("keep",)) != before) is counts, name
        (copy / name).write_bytes(content)
        assert keep.code_digest(("keep",)) == before


@pytest.mark.parametrize("name", [one for one in registry.EXPERIMENTS if registry.load(one).kept])
def test_what_makes_the_results_of_an_experiment_is_there(name):
    """Its module, and the methods of its paper, are in the fingerprint."""
    experiment = registry.load(name)
    assert experiment.measure.__module__.removeprefix(keep.PAPERS) in experiment.kept
    assert "impa.methods" in experiment.kept and keep.code_digest(experiment.kept)


def reproduce(*arguments):
    return CliRunner().invoke(app, ["reproduce", *(str(one) for one in arguments)])


def measure_until_interrupted(samples, seed, first):
    if first >= 40:
        raise KeyboardInterrupt  # as from Ctrl-C
    return measure(samples, seed, first)


@pytest.mark.parametrize("kept", [True, False])
def test_an_interrupted_command_says_what_is_left(kept, monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "EXPERIMENTS", {"kept": ("kept", "numbers")})
    monkeypatch.setattr(engine, "cores", lambda: 1)
    monkeypatch.setattr(registry, "load", lambda name: KEPT._replace(measure=measure_until_interrupted))
    folder = tmp_path / "kept"
    arguments = ("kept", "--samples", 95, "--out", tmp_path, *(("--keep", folder) if kept else ()))
    result = reproduce(*arguments)
    assert result.exit_code == 130 and result.stdout == ""
    if not kept:
        assert result.stderr.endswith("interrupted; nothing is kept, --keep FOLDER would\n")
        return
    words = f"interrupted; 4 of 10 chunks are kept in {folder}, the same command goes on from there\n"
    assert result.stderr.endswith(words)
    head = keep.store(KEPT._replace(measure=measure_until_interrupted), 1, folder)
    assert all(head.path(k).exists() == (k < 4) for k in range(10))


def measure_like_the_compiler(samples, seed, first):
    if first >= 40:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        if first == 40:
            return measure(samples, seed, first)  # the interrupt is swallowed
        raise RuntimeError("no compiled object yet")
    return measure(samples, seed, first)


@pytest.mark.parametrize("start", [0, 5])
def test_an_interrupt_that_the_compiler_swallows_counts(start, monkeypatch, tmp_path):
    """Whether what was interrupted goes on as if nothing had been, or fails with another exception."""

    def measured(samples, seed, first):
        return measure_like_the_compiler(samples, seed, first + start)

    monkeypatch.setattr(registry, "EXPERIMENTS", {"kept": ("kept", "numbers")})
    monkeypatch.setattr(engine, "cores", lambda: 1)
    monkeypatch.setattr(registry, "load", lambda name: KEPT._replace(measure=measured))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        result = reproduce("kept", "--samples", 95, "--out", tmp_path, "--keep", tmp_path / "kept")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert result.exit_code == 130
    kept = 5 if start == 0 else 4
    assert f"interrupted; {kept} of 10 chunks are kept" in result.stderr


def said_of_progress(total, step_s):
    """Lines about work of which each step takes so long."""
    said, now = [], [0.0]
    told = progress.lines(total, said.append, clock=lambda: now[0])
    for done in range(1, total + 1):
        now[0] += step_s
        told(done, f"{done} of {total} done")
    return said


def test_lines_of_progress_come_each_tenth_or_each_minute():
    assert said_of_progress(1000, 30.0) == [f"{k} of 1000 done" for k in range(2, 1000, 2)]
    assert said_of_progress(1000, 0.1) == [f"{k} of 1000 done" for k in range(100, 1000, 100)]
    assert said_of_progress(20, 0.0) == []  # done at once


def test_the_command_keeps_and_refuses(monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "EXPERIMENTS", {"kept": ("kept", "numbers")})
    monkeypatch.setattr(registry, "load", lambda name: KEPT)
    monkeypatch.setattr(engine, "cores", lambda: 1)
    folder = tmp_path / "kept"
    arguments = ("kept", "--samples", 30, "--out", tmp_path, "--keep", folder)
    assert reproduce(*arguments).exit_code == 0
    path = sorted(folder.iterdir())[1]
    path.write_bytes(b"spoilt")
    result = reproduce(*arguments)
    assert result.exit_code == 2 and result.stdout == ""
    shown = "".join(result.output.replace("│", "").split())  # the box may break a line anywhere
    assert "damaged" in result.output and path.name in shown
    monkeypatch.setattr(registry, "load", lambda name: KEPT._replace(kept=()))
    result = reproduce(*arguments)
    assert result.exit_code == 2 and "keeps no results" in result.output
