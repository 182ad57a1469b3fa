"""What of a campaign is refused because it would fill the memory, has no end, or would write elsewhere."""

import json
import math
import os
import re
import subprocess
import sys

import pytest
import synthetic_campaign

from shefex_nav import files
from shefex_nav.campaign import head as heads
from shefex_nav.campaign import results, running, store, table

HEAD = {
    **{name: types[0]() for name, types in heads.HEAD.items()},
    "format": 2, "sampling": "random", "flight": "shared", "rate": 1.0, "runs": 1,
}  # fmt: skip
DEEP = 100_000
HEADS = {
    "[" * DEEP: "cannot be read: too many lists and objects within each other",
    '{"a":' * DEEP: "cannot be read: too many lists and objects within each other",
    "{}": "its format is None",
    json.dumps(HEAD | {"runs": 10_000_001}): "runs: got 10000001, expected 1 to 10000000",
    json.dumps(HEAD | {"seed": -5}): "seed: got -5, expected 0 or more",
    json.dumps(HEAD | {"rate": 3e6}): "rate: got 3000000.0, expected 1e-6 to 100 Hz",
    json.dumps(HEAD | {"rate": math.nan}): "rate: got nan, expected",
    json.dumps(HEAD | {"wall_s": math.nan}): "wall_s: got nan, expected",
    json.dumps(HEAD | {"sampling": "zz"}): "sampling: got 'zz', expected random or latin_hypercube",
    json.dumps(HEAD | {"timed": {}}): "timed: got {}, expected a number of runs",
    json.dumps(HEAD | {"timed": {"runs": 10**400, "wall_s": 1}}): "timed: got {'runs': 1000",
    json.dumps(HEAD | {"timed": {"runs": 1, "wall_s": 1e-320}}): "timed: got",
    json.dumps(HEAD | {"dispersions": {"x": [1]}}): "dispersions: got {'x': [1]}, expected an object",
    json.dumps(HEAD | {"asked_before": ["x"]}): "asked_before: got ['x'], expected a list",
    json.dumps(HEAD | {"runs": "x"}): "runs: got str, expected int",
    json.dumps(HEAD | {"runs": None}): "runs: got NoneType, expected int",
}


@pytest.mark.parametrize("content", HEADS, ids=HEADS.values())
def test_a_damaged_head_is_refused_in_words(content, tmp_path):
    (tmp_path / "campaign.json").write_text(content)
    with pytest.raises(store.StoreError) as refused:
        heads.read_head(tmp_path)
    assert HEADS[content] in str(refused.value)


def test_a_head_of_the_most_runs_is_read(tmp_path):
    (tmp_path / "campaign.json").write_text(json.dumps(HEAD | {"runs": 10_000_000, "seed": 10**50}))
    assert heads.read_head(tmp_path)["runs"] == 10_000_000


@pytest.mark.parametrize("warnings", ["[" * DEEP, "junk", "3", '[{"field": "x"}]'])
def test_warnings_of_a_run_that_are_none_are_refused_in_words(warnings):
    with pytest.raises(table.TableError, match=r"^results\.parquet: spoilt: "):
        results._said(warnings, "results.parquet")
    assert results._said('[{"field": "gps", "text": "late"}]', "results.parquet") == ["gps: late"]


def test_more_runs_than_fit_into_memory_are_refused():
    asked = running.Request(None, 10_000_001, 1, None, None, ())
    with pytest.raises(running.BadCampaign, match="10000001; expected 10000000 at most"):
        running.checked(asked)
    assert running.checked(asked._replace(runs=10_000_000)).runs == 10_000_000


@pytest.mark.parametrize("name", store.OWN)
def test_links_in_a_folder_are_not_written_through(tmp_path, name):
    """The folder of somebody else's may have them lead to any file."""
    mine = tmp_path / "mine.txt"
    mine.write_text("precious")
    folder = tmp_path / "campaign"
    folder.mkdir()
    (folder / name).symlink_to(mine)
    with pytest.raises(store.StoreError, match=f"{re.escape(name)} is a symbolic link"), store.Store(folder):
        pass
    assert mine.read_text() == "precious"


def test_a_half_written_file_that_is_a_link_is_replaced(tmp_path):
    mine, path = tmp_path / "mine.txt", tmp_path / "results.json"
    mine.write_text("precious")
    files.part(path).symlink_to(mine)
    files.put(path, "new")
    assert (mine.read_text(), path.read_text()) == ("precious", "new") and not path.is_symlink()


def test_a_lock_that_holds_something_is_not_emptied(tmp_path):
    (tmp_path / ".lock").write_text("precious")
    with store.Store(tmp_path):
        pass
    assert (tmp_path / ".lock").read_text() == "precious"


@pytest.mark.parametrize("name", ["campaign.json", "results.parquet", "runs.sqlite", ".lock"])
@pytest.mark.parametrize("kind", ["a pipe", "a device"])
def test_a_folder_with_a_pipe_or_a_device_is_refused(tmp_path, name, kind):
    """Nobody writes to the pipe: a reader would wait for ever; the device never ends."""
    folder, whole = (synthetic_campaign.write(tmp_path / one, 3) for one in ("other", "whole"))
    (folder / name).unlink(missing_ok=True)
    if kind == "a pipe":
        os.mkfifo(folder / name)
    else:
        (folder / name).symlink_to("/dev/zero")
    for words in (["report", folder], ["repeat", folder, "0"], ["compare", folder, whole]):
        if name in (".lock", "results.parquet"):  # is not read
            continue
        done = subprocess.run(
            [sys.executable, "-m", "shefex_nav", *map(str, words)], capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
        assert f"is {kind}, expected a file" in done.stderr
    if name == "results.parquet":
        with pytest.raises(files.IrregularError):
            next(table.load(folder / name))
        return
    wrong = pytest.raises((store.StoreError, files.IrregularError), match=rf"is {kind}|symbolic link")
    with wrong, store.Store(folder) as kept:
        kept.head(), kept.runs
