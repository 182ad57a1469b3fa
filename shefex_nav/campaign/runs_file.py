"""The runs of a campaign in one file of SQLite: what is known of each, record, series, why it was lost.

A run is kept in one transaction: all of it is there, or nothing. Table `runs` has what a session that goes on
needs to know of each run and is small; records and series are read run by run.

The journal is a write-ahead log (WAL), so that a report reads while a campaign writes; at the end of a
session the file is one file again. `synchronous=FULL`: the log is on the disk before a run counts as done.
"""

import json
import sqlite3
import weakref
import zlib
from contextlib import contextmanager, suppress
from typing import NamedTuple

from shefex_nav.campaign import MOST_RUNS
from shefex_nav.campaign.plan import digest
from shefex_nav.errors import UserError
from shefex_nav.files import from_json, refuse_irregular, unpacked

NAME = "runs.sqlite"
FILES = (NAME, f"{NAME}-wal", f"{NAME}-shm", f"{NAME}-journal")
KIND = 0x53484658  # `application_id` of the file
PAGE = 16384  # bytes; the small table of a million runs has then 2000 pages
PATIENCE_S = 60.0  # for a lock that another program holds
LARGEST_RECORD = 8 << 20  # bytes unpacked; one of a mission has 12 000
LEVEL = 1  # of zlib; 6 takes twice the time for 8 % less
TABLES = (
    "CREATE TABLE runs (run INTEGER PRIMARY KEY, failed INTEGER, severity REAL, rms_deg REAL)",
    "CREATE TABLE records (run INTEGER PRIMARY KEY, record BLOB)",  # zlib of JSON
    "CREATE TABLE series (run INTEGER PRIMARY KEY, sha256 TEXT, arrays BLOB)",  # an .npz file
    "CREATE TABLE lost (run INTEGER PRIMARY KEY, reason TEXT, deadly INTEGER)",
)
OF_RUN = "run", "failed", "severity", "rms_deg"
WRONG_ROW = (
    "SELECT * FROM runs WHERE run < 0 OR run >= ? OR typeof(failed) NOT IN ('integer', 'null') OR "
    "typeof(severity) NOT IN ('real', 'null') OR typeof(rms_deg) NOT IN ('real', 'null') LIMIT 1"
)
KINDS = {str: "a text", int: "a whole number", dict: "an object"}
MOST_SEED = 2**53  # as `draws.SEED_BITS`
WORST_FIRST = "ORDER BY severity DESC, rms_deg DESC, run"


class StoreError(UserError):
    """A folder that cannot be used; the message says why and what to do."""


class SpoiltError(StoreError):
    """A run whose record or series a disk has spoilt; the message says how to have it again."""


FORM = {  # of a record: its types
    "status": str, "reason": str, "traceback": str, "seed": int, "draws": dict, "summary": dict,
    "series_sha256": str, "timing": dict,
}  # fmt: skip


def _form_fault(record, run):
    """What is wrong with the form of what was kept as the record of a run, in words; '' if nothing is."""
    if type(record) is not dict:
        return f"got a {type(record).__name__}, expected an object"
    for key, kind in FORM.items():
        if type(record.get(key)) is not kind:
            return f"{key}: got {record.get(key)!r:.80}, expected {KINDS[kind]}"
    if record.get("run") != run:
        return f"run: got {record.get('run')!r:.80}, expected {run}"
    if record["status"] not in ("succeeded", "failed"):
        return f"status: got {record['status']!r:.80}, expected 'succeeded' or 'failed'"
    if not 0 <= record["seed"] < MOST_SEED:
        return f"seed: got {record['seed']!r:.80}, expected a whole number from 0 to {MOST_SEED - 1}"
    if record["status"] == "failed" and record["summary"]:
        return "status: got 'failed' with a summary, which only a run that flew to its end has"
    return ""


class Standing(NamedTuple):
    """What is known of the runs that are done, together."""

    done: int
    failed: int
    missed: int  # that do not meet a requirement
    worst: tuple | None  # ((severity, rms_deg), run)


class RunsFile:
    """The file of a folder, open. Errors of SQLite and of the disk are StoreErrors."""

    def __init__(self, folder, *, write=False):
        """write : whether runs are to be kept in it. Without a file one is made, or an empty one read."""
        self.path, self._writes = folder / NAME, write
        address = f"{self.path.absolute().as_uri()}?mode={'rwc' if write else 'ro'}"
        if not write and not (self.path.exists() and self.path.stat().st_size):
            address = "file::memory:"
        with self._told():
            refuse_irregular(self.path)
            self._db = sqlite3.connect(
                address, uri=True, isolation_level=None, timeout=PATIENCE_S, check_same_thread=False
            )
            weakref.finalize(self, self._db.close)  # a reader's lock would outlive it: sqlite3 has a cycle
            self._db.execute(f"PRAGMA page_size = {PAGE}")
            self._db.execute("PRAGMA trusted_schema = OFF")
            if not self._one("PRAGMA schema_version"):
                self._make()
            if self._one("PRAGMA application_id") != KIND:
                raise StoreError(f"{self.path}: is another program's; expected the runs of a campaign")
            self._check()
            if write:
                self._db.execute("PRAGMA journal_mode = WAL")
                self._db.execute("PRAGMA synchronous = FULL")

    def _make(self):
        """Tables of a new file."""
        with self._transaction():
            for table in TABLES:
                self._db.execute(table)
            self._db.execute(f"PRAGMA application_id = {KIND}")

    def _check(self):
        """StoreError unless the file has the tables that `_make` makes, and nothing else, and rows of runs.

        A view may be endless, a trigger do anything.
        """
        found = {text for (text,) in self._db.execute("SELECT sql FROM sqlite_master")}
        if found != set(TABLES):
            other = next(iter(sorted(str(text) for text in found - set(TABLES))), None)
            words = f"holds {other[:80]!r}" if other else "lacks a table"
            raise StoreError(
                f"{self.path}: {words}, unlike that of a campaign; restore it, or fly a new one with --out"
            )
        if (wrong := self._db.execute(WRONG_ROW, (MOST_RUNS,)).fetchone()) is not None:
            told = ", ".join(f"{name} {value!r:.40}" for name, value in zip(OF_RUN, wrong, strict=True))
            raise StoreError(
                f"{self.path}: table runs: got {told}; expected a run from 0 to {MOST_RUNS - 1} and numbers; "
                "restore it, or fly a new campaign with --out"
            )

    def close(self):
        """End the use of the file; after writing it is one file again, unless somebody reads it now."""
        with suppress(sqlite3.Error):
            if self._writes:
                self._db.execute("PRAGMA busy_timeout = 0")
                self._db.execute("PRAGMA journal_mode = DELETE")
        self._db.close()

    @contextmanager
    def _told(self):
        """An error of SQLite becomes a StoreError."""
        try:
            yield
        except sqlite3.OperationalError as error:
            words = f"cannot use {self.path}: {error}"
            raise StoreError(f"{words}; what is there is kept, the same command goes on") from None
        except sqlite3.DatabaseError as error:
            words = f"is damaged, or no file of runs, or its disk fails ({error})"  # SQLite calls these alike
            raise StoreError(
                f"{self.path}: {words}; copy it to another disk, restore it, or fly a new campaign with --out"
            ) from None

    @contextmanager
    def _transaction(self, kind="IMMEDIATE"):
        """All of it, or nothing."""
        self._db.execute(f"BEGIN {kind}")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:  # a full disk may have ended it
                self._db.execute("ROLLBACK")
            raise

    def _one(self, question, *values):
        """The first value of the first row; None without any."""
        return next(iter(self._db.execute(question, values).fetchone() or (None,)))

    def _all(self, question, *values):
        with self._told():
            return self._db.execute(question, values).fetchall()

    @contextmanager
    def unchanged(self):
        """What is read meanwhile is of one instant."""
        with self._told(), self._transaction("DEFERRED"):
            yield

    # ---- write -------------------------------------------------------------------------------------------

    def keep(self, many):
        """Keep runs in one transaction. many : iterable of (Flown, (severity, rms_deg) or None)"""
        with self._told(), self._transaction():
            for flown, bad in many:
                self._keep(flown, bad)
            self._db.execute(f"PRAGMA user_version = {self._one('PRAGMA user_version') + 1}")

    def _keep(self, flown, bad):
        run, say = flown.record["run"], self._db.execute
        packed = zlib.compress(json.dumps(flown.record, allow_nan=False).encode(), LEVEL)
        is_failed = flown.record.get("status") == "failed"
        say("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?)", (run, is_failed, *(bad or (None, None))))
        say("INSERT OR REPLACE INTO records VALUES (?, ?)", (run, packed))
        say("DELETE FROM lost WHERE run = ?", (run,))
        if flown.series is None:
            say("DELETE FROM series WHERE run = ?", (run,))
        else:
            row = run, digest(flown.series), flown.series
            say("INSERT OR REPLACE INTO series VALUES (?, ?, ?)", row)

    def lose(self, lost):
        """Keep why a run was lost. engine.Lost -> in how many sessions it killed its worker each time"""
        with self._told(), self._transaction():
            before = self._one("SELECT deadly FROM lost WHERE run = ?", lost.run) or 0
            row = lost.run, lost.reason, before + lost.deadly
            self._db.execute("INSERT OR REPLACE INTO lost VALUES (?, ?, ?)", row)
        return row[-1]

    # ---- read --------------------------------------------------------------------------------------------

    def state(self):
        """Text that is another one after each change of what is kept."""
        with self._told():
            return f"{self._one('PRAGMA user_version')} {self._one('SELECT count(*) FROM runs')}"

    def done(self):
        """Numbers of the runs that are done: set."""
        return {run for (run,) in self._all("SELECT run FROM runs")}

    def standing(self, without=()):
        """Standing of the runs that are done, but for a few."""
        others = f"run NOT IN ({', '.join(str(int(run)) for run in without)})"
        ((done, failed, missed),) = self._all(
            f"SELECT count(*), total(failed), total(severity >= 1.0) FROM runs WHERE {others}"
        )
        known = f"WHERE severity NOTNULL AND {others}"
        worst = self._all(f"SELECT severity, rms_deg, run FROM runs {known} {WORST_FIRST} LIMIT 1")
        worst = (worst[0][:2], worst[0][2]) if worst else None
        return Standing(done, int(failed), int(missed), worst)

    def worst(self, most):
        """Numbers of the worst runs that flew to their end, the worst first: list."""
        question = f"SELECT run FROM runs WHERE NOT failed {WORST_FIRST} LIMIT ?"
        return [run for (run,) in self._all(question, most)]

    def failed(self):
        """Numbers of the runs that failed: list."""
        return [run for (run,) in self._all("SELECT run FROM runs WHERE failed ORDER BY run")]

    def lost(self):
        """Runs that were lost and have no record since: dict run -> {"reason", "deadly": sessions}."""
        rows = self._all("SELECT * FROM lost WHERE run NOT IN (SELECT run FROM runs) ORDER BY run")
        return {run: {"reason": reason, "deadly": deadly} for run, reason, deadly in rows}

    def record(self, run):
        """Record of a run; None if it is not done. SpoiltError if a disk spoilt it."""
        question = "SELECT record FROM runs LEFT JOIN records USING (run) WHERE run = ?"
        rows = self._all(question, int(run))
        return self._unpacked(run, rows[0][0]) if rows else None

    def records(self):
        """Records of the runs that are done, in order: iterator."""
        question = "SELECT run, record FROM runs LEFT JOIN records USING (run) ORDER BY run"
        with self._told():
            for run, packed in self._db.execute(question):
                yield self._unpacked(run, packed)

    def _unpacked(self, run, packed):
        """Record of what is kept of it."""
        try:
            record = from_json(unpacked(packed, LARGEST_RECORD))
        except (zlib.error, ValueError, TypeError):
            raise self.spoilt_run(f"the record of run {run} is spoilt", run) from None
        if words := _form_fault(record, run):
            raise self.spoilt_run(f"the record of run {run}: {words}", run)
        return record

    def series(self, run):
        """Series of a run, bytes of an .npz file; None if there is none. SpoiltError if a disk spoilt it."""
        rows = self._all("SELECT sha256, arrays FROM series WHERE run = ?", int(run))
        if not rows:
            return None
        (expected, content) = rows[0]
        if not isinstance(content, bytes) or digest(content) != expected:
            raise self.spoilt_run(f"the series of run {run} are spoilt", run)
        return content

    def spoilt_run(self, what, run):
        """SpoiltError that says how to have a run again."""
        command = f"shefex-nav repeat {self.path.parent} {run} --keep"
        return SpoiltError(f"{self.path}: {what}; `{command}` flies it again and keeps it")

    def spoilt(self, first):
        """Numbers of those of the first runs whose record or series a disk has spoilt: list."""
        found = []
        for (run,) in self._all("SELECT run FROM runs WHERE run < ? ORDER BY run", first):
            try:
                self.record(run)
                self.series(run)
            except SpoiltError:
                found.append(run)
        return found
