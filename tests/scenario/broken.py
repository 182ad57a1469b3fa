"""Scenarios broken in one place, and what is said about them."""

from pathlib import Path

import pytest

from shefex_nav.scenario.load import ScenarioError, load

SCENARIO_FOLDER = Path(__file__).parents[2] / "scenarios"
DEFAULT = SCENARIO_FOLDER / "shefex2_andoya.yaml"
TEXT = DEFAULT.read_text(encoding="utf-8")


def messages(path, overrides=()):
    """All that is said about a scenario that cannot be flown."""
    with pytest.raises(ScenarioError) as caught:
        load(path, overrides)
    assert str(caught.value) == "\n".join(caught.value.messages)
    return caught.value.messages


def the_message(path, overrides=()):
    """What is said, which is one line."""
    said = messages(path, overrides)
    assert len(said) == 1, said
    assert "\n" not in said[0]
    return said[0]


def check_one_message(folder, good, bad, field, words, text=TEXT):
    """Put `bad` in the place of `good`; one message names field and place, which is where `bad` has its @."""
    assert text.count(good.replace("@", "")) >= 1, good
    marked = text.replace(good.replace("@", ""), bad, 1)
    path = folder / "broken.yaml"
    path.write_text(marked.replace("@", ""), encoding="utf-8")
    said = the_message(path)
    assert f": {field}: " in said, said
    assert words in said, said
    if "@" in bad:
        before = marked[: marked.index("@")]
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        assert said.startswith(f"{path}:{line}:{column}: {field}: "), (said, line, column)
