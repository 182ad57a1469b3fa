"""The layout for Foxglove names topics and fields that a log has."""

import json
import re
from pathlib import Path

import pytest

from shefex_nav.log.drawings import CHANNELS
from shefex_nav.log.topics import topics
from shefex_nav.log.wire import all_fields

LAYOUT = Path(__file__).parents[2] / "docs" / "foxglove-layout.json"
FIELDS = {topic.topic: {field.name: field for field in all_fields(topic)} for topic in topics()}


@pytest.fixture(scope="module")
def layout():
    return json.loads(LAYOUT.read_text())


def panels(node):
    return [node] if isinstance(node, str) else panels(node["first"]) + panels(node["second"])


def test_every_panel_is_configured_once(layout):
    placed = panels(layout["layout"])
    assert sorted(placed) == sorted(layout["configById"])


def test_every_path_is_a_field_of_the_log(layout):
    paths = [path["value"] for config in layout["configById"].values() for path in config.get("paths", ())]
    assert len(paths) > 15
    for path in paths:
        topic, condition, name, index = re.fullmatch(
            r"(/[\w/]+)(?:\{(\w+)==.*\})?\.(\w+)(?:\[(\d+)\])?", path
        ).groups()
        field = FIELDS[topic][name]
        assert condition is None or condition in FIELDS[topic]
        assert (index is None) == (field.shape == ())
        assert index is None or int(index) < field.shape[0]


def test_every_topic_that_is_drawn_exists(layout):
    text = json.dumps(layout["configById"])
    named = set(re.findall(r'"(/[a-z_]+(?:/[a-z_]+)?)"', text))
    assert {"/star_tracker/image", "/log", "/gps/location", "/truth/pose"} <= named
    assert named <= set(CHANNELS) | set(FIELDS)
