"""What campaign.json of a folder holds, read back, and what differs from it: it may be anybody's."""

import math
from pathlib import Path

from shefex_nav.campaign import MOST_RUNS
from shefex_nav.campaign import plan as planning
from shefex_nav.campaign.runs_file import StoreError
from shefex_nav.clock import TICK_HZ
from shefex_nav.files import from_json, text_of
from shefex_nav.scenario import differences
from shefex_nav.scenario.dispersions import SAMPLINGS

NUMBER = int, float
LONGEST_S = 1e12
HEAD = {  # of campaign.json, what readers cannot do without: its types
    "scenario": (str,), "source": (str,), "seed": (int,), "runs": (int,), "sampling": (str,),
    "flight": (str,), "rate": NUMBER, "versions": (dict,), "wall_s": NUMBER,
}  # fmt: skip


def read_head(folder, missing=StoreError):
    """What campaign.json of a folder holds; StoreError, or None if `missing` is None, without one."""
    path = Path(folder) / "campaign.json"
    if Path(folder).is_file():
        raise StoreError(f"{folder}: is a file; expected the folder of a campaign")
    try:
        head = from_json(text_of(path))
    except FileNotFoundError:
        if missing is None:
            return None
        raise StoreError(f"{folder}: there is no campaign.json; expected the folder of a campaign") from None
    except (OSError, ValueError) as error:
        words = getattr(error, "strerror", None) or error
        raise StoreError(f"{path}: cannot be read: {words}") from None
    found = head.get("format") if isinstance(head, dict) else None
    if found != planning.FORMAT:
        raise StoreError(
            f"{path}: its format is {found}, expected {planning.FORMAT}; fly it in another folder"
        )
    if missing := [name for name in HEAD if name not in head]:
        raise StoreError(f"{path}: is damaged or another program's, {', '.join(missing)} missing")
    if wrong := [name for name, types in HEAD.items() if type(head[name]) not in types]:
        expected = " or ".join(one.__name__ for one in HEAD[wrong[0]])
        got = type(head[wrong[0]]).__name__
        raise StoreError(f"{path}: is damaged: {wrong[0]}: got {got}, expected {expected}")
    for name, (is_right, expected) in BOUNDS.items():
        if name in head and not is_right(head[name]):
            raise StoreError(f"{path}: is damaged: {name}: got {head[name]!r:.60}, expected {expected}")
    return head


def _is_number(value, least, most):
    """Whether a value of JSON is a number within bounds; NaN is not."""
    return type(value) in NUMBER and least <= value <= most


def _is_whole(value, least, most):
    return type(value) is int and least <= value <= most


BOUNDS = {  # of campaign.json: whether a value can be, and what can
    "runs": (lambda runs: _is_whole(runs, 1, MOST_RUNS), f"1 to {MOST_RUNS}"),
    "seed": (lambda seed: _is_whole(seed, 0, math.inf), "0 or more"),  # --seed has no end
    "sampling": (lambda name: name in SAMPLINGS, " or ".join(SAMPLINGS)),
    "flight": (lambda name: name in ("shared", "dispersed"), "shared or dispersed"),
    "rate": (lambda rate: _is_number(rate, 1e-6, TICK_HZ), f"1e-6 to {TICK_HZ:g} Hz"),
    "wall_s": (lambda wall_s: _is_number(wall_s, 0.0, LONGEST_S), f"0 to {LONGEST_S:g} s"),
    "timed": (
        lambda one: (
            isinstance(one, dict)
            and _is_whole(one.get("runs"), 0, MOST_RUNS)
            and _is_number(one.get("wall_s"), 1e-6 if one["runs"] else 0.0, LONGEST_S)
        ),
        "a number of runs and what they took, wall_s",
    ),
    "dispersions": (
        lambda found: isinstance(found, dict) and all(isinstance(one, dict) for one in found.values()),
        "an object of objects",
    ),
    "asked_before": (
        lambda found: isinstance(found, list) and all(_is_whole(one, 1, MOST_RUNS) for one in found),
        "a list of numbers of runs",
    ),
}


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
    from shefex_nav.scenario import load

    return load.load(path).source


def differing(scenario, path):
    """What differs, one line a value, with the place in the scenario's own files."""
    found = differences.of_texts(source_of(path), scenario.source, (path, scenario.mission.name))
    if not found:
        return [f"{path}: no value differs"]
    count = f"{len(found)} values differ" if found[1:] else "one value differs"
    return [f"{path}: {count} (there -> here):", *differences.lines(found, scenario.place)]
