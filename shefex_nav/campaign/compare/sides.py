"""What is compared: the runs of a log or of a campaign's folder by their seeds, with the figures of each."""

from pathlib import Path
from typing import NamedTuple

from shefex_nav.campaign import results, store
from shefex_nav.campaign.compare.given import LOG
from shefex_nav.scenario import document
from shefex_nav.scenario import software as own

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
SECTIONS = tuple(section for section, _ in own.PATHS)


class Flown(NamedTuple):
    """One run of a side."""

    seed: int
    run: int | None  # its number in a campaign
    failed: str  # why it failed; '' of one that flew to its end
    get: object  # function that gives the figure at a dotted path of the summary, `wall_s` among them
    judged: tuple  # of report.requirements.Judged
    draws: dict


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
    log_hz: float | None = None  # of a log
    notes: tuple = ()

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


def of(kind, path, letter, label=None):
    """Side of a log or of a campaign's folder; LogError, StoreError."""
    make = _of_log if kind == LOG else _of_campaign
    return make(Path(path), letter, label or str(path))


def _of_log(path, letter, label):
    from shefex_nav.log import reader
    from shefex_nav.report import configured, metrics

    data = reader.read(path)
    summary = metrics.summarise(data)
    judged = tuple(configured.judged(data, summary))
    seed, notes = data.mission.seed, []
    if data.ended_early and not data.failure:
        notes.append(f"{letter}: the log ends early, at T{data.last_t_s:+.1f} s")
    if data.until_s is not None:
        notes.append(f"{letter}: was looked at until T{data.until_s:+.1f} s")
    flown = Flown(seed, None, data.failure.partition("\n")[0], _figures_of(summary), judged, {})
    return Side(
        letter, label, path, LOG, data.mission.scenario_text, summary["software"],
        {"shefex_nav": data.mission.version}, {seed: flown}, notes=tuple(notes),
    )  # fmt: skip


def _figures_of(summary):
    from shefex_nav.report.requirements import figures_of

    return figures_of(summary)


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
    head = store.read_head(folder)
    return Side(
        letter, label, folder, "campaign", head["source"], software_in(head["source"]), head["versions"],
        flown, notes=notes,
    )  # fmt: skip


def _of_row(row):
    """The same of a row of a campaign's table, where measured durations stand apart."""
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
        given = (tree.get(section) or {}).get(key)
        if isinstance(given, dict):
            text = given.get(own.PYTHON) or given.get(own.COMMAND) or given.get(own.CONNECT)
            name = Path(str(text)).name if own.COMMAND not in given else str(text)
            found[section] = f"{name}, sha256 {str(given.get(own.HASH) or '')[:12]}"
    return found
