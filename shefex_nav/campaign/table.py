"""Results of a run as one row of a table: names of the columns, Parquet, digest.

What a run writes (`runs/000123.json`) is a tree; its scalars become columns named by their path:
`summary.navigation.at_entry.position_error_m`. Short lists of numbers are columns .0, .1, .2; other lists
stay in the file of the run alone, but of draws they are columns of JSON. Durations that were measured,
wherever they stand, are columns `timing.*`: all others depend on scenario, seed and index of the run alone.
"""

import hashlib
import json
import math

import numpy as np

from shefex_nav.files import whole

LONGEST = 6  # numbers of a list that become columns
HEAD = ("run", "status", "reason", "traceback", "seed", "series_sha256")
MEASURED = ("wall_s", "setup_s", "real_time_factor", "star_tracker.chain_ms.")  # of a summary
NOT_RESULTS = ("log",)  # of a summary: where a file was put
EXACT = 2**53  # whole numbers to here are the same as float
BATCH = 4096  # rows in memory at a time


def row(record):
    """Row of a run: dict column -> number, text, bool or None.

    record : object of a runs/*.json: run, status, reason, traceback, seed, draws, summary, timing
    """
    result = {name: record.get(name) for name in HEAD}
    for path, value in (record.get("draws") or {}).items():
        result |= {f"draw.{name}": scalar for name, scalar in of_draw(path, value)}
    for path, value in _scalars(record.get("summary") or {}):
        if path in NOT_RESULTS:
            continue
        measured = any(path == name or (name.endswith(".") and path.startswith(name)) for name in MEASURED)
        result[f"timing.summary.{path}" if measured else f"summary.{path}"] = value
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
    found = list(_scalars(value, path))
    yield from found or [(path, json.dumps(value))]


def _scalars(value, path=""):
    """(dotted path, scalar) of everything in a tree that becomes a column."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _scalars(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        if len(value) <= LONGEST and all(isinstance(item, int | float | None) for item in value):
            for k, item in enumerate(value):
                yield f"{path}.{k}", item
    else:
        yield path, value


def unmixed(rows):
    """Rows whose columns are of one kind each: values of a column of several kinds become their JSON.

    A choice between a word and a number is such a column, which Parquet does not know. -> the same list
    """
    kinds = {}
    for one in rows:
        for name, value in one.items():
            if value is not None:
                kinds.setdefault(name, set()).add(_kind(value))
    for name in [name for name, found in kinds.items() if len(found) > 1]:
        for one in rows:
            if one.get(name) is not None:
                one[name] = json.dumps(one[name])
    return rows


def _kind(value):
    if isinstance(value, bool):
        return "truth"
    return "text" if isinstance(value, str) else "number"


def digest(rows):
    """sha256 over all columns but timing.*, in the order of the runs: hexadecimal str.

    Neither the order of the rows nor that of the columns counts, nor whether a value that is missing has a
    column.
    """
    return digest_sorted(sorted(rows, key=lambda one: one["run"]))


def digest_sorted(rows):
    """The same of rows, any iterable, that are in the order of the runs."""
    total = hashlib.sha256()
    for one in rows:
        kept = {
            name: plain
            for name, value in sorted(one.items())
            if not name.startswith("timing.") and (plain := _plain(value)) is not None
        }
        total.update(json.dumps(kept, separators=(",", ":")).encode() + b"\n")
    return total.hexdigest()


def _plain(value):
    """A value in the one form that JSON and Parquet give back alike: 1 and 1.0 are one number."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return float(value) if abs(int(value)) <= EXACT else str(int(value))
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def columns(rows):
    """Arrays by the name of the column: {name: (N,)}.

    Numbers are float with NaN where there is none, whole numbers without a gap int; bool without a gap stays
    bool, with gaps it is float (1, 0, NaN). Texts are object arrays with None.
    """
    names = dict.fromkeys(name for one in rows for name in one)
    return {name: _column([one.get(name) for one in rows]) for name in names}


def _column(values):
    given = [value for value in values if value is not None]
    whole = len(given) == len(values)
    if any(isinstance(value, str) for value in given):
        return np.array(values, dtype=object)
    if whole and given and all(isinstance(value, bool) for value in given):
        return np.array(values, dtype=bool)
    if whole and given and all(isinstance(value, int) and abs(value) < 2**63 for value in given):
        return np.array(values, dtype=np.int64)
    return np.array([math.nan if value is None else float(value) for value in values])


def save(rows, path, units=None):
    """Write unmixed rows as Parquet, sorted by run; the file is whole or not there. list of dict, Path

    units : {path of a draw: unit}, which go into the metadata of its field
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = sorted(rows, key=lambda one: one["run"])
    names = [*HEAD, *sorted({name for one in rows for name in one} - set(HEAD))]
    arrays = [_arrow([one.get(name) for one in rows]) for name in names]
    fields = [
        pa.field(name, values.type, metadata=_metadata(name, units or {}))
        for name, values in zip(names, arrays, strict=True)
    ]
    with whole(path) as part:
        pq.write_table(pa.table(arrays, schema=pa.schema(fields)), part, compression="zstd")


def _metadata(name, units):
    """What a field of Parquet says of itself beside its name: of a draw its unit, of others nothing."""
    unit = units.get(name.removeprefix("draw.")) if name.startswith("draw.") else None
    return {"unit": unit} if unit else None


def _arrow(values):
    """pyarrow array of one column of one kind."""
    import pyarrow as pa

    given = [value for value in values if value is not None]
    if all(isinstance(value, bool) for value in given) and given:
        return pa.array(values, pa.bool_())
    if any(isinstance(value, str) for value in given) or not given:
        return pa.array(values, pa.string())
    if all(isinstance(value, int) for value in given):
        return pa.array(values, pa.int64() if max(given) < 2**63 else pa.uint64())
    return pa.array([None if value is None else float(value) for value in values], pa.float64())


def load(path):
    """Rows of a Parquet file that `save` wrote, one after the other: iterator of dict."""
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        for batch in file.iter_batches(batch_size=BATCH):
            yield from batch.to_pylist()


def load_columns(path):
    """Arrays of a Parquet file as `columns` makes them of rows, without the rows."""
    import pyarrow.parquet as pq

    found = pq.read_table(path)
    return {name: _of_arrow(found[name]) for name in found.column_names}


def _of_arrow(values):
    """What `_column` makes of a column of Parquet."""
    import pyarrow as pa

    if pa.types.is_string(values.type):
        if values.null_count == len(values):  # nothing is known of its kind
            return np.full(len(values), np.nan)
        return np.array(values.to_pylist(), dtype=object)
    if pa.types.is_boolean(values.type) and values.null_count:
        values = values.cast(pa.int8())
    plain = values.to_numpy()
    whole = plain.dtype == bool or (plain.dtype.kind == "i" and not values.null_count)
    return plain if whole else plain.astype(float)
