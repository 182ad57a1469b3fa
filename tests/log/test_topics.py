"""The table of the log and its clock."""

import numpy as np

from shefex_nav import records
from shefex_nav.log import run_data, topics, wire


def test_every_field_names_an_attribute_of_its_record():
    for topic in topics.topics():
        assert topic.time in topic.record._fields
        for field in topic.fields:
            kind = topic.record
            for name in field.source.split("."):
                assert name in kind._fields, (topic.topic, field.name)
                kind = kind.__annotations__[name]


def test_every_attribute_of_a_record_is_logged():
    not_in_messages = {
        "image_dn",
        "scenario",
        "scenario_text",
        "seed",
        "version",
        "epoch_utc",
        "plugins",
        "software",
        "distortion",
    }
    for topic in topics.topics():
        logged = {field.source.split(".")[0] for field in topic.fields}
        assert set(topic.record._fields) - logged <= not_in_messages, topic.topic


def test_names_are_unique_and_say_the_unit():
    assert len({topic.topic for topic in topics.topics()}) == len(topics.topics())
    for topic in topics.topics():
        names = [field.name for field in topic.fields]
        assert len(set(names)) == len(names)
        for field in topic.fields:
            if field.source.endswith("_s"):
                assert field.name.endswith("_s")


def test_steady_topics_have_a_fixed_layout():
    """All but the covariance, whose blocks a scenario chooses."""
    loose = {topic.record for topic in topics.topics() if not wire.is_fixed(topic)} & set(
        run_data.kept_as_arrays()
    )
    assert loose == {records.NavCovariance}


def test_log_times_are_utc_nanoseconds():
    # 2012-06-22T19:18:00Z is 1340392680 s after 1970 (date -u -d 2012-06-22T19:18:00Z +%s)
    epoch = 1_340_392_680_000_000_000
    assert topics.epoch_ns("2012-06-22T19:18:00Z") == epoch
    assert topics.epoch_ns("2012-06-22T19:18:00") == epoch
    assert topics.epoch_ns("2012-06-22T21:18:00+02:00") == epoch
    assert topics.log_time_ns(epoch, -10.0) == epoch - 10_000_000_000
    ticks = topics.log_time_ns(epoch, -10.0 + np.arange(50_000) / 100) - epoch
    np.testing.assert_array_equal(np.diff(ticks), 10_000_000)
