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

from shefex_nav.campaign import store, table
from shefex_nav.report import requirements

DRAW, SUMMARY = "draw.", "summary."
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


class Failure(NamedTuple):
    """A run that did not fly to its end."""

    run: int
    reason: str
    traceback: str


class Cause(NamedTuple):
    """Failures that say the same but for their numbers."""

    words: str  # their reason, numbers as in the first of them
    runs: tuple  # indices of the runs


class Campaign:
    """An open folder of a campaign. Columns are in the order of the runs: `campaign["summary.seed"]`."""

    def __init__(self, folder, head, rows):
        self.folder, self.head, self.rows = Path(folder), head, rows
        self.columns = table.columns(rows)

    def __len__(self):
        return len(self.rows)

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
        return self["status"] == "succeeded"

    @property
    def draws(self):
        """{path: (N,) array} of what was drawn."""
        return {name[len(DRAW) :]: self[name] for name in self.columns if name.startswith(DRAW)}

    @property
    def wall_s(self):
        """Time that the sessions of the campaign took [s]; None if none has ended."""
        return self.head.get("wall_s") or None

    @cached_property
    def digest(self):
        """sha256 over all columns but timing.*."""
        return table.digest(self.rows)

    @cached_property
    def scenario(self):
        """Scenario that was flown, before its dispersions."""
        from shefex_nav.scenario import load

        return load.load_text(self.head["source"], f"{self.folder}/campaign.json")

    @cached_property
    def judged(self):
        """Per run that succeeded, what `report.requirements.judge` says of it: list of lists of Judged."""
        required = requirements.limits(self.scenario.requirements)
        return [
            requirements.judge_figures(required, _figure(row))
            for row in self.rows
            if row["status"] == "succeeded"
        ]

    def record(self, run):
        """Object of runs/*.json of a run, with its whole summary; KeyError if it is not done."""
        found = store.read_record(self.folder, int(run))
        if found is None:
            raise KeyError(f"{self.folder}: run {run} is not there")
        return found

    def summary(self, run):
        """The object that `report.metrics.summarise` made of a run."""
        return self.record(run)["summary"]

    def series(self, run):
        """Errors and sigmas over time of a run: dict of arrays as `campaign.series` describes them."""
        path = self.folder / "runs" / f"{int(run):0{store.DIGITS}d}.npz"
        try:
            with np.load(path, allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        except FileNotFoundError:
            raise KeyError(f"{path} is not there; a failed run has no series") from None

    def failures(self):
        """Runs that failed, in order: list of Failure."""
        return [
            Failure(row["run"], row["reason"] or "", row["traceback"] or "")
            for row in self.rows
            if row["status"] != "succeeded"
        ]

    def causes(self):
        """Failures by what they say, the most frequent first: list of Cause."""
        found = {}
        for failure in self.failures():
            found.setdefault(_NUMBER.sub("#", failure.reason), []).append(failure)
        groups = [Cause(group[0].reason, tuple(one.run for one in group)) for group in found.values()]
        return sorted(groups, key=lambda cause: (-len(cause.runs), cause.runs[0]))


def _figure(row):
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


def open_campaign(folder):
    """Campaign in a folder, finished or not; StoreError if there is none or if no run is done.

    The table is read if it has every run that is done, else the files of the runs.
    """
    head = store.read_head(folder)
    kept = store.Store(folder)
    done = {run for run in kept.done() if run < head["runs"]}
    path = kept.folder / "results.parquet"
    rows = table.load(path) if path.exists() else []
    if not done <= {row["run"] for row in rows}:
        rows = [table.row(record) for record in kept.records(head["runs"])]
    if not rows:
        raise store.StoreError(f"{folder}: no run of this campaign is done yet")
    return Campaign(folder, head, sorted(rows, key=lambda row: row["run"]))
