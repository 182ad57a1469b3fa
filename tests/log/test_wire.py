"""Messages against google.protobuf, which knows nothing of our fixed layouts."""

import numpy as np
import pytest
import synthetic_run
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from shefex_nav import records as rec
from shefex_nav.log import topics, wire
from shefex_nav.log.topics import LogError

NS = 1_340_392_680_123_456_789


def parsed(topic, data):
    """The message as a reader sees it that has nothing but the stored schema."""
    files = descriptor_pb2.FileDescriptorSet.FromString(wire.schema_bytes(topic))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"shefex.{topic.schema}"))
    return kind.FromString(data)


def stamps(records):
    return np.full(len(records), NS)


def attribute(record, source):
    for name in source.split("."):
        record = getattr(record, name)
    return record


@pytest.fixture(scope="module")
def samples():
    """A few records of every type."""
    run = synthetic_run.Options(start_s=222.0, end_s=222.4, frame_pixels=False)
    found = {topics.Mission: [synthetic_run.mission()], rec.Event: [rec.Event(1.5, "näme", -3.0, "")]}
    for record in synthetic_run.simulate(run):
        if isinstance(record, rec.ComputeTime):
            record = topics.timing(record)
        found.setdefault(type(record), []).append(record)
    found[topics.Timing].append(topics.timing(synthetic_run.summary()))
    return found


@pytest.mark.parametrize("topic", topics.topics(), ids=lambda topic: topic.schema)
def test_google_protobuf_reads_what_was_encoded(topic, samples):
    encoder = wire.codec(topic)
    rows = samples[topic.record]
    for record, data in zip(rows, encoder.encode(rows, stamps(rows)), strict=True):
        message = parsed(topic, data)
        assert message.timestamp_ns == NS
        for field in topic.fields:
            value = getattr(message, field.name)
            expected = attribute(record, field.source)
            if field.shape:
                np.testing.assert_array_equal(list(value), np.ravel(expected), err_msg=field.name)
            elif isinstance(expected, float) and np.isnan(expected):
                assert np.isnan(value)
            else:
                assert value == expected, field.name


@pytest.mark.parametrize("topic", topics.topics(), ids=lambda topic: topic.schema)
def test_decoding_gives_back_the_records(topic, samples):
    coder = wire.codec(topic)
    rows = samples[topic.record]
    decoded = coder.decode(coder.encode(rows, stamps(rows)))
    for k, row in enumerate(rows):
        for field in topic.fields:
            value = attribute(decoded if wire.is_fixed(topic) else decoded[k], field.source)
            value = value[k] if wire.is_fixed(topic) else value
            expected = attribute(row, field.source)
            if isinstance(expected, str):
                assert value == expected
            else:
                np.testing.assert_array_equal(value, expected, err_msg=field.name)
                assert np.shape(value) == np.shape(expected), field.name


@pytest.mark.parametrize("topic", [*filter(wire.is_fixed, topics.topics())], ids=lambda topic: topic.schema)
def test_fixed_layouts_say_what_google_protobuf_says(topic, samples):
    rows = samples[topic.record]
    google = wire.VariableCodec(topic).encode(rows, stamps(rows))
    for data, expected in zip(wire.codec(topic).encode(rows, stamps(rows)), google, strict=True):
        assert wire.message_class(topic).FromString(data).SerializeToString() == expected


def test_varints_have_the_published_encoding():
    # protobuf.dev, Encoding, Base 128 Varints: 150 is 96 01
    assert wire.varint(150) == b"\x96\x01"
    assert wire.varint(1) == b"\x01"
    assert wire.varint(300) == b"\xac\x02"


def test_comments_travel_with_the_schema():
    topic = next(t for t in topics.topics() if t.schema == "Truth")
    file = descriptor_pb2.FileDescriptorSet.FromString(wire.schema_bytes(topic)).file[0]
    comments = {tuple(place.path): place.leading_comments for place in file.source_code_info.location}
    number = [field.name for field in file.message_type[0].field].index("r_i_m")
    assert "inertial axes [m]" in comments[(4, 0, 2, number)]


def test_schema_comparison_sees_fields_and_not_comments():
    topic = next(t for t in topics.topics() if t.schema == "Truth")
    reworded = topic._replace(comment="In other words.")
    renamed = topic._replace(fields=(topic.fields[0]._replace(name="other"), *topic.fields[1:]))
    assert wire.is_same_schema(wire.schema_bytes(reworded), topic)
    assert not wire.is_same_schema(wire.schema_bytes(renamed), topic)


def test_fixed_decoding_refuses_other_bytes():
    topic = next(t for t in topics.topics() if t.schema == "Truth")
    coder = wire.codec(topic)
    truth = synthetic_run.truth_at(synthetic_run.mission(), 3.0)
    data = coder.encode([truth], stamps([truth]))[0]
    with pytest.raises(LogError, match=f"message 2: got {len(data) - 1} bytes, expected {len(data)}"):
        coder.decode([data, data[:-1]])
    with pytest.raises(LogError, match="layout"):
        coder.decode([data, b"\x00" + data[1:]])


def test_why_a_message_is_of_another_length_is_told():
    """Proto3 leaves out what is zero, as every program of others writes it; ours have all fields."""
    topic = next(t for t in topics.topics() if t.schema == "ImuBlock")
    rows = [rec.ImuBlock(0.01 * k, 0.01 * k, 0.0025, *np.ones((2, 4, 3)), False) for k in range(3)]
    data = wire.codec(topic).encode(rows, stamps(rows))
    message = wire.message_class(topic).FromString(data[1])
    others = message.SerializeToString()
    assert len(others) == len(data[1]) - 2  # saturated: tag and value
    del message.dv_b_m_s[9:]
    fewer, more = message.SerializeToString(), data[1] + data[1][-2:]
    for odd, words in (
        (others, "another program wrote it and left out the fields that are zero; this reader wants all"),
        (fewer, "dv_b_m_s has 9 numbers, expected 12"),
        (data[1][:-1], "it is no whole message ImuBlock"),
        (more, "another program wrote it in another form"),
    ):
        with pytest.raises(LogError, match=rf"/imu: message 3: got {len(odd)} bytes, expected .*: {words}"):
            wire.codec(topic).decode([data[0], data[0], odd])
    with pytest.raises(LogError, match=r"message 1: got .* left out the fields that are zero"):
        wire.codec(topic).decode([others, others])


def test_wrong_shapes_are_refused():
    coder = wire.codec(next(t for t in topics.topics() if t.schema == "Truth"))
    truth = synthetic_run.truth_at(synthetic_run.mission(), 3.0)
    for wrong in (np.zeros(4), np.zeros((3, 1))):
        with pytest.raises(ValueError, match=r"broadcast|sequence"):
            coder.encode([truth._replace(r_i=wrong)], stamps([truth]))


@pytest.mark.parametrize("n", [1, 2, 4, 9])
def test_any_number_of_imu_samples_in_a_tick(n):
    """Two at 200 Hz: what protobuf reads is what was encoded, and it comes back with its shape."""
    topic, rng = next(t for t in topics.topics() if t.schema == "ImuBlock"), np.random.default_rng(n)
    rows = [
        rec.ImuBlock(0.01 * k, 0.01 * k, 0.01 / n, *rng.standard_normal((2, n, 3)), k == 3) for k in range(5)
    ]
    data = wire.codec(topic).encode(rows, stamps(rows))
    assert list(parsed(topic, data[3]).dv_b_m_s) == rows[3].dv_b.ravel().tolist()
    decoded = wire.codec(topic).decode(data)
    assert decoded.dtheta_b.shape == decoded.dv_b.shape == (5, n, 3)
    np.testing.assert_array_equal(decoded.dtheta_b, [row.dtheta_b for row in rows])
    assert decoded.saturated.tolist() == [False, False, False, True, False]
    with pytest.raises(LogError, match="message 6: got"):
        wire.codec(topic).decode([*data, data[0][:-8]])


def test_ticks_of_different_lengths_are_refused():
    topic = next(t for t in topics.topics() if t.schema == "ImuBlock")
    two, four = (rec.ImuBlock(0.0, 0.0, 0.01, np.zeros((n, 3)), np.zeros((n, 3)), False) for n in (2, 4))
    encoder = wire.codec(topic)
    encoder.encode([two], stamps([two]))
    with pytest.raises(LogError, match=r"\[4\] rows in a log whose others have 2"):
        encoder.encode([four], stamps([four]))
    none = wire.codec(topic).decode([])
    assert none.dtheta_b.shape == (0, 0, 3)
