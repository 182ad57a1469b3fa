"""A log as flat tables for people with their own tools: one table a topic, as CSV or Parquet.

The first column is `t_s`, mission time: that of the record, for a measurement the instant it measures. Names
of columns carry their unit as the fields of the log do; elements of vectors end in their axis, those of
matrices in row and column, from 1. What has a length of its own in each record (centroids, ranges) has a
table with a row for each element. What a column is, with frame and unit, stands in columns.csv beside the
tables, and in the metadata of the fields of a Parquet file.
"""

import csv
import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.fields import EQUAL
from shefex_nav.files import text_of, whole
from shefex_nav.instruments import TABLE, outer_states
from shefex_nav.log.run_data import ARRAYS, LISTS
from shefex_nav.log.topics import of_record
from shefex_nav.onboard.navigation.blocks import STATES
from shefex_nav.report.navigation_errors import navigation_errors

KINDS = ("csv", "parquet")
COLUMNS, HEADS = "columns.csv", ("table", "column", "comment")
_SOURCES = {  # table -> field of RunData
    "truth": "truth",
    "attitude_control": "control",
    "imu": "imu",
    "gps": "gps",
    "gps_ranges": "gps_ranges",
    "frames": "frames",
    "frame_truth": "frame_truths",
    "camera_commands": "commands",
    "star_fixes": "star_fixes",
    "nav": "nav",
    "nav_covariance": "covariance",
    "gates": "gates",
    "health": "health",
    "events": "events",
}
_RECORDS = {field: record for record, field in (ARRAYS | LISTS).items()}
_PER_ELEMENT = {  # tables of what has a length of its own: name, and an attribute that has it
    "gps_ranges": (("gps_ranges", "prn"),),
    "star_fixes": (("star_fix_objects", "hip"), ("star_vectors", "stars.hip")),
    "frame_truth": (("frame_truth_stars", "hip"),),
    "gates": (("gate_innovations", "innovation"),),
    "nav_covariance": (("nav_states", "estimates"),),
}
_SAMPLES = ("dtheta_b_rad", "dv_b_m_s")  # a vector in each row


class Column(NamedTuple):
    """One column of a table."""

    name: str
    values: np.ndarray  # (n,) float, int, bool or text
    comment: str


def tables(data):
    """Tables of a RunData: {name: list of Column}; those without a row are left out."""
    return dict(_each(data))


def _each(data):
    """The same one by one, each made when it is asked for. Yields (name, list of Column)"""
    for name, columns in _all(data):
        if columns and len(columns[0].values):
            yield name, columns


def _all(data):
    """The same with those without a row."""
    for name, field in _SOURCES.items():
        topic, source = of_record(_RECORDS[field]), getattr(data, field)
        if name != "gps_ranges":
            yield name, _table(topic, source)
        for inner, counted in _PER_ELEMENT.get(name, ()):
            yield inner, _elements(topic, source, counted)
    for name, one in TABLE.items():
        yield name, _table(of_record(one.record), data.readings[name])
    yield from _errors(data).items()
    for name, other in data.others.items():
        yield from _of_other(name, data.with_other(name, other)).items()


def _of_other(name, data):
    """Tables of what another filter says of a flight, a RunData of it: nav_NAME and others."""
    tables_of = {key: _table(of_record(_RECORDS[key]), getattr(data, key)) for key in ("nav", "covariance")}
    return {
        f"nav_{name}": tables_of["nav"],
        f"nav_covariance_{name}": tables_of["covariance"],
        f"errors_{name}": _errors(data).get("errors", []),
    }


def _values(source, path):
    """All values of a dotted attribute: an array, or a list of rows."""
    if isinstance(source, list):
        return [_attribute(record, path) for record in source]
    return _attribute(source, path)


def _attribute(record, path):
    for part in path.split("."):
        record = getattr(record, part)
    return record


def _time(topic, source):
    field = next(field for field in topic.fields if field.source == topic.time)
    values = np.asarray(_values(source, field.source), dtype=float)
    return Column("t_s", values, field.comment)


def _table(topic, source):
    """Columns of the fields of fixed shape, one row a record."""
    columns = [_time(topic, source)]
    for field in topic.fields:
        if field.source == topic.time or -1 in field.shape:
            continue
        values, comment = _column(field, _values(source, field.source)), _comment(field)
        if not field.shape:
            columns.append(Column(field.name, values, comment))
            continue
        name = field.name.removesuffix("_wxyz")
        shape = values.shape[1:]
        columns += [
            Column(f"{name}_{ending}", values[(slice(None), *index)], comment)
            for index, ending in zip(np.ndindex(shape), endings(field.name, shape), strict=True)
        ]
    return columns


def _comment(field):
    """What a column is, and of a list of names all that may stand in it."""
    if not isinstance(field.kind, type):
        return field.comment
    return f"{field.comment}: {', '.join(one.name.lower() for one in field.kind)}"


def _column(field, values):
    """Values of a field as one array, numbers of a list of names as the names."""
    if isinstance(field.kind, type):  # an IntEnum
        return np.array([field.kind(int(value)).name.lower() for value in values], dtype=str)
    dtype = {"double": float, "bool": bool, "string": str, "sfixed32": np.int64}[field.kind]
    array = np.asarray(values, dtype=dtype)
    if EQUAL in field.shape:  # as many in each record as in the first
        return array if array.ndim == 1 + len(field.shape) else array.reshape(0, *map(abs, field.shape))
    return array.reshape(len(values), *field.shape)


def endings(name, shape):
    """What tells the columns of a field of a shape apart, in the order of np.ndindex."""
    if name.endswith("_wxyz"):
        return list("wxyz")
    if shape == (3,):
        return list("xyz")
    if len(shape) == 2 and name in _SAMPLES:
        return [f"{i + 1}_{'xyz'[j]}" for i, j in np.ndindex(shape)]
    return ["_".join(str(i + 1) for i in index) for index in np.ndindex(shape)]


def _elements(topic, source, counted):
    """Columns of the fields with a length of their own: one row for each element of each record."""
    lengths = [len(row) for row in _values(source, counted)]
    time = _time(topic, source)
    first = np.cumsum([0, *lengths[:-1]])
    element = np.arange(sum(lengths)) - np.repeat(first, lengths) + 1 if lengths else np.zeros(0, int)
    columns = [
        Column("t_s", np.repeat(time.values, lengths), time.comment),
        Column("element", element.astype(np.int64), "of the record, from 1"),
    ]
    for name in ("number", "sensor", "states"):
        field = next((one for one in topic.fields if one.name == name), None)
        if field is not None:
            values = _column(field, _values(source, field.source))
            columns.append(Column(name, np.repeat(values, lengths), field.comment))
    if counted == "estimates":
        columns += _blocks(_values(source, "states"), lengths)
    for field in topic.fields:
        own = field.source.startswith("stars.") == counted.startswith("stars.")
        if field.shape and field.shape[0] == -1 and own:
            columns += _of_elements(field, _values(source, field.source), lengths)
    return columns


def _blocks(states, lengths):
    """Which error each element of a NavCovariance is: columns of the block and of the unit.

    states : names of the blocks of each record;  lengths : numbers of elements
    """
    named = {key: _errors_of(*key) for key in set(zip(states, lengths, strict=True))}
    rows = [row for key in zip(states, lengths, strict=True) for row in named[key]]
    return [
        Column("block", np.array([name for name, _ in rows], dtype=str), "of states, that it is an error of"),
        Column("unit", np.array([unit for _, unit in rows], dtype=str), "of its estimate and its sigma"),
    ]


def _errors_of(names, length):
    """(block, unit) of each of the errors of some blocks, `length` in all: list.

    A block of a plug-in that is not loaded has what the others leave, and no unit; no names, no blocks.
    """
    known, found = {block.name: block for block in (*STATES, *outer_states())}, []
    blocks = [(name, known.get(name)) for name in names.split()]
    left = length - sum(block.size for _, block in blocks if block is not None)
    for name, block in blocks:
        units = [""] if block is None else block.unit.split(", ")
        size = left if block is None else block.size
        found += [(name, units[min(k, len(units) - 1)]) for k in range(size)]
    return (found + [("", "")] * length)[:length]


def _of_elements(field, rows, lengths):
    """Columns of a field with a row for each element."""
    dtype, inner = (float if field.kind == "double" else np.int64), field.shape[1:]
    parts = [np.asarray(row, dtype).reshape(-1, *inner) for row in rows]
    if [len(part) for part in parts] != lengths:  # of an older log, which lacks it
        return []
    values = np.concatenate(parts) if parts else np.zeros((0, *inner), dtype)
    if not inner:
        return [Column(field.name, values, field.comment)]
    return [
        Column(f"{field.name}_{_inner_ending(inner, index)}", values[(slice(None), *index)], field.comment)
        for index in np.ndindex(inner)
    ]


def _inner_ending(shape, index):
    """Axis of an element of a vector (2 or 3), row and column of one of a matrix."""
    return "xyz"[index[0]] if len(shape) == 1 else "_".join(str(i + 1) for i in index)


def _errors(data):
    """Errors of the navigation at every tick that has truth and estimate, and of the star fixes."""
    from shefex_nav.report import star_metrics
    from shefex_nav.report.figures import errors as levelled

    errors = navigation_errors(data)
    out = {}
    if len(errors.t_s):
        position, velocity = levelled.level(data)
        columns = [Column("t_s", errors.t_s, "mission time, from lift-off [s]")]
        level, here = ("north", "east", "down"), "truth less estimate, local level axes of the true position"
        for name, values, axes, comment in (
            ("position_error_m", position[1], level, here),
            ("velocity_error_m_s", velocity[1], level, f"{here}, relative to the Earth"),
            ("attitude_error_rad", errors.attitude_b, "xyz", "rotation from estimate to truth, body axes"),
            ("position_error_i_m", errors.position_i, "xyz", "truth less estimate, inertial axes"),
            ("velocity_error_i_m_s", errors.velocity_i, "xyz", "truth less estimate, inertial axes"),
        ):
            columns += [Column(f"{name}_{axis}", values[:, k], comment) for k, axis in enumerate(axes)]
        out["errors"] = columns
    stars = star_metrics.star_errors(data)
    if len(stars.t_s):
        columns = [
            Column("t_s", stars.t_s, "middle of the exposure [s]"),
            Column("number", stars.number.astype(np.int64), "of the frame"),
        ]
        for name, values, comment in (
            ("error_rad", stars.rotation_c, "rotation from the fix to the true attitude, camera axes"),
            ("sigma_rad", stars.sigma_c, "standard deviation as the star tracker reports it"),
        ):
            columns += [Column(f"{name}_{axis}", values[:, k], comment) for k, axis in enumerate("xyz")]
        out["star_fix_errors"] = columns
    return out


def arrow(columns):
    """pyarrow.Table of Columns, their comments in the metadata of its fields."""
    import pyarrow as pa

    fields = [pa.field(c.name, pa.array(c.values[:0]).type, metadata={"comment": c.comment}) for c in columns]
    return pa.Table.from_arrays([pa.array(c.values) for c in columns], schema=pa.schema(fields))


def write(data, folder, kind):
    """Write all tables of a RunData into a folder, which is there. kind : one of KINDS. -> list of Path

    Tables of an earlier export that this flight does not have are taken away: they are of another one.
    """
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    earlier, written, listed = _listed(folder), [], []
    for name, columns in _each(data):
        table, path = arrow(columns), Path(folder) / f"{name}.{kind}"
        with whole(path) as half:
            if kind == "csv":
                pa.csv.write_csv(table, half)
            else:
                pa.parquet.write_table(table, half, compression="zstd")
        written.append(path)
        listed += [(name, c.name, c.comment) for c in columns]
        del table, columns  # before the next is made: of a log of many hours each takes a gigabyte
    listing = pa.table([list(column) for column in zip(*listed, strict=True)] if listed else [[], [], []],
                       names=HEADS)  # fmt: skip
    written.append(Path(folder) / COLUMNS)
    with whole(written[-1]) as half:
        pa.csv.write_csv(listing, half)
    for name in earlier - {name for name, _, _ in listed}:
        (Path(folder) / f"{name}.{kind}").unlink(missing_ok=True)
    return written


def _listed(folder):
    """Names of the tables that COLUMNS in a folder lists: set, empty where there is none of an export."""
    try:
        head, *rows = csv.reader(io.StringIO(text_of(Path(folder) / COLUMNS)))
    except (OSError, ValueError, csv.Error):
        return set()
    names = {row[0] for row in rows if len(row) == len(HEADS)}
    return {name for name in names if name.isidentifier()} if tuple(head) == HEADS else set()
