"""`shefex-nav check SCENARIO --against OTHER`: every value that differs from what was flown, or will be."""

from pathlib import Path

from shefex_nav.campaign.head import read_head
from shefex_nav.scenario import differences, load


def source_of(path):
    """Scenario text of a campaign's folder, of a log or of a scenario file, whole as flown.

    Raises StoreError, LogError, ScenarioError.
    """
    path = Path(path)
    if path.is_dir():
        return read_head(path)["source"]
    if path.suffix == ".mcap":
        from shefex_nav.log import reader

        return reader.read(path).mission.scenario_text
    return load.load(path).source


def lines(scenario, path):
    """What differs, one line a value, with the place in the scenario's own files."""
    found = differences.of_texts(source_of(path), scenario.source, (path, scenario.mission.name))
    if not found:
        return [f"{path}: no value differs"]
    count = f"{len(found)} values differ" if found[1:] else "one value differs"
    return [f"{path}: {count} (there -> here):", *differences.lines(found, scenario.place)]
