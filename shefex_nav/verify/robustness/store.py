"""The folder of a study: `robustness.json` says what is flown, `flights.jsonl` has a line for each flight.

A line is on the disk before its flight counts as done; half a line, of a process that was killed, is taken
away when the study goes on.
"""

import json
import os
from functools import partial
from pathlib import Path

from shefex_nav.errors import UserError
from shefex_nav.files import digest, from_json, locked, put, refuse_irregular, refuse_links, settle, text_of
from shefex_nav.verify.robustness import flight, lines

HEAD, FLIGHTS, PAGE, LOCK = "robustness.json", "flights.jsonl", "robustness.html", ".lock"
PACKAGE = Path(__file__).parents[2]


class StoreError(UserError):
    """A folder that cannot be used; the message says why and what to do."""


def code_digest():
    """Digest of the program: a study is of one program."""
    return digest((path for path in PACKAGE.glob("**/*") if path.suffix in (".py", ".csv")), PACKAGE)


def head(request):
    """What a folder is of; what may grow, flights and cells, is not in it."""
    return {
        "scenarios": [name for name, *_ in request.scenarios],
        "set": list(request.overrides),
        "seed": request.seed,
        "of": "random faults" if request.random else "design",
        "code": code_digest(),
    }


class Store:
    """An open folder; None: nothing is kept but in memory. `with` closes its file."""

    def __init__(self, folder, head, resume):
        self.done, self._file, self._lock = {}, None, None
        if folder is None:
            return
        self.folder = Path(folder)
        try:
            self._open(head, resume)
        except OSError as error:
            self._close()
            which = "" if error.filename in (None, str(self.folder)) else f"{error.filename}: "
            raise StoreError(f"cannot write into the folder {folder}: {which}{error.strerror}") from None
        except UserError:
            self._close()
            raise

    def _open(self, head, resume):
        self.folder.mkdir(parents=True, exist_ok=True)
        refuse_links(self.folder, (HEAD, FLIGHTS))
        for name in (FLIGHTS, LOCK):
            refuse_irregular(self.folder / name)
        self._lock = open(self.folder / LOCK, "a")
        if not locked(self._lock):
            raise StoreError(f"{self.folder}: another study is at work in this folder")
        self._begin(head, resume)
        self._file = open(self.folder / FLIGHTS, "a", encoding="utf-8")

    def _close(self):
        for file in (self._file, self._lock):
            if file is not None:
                file.close()

    def _begin(self, head, resume):
        path = self.folder / HEAD
        if path.exists():
            if not resume:
                raise StoreError(
                    f"{self.folder}: holds a study already; --resume goes on with it, or name another"
                )
            _compare(_head(path), head, self.folder)
            self.done = _read(self.folder / FLIGHTS, head["seed"])
        elif (self.folder / FLIGHTS).exists():
            raise StoreError(f"{self.folder}: there are flights, but no {HEAD} that says of what")
        else:
            put(path, json.dumps(head, indent=1) + "\n")
            settle(self.folder)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._close()

    def keep(self, record):
        """Keep the record of a flight."""
        self.done[key(record)] = record
        if self._file is not None:
            self._file.write(json.dumps(record, allow_nan=False) + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())

    def missing(self, jobs):
        """Those of a list of flight.Job whose flights are not done."""
        return [job for job in jobs if job_key(job) not in self.done]

    def of(self, jobs):
        """Records of those of a list of flight.Job whose flights are done, in the order of their keys."""
        wanted = {job_key(job) for job in jobs}
        return [record for one, record in sorted(self.done.items()) if one in wanted]


def job_key(job):
    """The `key` of the record that a flight.Job is going to have."""
    return job.cell.rocket, job.cell.number, job.flight


def key(record):
    """What tells one flight from the others: (rocket, cell, flight)."""
    return record["rocket"], record["cell"], record["flight"]


def _compare(old, new, folder):
    """StoreError if a folder is of another study."""
    differ = [name for name in new if old.get(name) != new[name]]
    if differ:
        words = "; ".join(f"{name} was {old.get(name)!r}, now {new[name]!r}" for name in differ)
        raise StoreError(f"{folder}: is of another study: {words}")


def _head(path):
    """What a folder says that it is of: dict."""
    try:
        found = from_json(text_of(path))
    except ValueError as error:
        raise StoreError(f"{path}: cannot be read: {error}") from None
    if not isinstance(found, dict):
        raise StoreError(f"{path}: is no head of a study")
    return found


def _read(path, seed):
    """Flights that are done: dict key -> record. Half a line at the end is cut off. seed : of the study"""
    if not path.exists():
        return {}
    found, whole = lines.read(path, partial(flight.seed_of, seed))
    if whole < path.stat().st_size:
        with open(path, "rb+") as file:
            file.truncate(whole)
    return {key(record): record for record in found}
