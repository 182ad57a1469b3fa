"""Text files -> columns of numbers that know their place in the file.

A file of some hundred thousand lines is read in one go; only when that fails is it searched for the lines
that are wrong.
"""

import difflib
import os
from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.scenario.files import LARGEST_DATA, Unreadable, read_text
from shefex_nav.scenario.quantity import quoted

MOST_ERRORS = 5  # of one file; a file of the wrong kind is wrong in every line


class DataError(UserError):
    """Data that cannot be used; the message has one line for each thing, `file:line: column: what`."""


class Table(NamedTuple):
    """Columns of one file."""

    file: str
    columns: dict  # name -> (N,) float64
    lines: np.ndarray | None  # (N,) number of the line of each row; None in files without lines

    def place(self, row):
        """Where a row stands, for a message."""
        return f"{self.file}: row {row + 1}" if self.lines is None else f"{self.file}:{self.lines[row]}"

    def stack(self, names):
        """(N, k) of columns; their names -> array."""
        return np.column_stack([self.columns[name] for name in names])


def read_csv(path, names):
    """Table of the columns `names` of a CSV whose first line that is no comment names its columns."""
    numbered = _lines(path)
    number, head = numbered[0]
    separator = next((mark for mark in (",", ";", "\t") if mark in head), None)
    found = [cell.strip() for cell in head.split(separator)]
    problems = [f"{path}:{number}: {missing(name, found)}" for name in names if found.count(name) != 1]
    if problems:
        raise DataError("\n".join(problems))
    if len(numbered) == 1:
        raise DataError(f"{path}:{number}: there is no row below the names of the columns; expected numbers")
    return _numbers(path, numbered[1:], [found.index(name) for name in names], names, separator)


class Export(NamedTuple):
    """A CSV of another program: the names of its columns, and its rows."""

    file: str
    number: int  # line of the names
    names: list  # of the columns
    rows: list  # (number, text) of each line
    separator: str

    def table(self, names, indices):
        """Table of the columns with these indices, under other names."""
        return _numbers(self.file, self.rows, indices, names, self.separator)


def read_export(path, first):
    """Export in the file at `path`, whose names of columns may stand in a comment.

    first : how the name of its first column begins, in lower case
    """
    for number, text in _numbered_text(path):
        line = text.strip().lstrip("#").strip()
        if line.strip('"').lower().startswith(first):
            separator = next((mark for mark in (",", ";", "\t") if mark in line), ",")
            names = [cell.strip().strip('"') for cell in line.split(separator)]
            rows = [(n, one) for n, one in _lines(path) if n > number]
            if not rows:
                words = "there is no row below the names of the columns; expected numbers"
                raise DataError(f"{path}:{number}: {words}")
            return Export(path, number, names, rows, separator)
    words = f"there is no line with the names of the columns; expected one that begins with '{first}'"
    raise DataError(f"{path}:1: {words}")


def read_columns(path, names, others=()):
    """Table of a text file without names whose rows begin with the columns `names`, parted by spaces.

    others: further lists of names; the longest list that fits the first row is taken
    """
    numbered = _lines(path)
    width = len(numbered[0][1].replace(",", " ").split())
    fitting = [choice for choice in (names, *others) if len(choice) <= width]
    if not fitting:
        words = f"expected {len(names)} columns ({', '.join(names)}), got {width}"
        raise DataError(f"{path}:{numbered[0][0]}: {words}")
    chosen = max(fitting, key=len)
    separator = "," if "," in numbered[0][1] else None
    return _numbers(path, numbered, list(range(len(chosen))), chosen, separator)


def _lines(path):
    """(number, text) of every line that is neither empty nor a comment."""
    pairs = ((n, line.partition("#")[0].strip()) for n, line in _numbered_text(path))
    numbered = [(n, line) for n, line in pairs if line]
    if not numbered:
        raise DataError(f"{path}: the file is empty; expected rows of numbers")
    return numbered


def _numbered_text(path):
    """(number, text) of every line."""
    try:
        text = read_text(path, "a table", LARGEST_DATA)
    except Unreadable as error:
        raise DataError(f"{path} {error}") from None
    return enumerate(text.splitlines(), 1)


def missing(name, found, kind="column"):
    """Words about a column that is not there, or not alone."""
    if found.count(name) > 1:
        return f"{kind} {quoted(name)} is there {found.count(name)} times; keep one of them"
    plain = {one.lower(): one for one in reversed(found)}
    close = difflib.get_close_matches(name.lower(), plain, n=1, cutoff=0.6)
    similar = [plain[one] for one in close]
    hint = f"did you mean '{similar[0]}'?" if similar else f"there are: {', '.join(found)}"
    return f"{kind} {quoted(name)} is missing; {hint}"


def _numbers(path, numbered, indices, names, separator):
    """Table of the columns with these indices."""
    try:
        values = np.loadtxt(
            [line for _, line in numbered], delimiter=separator, usecols=indices, ndmin=2, comments=None
        )
    except (ValueError, IndexError):
        raise _explained(path, numbered, indices, names, separator) from None
    lines = np.array([n for n, _ in numbered])
    table = Table(path, {name: values[:, k].copy() for k, name in enumerate(names)}, lines)
    refuse_infinite(table)
    return table


def refuse_infinite(table):
    """Refuse numbers that are none."""
    bad = [
        (int(row), name)
        for name, column in table.columns.items()
        for row in np.flatnonzero(~np.isfinite(column))[:MOST_ERRORS]
    ]
    if bad:
        texts = [f"{table.place(row)}: {name}: must be a finite number" for row, name in sorted(bad)]
        raise DataError("\n".join(texts[:MOST_ERRORS]))


def _explained(path, numbered, indices, names, separator):
    """DataError about the first lines that are no rows of numbers."""
    found = []
    for number, line in numbered:
        cells = [cell.strip() for cell in line.split(separator)]
        for index, name in zip(indices, names, strict=True):
            if index >= len(cells):
                found.append(
                    f"{path}:{number}: {name}: expected {index + 1} columns at least, got {len(cells)}"
                )
                break
            if not _is_number(cells[index]):
                got = quoted(cells[index]) if cells[index] else "nothing"
                found.append(f"{path}:{number}: {name}: expected a number such as 12.5, got {got}")
                break
        if len(found) == MOST_ERRORS:
            break
    return DataError("\n".join(found) or f"{os.fspath(path)}: cannot be read as a table of numbers")


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True
