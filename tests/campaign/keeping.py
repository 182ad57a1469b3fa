"""The runs that a campaign has kept, as tests look at them and spoil them."""

import io
import sqlite3
from contextlib import closing

import numpy as np

from shefex_nav.campaign.flight import Flown
from shefex_nav.campaign.runs_file import NAME
from shefex_nav.campaign.store import Store


def rows(folder):
    """Rows of its table: list of dict."""
    from shefex_nav.campaign import table

    return list(table.load(folder / "results.parquet"))


def done(folder):
    """How many runs are done, also while a campaign is at work."""
    return len(Store(folder).runs.done())


def state(folder):
    """Text that is another one when a run has been kept since."""
    return Store(folder).runs.state()


def record(folder, run):
    return Store(folder).runs.record(run)


def content(folder, run):
    """Bytes of the series of a run."""
    return Store(folder).runs.series(run)


def series(folder, run):
    """Arrays of a run by their names."""
    return np.load(io.BytesIO(content(folder, run)))


def change(folder, run, edit):
    """Let `edit` change the record of a run."""
    with Store(folder) as store:
        found = store.runs.record(run)
        edit(found)
        store.keep(Flown(found, store.runs.series(run)))


def say(folder, *sql):
    """Statements of SQL, as a user may give them, or a disk that spoils what is there."""
    with closing(sqlite3.connect(folder / NAME)) as file, file:
        file.execute(*sql)


def spoil(folder, run, content=b""):
    """Other bytes in place of the series of a run."""
    say(folder, "UPDATE series SET arrays = ? WHERE run = ?", (content, run))


def forget(folder, run):
    """Take a run away, as the documentation says."""
    say(folder, f"DELETE FROM runs WHERE run = {run}")


def without_series(folder):
    say(folder, "DELETE FROM series")


def sound(folder):
    """Whether SQLite finds no fault in the file."""
    with closing(sqlite3.connect(folder / NAME)) as file:
        return file.execute("PRAGMA integrity_check").fetchone() == ("ok",)
