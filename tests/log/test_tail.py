"""Logs while they are written: slices together are the whole, and nothing is taken before it is whole."""

import os

import numpy as np
import pytest
import synthetic_run

from shefex_nav.log import reader
from shefex_nav.log.mcap_file import MAGIC
from shefex_nav.log.run_data import join
from shefex_nav.log.tail import Tail
from shefex_nav.log.topics import LogError
from shefex_nav.log.writer import LogWriter

SHORT = synthetic_run.Options(start_s=230.0, end_s=236.0)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("tail") / "run.mcap"
    with LogWriter(path, synthetic_run.mission(start_s=SHORT.start_s), synthetic_run.THRESHOLDED) as writer:
        for record in (*synthetic_run.simulate(SHORT), synthetic_run.summary(SHORT)):
            writer.write(record)
    return path


def slices(tail, path):
    """RunData of what is new, in a list of none or one."""
    return [reader.read(path)] if tail.write_slice(path) else []


@pytest.mark.parametrize("step", [997, 50_021])
def test_slices_together_are_the_log(log, tmp_path, step):
    whole, content, grown = reader.read(log), log.read_bytes(), tmp_path / "grown.mcap"
    parts = []
    with Tail(grown) as tail:
        assert not slices(tail, tmp_path / "slice.mcap")  # there is none yet
        for end in range(step, len(content) + step, step):
            assert not tail.is_complete
            grown.write_bytes(content[:end])
            parts += slices(tail, tmp_path / "slice.mcap")
        assert tail.is_complete and not slices(tail, tmp_path / "slice.mcap")
    assert len(parts) > 5
    for name in ("truth", "nav", "imu", "covariance"):
        joined = join([getattr(part, name) for part in parts])
        for mine, written in zip(joined, getattr(whole, name), strict=True):
            np.testing.assert_array_equal(mine, written)
    for name in ("star_fixes", "gps", "events", "gates"):
        assert sum(len(getattr(part, name)) for part in parts) == len(getattr(whole, name)), name
    for part in parts:
        assert part.mission.seed == whole.mission.seed
        assert part.mission.scenario_text == whole.mission.scenario_text
        assert np.array_equal(part.mission.C_bc, whole.mission.C_bc)


def test_other_readers_find_the_messages_of_a_slice(log, tmp_path):
    from rerun.chunk import McapReader

    found = tmp_path / "slice.mcap"
    with Tail(log) as tail:
        assert tail.write_slice(found)
    counts = {one.topic: one.message_count for one in McapReader(found, recover=True).info().channels}
    assert counts["/truth/state"] == len(reader.read(log).truth.t_s)


def first_chunk(content):
    """Where the first chunk of a log begins."""
    at = len(MAGIC)
    while content[at] != 6:
        at += 9 + int.from_bytes(content[at + 1 : at + 9], "little")
    return at


def test_a_chunk_whose_length_is_not_known_yet_waits(log, tmp_path):
    content, grown = log.read_bytes(), tmp_path / "grown.mcap"
    at = first_chunk(content)
    unknown = content[: at + 1] + b"\xff" * 8 + content[at + 9 : at + 5000]  # as its writer leaves it
    with Tail(grown) as tail:
        grown.write_bytes(unknown)
        assert not slices(tail, tmp_path / "slice.mcap")
        grown.write_bytes(content)
        assert len(slices(tail, tmp_path / "slice.mcap")) == 1 and tail.is_complete


def test_an_old_log_is_not_taken_for_the_new_one(log, tmp_path):
    grown = tmp_path / "grown.mcap"
    grown.write_bytes(log.read_bytes())
    changed_ns = os.stat(grown).st_mtime_ns
    for old_ns, is_taken in ((changed_ns, False), (changed_ns + 1, True)):  # the clock may have been set back
        with Tail(grown, old_ns) as tail:
            assert tail.write_slice(tmp_path / "slice.mcap") == is_taken


def test_what_is_no_log_is_refused(tmp_path):
    other = tmp_path / "other.mcap"
    other.write_text("seven bytes and more")
    with pytest.raises(LogError, match="not an MCAP file"):
        Tail(other).write_slice(tmp_path / "slice.mcap")
    with pytest.raises(LogError, match="cannot be read"):
        Tail(tmp_path).write_slice(tmp_path / "slice.mcap")
