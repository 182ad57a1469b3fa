"""CSV text -> columns of numbers, each with its place in the file.

The first line that is no comment names the columns, with their units in the names. `#` starts a comment.
"""

import difflib
import math
import re
from typing import NamedTuple

from shefex_nav.scenario.document import Mark
from shefex_nav.scenario.quantity import quoted

MOST_ERRORS = 5  # of one file; a table of the wrong kind is wrong in every line
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?", re.I)


class BadTable(Exception):
    """Text that is no such table; `errors` is a list of (Mark, text)."""

    def __init__(self, errors):
        self.errors = errors[:MOST_ERRORS]
        if len(errors) > MOST_ERRORS:
            more = f"and {len(errors) - MOST_ERRORS} more errors of this kind"
            self.errors.append((errors[MOST_ERRORS][0], more))
        super().__init__("\n".join(f"{mark}: {text}" for mark, text in self.errors))


class Cell(NamedTuple):
    """A number in a file: as it was written, its value, and where."""

    text: str
    value: float
    mark: Mark


def number(text, name, mark):
    """Cell of a piece of text; BadTable if it is no finite number."""
    if not NUMBER.fullmatch(text) or not math.isfinite(float(text)):
        got = quoted(text) if text else "nothing"
        raise BadTable([(mark, f"{name}: expected a number such as 12.5, got {got}")])
    return Cell(text, float(text), mark)


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
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.split("#")[0].strip()]
    wanted = f"a line with the columns {', '.join(required)}"
    if not lines:
        raise BadTable([(Mark(file, 1, 1), f"the file is empty; expected {wanted}, then rows of numbers")])
    head = cells(lines[0][1], lines[0][0], file)
    names = _names(head, file, required, optional)
    if len(lines) == 1:
        raise BadTable([(head[0][1], "there is no row below the names of the columns; expected numbers")])
    columns, errors = {name: [] for name in names}, []
    for n, line in lines[1:]:
        row = cells(line, n, file)
        if len(row) != len(names):
            words = f"expected {len(names)} numbers, one for each of {', '.join(names)}, got {len(row)}"
            errors.append((row[min(len(row), len(names)) - 1][1], words))
            continue
        for name, (cell, mark) in zip(names, row, strict=True):
            try:
                columns[name].append(number(cell, name, mark))
            except BadTable as bad:
                errors += bad.errors
    if errors:
        raise BadTable(errors)
    return columns


def names(text, file):
    """Names of the columns as they stand in the first line, whatever they are; none of an empty file."""
    lines = ((n, line) for n, line in enumerate(text.splitlines(), 1) if line.split("#")[0].strip())
    first = next(lines, None)
    return () if first is None else tuple(name for name, _ in cells(first[1], first[0], file) if name)


def _names(head, file, required, optional):
    """Names of the columns, checked."""
    known, errors, names = (*required, *optional), [], []
    if not any(difflib.get_close_matches(name, known, n=1, cutoff=0.6) for name, _ in head):
        got = quoted(", ".join(name for name, _ in head))
        raise BadTable([(head[0][1], f"expected a line with the columns {', '.join(required)}, got {got}")])
    for name, mark in head:
        if name in names:
            errors.append((mark, f"{name}: there is a column of this name already; keep one of them"))
        elif name not in known:
            similar = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
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
