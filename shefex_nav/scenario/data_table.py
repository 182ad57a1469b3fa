"""Text files -> columns of numbers that know their place in the file.

A file of some hundred thousand lines is read in one go; only when that fails is it searched for the lines
that are wrong.
"""

import csv
import difflib
import os
import re
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.numerals import is_number
from shefex_nav.scenario.files import LARGEST_DATA, Unreadable, read_text
from shefex_nav.scenario.quantity import quoted

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
OF_NAMES, OF_FIRST_ROW = "names of columns", "in the first row"  # what the values of a row are counted by
MOST_NAMES, LONGEST_NAME = 30, 40  # that are told; characters of one
QUOTE = '"'
COMMENT = re.compile(r"(?<=[^,;\s]) +#.*")  # behind a name; '#sat' is one


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


class _Form(NamedTuple):
    """How the rows of a file are made."""

    separator: str | None  # None: spaces
    width: int  # values in a row
    what: str = OF_NAMES

    def fits(self, line):
        """Whether a row has as many values; empty ones beyond them do not count."""
        if QUOTE in line or self.separator is None:
            count = len(_cells(line, self.separator))
        else:
            count = line.count(self.separator) + 1
        return count == self.width or (count > self.width and len(self.filled(line)) == self.width)

    def filled(self, line):
        """Cells of a row without empty ones beyond the width."""
        cells = _cells(line, self.separator)
        while len(cells) > self.width and not cells[-1]:
            cells.pop()
        return cells


def read_csv(path, names, *, flag=None, torn_end=False):
    """Table of the columns `names` of a CSV whose first line that is no comment names its columns.

    flag : name of a column; in rows where it is 0 what is no number is NaN and is not refused
    torn_end : a last line that was not written to its end is left out, `Table.torn` says so, not refused
    """
    text = _text(path)
    whole = text.rstrip("\0") if torn_end else text
    numbered = _lines(path, whole)
    number, _ = numbered[0]
    head = COMMENT.sub("", whole.splitlines()[number - 1])
    separator = next((mark for mark in (",", ";", "\t") if mark in head), None)
    found = _cells(head, separator)
    problems = [f"{path}:{number}: {missing(name, found)}" for name in names if found.count(name) != 1]
    if problems:
        raise DataError("\n".join(problems))
    while not found[-1]:  # separators at the end of a line
        found.pop()
    form, indices, rows, torn = (
        _Form(separator, len(found)),
        [found.index(name) for name in names],
        numbered[1:],
        "",
    )
    if torn_end and rows:
        rows, torn = _without_torn_end(path, text, whole, rows, indices, form)
    if not rows:
        raise DataError(f"{path}:{number}: there is no row below the names of the columns; expected numbers")
    table = _numbers(path, rows, indices, names, form, flag=None if flag is None else found.index(flag))
    return table._replace(torn=torn)


def _without_torn_end(path, text, whole, rows, indices, form):
    """Rows without a last one that was not written to its end, and words about what is left out.

    whole : the text without null characters at its end
    """
    number, last = rows[-1]
    nulls, open_end = len(text) - len(whole), not whole.endswith("\n")
    if not nulls and not open_end:
        return rows, ""
    words = [f"the file ends in {nulls} null characters"] if nulls else []
    if open_end and number == len(whole.splitlines()):
        cells = _cells(last, form.separator)
        at_end = max(indices) == len(cells) - 1
        is_cut = len(cells) < form.width or (at_end and not is_number(cells[-1]))
        if nulls or is_cut:
            words.append("the last line was not written to its end")
            rows = rows[:-1]
    if not words:
        return rows, ""
    read_to = f"; read to line {rows[-1][0]}" if rows else ""
    return rows, f"{path}:{number}: {' and '.join(words)}{read_to}"


class Export(NamedTuple):
    """A CSV of another program: the names of its columns, and its rows."""

    file: str
    number: int  # line of the names
    names: list  # of the columns
    rows: list  # (number, text) of each line
    separator: str

    def table(self, names, indices):
        """Table of the columns with these indices, under other names."""
        form = _Form(self.separator, len(self.names), f"{OF_NAMES} in line {self.number}")
        return _numbers(self.file, self.rows, indices, names, form)


def read_export(path, first):
    """Export in the file at `path`, whose names of columns may stand in a comment.

    first : how the name of its first column begins, in lower case
    """
    whole = _text(path)
    for number, text in enumerate(whole.splitlines(), 1):
        line = text.strip().lstrip("#").strip()
        if line.strip('"').lower().startswith(first):
            separator = next((mark for mark in (",", ";", "\t") if mark in line), ",")
            names = [cell.strip().strip('"') for cell in line.rstrip(separator).split(separator)]
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
    separator = "," if "," in numbered[0][1] else None
    width = len(_cells(numbered[0][1].rstrip(", "), separator))
    fitting = [choice for choice in (names, *others) if len(choice) <= width]
    if not fitting:
        words = f"expected {len(names)} columns ({', '.join(names)}), got {width}"
        raise DataError(f"{path}:{numbered[0][0]}: {words}")
    chosen = max(fitting, key=len)
    form, indices, torn = _Form(separator, width, OF_FIRST_ROW), list(range(len(chosen))), ""
    if torn_end and len(numbered) > 1:
        numbered, torn = _without_torn_end(path, text, whole, numbered, indices, form)
    return _numbers(path, numbered, indices, chosen, form)._replace(torn=torn)


def _text(path):
    """Text of the file."""
    try:
        return read_text(path, "a table", LARGEST_DATA)
    except Unreadable as error:
        raise DataError(f"{path} {error}") from None


def _lines(path, text):
    """(number, text) of every line of a text that is neither empty nor a comment."""
    # tabs part cells, of which the first or the last may be empty
    pairs = ((n, line.partition("#")[0].strip(" ")) for n, line in enumerate(text.splitlines(), 1))
    numbered = [(n, line) for n, line in pairs if line.strip()]
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
    hint = f"did you mean '{similar[0]}'?" if similar else f"there are: {_some(found)}"
    return f"{kind} {quoted(name)} is missing; {hint}"


def _some(names):
    """Names one after the other, those of the first that there is room for."""
    short = [
        one if len(one) <= LONGEST_NAME else f"{one[: LONGEST_NAME - 3]}..." for one in names[:MOST_NAMES]
    ]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(short) + more


def _numbers(path, numbered, indices, names, form, flag=None):
    """Table of the columns with these indices. flag : as in `read_csv`, an index"""
    try:
        values = _values(numbered, indices, form)
    except (ValueError, IndexError):
        try:
            if flag is None:
                raise
            numbered = _with_nan(numbered, form, flag)
            values = _values(numbered, indices, form)
        except (ValueError, IndexError):
            raise _explained(path, numbered, indices, names, form) from None
    lines = np.array([n for n, _ in numbered])
    table = Table(path, {name: values[:, k].copy() for k, name in enumerate(names)}, lines)
    refuse_infinite(table, None if flag is None else values[:, indices.index(flag)] == 0.0)
    return table


def _values(numbered, indices, form):
    """(N, k) of the columns with these indices; ValueError also of a row with more values, or fewer.

    Which value belongs to which column is not known there, even if those that are asked for are numbers.
    """
    if not all(form.fits(line) for _, line in numbered):
        raise ValueError("rows of several widths")
    lines = [line if QUOTE not in line else _unquoted(line, form.separator) for _, line in numbered]
    return np.loadtxt(lines, delimiter=form.separator, usecols=indices, ndmin=2, comments=None)


def _unquoted(line, separator):
    """A line without quotes; what is no number becomes a question mark."""
    cells = (cell if is_number(cell) else "?" for cell in _cells(line, separator))
    return (separator or " ").join(cells)


def _with_nan(numbered, form, flag):
    """(number, text) of lines, with nan for what is no number, or not there, where the flag is 0.

    flag : index of its column
    """
    out = []
    for number, line in numbered:
        cells = form.filled(line)
        if flag < len(cells) and is_number(cells[flag]) and float(cells[flag]) == 0.0:
            cells += [""] * (form.width - len(cells))
            line = (form.separator or " ").join(cell if is_number(cell) else "nan" for cell in cells)
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


def _explained(path, numbered, indices, names, form):
    """DataError about what is wrong in lines that are no rows of numbers: one line for each kind of thing."""
    found = {}  # kind -> [first line, words, count, last line]
    for number, line in numbered:
        if (wrong := _wrong(form.filled(line), indices, names, form)) is not None:
            entry = found.setdefault(wrong[0], [number, wrong[1], 0, number])
            entry[2:] = entry[2] + 1, number
    texts = [
        f"{path}:{first}: {words}{_likewise(count, f'{path}:{last}', 'line')}"
        for first, words, count, last in found.values()
    ]
    return DataError("\n".join(texts) or f"{os.fspath(path)}: cannot be read as a table of numbers")


def _wrong(cells, indices, names, form):
    """Kind and words of what is wrong first with the cells of a row; None if nothing is."""
    if len(cells) != form.width:
        words = f"{len(cells)} values, but {form.width} {form.what}"
        return ("long", words + _halves(cells, form)) if len(cells) > form.width else ("short", words)
    for index, name in zip(indices, names, strict=True):
        if (wrong := _wrong_cell(cells[index])) is not None:
            return wrong[0], f"{name}: {wrong[1]}"
    return None


def _halves(cells, form):
    """What to do about a row that is too long if its numbers seem to be cut by decimal commas."""
    joined, more = (f"{one},{other}" for one, other in pairwise(cells)), len(cells) - form.width
    halves = sum(DECIMAL_COMMA.fullmatch(one) is not None for one in joined)
    are_cut = 2 <= more <= min(form.width, halves)
    if form.separator != "," or not are_cut or any("." in cell for cell in cells):
        return ""
    return "; the commas seem to be in the numbers (decimal comma): write points"


def _wrong_cell(cell):
    """Kind and words of what is wrong with a cell; None if it is a number."""
    if is_number(cell):
        return None
    if DECIMAL_COMMA.fullmatch(cell):
        words = f"'{cell}' has a decimal comma; write {cell.replace(',', '.')}, with a point"
        return "comma", words
    if cell:
        return "word", f"expected a number such as 12.5, got {quoted(cell)}"
    return "nothing", "expected a number such as 12.5, got nothing"
