"""Damaged, foreign and missing files, and that a file gives back the run."""

import numpy as np
import pytest
import synthetic_run
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import Writer

from shefex_nav.log import reader, run_data, topics, wire
from shefex_nav.log.run_data import ARRAYS, RunDataBuilder
from shefex_nav.log.topics import LogError
from shefex_nav.log.writer import LogWriter

OPTIONS = synthetic_run.Options(start_s=231.0, end_s=241.0)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """(path of the log, RunData of the same records in memory)."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    mission = synthetic_run.mission(start_s=OPTIONS.start_s)
    builder = RunDataBuilder(mission)
    with LogWriter(path, mission, synthetic_run.THRESHOLDED) as log:
        for record in (*synthetic_run.simulate(OPTIONS), synthetic_run.summary(OPTIONS)):
            log.write(record)
            builder.add(record)
    return path, builder.build()


def assert_equal(a, b, where=""):
    assert type(a) is type(b), where
    if hasattr(a, "_fields"):
        for name in a._fields:
            assert_equal(getattr(a, name), getattr(b, name), f"{where}.{name}")
    elif isinstance(a, list):
        assert len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_equal(x, y, f"{where}[{k}]")
    elif isinstance(a, dict):
        assert list(a) == list(b), where
        for name in a:
            assert_equal(a[name], b[name], f"{where}[{name}]")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        np.testing.assert_array_equal(a, b, err_msg=where)
    else:
        assert a == b or (a != a and b != b), where


def test_the_file_gives_back_the_run(run):
    path, in_memory = run
    assert_equal(reader.read(path), in_memory)


def test_arrays_made_on_the_way_are_those_made_at_the_end(run, monkeypatch):
    """However many records wait until they are stacked."""
    monkeypatch.setattr(run_data, "_STACK_ROWS", 7)
    builder = RunDataBuilder(synthetic_run.mission(start_s=OPTIONS.start_s))
    for record in (*synthetic_run.simulate(OPTIONS), synthetic_run.summary(OPTIONS)):
        builder.add(record)
    assert_equal(builder.build(), run[1])


def test_a_run_without_records_is_read(tmp_path):
    path = tmp_path / "run.mcap"
    with LogWriter(path, synthetic_run.mission(), synthetic_run.NO_PIXELS):
        pass
    data = reader.read(path)
    assert np.isnan(data.last_t_s)
    for name in ARRAYS.values():
        if name != "timing":
            assert len(getattr(data, name)[0]) == 0
    assert data.ended_early
    assert_equal(data._replace(ended_early=False), RunDataBuilder(synthetic_run.mission()).build())


def test_a_file_cut_anywhere_is_read_up_to_there_or_refused(run, tmp_path):
    path, whole = run
    data = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    last = -np.inf
    lengths = np.unique(np.linspace(0, len(data) - 1, 60).astype(int))
    for length in lengths:
        cut.write_bytes(data[:length])
        try:
            found = reader.read(cut)
        except LogError:
            assert length < 0.1 * len(data)  # before the constants of the run
            continue
        assert found.ended_early
        if not np.isnan(found.last_t_s):
            assert found.last_t_s >= last
            last = found.last_t_s
            assert_equal(found.truth.r_i, whole.truth.r_i[: len(found.truth.r_i)])
    assert last == whole.last_t_s


def test_what_follows_the_end_of_a_log_is_an_error(run, tmp_path):
    """`cat a.mcap a.mcap`: the second was passed over without a word."""
    whole = run[0].read_bytes()
    for more, words in ((whole, "another log begins there"), (b"\0", "nothing may follow")):
        path = tmp_path / "two.mcap"
        path.write_bytes(whole + more)
        with pytest.raises(LogError) as caught:
            reader.read(path)
        said = f"two.mcap: the log ends at byte {len(whole)}, {len(more)} bytes follow; {words}"
        assert said in str(caught.value)


def test_damage_in_the_middle_is_an_error(run, tmp_path):
    path, _ = run
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    with pytest.raises(LogError, match="damaged"):
        reader.read(damaged)


@pytest.mark.parametrize("where", [b"epoch_utc", b"scenario.yaml"])
def test_a_bit_outside_of_the_chunks_is_noticed(run, where, tmp_path):
    """In the scenario, which is an attachment, and in the metadata."""
    path, _ = run
    data = bytearray(path.read_bytes())
    at = data.find(where) + len(where) + 12
    assert at > 100
    data[at] ^= 0x01
    (tmp_path / "damaged.mcap").write_bytes(data)
    with pytest.raises(LogError, match="damaged"):
        reader.read(tmp_path / "damaged.mcap")


def test_a_chunk_that_would_fill_the_memory_is_refused(run, tmp_path):
    """A hundred megabytes of zeros are a few kilobytes packed."""
    path, _ = run
    builder = RecordBuilder()
    Chunk("zstd", zstandard.compress(bytes(300 << 20)), 0, 0, 0, 100).write(builder)
    (tmp_path / "bomb.mcap").write_bytes(path.read_bytes()[:8] + builder.end() + bytes(9))
    with pytest.raises(LogError, match=r"bomb\.mcap: damaged .* a chunk of \d+ bytes claims 314572800 "):
        reader.read(tmp_path / "bomb.mcap")


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r", b"hello, I am a text file\n"])
def test_what_is_not_mcap_is_refused(content, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    with pytest.raises(LogError, match="not an MCAP file"):
        reader.read(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(LogError, match=r"nothing\.mcap: cannot be read: No such file"):
        reader.read(tmp_path / "nothing.mcap")
    with pytest.raises(LogError, match="cannot be read"):
        reader.read(tmp_path)


def foreign(path, metadata, schema_data):
    """An MCAP written by other software, with a topic that is named like one of ours."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        if metadata:
            writer.add_metadata(topics.METADATA, metadata)
        schema = writer.register_schema("shefex.Truth", "protobuf", schema_data)
        channel = writer.register_channel("/truth/state", "protobuf", schema)
        writer.add_message(channel, 0, b"\x09" + bytes(8), 0)
        writer.finish()


def test_the_mcap_of_somebody_else_is_refused(tmp_path):
    path = tmp_path / "other.mcap"
    foreign(path, None, b"")
    with pytest.raises(LogError, match="not a log of shefex_nav"):
        reader.read(path)


def test_the_log_of_another_version_is_refused(tmp_path):
    path = tmp_path / "other.mcap"
    foreign(path, {"format": "0", "version": "0.0.1"}, b"")
    with pytest.raises(LogError, match="format 0"):
        reader.read(path)
    imu = next(t for t in topics.topics() if t.schema == "ImuBlock")
    foreign(path, {"format": topics.FORMAT, "version": "0.0.1"}, wire.schema_bytes(imu))
    with pytest.raises(LogError, match="other fields"):
        reader.read(path)


def test_a_log_without_the_newest_fields_is_read_with_their_defaults(run, tmp_path, monkeypatch):
    """As written before rows had times of their own and fixes said how their objects were searched."""
    _, in_memory = run
    older = tuple(
        topic._replace(
            fields=tuple(
                field
                for field in topic.fields
                if field.source.partition(".")[0] not in topic.record._field_defaults
            )
        )
        for topic in topics.topics()
    )
    assert older != topics.topics()
    path = tmp_path / "older.mcap"
    with monkeypatch.context() as before:
        before.setattr(topics, "topics", lambda: older)
        with LogWriter(path, synthetic_run.mission(), synthetic_run.NO_PIXELS) as log:
            for record in synthetic_run.simulate(OPTIONS):
                log.write(record)
    data = reader.read(path)
    assert len(data.frames.number) == len(in_memory.frames.number) > 10
    assert np.all(data.frames.line_s == 0.0) and np.all(data.frames.bits == 8)
    assert data.frames.line_s.shape == data.frames.number.shape
    assert_equal(data.frames._replace(image_dn=None), in_memory.frames._replace(image_dn=None))
    assert {fix.scan for fix in data.star_fixes} == {0}
    assert {len(fix.stars.hip) for fix in data.star_fixes} == {0}
    n = len(data.covariance.t_s)
    assert set(data.covariance.states) == {""} and data.covariance.sigmas.shape == (n, 0)
    assert in_memory.covariance.sigmas.shape == (n, 6)
    assert_equal(data.star_fixes[0].detections, in_memory.star_fixes[0].detections)


def test_a_log_that_lacks_what_has_no_default_is_refused(tmp_path):
    path = tmp_path / "other.mcap"
    truth = next(t for t in topics.topics() if t.schema == "Truth")
    shorter = truth._replace(fields=truth.fields[:-1])
    foreign(path, {"format": topics.FORMAT, "version": "0.0.1"}, wire.schema_bytes(shorter))
    with pytest.raises(LogError, match="other fields"):
        reader.read(path)


def test_how_far_a_log_goes_is_known_without_truth(run):
    _, data = run
    assert data.reached_s == data.last_t_s
    without = data._replace(last_t_s=np.nan)
    assert without.reached_s == data.nav.t_s[-1]
    nothing = without._replace(nav=data.nav._replace(t_s=data.nav.t_s[:0]))
    assert nothing.reached_s == data.mission.start_s
