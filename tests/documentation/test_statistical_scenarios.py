"""The page on campaigns names the scenarios that may be flown without pictures."""

import re

from page_session import ROOT

from shefex_nav.scenario.load import Scenario, ScenarioError

STATISTICAL = {"star_tracker.frames": "statistical"}


def kind(path):
    """First word of the row of the table in which a scenario belongs."""
    try:
        return "yes" if Scenario.load(path, STATISTICAL).star_tracker.enabled else "changes"
    except ScenarioError:
        return "no"


def test_each_scenario_stands_in_the_row_that_holds():
    page = (ROOT / "docs" / "campaigns.md").read_text()
    table = page.partition("| `frames: statistical` | scenarios |\n|---|---|\n")[2].partition("\n\n")[0]
    told = {
        name: re.match(r"\| (\w+)", row)[1]
        for row in table.splitlines()
        for name in re.findall(r"`(\w+)`", row)
    }
    assert told == {path.stem: kind(path) for path in (ROOT / "scenarios").glob("*.yaml")}
