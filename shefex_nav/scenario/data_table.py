"""Text files -> columns of numbers that know their place in the file.

A file of some hundred thousand lines is read in one go; only when that fails is it searched for the lines
that are wrong.
"""

import csv
import difflib
import os
import re
from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.scenario.files import LARGEST_DATA, Unreadable, read_text
from shefex_nav.scenario.quantity import quoted

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
QUOTE = '"'


class DataError(UserError):
    """Data that cannot be used; the message has one line for each thing, `file:line: column: what`."""


class Table(NamedTuple):
    """Columns of one file."""

    file: str
    columns: dict  # name -> (N,) float64
    lines: np.ndarray | None  # (N,) number of the line of each row; None in files without lines
    torn: str = ""  # words about an end of the file that is not read: it was not written to its end

    def place(self, row):
        """Where a row stands, for a message."""
        return f"{self.file}: row {row + 1}" if self.lines is None else f"{self.file}:{self.lines[row]}"

    def only(self, kept):
        """Table of some of its rows. kept : (N,) bool"""
        columns = {name: column[kept] for name, column in self.columns.items()}
        return self._replace(columns=columns, lines=None if self.lines is None else self.lines[kept])

    def stack(self, names):
        """(N, k) of columns; their names -> array."""
        return np.column_stack([self.columns[name] for name in names])


def read_csv(path, names, *, flag=None, torn_end=False):
    """Table of the columns `names` of a CSV whose first line that is no comment names its columns.

    flag : name of a column; in rows where it is 0 what is no number is NaN and is not refused
    torn_end : a last line that was not written to its end is left out, `Table.torn` says so, not refused
    """
    text = _text(path)
    whole = text.rstrip("\0") if torn_end else text
    numbered = _lines(path, whole)
    number, head = numbered[0]
    separator = next((mark for mark in (",", ";", "\t") if mark in head), None)
    found = _cells(head, separator)
    problems = [f"{path}:{number}: {missing(name, found)}" for name in names if found.count(name) != 1]
    if problems:
        raise DataError("\n".join(problems))
    indices, rows, torn = [found.index(name) for name in names], numbered[1:], ""
    if torn_end and rows:
        rows, torn = _without_torn_end(path, text, whole, rows, indices, (separator, len(found)))
    if not rows:
        raise DataError(f"{path}:{number}: there is no row below the names of the columns; expected numbers")
    _refuse_longer(path, rows[0], separator, len(found))
    table = _numbers(path, rows, indices, names, separator, flag=None if flag is None else found.index(flag))
    return table._replace(torn=torn)


def _without_torn_end(path, text, whole, rows, indices, form):
    """Rows without a last one that was not written to its end, and words about what is left out.

    whole : the text without null characters at its end;  form : separator and number of names
    """
    separator, width = form
    number, last = rows[-1]
    nulls, open_end = len(text) - len(whole), not whole.endswith("\n")
    if not nulls and not open_end:
        return rows, ""
    words = [f"the file ends in {nulls} null characters"] if nulls else []
    if open_end and number == len(whole.splitlines()):
        cells = _cells(last, separator)
        at_end = max(indices) >= len(cells) - 1
        is_cut = max(indices) >= len(cells) or (
            at_end and not (_is_number(cells[-1]) and len(cells) >= width)
        )
        if nulls or is_cut:
            words.append("the last line was not written to its end")
            rows = rows[:-1]
    if not words:
        return rows, ""
    read_to = f"; read to line {rows[-1][0]}" if rows else ""
    return rows, f"{path}:{number}: {' and '.join(words)}{read_to}"


def _refuse_longer(path, row, separator, width):
    """Refuse a first row with more values than there are names: which belongs to which is not known."""
    number, line = row
    if separator is None:
        return
    cells = _cells(line, separator)
    while cells and not cells[-1]:
        cells.pop()
    if len(cells) > width:
        words = f"{len(cells)} values, but {width} names of columns"
        hint = "; if commas are in the numbers (decimal comma), write points" if separator == "," else ""
        raise DataError(f"{path}:{number}: {words}{hint}")


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
    whole = _text(path)
    for number, text in enumerate(whole.splitlines(), 1):
        line = text.strip().lstrip("#").strip()
        if line.strip('"').lower().startswith(first):
            separator = next((mark for mark in (",", ";", "\t") if mark in line), ",")
            names = [cell.strip().strip('"') for cell in line.split(separator)]
            rows = [(n, one) for n, one in _lines(path, whole) if n > number]
            if not rows:
                words = "there is no row below the names of the columns; expected numbers"
                raise DataError(f"{path}:{number}: {words}")
            return Export(path, number, names, rows, separator)
    words = f"there is no line with the names of the columns; expected one that begins with '{first}'"
    raise DataError(f"{path}:1: {words}")


def read_columns(path, names, others=(), *, torn_end=False):
    """Table of a text file without names whose rows begin with the columns `names`, parted by spaces.

    others: further lists of names; the longest list that fits the first row is taken
    torn_end: as in `read_csv`
    """
    text = _text(path)
    whole = text.rstrip("\0") if torn_end else text
    numbered = _lines(path, whole)
    width = len(numbered[0][1].replace(",", " ").split())
    fitting = [choice for choice in (names, *others) if len(choice) <= width]
    if not fitting:
        words = f"expected {len(names)} columns ({', '.join(names)}), got {width}"
        raise DataError(f"{path}:{numbered[0][0]}: {words}")
    chosen = max(fitting, key=len)
    separator, indices, torn = "," if "," in numbered[0][1] else None, list(range(len(chosen))), ""
    if torn_end and len(numbered) > 1:
        numbered, torn = _without_torn_end(path, text, whole, numbered, indices, (separator, width))
    return _numbers(path, numbered, indices, chosen, separator)._replace(torn=torn)


def _text(path):
    """Text of the file."""
    try:
        return read_text(path, "a table", LARGEST_DATA)
    except Unreadable as error:
        raise DataError(f"{path} {error}") from None


def _lines(path, text):
    """(number, text) of every line of a text that is neither empty nor a comment."""
    pairs = ((n, line.partition("#")[0].strip()) for n, line in enumerate(text.splitlines(), 1))
    numbered = [(n, line) for n, line in pairs if line]
    if not numbered:
        raise DataError(f"{path}: the file is empty; expected rows of numbers")
    return numbered


def _cells(line, separator):
    """Cells of a line, without the quotes that may be around them."""
    if QUOTE not in line or separator is None:
        return [cell.strip().strip(QUOTE) for cell in line.split(separator)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def missing(name, found, kind="column"):
    """Words about a column that is not there, or not alone."""
    if found.count(name) > 1:
        return f"{kind} {quoted(name)} is there {found.count(name)} times; keep one of them"
    plain = {one.lower(): one for one in reversed(found)}
    close = difflib.get_close_matches(name.lower(), plain, n=1, cutoff=0.6)
    similar = [plain[one] for one in close]
    hint = f"did you mean '{similar[0]}'?" if similar else f"there are: {', '.join(found)}"
    return f"{kind} {quoted(name)} is missing; {hint}"


def _numbers(path, numbered, indices, names, separator, flag=None):
    """Table of the columns with these indices. flag : as in `read_csv`, an index"""
    try:
        values = _values(numbered, indices, separator)
    except (ValueError, IndexError):
        try:
            if flag is None:
                raise
            numbered = _with_nan(numbered, max(indices) + 1, flag, separator)
            values = _values(numbered, indices, separator)
        except (ValueError, IndexError):
            raise _explained(path, numbered, indices, names, separator) from None
    lines = np.array([n for n, _ in numbered])
    table = Table(path, {name: values[:, k].copy() for k, name in enumerate(names)}, lines)
    refuse_infinite(table, None if flag is None else values[:, indices.index(flag)] == 0.0)
    return table


def _values(numbered, indices, separator):
    """(N, k) of the columns with these indices."""
    lines = [line if QUOTE not in line else _unquoted(line, separator) for _, line in numbered]
    return np.loadtxt(lines, delimiter=separator, usecols=indices, ndmin=2, comments=None)


def _unquoted(line, separator):
    """A line without quotes; what is no number becomes a question mark."""
    cells = (cell if _is_number(cell) else "?" for cell in _cells(line, separator))
    return (separator or " ").join(cells)


def _with_nan(numbered, width, flag, separator):
    """(number, text) of lines, with nan for what is no number where the flag is 0.

    width : least number of cells;  flag : index of its column
    """
    out = []
    for number, line in numbered:
        cells = _cells(line, separator)
        if flag < len(cells) and _is_number(cells[flag]) and float(cells[flag]) == 0.0:
            cells += [""] * (width - len(cells))
            line = (separator or " ").join(cell if _is_number(cell) else "nan" for cell in cells)
        out.append((number, line))
    return out


def refuse_infinite(table, but=None):
    """Refuse numbers that are none. but : (N,) bool, rows in which they may be; None: in none"""
    bad = [
        (int(row), name)
        for name, column in table.columns.items()
        for row in np.flatnonzero(~np.isfinite(column) if but is None else ~np.isfinite(column) & ~but)
    ]
    if bad:
        row, name = min(bad)
        words = f"{table.place(row)}: {name}: must be a finite number, got {table.columns[name][row]:g}"
        raise DataError(words + _likewise(len(bad), table.place(max(bad)[0]), "value"))


def _likewise(count, last, what):
    """`; 3 more values likewise, the last in FILE:LINE`, or nothing. count : of all"""
    more = "" if count == 2 else "s"
    return f"; {count - 1} more {what}{more} likewise, the last in {last}" if count > 1 else ""


def _explained(path, numbered, indices, names, separator):
    """DataError about what is wrong in lines that are no rows of numbers: one line for each kind of thing."""
    found = {}  # kind -> [first line, words, count, last line]
    for number, line in numbered:
        cells = _cells(line, separator)
        for index, name in zip(indices, names, strict=True):
            wrong = _wrong(cells, index)
            if wrong is not None:
                entry = found.setdefault(wrong[0], [number, f"{name}: {wrong[1]}", 0, number])
                entry[2:] = entry[2] + 1, number
                break
    texts = [
        f"{path}:{first}: {words}{_likewise(count, f'{path}:{last}', 'line')}"
        for first, words, count, last in found.values()
    ]
    return DataError("\n".join(texts) or f"{os.fspath(path)}: cannot be read as a table of numbers")


def _wrong(cells, index):
    """Kind and words of what is wrong with a cell; None if it is a number."""
    if index >= len(cells):
        return "short", f"expected {index + 1} columns at least, got {len(cells)}"
    cell = cells[index]
    if _is_number(cell):
        return None
    if DECIMAL_COMMA.fullmatch(cell):
        words = f"'{cell}' has a decimal comma; write {cell.replace(',', '.')}, with a point"
        return "comma", words
    if cell:
        return "word", f"expected a number such as 12.5, got {quoted(cell)}"
    return "nothing", "expected a number such as 12.5, got nothing"


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True
