"""Trajectories of the NESC check-cases on disk: which there are, and what they say.

In: a folder of any layout. Out: the files of models and of trajectories in it; the columns of the latter.

Trajectories are files Atmos_<case>_sim_<simulator>.csv, models are .dml files, anywhere below the folder.
"""

import csv
import io
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.fields import LARGEST
from shefex_nav.files import opened
from shefex_nav.numerals import number

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
    """Series of a trajectory file; what is no number in it is an error, an empty cell is NaN.

    Times do not go down; two rows may have one, as simulators write them where a phase ends.
    """
    try:
        with io.TextIOWrapper(opened(path), encoding="utf-8-sig", newline="") as lines:
            reader = csv.reader(lines)
            names, *rows = [(reader.line_num, row) for row in reader if row] or [(1, [])]
    except (OSError, ValueError, csv.Error) as error:
        raise NescDataError(f"{path}: cannot be read as a trajectory: {error}") from None
    names = [name.strip() for name in names[1]]
    if names[:1] != ["time"] or len(rows) < 2:
        raise NescDataError(f"{path}: a trajectory has a line of titles, time first, and at least two rows")
    values = np.array([_row(path, n, names, row) for n, row in rows])
    for k in np.flatnonzero(~(np.diff(values[:, 0], prepend=-np.inf) >= 0.0))[:1]:
        words = (
            f"time: got {rows[k][1][0].strip() or 'nothing'}, expected one not before that of the row above"
        )
        raise NescDataError(f"{path}:{rows[k][0]}: {words}")
    columns = {}
    for k, name in enumerate(names[1:], start=1):
        columns.setdefault(name, values[:, k])  # one simulator writes a column twice
    return Series(values[:, 0], columns)


def _row(path, n, names, cells):
    """Numbers of a row, NaN of empty cells: list."""
    if len(cells) != len(names):
        raise NescDataError(f"{path}:{n}: {len(cells)} values, but {len(names)} titles")
    found = []
    for name, cell in zip(names, cells, strict=True):
        try:
            found.append(number(cell) if cell.strip() else math.nan)
        except ValueError as error:
            raise NescDataError(f"{path}:{n}: {name}: {error}") from None
        if abs(found[-1]) > LARGEST:
            raise NescDataError(
                f"{path}:{n}: {name}: expected a number below {LARGEST:g}, got {cell.strip()}"
            )
    return found


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
