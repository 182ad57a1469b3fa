"""What a viewer decodes by itself and could not decode is refused with topic and message."""

from pathlib import Path

import pytest
import synthetic_run

from shefex_nav.log import drawn, pixels
from shefex_nav.log.topics import LogError
from shefex_nav.log.writer import LogWriter

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
OPTIONS = synthetic_run.Options(start_s=231.0, end_s=232.0)


@pytest.fixture
def apart(monkeypatch, tmp_path):
    """A log taken apart, and the function that puts it together again."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    import fuzz_logs

    path = tmp_path / "a.mcap"
    with LogWriter(path, synthetic_run.mission(start_s=OPTIONS.start_s), synthetic_run.THRESHOLDED) as log:
        for record in synthetic_run.simulate(OPTIONS):
            log.write(record)
    return fuzz_logs.taken_apart(path), lambda log: fuzz_logs.put_together(path, log), path


def none(message):
    message.ClearField("transforms")


def far(message):
    message.transforms[0].translation.x = float("inf")


def late(message):
    message.transforms[0].timestamp.nanos = -1


def level(message):
    message.level = 99


def step(message):
    message.step += 1


def encoding(message):
    message.encoding = "rgb8"


def matrix(message):
    del message.K[3:]


WRONG = (
    ("/tf", none, "transforms: got none, expected at least one"),
    ("/tf", far, "transforms: translation: x: got inf, expected a number"),
    ("/tf", late, "transforms: timestamp: got .* s and -1 ns, expected a time"),
    ("/log", level, "level: got 99, expected one of 0, 1, 2"),
    (pixels.THRESHOLDED, step, r"step: got \d+ bytes a row, expected \d+ of"),
    (pixels.THRESHOLDED, encoding, "encoding: got 'rgb8', expected mono8 or mono16"),
    ("/star_tracker/calibration", matrix, "K: got 3 numbers, expected 9"),
)


def test_what_was_drawn_can_be_decoded(apart):
    drawn.check(apart[2])


@pytest.mark.parametrize("topic, change, words", WRONG)
def test_what_no_viewer_can_decode_is_named(apart, topic, change, words):
    log, together, path = apart
    channel = next(one for one in log.channels if one.topic == topic)
    message = pixels.message_class({}, channel.schema).FromString(channel.messages[0].data)
    change(message)
    channel.messages[0].data = message.SerializeToString()
    together(log)
    with pytest.raises(LogError, match=rf"a\.mcap: {topic}: message 1: {words}"):
        drawn.check(path)


def test_a_topic_described_as_another_is_named(apart):
    log, together, path = apart
    places = {one.topic: k for k, one in enumerate(log.channels)}
    log.channels[places["/tf"]] = log.channels[places["/tf"]]._replace(
        schema=log.channels[places["/log"]].schema
    )
    together(log)
    with pytest.raises(
        LogError, match=r"/tf: is described as foxglove\.Log, expected foxglove\.FrameTransforms"
    ):
        drawn.check(path)
