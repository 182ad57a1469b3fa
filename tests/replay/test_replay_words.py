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


def test_the_page_of_a_replay(command, tmp_path):
    log, page = tmp_path / "replay.mcap", tmp_path / "page.html"
    assert command("replay", "csv_example", "--until", "16s", "--log", log).code == 0
    assert command("report", log, "--html", page).code == 0
    text = page.read_text()
    assert "<h1>csv_example</h1>" in text
    assert "A student rocket's first half minute, from CSVs; epoch" in text.replace("&#x27;", "'")
    assert "4.0 s navigated from T+12.0 s" in text and "simulated" not in text.split("<pre")[0]
