"""The folder of a campaign: what is flown, the file of its runs, and the table of all (see the package).

A file is written whole or not at all (`files`), a run in one transaction (`runs_file`); it is on the disk
before it counts as done.
"""

import json
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path

from shefex_nav.campaign import checking, draws, runs_file, table
from shefex_nav.campaign import plan as planning
from shefex_nav.campaign.head import read_head
from shefex_nav.campaign.runs_file import StoreError
from shefex_nav.files import (
    content_of,
    finish,
    locked,
    put,
    refuse_irregular,
    refuse_links,
    settle,
)
from shefex_nav.scenario import differences

DIGITS = 6
MOST_DIFFERENCES = 10  # values, that are told


NAMES = {  # of versions
    "code": "the source code of shefex_nav",
    "data": "the star catalogue, a field or the table of the air",
    "target": "the processor that is compiled for",
    "libc": "the C library",
}


class FewerRunsError(StoreError):
    """A folder was asked for more runs than now; `advice` is how to see those that it has."""

    def __init__(self, words, advice=""):
        super().__init__(words, advice)

    def __str__(self):
        return ". ".join(filter(None, self.args))


OWN = (".lock", "campaign.json", "flight.npz", "results.parquet", *runs_file.FILES)
HALF_WRITTEN = (  # folder, pattern
    ("", "campaign.json*.part"),
    ("", "flight.npz*.part"),
    ("", "results.parquet*.part"),
    ("logs", "[0-9]*.part"),
)


class Store:
    """An open folder; `with` keeps every other campaign out of it."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self._lock = self._runs = None
        self._made = []  # folders that were not there before
        self._is_new = False

    def __enter__(self):
        if self.folder.is_file():
            raise StoreError(f"{self.folder}: is a file; expected the name of a folder")
        try:
            self._made = [path for path in (self.folder, *self.folder.parents) if not path.exists()]
            self.folder.mkdir(parents=True, exist_ok=True)
            refuse_links(self.folder, OWN)
            refuse_irregular(self.folder / ".lock")
            self._lock = open(self.folder / ".lock", "a")  # a file of that name is not emptied
        except OSError as error:
            which = "" if error.filename in (None, str(self.folder)) else f"{error.filename}: "
            words = f"cannot write into the folder {self.folder}: {which}{error.strerror}"
            raise StoreError(words) from None
        if not locked(self._lock):
            self._lock.close()
            self._lock = None
            raise StoreError(f"{self.folder}: another campaign is at work in this folder")
        self._is_new = not any((self.folder / name).exists() for name in OWN[1:])
        return self

    def __exit__(self, error, *_):
        if error is not None and self._is_new:
            self._leave_nothing()
        self._close()
        self._lock.close()
        self._lock = None

    @property
    def runs(self):
        """The RunsFile: for writing within the `with`, else for reading."""
        if self._runs is None:
            self._runs = runs_file.RunsFile(self.folder, write=self._lock is not None)
        return self._runs

    def _close(self):
        if self._runs is not None:
            self._runs.close()
        self._runs = None

    def _leave_nothing(self):
        """Take away what a campaign that could not begin has made; not where there is anything of a run."""
        with suppress(OSError, StoreError):
            if (self.folder / "logs").exists() or self.runs.done() or self.runs.lost():
                return
            self._close()
            self._clear()
            for name in OWN:
                (self.folder / name).unlink(missing_ok=True)
            for path in self._made:
                path.rmdir()

    # ---- what is flown -----------------------------------------------------------------------------------

    def head(self):
        """What campaign.json holds; None if there is none."""
        return read_head(self.folder, missing=None)

    def begin(self, plan, dispersions, place=lambda path: "", until_verified=False):
        """Say what is flown here, or go on with the same; StoreError if it was something else. -> head

        place : where the value at a path of the scenario is written, for that error
        until_verified : whether it is judged at its looks from now on
        """
        old = self.head()
        if old is not None:
            _compare(old, plan, self.folder, place)
        elif self.runs.done():
            raise StoreError(f"{self.folder}: there are runs, but no campaign.json that says of what")
        elif (self.folder / "results.parquet").exists():
            words = "results.parquet of another campaign, without the rest of it; choose another folder"
            raise StoreError(f"{self.folder}: there is {words}")
        self._clear()
        head = {
            "format": planning.FORMAT,
            "scenario": plan.name,
            "source": plan.source,
            "digest": planning.digest(plan.source),
            "seed": plan.seed,
            "runs": plan.runs,
            "sampling": plan.sampling,
            "flight": "shared" if plan.shared else "dispersed",
            "rate": plan.series_rate,
            "dispersions": dispersions,
            "versions": plan.versions if old is None else old["versions"],
            "wall_s": 0.0 if old is None else old["wall_s"],
            "timed": (old or {}).get("timed", {"runs": 0, "wall_s": 0.0}),  # runs, and what flying these took
            "flight_sha256": None if old is None else old.get("flight_sha256"),
            **_judging(old or {}, plan.runs, until_verified),
        }
        self._keep_head(head)
        return head

    def _clear(self):
        """Remove what a killed session left half written; only names that a campaign writes."""
        with self._writing():
            for folder, pattern in HALF_WRITTEN:
                for part in (self.folder / folder).glob(pattern):
                    if part.is_file():
                        part.unlink()

    @contextmanager
    def _writing(self):
        """A disk that is full, or gone, is a StoreError."""
        try:
            yield
        except OSError as error:
            words = f"cannot write into {self.folder}: {error.strerror or error}"
            raise StoreError(f"{words}; what is there is kept, the same command goes on") from None

    def took(self, wall_s, runs=None):
        """Add time to what the campaign has taken so far; flying so many runs, or other work. -> s in all"""
        head = self.head()
        head["wall_s"] += wall_s
        if runs is not None:
            head["timed"]["runs"] += runs
            head["timed"]["wall_s"] += wall_s
        self._keep_head(head)
        return head["wall_s"]

    def _keep_head(self, head):
        with self._writing():
            put(self.folder / "campaign.json", json.dumps(head, indent=1, allow_nan=False) + "\n")
            settle(self.folder)

    def flight(self, make):
        """The flight that all runs share, as bytes: the one that is kept here, else `make()`."""
        path, head = self.folder / "flight.npz", self.head()
        with self._writing():
            if path.exists() and planning.digest(content := content_of(path)) == head["flight_sha256"]:
                return content
            content = make()
            if head["flight_sha256"] not in (None, planning.digest(content)):
                raise StoreError(f"{path}: is not what the runs flew, and cannot be made again as it was")
            put(path, content)
        self._keep_head(head | {"flight_sha256": planning.digest(content)})
        return content

    # ---- runs --------------------------------------------------------------------------------------------

    def log(self, run):
        """Path of the log of a run; its folder is made."""
        with self._writing():
            (self.folder / "logs").mkdir(exist_ok=True)
        return self.folder / "logs" / f"{run:0{DIGITS}d}.mcap"

    def keep_log(self, run):
        """Give the log that has been written to the `files.part` of its place its name."""
        with self._writing():
            finish(self.log(run))

    def keep(self, flown, bad=None):
        """Keep a run. bad : how bad it is (`running.badness`)"""
        self.runs.keep([(flown, bad)])

    def _dispersed(self):
        """disperse.Dispersed of what is drawn here: list."""
        head = self.head()
        return [] if head is None else draws.dispersed_in(head["source"], f"{self.folder}/campaign.json")

    def record(self, run):
        """Record of a run; None if it is not done. SpoiltError if a disk spoilt it or a value cannot be."""
        record = self.runs.record(run)
        if record is not None and (wrong := checking.row_fault(table.row(record), self._drawn)):
            raise self._spoilt(checking.wrong_value(run, *wrong))
        return record

    @cached_property
    def _drawn(self):
        """Paths whose draws are numbers."""
        return draws.numeric(self._dispersed())

    def _spoilt(self, error):
        """SpoiltError of a checking.WrongValueError."""
        return self.runs.spoilt_run(f"the record of run {error.run}: {error.words}", error.run)

    def tabulate(self):
        """Write results.parquet of the runs that are done, unless it is there. -> table.Made"""
        path = self.folder / "results.parquet"
        state = self.runs.state()
        with suppress(OSError, ValueError, KeyError):
            if (made := table.made(path)).state == state:
                return made
        with self._writing():
            self.write_table(path)
            settle(self.folder)
        return table.made(path)

    def write_table(self, path):
        """Write the table of the runs that are done to a path."""
        with self.runs.unchanged():
            given = self._dispersed()
            measures = {one.name: one.measure for one in given}
            try:
                table.save(_Rows(self.runs), path, measures, self.runs.state(), draws.numeric(given))
            except checking.WrongValueError as error:
                raise self._spoilt(error) from None


class _Rows:
    """Rows of the runs that are done, in order, as often as they are gone through."""

    def __init__(self, runs):
        self._runs = runs

    def __iter__(self):
        return map(table.row, self._runs.records())


def _judging(old, runs, until_verified):
    """What of campaign.json says how its requirements are judged. old : head before, or {}"""
    was, before, asked = old.get("until_verified", False), old.get("asked_before", []), old.get("runs")
    flown_on = asked is not None and not was and (until_verified or asked != runs)
    return {
        "until_verified": until_verified or was,
        "asked_before": [*before, asked] if flown_on else before,  # numbers of runs that were settled
    }


def _compare(old, plan, folder, place):
    """StoreError if the campaign in the folder is another one."""
    how = "choose another folder with --out"
    if old["source"] != plan.source:
        raise StoreError(_other_scenario(old, plan, folder, place, how))
    if old["seed"] != plan.seed:
        raise StoreError(f"{folder}: was flown with --seed {old['seed']}, not {plan.seed}; {how}")
    if plan.sampling == "latin_hypercube" and old["runs"] != plan.runs:
        raise StoreError(
            f"{folder}: a Latin hypercube of {old['runs']} runs, of which each draw depends on that number; "
            f"--runs {plan.runs} is another campaign: {how}"
        )
    if plan.runs < old["runs"]:
        raise FewerRunsError(
            f"{folder}: was asked for {old['runs']} runs, --runs {plan.runs} would take some away; expected "
            f"{old['runs']} or more, or another folder with --out",
            "`shefex-nav report` reads what there is",
        )
    now = plan.versions
    differ = [
        f"{NAMES.get(name, name)} ({was} then, {now.get(name)} now)"
        for name, was in old["versions"].items()
        if now.get(name) != was
    ]
    if differ:
        raise StoreError(
            f"{folder}: results would be mixed, because something changed since: {', '.join(differ)}; {how}"
        )


def _other_scenario(old, plan, folder, place, how):
    """Words about a scenario that is not the one of the folder: the first values that differ."""
    found = differences.of_texts(old["source"], plan.source, (f"{folder}/campaign.json", plan.name))
    what = "the scenario is not the one that was flown here"
    if old["scenario"] != plan.name:
        what = f"this is a campaign of {old['scenario']!r}, not of {plan.name!r}"
    told = differences.lines(found, place, MOST_DIFFERENCES)
    if more := len(found) - len(told):
        see = f"`shefex-nav check SCENARIO --against {folder}` shows all"
        told.append(f"and {more} more values; {see}")
    count = f"{len(found)} values differ" if found[1:] else "one value differs"
    return "\n".join([f"{folder}: {what}; {how}, or undo the change. {count} (flown here -> now):", *told])
