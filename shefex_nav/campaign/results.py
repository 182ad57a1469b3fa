"""Results of a campaign: its table, its draws, its series, its failures. Also of one that is not finished.

campaign = open_campaign("campaigns/shefex2_andoya-seed1")
campaign["summary.navigation.at_entry.position_error_m"]  # one value a run, NaN where there is none
campaign.draws["vehicle.payload.mass"], campaign.series(12)["t_s"], campaign.summary(12)
"""

import re
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav import files
from shefex_nav.campaign import store, table, units
from shefex_nav.report import requirements as judging
from shefex_nav.scenario import document, plugged
from shefex_nav.scenario.requirements import Requirements

DRAW, SUMMARY, SUCCEEDED = "draw.", "summary.", "succeeded"
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


class Failure(NamedTuple):
    """A run that did not fly to its end."""

    run: int
    reason: str
    traceback: str


class Cause(NamedTuple):
    """Runs of which the same is said but for its numbers: failures, or warnings."""

    words: str  # what is said, numbers as in the first of them
    runs: tuple  # indices of the runs


class Judgements(NamedTuple):
    """What the n succeeded runs made of the R requirements."""

    names: tuple  # (R,)
    limits: tuple  # (R,) in the units
    units: tuple  # (R,)
    measured: np.ndarray  # (n, R) whether the run has the figure
    passed: np.ndarray  # (n, R)
    judgeable: np.ndarray  # (n, R) whether the software gives what it is judged by
    severity: np.ndarray  # (n,) report.requirements.severity


class Campaign:
    """An open folder of a campaign. Columns are in the order of the runs: `campaign["summary.seed"]`.

    The table of a finished campaign stays on disk but for its columns; `rows` goes through it.
    """

    def __init__(self, folder, head, *, rows=None, path=None):
        """rows : list of dict in the order of the runs, or path : results.parquet."""
        self.folder, self.head = Path(folder), head
        self._rows, self._path = rows, path
        self.columns = table.columns(rows) if path is None else table.load_columns(path)

    def __repr__(self):
        count = f"{len(self)} of {self.head['runs']} runs, {int(self.succeeded.sum())} flew to their end"
        return f"<Campaign {self.head['scenario']}, seed {self.head['seed']}, {count}>"

    def rows(self):
        """Rows in the order of the runs: iterator of dict."""
        return iter(self._rows) if self._path is None else table.load(self._path)

    def __len__(self):
        return len(self.columns["run"])

    def __getitem__(self, name):
        """(N,) array of a column; KeyError with similar names if there is none."""
        try:
            return self.columns[name]
        except KeyError:
            import difflib

            near = difflib.get_close_matches(name, self.columns, n=3)
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise KeyError(f"there is no column {name!r}{hint}") from None

    def numbers(self, name):
        """(N,) float of a column of numbers; all NaN if there is none of that name or if it holds texts."""
        values = self.columns.get(name)
        if values is None or values.dtype == object:
            return np.full(len(self), np.nan)
        return values.astype(float)

    @property
    def runs(self):
        """(N,) indices of the runs that are done."""
        return self["run"]

    @property
    def succeeded(self):
        """(N,) whether a run flew to its end."""
        return self["status"] == SUCCEEDED

    @property
    def draws(self):
        """{path: (N,) array} of what was drawn, in the unit of its dispersion (`units`)."""
        return {name[len(DRAW) :]: self[name] for name in self.columns if name.startswith(DRAW)}

    @cached_property
    def units(self):
        """{path: unit} of what was drawn: '' without one, 'times' of a factor."""
        return units.of_source(self.head["source"], f"{self.folder}/campaign.json")

    @property
    def wall_s(self):
        """Time that the sessions of the campaign took [s]; None if none has ended."""
        return self.head.get("wall_s") or None

    @property
    def lost(self):
        """Why runs that were tried have no row: {run: reason}; the campaign flies them when it goes on."""
        found = store.Store(self.folder).lost()
        return {run: why["reason"] for run, why in found.items() if run < self.head["runs"]}

    @cached_property
    def digest(self):
        """sha256 over all columns but timing.*."""
        return table.digest_sorted(self.rows())

    @cached_property
    def scenario(self):
        """Scenario that was flown, before its dispersions."""
        from shefex_nav.scenario import load

        return load.load_text(self.head["source"], f"{self.folder}/campaign.json")

    @cached_property
    def plugins(self):
        """(file or name of a package, SHA-256 of its source) of each plug-in that was flown with: tuple."""
        return plugged.pinned_in(self.head["source"], f"{self.folder}/campaign.json")

    @cached_property
    def requirements(self):
        """What the scenario requires of a run. Its plug-ins, which may be of somebody else, are not run."""
        tree = document.parse(self.head["source"], f"{self.folder}/campaign.json").tree
        try:
            return Requirements.model_validate(tree.get("requirements", {}))
        except ValueError:  # of another version: the whole says what is wrong
            return self.scenario.requirements

    @cached_property
    def limits(self):
        """{name: limit in its unit} of what the scenario requires."""
        return judging.limits(self.requirements)

    def _judged(self):
        """(run, list of Judged) of the succeeded runs, in order."""
        for row in self.rows():
            if row["status"] == SUCCEEDED:
                yield row["run"], judging.judge_figures(self.limits, figure_of(row))

    @cached_property
    def judgements(self):
        """Judgements of the succeeded runs."""
        shape = (int(self.succeeded.sum()), len(self.limits))
        measured, passed, judgeable = (np.zeros(shape, bool) for _ in range(3))
        severity = np.zeros(shape[0])
        for k, (_, judged) in enumerate(self._judged()):
            measured[k] = [one.found is not None for one in judged]
            passed[k] = [one.passed for one in judged]
            judgeable[k] = [one.judgeable for one in judged]
            severity[k] = judging.severity(judged)
        units = tuple(judging.MEASURES[name].unit for name in self.limits)
        limits = self.limits
        return Judgements(
            tuple(limits), tuple(limits.values()), units, measured, passed, judgeable, severity
        )  # fmt: skip

    @property
    def verdicts(self):
        """Whether each requirement is met as often as is stated: list of verdicts.Verdict."""
        from shefex_nav.campaign import verdicts

        return verdicts.of_campaign(self)

    def judged(self, runs):
        """What succeeded runs made of the requirements: {run: list of report.requirements.Judged}."""
        wanted = set(runs)
        return {run: judged for run, judged in self._judged() if run in wanted}

    def record(self, run):
        """Object of runs/*.json of a run, with its whole summary; KeyError if it is not done."""
        found = store.read_record(self.folder, int(run))
        if found is None:
            raise KeyError(self._absent(run))
        return found

    def _absent(self, run):
        """Why there is no record of a run."""
        last = self.head["runs"] - 1
        if not 0 <= run <= last:
            return f"{self.folder}: there is no run {run}; the campaign has runs 0 to {last}"
        lost = self.lost.get(int(run))
        return f"{self.folder}: run {run} {f'was lost: {lost}' if lost else 'is not done yet'}"

    def summary(self, run):
        """The object that `report.metrics.summarise` made of a run."""
        return self.record(run)["summary"]

    def series(self, run):
        """Errors and sigmas over time of a run: dict of arrays as `campaign.series` describes them.

        KeyError if they are not there or cannot be read.
        """
        return self._series(run)

    def times(self, run):
        """Times of the series of a run alone: (N,) s."""
        return self._series(run, ("t_s",))["t_s"]

    def _series(self, run, names=None):
        path = self.folder / "runs" / f"{int(run):0{store.DIGITS}d}.npz"
        try:
            return files.arrays(path, names)
        except FileNotFoundError:
            raise KeyError(self._without_series(run, path)) from None
        except files.UNREADABLE as error:
            raise KeyError(f"{path} cannot be read: {error}") from None

    def _without_series(self, run, path):
        """Why the file of a run's series is not there."""
        record = store.read_record(self.folder, int(run))
        if record is None:
            return self._absent(run)
        if record["status"] != SUCCEEDED:
            return f"{self.folder}: run {run} failed, and a failed run has no series"
        return f"{path} is not there"

    def table(self):
        """Everything that `shefex-nav report` prints of a campaign: a rich Group, shown by notebooks too."""
        from shefex_nav.campaign import over_time, parts, tables

        return tables.tables(parts.parts(self, over_time.read(self)))

    @property
    def plot(self):
        """Figures of the campaign, each of matplotlib: `campaign.plot.errors()`; `dir(campaign.plot)`.

        `sensitivity` is among them where the scenario has dispersions.
        """
        from shefex_nav.campaign import figures

        return figures.plots(self)

    def failures(self):
        """Runs that failed, in order: list of Failure."""
        failed = ~self.succeeded
        kept = (self[name][failed].tolist() for name in ("run", "reason", "traceback"))
        return [Failure(run, _text(why), _text(trace)) for run, why, trace in zip(*kept, strict=True)]

    def causes(self):
        """Failures by what they say, the most frequent first: list of Cause."""
        found = {}
        for failure in self.failures():
            found.setdefault(_NUMBER.sub("#", failure.reason), []).append(failure)
        groups = [Cause(group[0].reason, tuple(one.run for one in group)) for group in found.values()]
        return sorted(groups, key=lambda cause: (-len(cause.runs), cause.runs[0]))

    def warnings(self):
        """What the scenario gets wrong of the flights, the most frequent first: list of Cause.

        It is in the files of the runs, not in the table: nothing is said where these are not kept.
        """
        found = {}
        for record in store.Store(self.folder).records(self.head["runs"]):
            said = {
                f"{one['field']}: {one['text']}" for one in (record["summary"] or {}).get("warnings") or ()
            }
            for words in sorted(said):
                found.setdefault(_NUMBER.sub("#", words), []).append((words, record["run"]))
        groups = [Cause(group[0][0], tuple(run for _, run in group)) for group in found.values()]
        return sorted(groups, key=lambda cause: (-len(cause.runs), cause.words))


def _text(value):
    """A text of a column; a column without any text holds NaN."""
    return value if isinstance(value, str) else ""


def figure_of(row):
    """Function that gives the figure at a dotted path of the summary, out of a row; lists come as lists."""

    def get(path):
        name = f"{SUMMARY}{path}"
        if f"{name}.0" not in row:
            return row.get(name)
        values = []
        while f"{name}.{len(values)}" in row:
            values.append(row[f"{name}.{len(values)}"])
        return values

    return get


def open_campaign(folder: str | Path) -> "Campaign":
    """Campaign in a folder, finished or not; StoreError if there is none or if no run is done.

    The table is read if it has the runs that are done and none of them is newer, else the files of the runs.
    """
    head = store.read_head(folder)
    kept = store.Store(folder)
    campaign = _of_table(kept, head)
    if campaign is not None:
        return campaign
    rows = table.unmixed([table.row(record) for record in kept.records(head["runs"])])
    if not rows:
        raise store.StoreError(f"{folder}: no run of this campaign is done yet")
    return Campaign(folder, head, rows=rows)


def _of_table(kept, head):
    """Campaign of results.parquet; None if it is not there, cannot be read, or is not of all that is done."""
    from pyarrow import ArrowException

    path = kept.folder / "results.parquet"
    done, newest = {run for run in kept.done() if run < head["runs"]}, kept.newest()
    try:
        if newest is not None and path.stat().st_mtime_ns < newest:
            return None
        campaign = Campaign(kept.folder, head, path=path)
        fits = newest is None or set(campaign.runs.tolist()) == done  # without any, the table alone was kept
        return campaign if fits and len(campaign) else None
    except (OSError, ArrowException, KeyError):
        return None
