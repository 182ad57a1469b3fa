"""Trajectories of the NESC check-cases on disk: which there are, and what they say.

In: a folder of any layout. Out: the files of models and of trajectories in it; the columns of the latter.

Trajectories are files Atmos_<case>_sim_<simulator>.csv, models are .dml files, anywhere below the folder.
"""

import csv
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError

_TRAJECTORY = re.compile(r"(?:\w+_)?(Atmos|Orbit)_([0-9A-Za-z]+)(?:_\w+)?_sim_([0-9A-Za-z]+)\.csv")


class NescDataError(UserError, ValueError):
    """Check-case data that are missing or cannot be read."""


class Files(NamedTuple):
    """What a folder holds."""

    folder: Path
    trajectories: dict  # case ("01", "13p1", "Orbit 06A" ...) -> {simulator ("04"): path}
    models: dict  # file name in lower case -> path


class Series(NamedTuple):
    """The trajectory of one simulator."""

    t_s: np.ndarray  # (n,)
    columns: dict  # name -> (n,)


def search(folder):
    """Files of models and trajectories anywhere below a folder."""
    folder = Path(folder)
    if not folder.is_dir():
        raise NescDataError(f"{folder}: there is no such folder of check-cases")
    trajectories, models = {}, {}
    for path in sorted(folder.rglob("*")):
        found = _TRAJECTORY.fullmatch(path.name)
        if found:
            kind, case, simulator = found.groups()
            case = case if kind == "Atmos" else f"Orbit {case}"
            trajectories.setdefault(case, {}).setdefault(simulator, path)
        elif path.suffix.lower() == ".dml":
            models.setdefault(path.name.lower(), path)
    if not trajectories:
        raise NescDataError(f"{folder}: no trajectory Atmos_<case>_sim_<simulator>.csv in it or below it")
    return Files(folder, trajectories, models)


def model_path(files, name):
    """Path of a model by its file name."""
    if name not in files.models:
        raise NescDataError(f"{files.folder}: the model {name} is not in it or below it")
    return files.models[name]


def read_series(path):
    """Series of a trajectory file; what is no number in it is an error, an empty cell is NaN."""
    try:
        with open(path, encoding="utf-8-sig", newline="") as lines:
            names, *rows = [row for row in csv.reader(lines) if row] or [[]]
        values = np.array([[float(cell.strip() or "nan") for cell in row] for row in rows])
    except (OSError, ValueError, csv.Error) as error:
        raise NescDataError(f"{path}: cannot be read as a trajectory: {error}") from None
    names = [name.strip() for name in names]
    if names[:1] != ["time"] or values.ndim != 2 or len(values) < 2 or values.shape[1] != len(names):
        raise NescDataError(f"{path}: a trajectory has a line of titles, time first, and at least two rows")
    columns = {}
    for k, name in enumerate(names[1:], start=1):
        columns.setdefault(name, values[:, k])  # one simulator writes a column twice
    return Series(values[:, 0], columns)


def on_grid(series, t_s, name):
    """Column `name` at the times t_s (n,), NaN where the series has no row: (n,); None: no such column.

    Times are matched to 5e-6 s: one simulator wrote them in single precision.
    """
    if name not in series.columns:
        return None
    right = np.clip(np.searchsorted(series.t_s, t_s), 1, series.t_s.size - 1)
    left = right - 1
    nearest = np.where(np.abs(series.t_s[left] - t_s) < np.abs(series.t_s[right] - t_s), left, right)
    same = np.abs(series.t_s[nearest] - t_s) < 5e-6
    return np.where(same, series.columns[name][nearest], np.nan)
