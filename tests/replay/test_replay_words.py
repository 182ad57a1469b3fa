"""What the table of a replay says of itself: no seed, nothing simulated, and the limits that it goes by."""

import pytest


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("requirements.attitude.limit=0.25 deg", "above 0.25 deg (requirements.attitude.limit)"),
        ("mission.name=mine", "above 0.17 deg (requirements.attitude.limit, by default)"),
    ],
)
def test_the_table_of_a_replay(command, override, words):
    result = command("replay", "csv_example", "--until", "16s", "--set", override)
    assert result.code == 0, result.err
    said = " ".join(result.out.replace("│", " ").split())
    assert words in said
    assert "seed" not in said and "simulated" not in said and "navigated" in said
