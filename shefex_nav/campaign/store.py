"""The folder of a campaign: what is flown, one file a run, and the table of all (see the package).

A file is written whole or not at all: under another name first, which then becomes its own.
"""

import difflib
import json
import os
from pathlib import Path

from shefex_nav.campaign import plan as planning
from shefex_nav.campaign import table
from shefex_nav.scenario import document

DIGITS = 6
LONGEST_DIFFERENCE = 60  # lines


class StoreError(Exception):
    """A folder that cannot be used; the message says why and what to do."""


def put(path, content):
    """Write bytes or text to a file, whole or not at all."""
    part = path.with_name(path.name + ".part")
    if isinstance(content, str):
        content = content.encode()
    part.write_bytes(content)
    os.replace(part, path)


HALF_WRITTEN = (  # folder, pattern
    ("", "campaign.json*.part"),
    ("", "flight.npz*.part"),
    ("", "results.parquet*.part"),
    ("runs", "[0-9]*.part"),
    ("logs", "[0-9]*.part"),
)


class Store:
    """An open folder; `with` keeps every other campaign out of it."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self._lock = None

    def __enter__(self):
        try:
            (self.folder / "runs").mkdir(parents=True, exist_ok=True)
            self._lock = open(self.folder / ".lock", "w")
        except OSError as error:
            raise StoreError(f"cannot write into the folder {self.folder}: {error.strerror}") from None
        if not _locked(self._lock):
            self._lock.close()
            raise StoreError(f"{self.folder}: another campaign is at work in this folder")
        return self

    def __exit__(self, *_):
        self._lock.close()

    # ---- what is flown -----------------------------------------------------------------------------------

    def head(self):
        """What campaign.json holds; None if there is none."""
        return read_head(self.folder, missing=None)

    def begin(self, plan, dispersions):
        """Say what is flown here, or go on with the same; StoreError if it was something else. -> head"""
        old = self.head()
        if old is not None:
            _compare(old, plan, self.folder)
        elif any((self.folder / "runs").iterdir()):
            raise StoreError(f"{self.folder}: there are runs, but no campaign.json that says of what")
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
        }
        self._keep_head(head)
        return head

    def _clear(self):
        """Remove what a killed session left half written; only names that a campaign writes."""
        for folder, pattern in HALF_WRITTEN:
            for part in (self.folder / folder).glob(pattern):
                if part.is_file():
                    part.unlink()

    def took(self, wall_s):
        """Add the time of a session to what the campaign has taken so far. -> s in all"""
        head = self.head()
        head["wall_s"] += wall_s
        self._keep_head(head)
        return head["wall_s"]

    def _keep_head(self, head):
        put(self.folder / "campaign.json", json.dumps(head, indent=1, allow_nan=False) + "\n")

    def flight(self, make):
        """The flight that all runs share, as bytes: the one that is kept here, else `make()`."""
        path = self.folder / "flight.npz"
        if not path.exists():
            put(path, make())
        return path.read_bytes()

    # ---- runs --------------------------------------------------------------------------------------------

    def path(self, run, ending):
        """Path of a file of a run."""
        return self.folder / "runs" / f"{run:0{DIGITS}d}.{ending}"

    def log(self, run):
        """Path of the log of a run; its folder is made."""
        (self.folder / "logs").mkdir(exist_ok=True)
        return self.folder / "logs" / f"{run:0{DIGITS}d}.mcap"

    def keep(self, flown):
        """Keep a run; its record comes last, because it says that the run is done."""
        run = flown.record["run"]
        if flown.series is not None:
            put(self.path(run, "npz"), flown.series)
        put(self.path(run, "json"), json.dumps(flown.record, allow_nan=False) + "\n")

    def record(self, run):
        """Record of a run; None if it is not there or was cut off by a power failure."""
        return read_record(self.folder, run)

    def records(self, runs):
        """Records of those of the first `runs` runs that are done, in order: iterator."""
        for run in sorted(self.done()):
            if run < runs and (record := self.record(run)) is not None:
                yield record

    def done(self):
        """Numbers of the runs whose record is there: set."""
        return {int(path.stem) for path in (self.folder / "runs").glob("*.json") if path.stem.isdecimal()}

    def tabulate(self, runs):
        """Write results.parquet of the runs that are done. -> (rows, digest)"""
        rows = [table.row(record) for record in self.records(runs)]
        table.save(rows, self.folder / "results.parquet")
        return rows, table.digest(rows)


def read_head(folder, missing=StoreError):
    """What campaign.json of a folder holds; StoreError, or None if `missing` is None, without one."""
    path = Path(folder) / "campaign.json"
    try:
        head = json.loads(path.read_text())
    except FileNotFoundError:
        if missing is None:
            return None
        raise StoreError(f"{folder}: there is no campaign.json; expected the folder of a campaign") from None
    except (OSError, ValueError) as error:
        raise StoreError(f"{path}: cannot be read: {error}") from None
    if head.get("format") != planning.FORMAT:
        raise StoreError(f"{path}: its format is {head.get('format')}, expected {planning.FORMAT}")
    return head


def read_record(folder, run):
    """Record of a run of a folder; None if there is no whole one."""
    try:
        record = json.loads((Path(folder) / "runs" / f"{run:0{DIGITS}d}.json").read_text())
    except (FileNotFoundError, ValueError):
        return None
    return record if isinstance(record, dict) and record.get("run") == run else None


def _locked(file):
    """Whether this process may use the folder alone from now on; the lock goes when the process does."""
    try:
        import fcntl
    except ImportError:  # Windows has none
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _compare(old, plan, folder):
    """StoreError if the campaign in the folder is another one."""
    how = "choose another folder with --out"
    if old["source"] != plan.source:
        raise StoreError(
            f"{folder}: the scenario is not the one that was flown here; {how}, or undo the change:\n"
            + difference(old["source"], plan.source)
        )
    if old["seed"] != plan.seed:
        raise StoreError(f"{folder}: was flown with --seed {old['seed']}, not {plan.seed}; {how}")
    if plan.sampling == "latin_hypercube" and old["runs"] != plan.runs:
        raise StoreError(
            f"{folder}: a Latin hypercube of {old['runs']} runs, of which each draw depends on that number; "
            f"--runs {plan.runs} is another campaign: {how}"
        )
    now = plan.versions
    differ = [
        f"{name} {was}, now {now.get(name)}" for name, was in old["versions"].items() if now.get(name) != was
    ]
    if differ:
        raise StoreError(f"{folder}: was flown with {'; '.join(differ)}; {how}")


def difference(old, new):
    """Unified difference of two scenarios' texts, one line a value, cut off if it is long."""
    before, after = (list(_values(document.parse(text, "").tree)) for text in (old, new))
    lines = list(difflib.unified_diff(before, after, "flown here", "asked for now", n=0, lineterm=""))
    lines = [line for line in lines if not line.startswith("@@")]
    more = len(lines) - LONGEST_DIFFERENCE
    return "\n".join([*lines[:LONGEST_DIFFERENCE], *([f"... and {more} more lines"] if more > 0 else [])])


def _values(tree, path=""):
    """`launch.elevation: 86.43 deg` for each value of a scenario."""
    for key, value in tree.items():
        name = f"{path}.{key}" if path else str(key)
        if isinstance(value, dict) and value:
            yield from _values(value, name)
        else:
            yield f"{name}: {value}"
