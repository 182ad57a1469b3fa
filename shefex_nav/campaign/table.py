"""Results of a run as one row of a table: names of the columns, Parquet, digest.

The record of a run is a tree; its scalars become columns named by their path:
`summary.navigation.at_entry.position_error_m`. Short lists of numbers are columns .0, .1, .2; other lists
stay in the record alone, but of draws they are columns of JSON, as warnings are. Durations that were
measured, wherever they stand, are columns `timing.*`: all others depend on scenario, seed and index of the
run alone.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import checking
from shefex_nav.campaign.checking import LARGE, TableError
from shefex_nav.files import named, refuse_irregular, whole

LONGEST = 6  # numbers of a list that become columns
HEAD = ("run", "status", "reason", "traceback", "seed", "series_sha256")
MEASURED = ("wall_s", "setup_s", "real_time_factor")  # of a summary
MEASURED_BELOW = ("star_tracker.chain_ms.",)
NOT_RESULTS = ("log",)  # of a summary: where a file was put
WARNINGS = "summary.warnings"
EXACT = 2**53  # whole numbers to here are the same as float
BATCH = 4096  # rows in memory at a time
DIGEST, STATE = b"results_digest", b"state"  # of the metadata of a file


class Made(NamedTuple):
    """What a file says of its rows."""

    runs: int
    digest: str
    state: str  # of the store that they come from (`runs_file.RunsFile.state`)


def row(record):
    """Row of a run: dict column -> number, text, bool or None.

    record : run, status, reason, traceback, seed, draws, summary, timing
    """
    result = {name: record.get(name) for name in HEAD}
    if warnings := (record.get("summary") or {}).get("warnings"):
        # no escapes: their digits would look like numbers, without which kinds of warnings are told apart
        result[WARNINGS] = json.dumps(warnings, ensure_ascii=False)
    for path, value in (record.get("draws") or {}).items():
        result |= {f"draw.{name}": scalar for name, scalar in of_draw(path, value)}
    for path, value in _scalars(record.get("summary") or {}):
        if path in MEASURED or path.startswith(MEASURED_BELOW):
            result[f"timing.summary.{path}"] = value
        elif path not in NOT_RESULTS:
            result[f"summary.{path}"] = value
    result |= {f"timing.{path}": value for path, value in _scalars(record.get("timing") or {})}
    return result


def of_draw(path, value):
    """(path, scalar) of the columns of one draw, of which nothing is left out.

    A short list of numbers is several, as everywhere; any other list that a choice has drawn is its JSON.
    """
    if isinstance(value, dict):
        for key, item in value.items():
            yield from of_draw(f"{path}.{key}", item)
        return
    yield from _scalars(value, path) or [(path, json.dumps(value))]


def _scalars(value, path=""):
    """(dotted path, scalar) of everything in a tree that becomes a column: list."""
    found = []
    _gather(value, path, found)
    return found


def _gather(value, path, found):
    """Append what `_scalars` gives."""
    kind = type(value)
    if kind is dict:
        for key, item in value.items():
            _gather(item, f"{path}.{key}" if path else str(key), found)
    elif kind is list:
        if len(value) <= LONGEST and all(isinstance(item, int | float | None) for item in value):
            found.extend((f"{path}.{k}", item) for k, item in enumerate(value))
    else:
        found.append((path, value))


def kinds(rows):
    """Types of the values of each column: {name: set of bool, str, int, LARGE, float}."""
    found = {}
    for one in rows:
        for name, value in one.items():
            if value is not None:
                kind = LARGE if type(value) is int and not -(2**63) <= value < 2**63 else type(value)
                if name not in found:
                    found[name] = {kind}
                elif kind not in found[name]:
                    found[name].add(kind)
            elif name not in found:
                found[name] = set()
    return found


def _mixed(kind):
    """Whether a column has values of several kinds, as words and numbers, which Parquet does not know."""
    return len(kind) > 1 and (bool in kind or str in kind)


def unmixed(rows, found):
    """Rows whose columns are of one kind each: values of mixed columns become their JSON. -> iterator

    found : of `kinds`
    """
    names = [name for name, kind in found.items() if _mixed(kind)]
    for one in rows:
        for name in names:
            if one.get(name) is not None:
                one[name] = json.dumps(one[name])
        yield one


def digest(rows):
    """The digest of rows in any order: hexadecimal str."""
    return Digest(sorted(rows, key=lambda one: one["run"])).words


class Digest:
    """sha256 over all columns but timing.* of rows in the order of the runs.

    The order of the columns does not count, nor whether a value that is missing has a column.
    """

    def __init__(self, rows=()):
        self._total = hashlib.sha256()
        for one in rows:
            self.add(one)

    def add(self, row):
        """Count one row more. -> the row"""
        kept = {
            name: plain
            for name, value in sorted(row.items())
            if not name.startswith("timing.") and (plain := _plain(value)) is not None
        }
        self._total.update(json.dumps(kept, separators=(",", ":")).encode() + b"\n")
        return row

    @property
    def words(self):
        """64 hexadecimal digits."""
        return self._total.hexdigest()


def _plain(value):
    """A value in the one form that JSON and Parquet give back alike: 1 and 1.0 are one number."""
    kind = type(value)
    if kind is int:
        return float(value) if abs(value) <= EXACT else str(value)
    if kind is float:
        return value if math.isfinite(value) else None
    return value


def save(rows, path, units=None, state="", drawn=()):
    """Write rows as Parquet, a batch in memory at a time; the file is whole or not there.

    WrongValueError, and no file, if a row has a value that no campaign writes.

    rows : of dict in the order of the runs; gone through twice, first for the kinds of the columns
    units : {path of a draw: unit}, which go into the metadata of its field
    state : of the store that they come from
    drawn : paths whose draws are numbers
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    found = kinds(rows)
    checking.check_kinds(rows, found, drawn)
    names = [*HEAD, *sorted(set(found) - set(HEAD))]
    types = [_type(found.get(name, set())) for name in names]
    fields = [
        pa.field(name, kind, metadata=_metadata(name, units or {}))
        for name, kind in zip(names, types, strict=True)
    ]
    total = Digest()
    with whole(path) as part, pq.ParquetWriter(part, pa.schema(fields), compression="zstd") as writer:
        ready = map(total.add, unmixed(rows, found))
        while some := list(islice(ready, BATCH)):
            columns = [
                _arrow([one.get(name) for one in some], kind) for name, kind in zip(names, types, strict=True)
            ]
            checking.check_columns(dict(zip(names, columns, strict=True)), some, drawn)
            writer.write_batch(pa.record_batch(columns, writer.schema))
        writer.add_key_value_metadata({DIGEST: total.words, STATE: state})


def _metadata(name, units):
    """What a field of Parquet says of itself beside its name: of a draw its unit, of others nothing."""
    unit = units.get(name.removeprefix("draw.")) if name.startswith("draw.") else None
    return {"unit": unit} if unit else None


def _type(kind):
    """Type of a column in Parquet. kind : of `kinds`"""
    import pyarrow as pa

    if not kind or str in kind or _mixed(kind):
        return pa.string()
    if kind == {bool}:
        return pa.bool_()
    if float in kind:
        return pa.float64()
    return pa.uint64() if LARGE in kind else pa.int64()


def _arrow(values, kind):
    """pyarrow array of values of one kind."""
    import pyarrow as pa

    if kind == pa.float64():  # pyarrow takes no whole number above 2^53 for one
        values = [None if value is None else float(value) for value in values]
    return pa.array(values, kind)


def made(path):
    """Made of a file that `save` wrote; KeyError if it is another's."""
    import pyarrow.parquet as pq

    with named(path):
        refuse_irregular(path)
        found = pq.read_metadata(path)
    said = found.metadata or {}
    return Made(found.num_rows, said[DIGEST].decode(), said[STATE].decode())


def load(path, names=None, wanted=None):
    """Rows of a Parquet file, one after the other: iterator of dict.

    names : of columns, None: all;  wanted : function of a batch of rows that gives which of them, None: all
    """
    for batch in batches(path, names):
        yield from (batch if wanted is None else batch.filter(wanted(batch))).to_pylist()


def batches(path, names=None):
    """Rows of a Parquet file, so many at a time: iterator of pyarrow RecordBatch. names : as of `load`"""
    import pyarrow.parquet as pq

    with _reading(path), pq.ParquetFile(path) as file:
        yield from file.iter_batches(batch_size=BATCH, columns=names, use_threads=False)


@contextmanager
def _reading(path):
    """Errors of the disk name the table within the `with`; TableError for what is no table any more."""
    import pyarrow as pa

    try:
        with named(path):
            refuse_irregular(path)
            yield
    except (OSError, pa.ArrowException) as error:
        of_machine = getattr(error, "errno", None) is not None
        if of_machine or isinstance(error, (MemoryError, pa.ArrowCancelled)):
            raise
        from shefex_nav.campaign import runs_file

        helps = ""
        if Path(path).with_name(runs_file.NAME).exists():
            helps = "; delete it, it is made of the records again"
        raise TableError(f"{path}: spoilt: {str(error).splitlines()[0]}{helps}") from None


class File:
    """A table on the disk, open; errors of the disk name it."""

    def __init__(self, path):
        import pyarrow.parquet as pq

        self._path = path
        with _reading(path):
            self._file = pq.ParquetFile(path)
        self.names = self._file.schema_arrow.names
        metadata = self._file.metadata
        self.rows = [metadata.row_group(k).num_rows for k in range(metadata.num_row_groups)]  # of each group

    def column(self, name, groups):
        """A column of some groups of rows: pyarrow ChunkedArray."""
        with _reading(self._path):
            values = self._file.read_row_groups(groups, [name], use_threads=False).column(0)
            if checking.is_faulty(name, values):
                runs = self._file.read_row_groups(groups, ["run"], use_threads=False).column(0)
                checking.refuse(self._path, runs, name, values)
        return values


class Columns(Mapping):
    """Columns of a Parquet file by their names, each read when it is asked for: {name: (N,)}.

    Numbers are float with NaN where there is none, whole numbers without a gap int; bool without a gap stays
    bool, with gaps it is float (1, 0, NaN). Texts are object arrays with None.
    """

    def __init__(self, file, names=None, groups=None):
        """file : File;  names : {name: name in the file}, None: all;  groups : of rows, None: all"""
        self._file = file
        self._names = {name: name for name in file.names} if names is None else names
        self._groups = list(range(len(file.rows))) if groups is None else groups

    def __getitem__(self, name):
        return _of_arrow(self._file.column(self._names[name], self._groups))

    def first(self, runs):
        """Columns of the first groups of rows that have so many runs together."""
        ends = np.cumsum([self._file.rows[k] for k in self._groups])
        return Columns(self._file, self._names, self._groups[: int(np.searchsorted(ends, runs)) + 1])

    def __contains__(self, name):  # that of a Mapping reads the column
        return name in self._names

    def __iter__(self):
        return iter(self._names)

    def __len__(self):
        return len(self._names)

    def beginning(self, prefix):
        """Columns whose names begin so, under the rest of them."""
        names = {
            name[len(prefix) :]: inside for name, inside in self._names.items() if name.startswith(prefix)
        }
        return Columns(self._file, names, self._groups)


def numbers(columns, name, runs):
    """(runs,) float of a column of numbers; all NaN if there is none of that name or if it holds texts.

    columns : Mapping of name to values, of so many runs or more
    """
    values = columns.get(name)
    if values is None or values.dtype == object:
        return np.full(runs, np.nan)
    return values[:runs].astype(float)


class Group(dict):
    """Values of some rows by the name of their column, each read when it is asked for: lists, or None."""

    def __init__(self, file, number):
        """Rows of one group of a File."""
        super().__init__()
        self._file, self._number = file, number
        self._names = set(file.names)

    def __missing__(self, name):
        self[name] = self._read(name)
        return self[name]

    def __len__(self):
        return self._file.rows[self._number]

    def _read(self, name):
        """A column; short lists come as tuples of their elements' columns."""
        if name in self._names:
            return self._file.column(name, [self._number]).to_pylist()
        elements = []
        while f"{name}.{len(elements)}" in self._names:
            elements.append(self[f"{name}.{len(elements)}"])
        return list(zip(*elements, strict=True)) if elements else None


def _of_arrow(values):
    """Array of a column of Parquet."""
    import pyarrow as pa

    if pa.types.is_string(values.type):
        if values.null_count == len(values):  # nothing is known of its kind
            return np.full(len(values), np.nan)
        return np.array(values.to_pylist(), dtype=object)
    if pa.types.is_boolean(values.type) and values.null_count:
        values = values.cast(pa.int8())
    plain = values.to_numpy()
    is_whole = plain.dtype == bool or (plain.dtype.kind == "i" and not values.null_count)
    return plain if is_whole else plain.astype(float)
