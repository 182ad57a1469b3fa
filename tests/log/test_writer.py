"""Files: what is in them, that equal runs give equal ones, what they cost, what a killed run leaves."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import synthetic_run
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from shefex_nav import records as rec
from shefex_nav.log import reader, topics
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.topics import LogError
from shefex_nav.log.writer import LogWriter

SHORT = synthetic_run.Options(start_s=230.0, end_s=250.0)


@pytest.fixture(scope="module")
def records():
    return [*synthetic_run.simulate(SHORT), synthetic_run.summary(SHORT)]


def write(path, records, policy=synthetic_run.THRESHOLDED):
    with LogWriter(path, synthetic_run.mission(start_s=SHORT.start_s), policy) as log:
        for record in records:
            log.write(record)
    return path


@pytest.fixture(scope="module")
def log(records, tmp_path_factory):
    return write(tmp_path_factory.mktemp("log") / "run.mcap", records)


def test_mcap_reads_every_topic(log):
    with log.open("rb") as file:
        source = make_reader(file, decoder_factories=[DecoderFactory()])
        counts = {}
        for schema, channel, message, decoded in source.iter_decoded_messages():
            assert channel.message_encoding == schema.encoding == "protobuf"
            assert decoded.DESCRIPTOR.full_name == schema.name
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if schema.name.startswith("shefex."):
                assert decoded.timestamp_ns == message.log_time
    assert counts["/truth/state"] == counts["/imu"] == counts["/nav/solution"] == 2001
    assert counts["/nav/covariance"] == 201
    assert counts["/tf"] == 2 * 401
    assert counts["/truth/pose"] == counts["/nav/pose"] == 401
    for topic in ("/star_tracker/image", "/star_tracker/annotations", "/star_tracker/fix", "/truth/frame"):
        assert counts[topic] == 201
    assert counts["/star_tracker/calibration"] == counts["/mission"] == counts["/nav/alignment"] == 1
    assert {topic.topic for topic in topics.topics()} <= set(counts)


def test_scenario_and_origin_travel_in_the_file(log):
    mission = synthetic_run.mission()
    with log.open("rb") as file:
        source = make_reader(file)
        attachment = next(source.iter_attachments())
        metadata = next(source.iter_metadata())
    assert attachment.name == "scenario.yaml"
    assert attachment.data.decode() == mission.scenario_text
    assert metadata.metadata["seed"] == "1"
    assert metadata.metadata["scenario"] == "made_up"
    assert metadata.metadata["version"] == mission.version
    assert metadata.metadata["epoch_utc"] == mission.epoch_utc


def contents(path):
    """All messages but the measured times, in the order of the file, and what else is in it."""
    with path.open("rb") as file:
        source = make_reader(file)
        messages = [
            (channel.topic, schema.name, schema.data, message.log_time, message.data)
            for schema, channel, message in source.iter_messages(log_time_order=False)
            if channel.topic != "/timing"
        ]
        return messages, [m.metadata for m in source.iter_metadata()], list(source.iter_attachments())


def test_records_stand_in_the_order_in_which_they_came(records, log):
    topic_of = {topic.record: topic.topic for topic in topics.topics()}
    topic_of[rec.ComputeTime] = topic_of[topics.RunSummary] = topic_of[topics.Timing]
    with log.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=list(topic_of.values()), log_time_order=False)
        found = [channel.topic for _, channel, _ in messages]
    assert found == ["/mission", *(topic_of[type(record)] for record in records)]


def test_runs_that_differ_in_measured_times_alone_have_equal_records(records, tmp_path):
    slower = [
        r._replace(chain_s=2.0 * r.chain_s)
        if isinstance(r, rec.ComputeTime)
        else r._replace(wall_s=9.0)
        if isinstance(r, topics.RunSummary)
        else r
        for r in records
    ]
    first, second = write(tmp_path / "a.mcap", records), write(tmp_path / "b.mcap", slower)
    assert contents(first) == contents(second)
    assert reader.read(first).compute_times.chain_s[0] != reader.read(second).compute_times.chain_s[0]


def test_frame_policies(records, tmp_path):
    def images(policy, name):
        found = {"/star_tracker/image": [], "/star_tracker/image_full": []}
        with write(tmp_path / name, records, policy).open("rb") as file:
            source = make_reader(file, decoder_factories=[DecoderFactory()])
            for _, channel, _, decoded in source.iter_decoded_messages(topics=list(found)):
                assert (decoded.width, decoded.height, decoded.step) == (659, 493, 659)
                found[channel.topic].append(np.frombuffer(decoded.data, np.uint8).reshape(493, 659))
        return found["/star_tracker/image"], found["/star_tracker/image_full"]

    sky = next(r.image_dn for r in records if isinstance(r, rec.Frame))
    shown, full = images(FramePolicy(10, "thresholded", 4.0), "a.mcap")
    assert len(shown) == 201
    assert len(full) == 21  # numbers 80, 90 ... 280
    np.testing.assert_array_equal(full[0], sky)
    assert np.count_nonzero(shown[0]) < 0.01 * sky.size
    assert images(FramePolicy(1, "none", 4.0), "b.mcap")[0] == []
    assert images(FramePolicy(0, "none", 4.0), "c.mcap") == ([], [])


def test_a_mission_without_full_frames_stays_below_60_MB(log):
    duration_s = SHORT.end_s - SHORT.start_s  # the star tracker works all the time, more than in the mission
    assert log.stat().st_size * 505.0 / duration_s < 60e6


@pytest.mark.slow
def test_writing_a_mission_costs_less_than_two_seconds_of_cpu(tmp_path):
    records = list(synthetic_run.simulate())
    costs = []
    for k in range(3):
        begin = time.process_time()
        with LogWriter(tmp_path / f"{k}.mcap", synthetic_run.mission(), synthetic_run.THRESHOLDED) as log:
            for record in records:
                log.write(record)
        costs.append(time.process_time() - begin)
    assert min(costs) < 2.0


def test_an_existing_file_is_kept(records, tmp_path):
    path = write(tmp_path / "run.mcap", records[:10])
    before = path.read_bytes()
    with pytest.raises(LogError, match="exists already"):
        write(path, records[:10])
    assert path.read_bytes() == before
    with LogWriter(path, synthetic_run.mission(), synthetic_run.NO_PIXELS, overwrite=True):
        pass
    assert path.read_bytes() != before


def test_a_file_that_cannot_be_written_is_a_clear_error(tmp_path):
    with pytest.raises(LogError, match="no folder"):
        LogWriter(tmp_path / "nowhere" / "run.mcap", synthetic_run.mission(), synthetic_run.NO_PIXELS)
    with pytest.raises(LogError, match="cannot be written"):
        LogWriter(tmp_path, synthetic_run.mission(), synthetic_run.NO_PIXELS, overwrite=True)


def test_something_else_is_not_logged(tmp_path):
    with LogWriter(tmp_path / "run.mcap", synthetic_run.mission(), synthetic_run.NO_PIXELS) as log:
        with pytest.raises(TypeError, match="not a record of the log"):
            log.write((1.0, 2.0))


def test_an_exception_leaves_a_complete_file(records, tmp_path):
    path = tmp_path / "run.mcap"
    with pytest.raises(RuntimeError, match="diverged"):
        with LogWriter(path, synthetic_run.mission(), synthetic_run.NO_PIXELS) as log:
            for record in records[:3000]:
                log.write(record)
            raise RuntimeError("diverged")
    data = reader.read(path)
    assert data.ended_early  # whole messages to the last, but the run was not over
    assert data.last_t_s == [r.t_s for r in records[:3000] if isinstance(r, rec.TruthSample)][-1]


KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[1])
import synthetic_run
from shefex_nav.log.writer import LogWriter
options = synthetic_run.Options(start_s=228.0, end_s=240.0)
log = LogWriter(sys.argv[2], synthetic_run.mission(start_s=228.0), synthetic_run.THRESHOLDED)
for record in synthetic_run.simulate(options):
    log.write(record)
    if type(record).__name__ == "NavSolution" and record.t_s >= float(sys.argv[3]) - 1e-9:
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="no kill -9")
@pytest.mark.parametrize("killed_at_s", [229.5, 233.99, 235.0])
def test_a_killed_run_keeps_all_but_its_last_second(killed_at_s, tmp_path):
    path = tmp_path / "run.mcap"
    here = str(Path(__file__).parent)
    done = subprocess.run([sys.executable, "-c", KILLED, here, str(path), str(killed_at_s)], check=False)
    assert done.returncode == -signal.SIGKILL
    data = reader.read(path)
    assert data.ended_early
    assert killed_at_s - 1.0 <= data.last_t_s <= killed_at_s
    assert data.mission.scenario_text == synthetic_run.mission().scenario_text
    np.testing.assert_array_equal(np.round(np.diff(data.nav.t_s), 9), 0.01)
    assert len(data.nav.t_s) > 100.0 * (killed_at_s - 1.0 - 228.0)


@pytest.mark.skipif(sys.platform != "linux", reason="no limit of the size of files, or another error")
@pytest.mark.parametrize("is_limited", [True, False])
def test_a_disk_that_takes_no_more_is_told_and_what_it_took_is_read(is_limited, records, tmp_path):
    """The file's own flush stands for the disk; the Rust side fails in the same way, without the reason.

    The machine is asked for it, and what it takes of the question does not stay in the file.
    """
    import resource

    path, own = tmp_path / "run.mcap", resource.getrlimit(resource.RLIMIT_FSIZE)
    words = os.strerror(errno.EFBIG) if is_limited else ".*"
    try:
        with pytest.raises(LogError, match=rf"run\.mcap: cannot be written: {words}; what was"):
            with LogWriter(path, synthetic_run.mission(), synthetic_run.NO_PIXELS) as log:
                for k, record in enumerate(records[:3000]):
                    if k == 2000:
                        log.flush()
                        log._file.close()  # every write after it fails
                        size = path.stat().st_size
                        if is_limited:
                            resource.setrlimit(resource.RLIMIT_FSIZE, (size + 9, own[1]))
                    log.write(record)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, own)
    assert path.stat().st_size == size
    data = reader.read(path)
    assert data.ended_early and len(data.nav.t_s) > 0


def test_more_flushes_change_no_message(records, tmp_path):
    paths = tmp_path / "seldom.mcap", tmp_path / "often.mcap"
    for path, every_s in zip(paths, (1.0, 0.1), strict=True):
        mission = synthetic_run.mission(start_s=SHORT.start_s)
        with LogWriter(path, mission, synthetic_run.NO_PIXELS, flush_every_s=every_s) as log:
            for record in records:
                log.write(record)
    seldom, often = map(messages, paths)
    assert seldom == often and len(seldom) > len(records)


def messages(path):
    """(topic, time, bytes) of all messages, in the order of the file."""
    with path.open("rb") as file:
        found = make_reader(file).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]
