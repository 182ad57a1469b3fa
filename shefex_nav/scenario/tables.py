"""CSV text -> columns of numbers, each with its place in the file.

The first line that is no comment names the columns, with their units in the names. `#` starts a comment.
"""

import difflib
from typing import NamedTuple

from shefex_nav import numerals
from shefex_nav.scenario.document import Mark
from shefex_nav.scenario.quantity import quoted

ALIKE = 0.6  # of difflib: names that may be meant for each other
SEPARATORS = {";": "semicolons", "\t": "tabs"}  # of spreadsheets in other languages
MOST_ERRORS = 5  # of one file; a table of the wrong kind is wrong in every line


class BadTable(Exception):
    """Text that is no such table; `errors` is a list of (Mark, text)."""

    def __init__(self, errors):
        self.errors = errors[:MOST_ERRORS]
        if len(errors) > MOST_ERRORS:
            more = f"and {len(errors) - MOST_ERRORS} more errors of this kind"
            self.errors.append((errors[MOST_ERRORS][0], more))
        super().__init__("\n".join(f"{mark}: {text}" for mark, text in self.errors))


class NoColumn(Exception):
    """A table without the column that is asked for; the text says which it has."""

    def __init__(self, column, known):
        similar = difflib.get_close_matches(column, known, n=1, cutoff=ALIKE)
        hint = f"did you mean '{similar[0]}'? " if similar else ""
        super().__init__(f"has no column {quoted(column)}; {hint}its columns are {', '.join(known)}")


class Cell(NamedTuple):
    """A number in a file: as it was written, its value, and where."""

    text: str
    value: float
    mark: Mark


def number(text, name, mark):
    """Cell of a piece of text; BadTable if it is no finite number."""
    try:
        return Cell(text, numerals.number(text), mark)
    except ValueError as error:
        raise BadTable([(mark, f"{name}: {error}")]) from None


def cells(line, number_of_line, file, separator=","):
    """(text, Mark) of the parts of a line, trimmed; `#` and what follows is left out."""
    parts, position = [], 0
    for part in line.split("#")[0].split(separator):
        column = position + len(part) - len(part.lstrip()) + 1
        parts.append((part.strip(), Mark(file, number_of_line, column)))
        position += len(part) + 1
    return parts


def read(text, file, required, optional=()):
    """Columns of the CSV `text`, which came from `file`.

    Returns
    -------
    {name: list of Cell}, all of one length, not empty; BadTable with every error otherwise
    """
    rows = _rows(text, file, required)
    names = _names(rows[0], file, required, optional)
    return _numbers(rows, names, names)


def read_one(text, file, column):
    """One column of the CSV `text`: list of Cell, not empty; the others may hold anything, such as words.

    NoColumn if there is none of the name, BadTable with every error otherwise.
    """
    rows = _rows(text, file, (column,))
    names = [name for name, _ in rows[0]]
    if column not in names:
        raise NoColumn(column, [name for name in names if name])
    if names.count(column) > 1:
        again = [mark for name, mark in rows[0] if name == column][1]
        raise BadTable([(again, f"{column}: there is a column of this name already; keep one of them")])
    return _numbers(rows, names, (column,))[column]


def _rows(text, file, required):
    """(text, Mark) of the cells of each line, that of the names of the columns first: list of lists."""
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.split("#")[0].strip()]
    if not lines:
        wanted = f"a line with the columns {', '.join(required)}"
        raise BadTable([(Mark(file, 1, 1), f"the file is empty; expected {wanted}, then rows of numbers")])
    return [cells(line, n, file) for n, line in lines]


def _numbers(rows, names, wanted):
    """{name: list of Cell} of the `wanted` columns of rows whose cells have these names."""
    if len(rows) == 1:
        raise BadTable([(rows[0][0][1], "there is no row below the names of the columns; expected numbers")])
    columns, errors = {name: [] for name in wanted}, []
    for row in rows[1:]:
        if len(row) != len(names):
            kind = "numbers" if len(wanted) == len(names) else "values"
            words = f"expected {len(names)} {kind}, one for each of {', '.join(names)}, got {len(row)}"
            words += "; numbers have a point, not a comma" if len(row) > len(names) else ""
            errors.append((row[min(len(row), len(names)) - 1][1], words))
            continue
        for name, (cell, mark) in zip(names, row, strict=True):
            if name not in columns:
                continue
            try:
                columns[name].append(number(cell, name, mark))
            except BadTable as bad:
                errors += bad.errors
    if errors:
        raise BadTable(errors)
    return columns


def _names(head, file, required, optional):
    """Names of the columns, checked."""
    known, errors, names = (*required, *optional), [], []
    other = next((mark for mark in SEPARATORS if len(head) == 1 and mark in head[0][0]), None)
    if other:
        words = f"columns are separated by commas, not by {SEPARATORS[other]}, and numbers have a point"
        raise BadTable([(head[0][1], words)])
    if not any(difflib.get_close_matches(name, known, n=1, cutoff=ALIKE) for name, _ in head):
        got = quoted(", ".join(name for name, _ in head))
        raise BadTable([(head[0][1], f"expected a line with the columns {', '.join(required)}, got {got}")])
    for name, mark in head:
        if name in names:
            errors.append((mark, f"{name}: there is a column of this name already; keep one of them"))
        elif name not in known:
            similar = difflib.get_close_matches(name, known, n=1, cutoff=ALIKE)
            hint = f"did you mean '{similar[0]}'?" if similar else f"known here: {', '.join(known)}"
            errors.append((mark, f"{quoted(name)} is no column of this table; {hint}"))
        names.append(name)
    missing = [name for name in required if name not in names]
    if missing and not errors:
        words = f"column {missing[0]} is missing; expected {', '.join(required)}"
        errors.append((head[0][1], words))
    if errors:
        raise BadTable(errors)
    return names
