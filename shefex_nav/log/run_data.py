"""All records of one run as arrays: what `report` works on, from a log or from a run in memory.

A record that comes at a steady rate becomes one record of the same type whose fields are arrays over N
(`data.truth.r_i` is (N, 3)); the others are lists of records. `RunDataBuilder` fed with the records of a
run gives what `reader.read` gives from its log.
"""

import math
from typing import NamedTuple, get_args, get_origin

import numpy as np

from shefex_nav.instruments import TABLE
from shefex_nav.log.topics import FAILED, Mission, RunSummary, Timing, of_record, timing
from shefex_nav.log.wire import assemble
from shefex_nav.records import (
    Alignment,
    CameraCommand,
    ComputeTime,
    ControlSample,
    Event,
    Frame,
    FrameTruth,
    GateResult,
    GpsFix,
    GpsRanges,
    ImuBlock,
    NavCovariance,
    NavHealth,
    NavSolution,
    StarFix,
    TruthSample,
)


class RunData(NamedTuple):
    """One run."""

    mission: Mission
    truth: TruthSample  # arrays
    control: ControlSample  # arrays; empty without attitude control
    imu: ImuBlock  # arrays
    nav: NavSolution  # arrays
    covariance: NavCovariance  # arrays
    frames: Frame  # arrays, image_dn is None
    commands: CameraCommand  # arrays
    compute_times: ComputeTime  # arrays
    gps: list[GpsFix]
    gps_ranges: list[GpsRanges]
    readings: dict  # name of an instrument -> its record of arrays; empty ones of what was not aboard
    star_fixes: list[StarFix]
    frame_truths: list[FrameTruth]
    gates: list[GateResult]
    health: list[NavHealth]
    events: list[Event]
    alignment: Alignment | None
    summary: RunSummary | None
    ended_early: bool  # the flight was interrupted, killed, or failed
    last_t_s: float  # mission time of the last truth; NaN without any
    others: dict = {}  # noqa: RUF012 - name -> other_solutions.Other, what other filters say of the flight

    def with_other(self, name, other):
        """The same flight, of which another filter says this: RunData. other : other_solutions.Other

        What the filter on board said of its measurements and of the sensors is not there.
        """
        mission = self.mission._replace(software=(("navigation", name, ""),))
        nothing = {"gates": [], "health": [], "others": {}}
        return self._replace(mission=mission, nav=other.nav, covariance=other.covariance, **nothing)

    @property
    def failure(self):
        """What software failed with, which ended the flight; '' if none did."""
        return next((event.detail for event in reversed(self.events) if event.name == FAILED), "")

    @property
    def until_s(self):
        """Mission time at which looking was ended although the mission went on; None: seen to its end."""
        given = self.summary is not None and math.isfinite(self.summary.until_s)
        return self.summary.until_s if given else None

    @property
    def reached_s(self):
        """Mission time of the last truth; without any of the last solution, or of the start."""
        times = self.last_t_s, *self.nav.t_s[-1:].tolist(), self.mission.start_s
        return next(t_s for t_s in times if not math.isnan(t_s))

    @property
    def cut_s(self):
        """`RunSummary.until_s` of a log that is made of this one: where it ends if not with the mission."""
        if self.ended_early:
            return self.reached_s
        return math.nan if self.until_s is None else self.until_s


_KINDS = RunData.__annotations__
_OF_ARRAYS = ("truth", "control", "imu", "nav", "covariance", "frames", "commands")
ARRAYS = {_KINDS[name]: name for name in _OF_ARRAYS} | {Timing: "timing"}
LISTS = {get_args(kind)[0]: name for name, kind in _KINDS.items() if get_origin(kind) is list}
_STACK_ROWS = 4096  # records of one type that wait to be made arrays, which take a tenth of their memory


def kept_as_arrays():
    """Types of the records that become one record of arrays: tuple."""
    return (*ARRAYS, *(one.record for one in TABLE.values()))


def stack(record, rows):
    """Rows of the given record type -> one record of arrays; a field has one length in all of them."""
    values = {}
    for field in of_record(record).fields:
        k = record._fields.index(field.source)
        dtype = {"double": np.float64, "bool": np.bool_, "string": np.str_}.get(field.kind, np.int64)
        shape = tuple(max(n, -1 if rows else 0) for n in field.shape)
        if field.shape and rows:
            # lists of any number of rows are no arrays; those of an equal number make one
            if len(lengths := {len(row[k]) for row in rows}) > 1:
                raise ValueError(f"{field.name} has {min(lengths)} rows in one, {max(lengths)} in another")
            column = np.concatenate([row[k] for row in rows]).reshape(len(rows), *shape)
            values[field.source] = column.astype(dtype, copy=False)
        else:
            values[field.source] = np.array([row[k] for row in rows], dtype).reshape(len(rows), *shape)
    return assemble(record, values)


def gather(mission, arrays, lists, alignment, *, ended_early):
    """RunData from records of arrays and lists of records by record type."""
    times = arrays[Timing]
    is_frame = times.frame_number >= 0
    closing = np.flatnonzero(~is_frame)
    summary = None
    if len(closing):
        k = closing[-1]
        summary = RunSummary(*(float(getattr(times, name)[k]) for name in RunSummary._fields))
    compute_times = ComputeTime(times.t_s[is_frame], times.frame_number[is_frame], times.chain_s[is_frame])
    truth = arrays[TruthSample]
    return RunData(
        mission=mission,
        **{name: arrays[record] for record, name in ARRAYS.items() if record is not Timing},
        **{name: lists[record] for record, name in LISTS.items()},
        readings={name: arrays[one.record] for name, one in TABLE.items()},
        compute_times=compute_times,
        alignment=alignment,
        summary=summary,
        ended_early=ended_early or any(event.name == FAILED for event in lists[Event]),
        last_t_s=float(truth.t_s[-1]) if len(truth.t_s) else math.nan,
    )


def join(records):
    """Records of arrays, one after the other -> one, nested records included."""
    columns = []
    for parts in zip(*records, strict=True):
        if parts[0] is None:
            columns.append(None)
        elif isinstance(parts[0], tuple):
            columns.append(join(parts))
        else:
            filled = [part for part in parts if len(part)]  # an empty one does not know its length
            columns.append(np.concatenate(filled) if filled else parts[0])
    return type(records[0])(*columns)


def together(first, second):
    """Two RunData, one after the other; what a run has once is that of the second."""
    arrays = {name: join([getattr(first, name), getattr(second, name)]) for name in _OF_ARRAYS}
    arrays["compute_times"] = join([first.compute_times, second.compute_times])
    lists = {name: getattr(first, name) + getattr(second, name) for name in LISTS.values()}
    readings = {name: join([first.readings[name], one]) for name, one in second.readings.items()}
    return second._replace(**arrays, **lists, readings=readings)


class RunDataBuilder:
    """Collects the records of a run in memory."""

    def __init__(self, mission):
        self._mission = mission
        self._arrays_of = kept_as_arrays()
        self._rows = {record: [] for record in (*self._arrays_of, *LISTS, Alignment)}
        self._stacked = {record: [] for record in self._arrays_of}
        self._last_t_s = math.nan

    def add(self, record):
        """Take one record; the pixels of a frame are let go."""
        kind = type(record)
        if kind is TruthSample:
            self._last_t_s = float(record.t_s)
        elif kind is Frame:
            record = record._replace(image_dn=None)
        elif kind is ComputeTime or kind is RunSummary:
            kind, record = Timing, timing(record)
        rows = self._rows[kind]
        rows.append(record)
        if len(rows) == _STACK_ROWS and kind in self._stacked:
            self._stacked[kind].append(stack(kind, rows))
            rows.clear()

    @property
    def last_t_s(self):
        """Mission time of the last truth; NaN before the first."""
        return self._last_t_s

    def build(self, columns=()):
        """The RunData of everything taken so far, and of records of arrays that were not taken one by one."""
        arrays = {record: self._arrays(record) for record in self._arrays_of}
        arrays |= {type(one): one for one in columns}
        lists = {record: list(self._rows[record]) for record in LISTS}
        alignment = self._rows[Alignment][-1] if self._rows[Alignment] else None
        return gather(self._mission, arrays, lists, alignment, ended_early=False)

    def _arrays(self, record):
        """One record of arrays of everything taken of a type."""
        stacked, rows = self._stacked[record], self._rows[record]
        return join([*stacked, stack(record, rows)]) if stacked else stack(record, rows)
