"""What is compared: the runs of a log or of a campaign's folder by their seeds, with the figures of each."""

import re
from pathlib import Path
from string import ascii_uppercase
from typing import NamedTuple

from shefex_nav.campaign import results
from shefex_nav.campaign.compare.given import CAMPAIGN, IN_LOG, LOG, CompareError
from shefex_nav.campaign.head import read_head
from shefex_nav.report import requirements
from shefex_nav.report.pairing import same_times
from shefex_nav.scenario import document
from shefex_nav.scenario import software as own

MOST = 200  # sides
LETTERS = tuple(first + second for first in ("", *ascii_uppercase) for second in ascii_uppercase)[:MOST]
OF_SENSORS = ("measurements", "instruments", "nis")  # sections of `navigation` with figures by sensor


class Flown(NamedTuple):
    """One run of a side."""

    seed: int
    run: int | None  # its number in a campaign
    failed: str  # why it failed; '' of one that flew to its end
    get: object  # function that gives the figure at a dotted path of the summary, `wall_s` among them
    judged: tuple  # of report.requirements.Judged
    draws: dict


class Planned(NamedTuple):
    """A campaign that has not flown yet: as much of a Side as is known."""

    letter: str
    label: str
    runs: tuple  # seeds
    kind: str = CAMPAIGN


class Side(NamedTuple):
    """A log or a campaign."""

    letter: str
    label: str  # for people
    where: Path
    kind: str
    source: str  # whole text of the scenario
    software: dict  # section: name and SHA-256 of software of a user's own
    versions: dict
    runs: dict  # seed -> Flown
    notes: tuple = ()
    data: object = None  # RunData of a log
    sensors: tuple = ()  # with figures of their own

    @property
    def name(self):
        """What flew, in a word."""
        return ", ".join(one.partition(", sha256")[0] for one in self.software.values()) or "built-in"

    def result(self):
        """Plain dict for JSON."""
        return {
            "letter": self.letter,
            "label": self.label,
            "kind": self.kind,
            "where": str(self.where),
            "software": self.software,
            "runs": len(self.runs),
            "failed": sum(bool(one.failed) for one in self.runs.values()),
        }


def of(kind, text, letter, label=None):
    """Side of a log, of another solution in one (`run.mcap:name`), or of a campaign's folder.

    Raises LogError, StoreError, CompareError.
    """
    label = label or str(text)
    if kind != LOG:
        return _of_campaign(Path(text), letter, label)
    from shefex_nav.log import reader

    found = IN_LOG.fullmatch(str(text))
    if found is None:
        return _of_data(Path(text), reader.read(text), letter, label)
    path, name = found.groups()
    data = reader.read(path)
    if name not in data.others:
        names = ", ".join(data.others) or "none but the log's own"
        raise CompareError(f"{text}: the log has no solution {name!r}; it has: {names}")
    return _of_other(Path(path), data, name, data.others[name], letter, label)


def of_solution(path, letter, first):
    """Side of a CSV, which is about the flight of the log of the first side; BadTable, CompareError."""
    from shefex_nav.report import other_solution

    if first.kind != LOG:
        words = "a table is what a filter says of one flight"
        raise CompareError(f"{path}: {words}; expected a log before it, as in compare run.mcap {path}")
    given = other_solution.read_csv(path)
    name = "csv_" + re.sub(r"[^a-z0-9]+", "_", Path(path).stem.lower())
    try:
        other = other_solution.other(first.data, given, "i", name)
    except ValueError as error:
        raise CompareError(f"{path}: {error}") from None
    return _of_other(first.where, first.data, name, other, letter, str(path))


def _of_other(path, data, name, other, letter, label):
    """Side of what another filter says of the flight of a log, with a note of times that have no truth."""
    side = _of_data(path, data.with_other(name, other), letter, label)
    n = len(other.nav.t_s)
    if alone := n - len(same_times(data.truth.t_s, other.nav.t_s)[0]):
        note = f"{letter}: {alone} of its {n} times are no tick of the log: they have no errors"
        side = side._replace(notes=(*side.notes, note))
    return side


def _of_data(path, data, letter, label):
    """Side of the RunData of a log."""
    from shefex_nav.report import configured, metrics

    summary = metrics.summarise(data)
    is_part = data.ended_early or data.until_s is not None
    judged = tuple(_final(one, is_part) for one in configured.judged(data, summary))
    seed, notes = data.mission.seed, []
    if data.ended_early and not data.failure:
        notes.append(f"{letter}: the log ends early, at T{data.reached_s:+.1f} s")
    if data.until_s is not None:
        notes.append(f"{letter}: was looked at until T{data.until_s:+.1f} s")
    navigation = summary["navigation"]
    paths = (f"navigation.{key}.{name}" for key in OF_SENSORS for name in navigation.get(key, ()))
    flown = Flown(seed, None, data.failure.partition("\n")[0], requirements.figures_of(summary), judged, {})
    return Side(
        letter, label, path, LOG, data.mission.scenario_text, summary["software"],
        {"shefex_nav": data.mission.version}, {seed: flown}, notes=tuple(notes), data=data,
        sensors=_sensors(paths),
    )  # fmt: skip


def _final(one, is_part):
    """A requirements.Judged; what the rest of a mission may change cannot be judged of a part of it."""
    is_open = requirements.verdict(one, is_part) not in ("met", "not met")
    return one._replace(judgeable=False) if is_open else one


def _of_campaign(folder, letter, label):
    campaign = results.open_campaign(folder)
    judged = campaign.judged(campaign.runs[campaign.succeeded].tolist())
    flown = {}
    for row in campaign.rows():
        failed = "" if row["status"] == results.SUCCEEDED else row["reason"] or "failed"
        draws = {name: value for name, value in row.items() if name.startswith(results.DRAW)}
        one = Flown(row["seed"], row["run"], failed, _of_row(row), tuple(judged.get(row["run"], ())), draws)
        flown[row["seed"]] = one
    lost = campaign.lost
    notes = (f"{letter}: {len(lost)} runs were lost and are not there",) if lost else ()
    head = read_head(folder)
    if head["flight"] == "shared":
        notes += (f"{letter}: all runs have one and the same flight: what is seen is of this flight alone",)
    return Side(
        letter, label, folder, CAMPAIGN, head["source"], software_in(head["source"]), head["versions"],
        flown, notes=notes, sensors=_sensors(name.removeprefix(results.SUMMARY) for name in campaign.columns),
    )  # fmt: skip


def _sensors(paths):
    """Sensors that figures of a summary are of, in the order of their names. paths : dotted"""
    found = (path.split(".") for path in paths)
    return tuple(sorted({one[2] for one in found if one[0] == "navigation" and one[1] in OF_SENSORS}))


def _of_row(row):
    """Function that gives figures of a row of a campaign's table, where measured durations stand apart."""
    figure = results.figure_of(row)

    def get(path):
        if path == "wall_s":
            return row.get("timing.wall_s")
        value = figure(path)
        return row.get(f"timing.summary.{path}") if value is None else value

    return get


def software_in(source):
    """Software of a user's own in the text of a scenario as a summary has it: {section: name and SHA-256}."""
    tree, found = document.parse(source, "").tree, {}
    for section, key in own.PATHS:
        block = tree.get(section)
        given = block.get(key) if isinstance(block, dict) else None
        if isinstance(given, dict):
            text = given.get(own.PYTHON) or given.get(own.COMMAND) or given.get(own.CONNECT)
            name = Path(str(text)).name if own.COMMAND not in given else str(text)
            found[section] = f"{name}, sha256 {str(given[own.HASH])[:12]}" if given.get(own.HASH) else name
    return found
