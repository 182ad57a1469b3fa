"""Results of a campaign: its table, its draws, its series, its failures. Also of one that is not finished.

campaign = open_campaign("campaigns/shefex2_andoya-seed1")
campaign["summary.navigation.at_entry.position_error_m"]  # one value a run, NaN where there is none
campaign.draws["vehicle.payload.mass"], campaign.series(12)["t_s"], campaign.summary(12)
"""

import io
import re
import shutil
import tempfile
import weakref
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav import files
from shefex_nav.campaign import runs_file, store, table
from shefex_nav.campaign.draws import units_of
from shefex_nav.campaign.head import read_head
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

    The table stays on the disk: a column is read when it is asked for, `rows` goes through all of it.
    """

    def __init__(self, kept, head, path):
        """kept : Store;  path : of a table that `table.save` wrote"""
        self.folder, self.head = kept.folder, head
        self._store, self._path = kept, path
        self._file = table.File(path)
        self.columns = table.Columns(self._file)

    def __repr__(self):
        count = f"{len(self)} of {self.head['runs']} runs, {int(self.succeeded.sum())} flew to their end"
        return f"<Campaign {self.head['scenario']}, seed {self.head['seed']}, {count}>"

    def rows(self):
        """Rows in the order of the runs: iterator of dict."""
        yield from table.load(self._path)

    def __len__(self):
        return sum(self._file.rows)

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
        return table.numbers(self.columns, name, len(self))

    @cached_property
    def runs(self):
        """(N,) indices of the runs that are done."""
        return self["run"]

    @cached_property
    def succeeded(self):
        """(N,) whether a run flew to its end."""
        import pyarrow.compute as pc

        every = list(range(len(self._file.rows)))
        return pc.equal(self._file.column("status", every), SUCCEEDED).to_numpy()

    @property
    def draws(self):
        """{path: (N,) array} of what was drawn, in the unit of its dispersion (`units`)."""
        return self.columns.beginning(DRAW)

    @cached_property
    def units(self):
        """{path: unit} of what was drawn: '' without one, 'times' of a factor."""
        return units_of(self.head["source"], f"{self.folder}/campaign.json")

    @property
    def wall_s(self):
        """Time that the sessions of the campaign took [s]; None if none has ended."""
        return self.head.get("wall_s") or None

    @property
    def lost(self):
        """Why runs that were tried have no row: {run: reason}; the campaign flies them when it goes on."""
        found = self._store.runs.lost()
        return {run: why["reason"] for run, why in found.items() if run < self.head["runs"]}

    @cached_property
    def digest(self):
        """sha256 over all columns but timing.*."""
        return table.made(self._path).digest

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

    def _judged(self, wanted):
        """Lists of Judged of the wanted rows, (N,) bool, in order, from the columns that they need alone."""
        first = 0
        for number in range(len(self._file.rows)):
            group = table.Group(self._file, number)
            for k in np.flatnonzero(wanted[first : first + len(group)]).tolist():
                yield judging.judge_figures(self.limits, _figure_of(group, k))
            first += len(group)

    @cached_property
    def judgements(self):
        """Judgements of the succeeded runs."""
        shape = (int(self.succeeded.sum()), len(self.limits))
        measured, passed, judgeable = (np.zeros(shape, bool) for _ in range(3))
        severity = np.zeros(shape[0])
        for k, judged in enumerate(self._judged(self.succeeded)):
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
        wanted = self.succeeded & np.isin(self.runs, list(runs))
        return dict(zip(self.runs[wanted].tolist(), self._judged(wanted), strict=True))

    def record(self, run):
        """Record of a run, with its whole summary; KeyError if it is not done."""
        found = self._store.record(run)
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
        try:
            content = self._store.runs.series(run)
            if content is not None:
                return files.arrays_of(io.BytesIO(content), names)
        except runs_file.SpoiltError as error:
            raise KeyError(str(error)) from None
        except files.UNREADABLE as error:
            raise KeyError(f"{self.folder}: the series of run {run} cannot be read: {error}") from None
        raise KeyError(self._without_series(run))

    def _without_series(self, run):
        """Why there are no series of a run."""
        record = self._store.runs.record(run)
        if record is None:
            return self._absent(run)
        if record["status"] != SUCCEEDED:
            return f"{self.folder}: run {run} failed, and a failed run has no series"
        return f"{self.folder}: the series of run {run} were deleted"

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

    def _failed(self, *names):
        """Some columns of the runs that failed, in order: iterator of dict."""
        import pyarrow.compute as pc

        def failed(batch):
            return pc.not_equal(batch["status"], SUCCEEDED)

        yield from table.load(self._path, ["run", "status", *names], failed)

    def failures(self):
        """Runs that failed, in order: list of Failure."""
        names = "reason", "traceback"
        return [Failure(row["run"], *(row[name] or "" for name in names)) for row in self._failed(*names)]

    def causes(self):
        """Failures by what they say, the most frequent first: list of Cause."""
        return _grouped(([row["run"]], row["reason"] or "") for row in self._failed("reason"))

    def warnings(self):
        """What the scenario gets wrong of the flights, the most frequent first: list of Cause."""
        if table.WARNINGS not in self.columns:
            return []
        return _grouped(
            (runs, words)
            for batch in table.batches(self._path, ["run", table.WARNINGS])
            for runs, said in _alike(batch["run"], batch[table.WARNINGS])
            for words in _said(said, self._path)
        )


def _said(warnings, path):
    """Texts of the warnings of a run, which are JSON: sorted list. path : of the table, for a complaint"""
    try:
        return sorted({f"{one['field']}: {one['text']}" for one in files.from_json(warnings)})
    except (ValueError, TypeError, KeyError):
        raise table.TableError(f"{path}: spoilt: {table.WARNINGS} of a run is no list of warnings") from None


def _alike(runs, warnings):
    """Runs whose warnings are alike but for their numbers, with those of the first: iterator.

    runs, warnings : Arrow arrays; a run without a warning has null
    """
    import pyarrow.compute as pc

    runs, warnings = runs.filter(warnings.is_valid()), warnings.drop_null()
    kinds = pc.replace_substring_regex(warnings, _NUMBER.pattern, "#").dictionary_encode().indices
    kinds, runs = kinds.to_numpy(), runs.to_numpy()
    for first in np.unique(kinds, return_index=True)[1]:
        yield runs[kinds == kinds[first]], warnings[first].as_py()


def _grouped(said):
    """Causes of (runs, words of the first) by what is said but for numbers: list, the most frequent first.

    A run counts once however often it says the same of other numbers.
    """
    first, runs = {}, {}
    for some, words in said:
        kind = _NUMBER.sub("#", words)
        first[kind] = min(first.get(kind, (some[0], words)), (some[0], words))
        runs.setdefault(kind, []).append(some)
    groups = [Cause(first[kind][1], tuple(np.unique(np.concatenate(runs[kind])).tolist())) for kind in runs]
    return sorted(groups, key=lambda cause: (-len(cause.runs), cause.runs[0], cause.words))


def _figure_of(group, k):
    """Function that gives the figure at a dotted path of the summary, of row k of a table.Group."""

    def get(path):
        values = group[f"{SUMMARY}{path}"]
        return None if values is None else values[k]

    return get


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

    The table of the folder is read if it is of the runs that are done; else one is made of their records, in
    a place of its own. Where only the table was kept, it counts.
    """
    head = read_head(folder)
    _check_source(head["source"], folder)
    kept = store.Store(folder)
    path = kept.folder / "results.parquet"
    try:
        made = table.made(path)
        if made.runs and (made.state == kept.runs.state() or not kept.runs.path.exists()):
            return Campaign(kept, head, path)
    except (OSError, ValueError, KeyError):  # not there, half of one, another program's
        pass
    if not kept.runs.done():
        raise store.StoreError(f"{folder}: no run of this campaign is done yet")
    return _of_records(kept, head)


def _check_source(source, folder):
    """StoreError if the scenario that a folder keeps is no YAML."""
    try:
        document.parse(source, f"{folder}/campaign.json")
    except document.BadText as error:
        (mark, words) = error.args
        raise store.StoreError(
            f"{folder}/campaign.json: is damaged: source: line {mark.line}: {words}"
        ) from None


def _of_records(kept, head):
    """Campaign of the records that are kept; its table is deleted with it."""
    place = Path(tempfile.mkdtemp())
    try:
        path = place / "results.parquet"
        kept.write_table(path)
        campaign = Campaign(kept, head, path)
    except BaseException:
        shutil.rmtree(place, ignore_errors=True)
        raise
    weakref.finalize(campaign, shutil.rmtree, place, ignore_errors=True)
    return campaign
