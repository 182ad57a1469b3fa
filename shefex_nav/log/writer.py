"""Writes a mission's records to an MCAP file as they come.

Records wait until the next flush, because encoding a hundred of one type at once costs half as much as one by
one; they are then written in the order in which they came. What a flight tells at every tick need not come as
records: at a flush its columns are taken (`steady.Steady`), and their messages stand in the file where those
of the records would. A flush is due after the first tenth of a second (who follows the log has something to
show), at every whole second of mission time, at least once a second of the wall clock and after every event:
a run that is killed keeps all but its last second. In real time it is due ten times as often: a second at
once would hold up the next tick.
"""

import json
import logging
import os
import time
from contextlib import contextmanager
from functools import partial
from itertools import repeat
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.errors import CodeError
from shefex_nav.geometry import frames, wgs84
from shefex_nav.log import topics, wire
from shefex_nav.log.steady import Reached
from shefex_nav.log.topics import LogError, LogExists, RunSummary, Timing, check_folder
from shefex_nav.records import (
    ComputeTime,
    Event,
    Frame,
    GateResult,
    GpsFix,
    NavSolution,
    StarFix,
    TruthSample,
    row,
)

EVERY_S, AT_A_PACE_S = 1.0, 0.1  # of mission time, from flush to flush
CLOCKS = TruthSample, NavSolution, Event, Reached  # records whose time may say that a flush is due
_FLUSH_WALL_S = 1.0
_FIRST_FLUSH_S = 0.1
_CHUNK_BYTES = 1 << 20


class _Route(NamedTuple):
    """Where one type of record goes."""

    codec: object  # of wire.codec
    log: object  # bytes, ns -> file
    time: object  # record, or one of arrays -> its log time [s]
    draw: object  # record, ns -> (topic, Foxglove message) pairs, or None
    draw_columns: object  # record of arrays, (n,) ns -> (topic, rows, list of bytes) triples, or None


class LogWriter:
    """An open log.

    with LogWriter(path, mission, policy) as log:
        for record in records:
            log.write(record)

    `mission` is a `topics.Mission`, `policy` a `drawings.FramePolicy`, `flush_every_s` of mission time,
    `steady` a `steady.Steady` of a flight that passes on all other records, and Reached.
    Leaving the block by an exception still closes the file properly; of software that failed its last record
    says what (topics.FAILED).
    """

    def __init__(self, path, mission, policy, *, overwrite=False, flush_every_s=EVERY_S, steady=None):
        self.path, self._every_s, self._steady = Path(path), flush_every_s, steady
        self._mission = mission
        self._epoch = topics.epoch_ns(mission.epoch_utc)
        self._waiting, self._places, self._last_truth = [], [], None
        self._open(overwrite)
        self._route(policy)
        self._next_flush_s = mission.start_s + _FIRST_FLUSH_S
        self._flushed_at = time.monotonic()
        with self._written():
            self._describe()

    def write(self, record):
        """Log one record under every topic it belongs to."""
        kind = type(record)
        if kind is ComputeTime or kind is RunSummary:
            record = topics.timing(record)
            kind = Timing
        if kind is not Reached:
            if kind not in self._routes:
                raise TypeError(f"{kind.__name__} is not a record of the log")
            self._waiting.append(record)
            self._places.append(0 if self._steady is None else self._steady.place)
            if kind is TruthSample:
                self._last_truth = record
        if kind in CLOCKS:
            self._flush_if_due(kind, record.t_s)

    def flush(self):
        """Put everything written so far on the disk."""
        waiting, self._waiting = self._waiting, []
        places, self._places = self._places, []
        messages, places_of = [], []  # (function, message, ns)
        encoded = self._encode(waiting)
        for record, place in zip(waiting, places, strict=True):
            kind = type(record)
            _, log, _, draw, _ = self._routes[kind]
            data, ns = next(encoded[kind])
            messages.append((log, data, ns))
            if draw is not None:
                messages += [(self._draws[topic], message, ns) for topic, message in draw(record, ns)]
            places_of += [place] * (len(messages) - len(places_of))
        if self._steady is not None:
            messages = self._in_order(messages, np.array(places_of, dtype=np.int64))
        for log, message, ns in messages:
            log(message, ns)
        with self._written():
            self._file.flush()

    def _in_order(self, messages, places):
        """Messages of records and of the columns that are new, in the order of their places."""
        places = [places]
        for arrays, ticks in self._steady.take():
            route = self._routes[type(arrays)]
            ns = topics.log_time_ns(self._epoch, route.time(arrays))
            data = route.codec.encode_columns(arrays, ns)
            messages += zip(repeat(route.log), data, ns.tolist())
            places.append(ticks)
            if route.draw_columns is not None:
                for topic, rows, drawn in route.draw_columns(arrays, ns):
                    messages += zip(repeat(self._draw_bytes[topic]), drawn, ns[rows].tolist())
                    places.append(ticks[rows])
            if type(arrays) is TruthSample:
                self._last_truth = row(arrays, -1)
        return [messages[k] for k in np.argsort(np.concatenate(places), kind="stable").tolist()]

    @contextmanager
    def _written(self):
        """LogError where the disk takes no more; what it has taken before is a log that can be read."""
        try:
            yield
        except RuntimeError as error:  # the SDK has no public type for it
            self._abandon()
            words = self._refusal() or str(error)
            raise LogError(
                f"{self.path}: cannot be written: {words}; what was written before can be read"
            ) from error

    def _refusal(self):
        """Why the machine takes no more, which the SDK does not pass on: disk full, file too large, quota.

        It is asked once more, with a chunk at the end of the file; what it takes of that goes again.
        '' if it takes all of it.
        """
        try:
            with self.path.open("r+b", buffering=0) as file:
                end = file.seek(0, os.SEEK_END)
                try:
                    left = _CHUNK_BYTES
                    while left > 0:
                        left -= file.write(bytes(left))
                finally:
                    file.truncate(end)
        except OSError as error:
            return os.strerror(error.errno)
        return ""

    def _abandon(self):
        """Let go of a file that cannot be written on."""
        self._waiting, self._places = [], []
        try:
            self._file.close()
        except RuntimeError:
            pass  # said already
        self._file = None
        for channel in self._channels:
            channel.close()

    def _encode(self, records):
        """{type: iterator of (bytes, log time in ns) over its records}."""
        rows, messages = {}, {}
        for record in records:
            rows.setdefault(type(record), []).append(record)
        for kind, same in rows.items():
            route = self._routes[kind]
            ns = topics.log_time_ns(self._epoch, np.array([route.time(record) for record in same]))
            messages[kind] = zip(route.codec.encode(same, ns), ns.tolist(), strict=True)
        return messages

    def close(self):
        """Write what waits and the summary section; the log is complete."""
        try:
            if self._file is not None:
                self.flush()
        finally:
            if self._file is not None:
                with self._written():
                    self._file.close()
                for channel in self._channels:
                    channel.close()

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        try:
            if isinstance(error, CodeError):
                self.flush()  # the columns have the last truth
                self.write(self._failure(error))
        finally:
            self.close()

    def _failure(self, error):
        """Event of software that failed, at the time and height of the last truth."""
        truth = self._last_truth
        if truth is None:
            return Event(self._mission.start_s, topics.FAILED, self._mission.launch_height, str(error))
        r_e, _ = frames.ecef_from_inertial(self._mission.earth, truth.t_s, truth.r_i, truth.v_i)
        return Event(truth.t_s, topics.FAILED, float(wgs84.geodetic_from_ecef(r_e)[2]), str(error))

    def _open(self, overwrite):
        import foxglove
        from foxglove.mcap import MCAPCompression, MCAPWriteOptions

        if self.path.exists() and not overwrite:
            raise LogExists(f"{self.path}: exists already; choose another name or pass overwrite=True")
        check_folder(self.path)
        options = MCAPWriteOptions(
            compression=MCAPCompression.Zstd,
            compression_level=1,  # a fifth of the time less than the default, 3 % more bytes
            compression_threads=0,
            chunk_size=_CHUNK_BYTES,
        )
        # it would warn of every single message that a full disk does not take
        logging.getLogger("foxglove").setLevel(logging.ERROR)
        self._context = foxglove.Context()
        try:
            self._file = foxglove.open_mcap(
                self.path, allow_overwrite=overwrite, context=self._context, writer_options=options
            )
        except Exception as error:  # the SDK has no public type for it
            raise LogError(f"{self.path}: cannot be written: {error}") from error

    def _route(self, policy):
        """Open every channel and list what happens with each type of record."""
        from foxglove import Channel, Schema, channels, messages

        from shefex_nav.log.drawings import CHANNELS, Drawings

        self._drawings, self._channels = Drawings(self._mission, policy), []
        self._draws, self._draw_bytes = {}, {}  # topic -> function of a message, of its bytes
        for topic, name in CHANNELS.items():
            channel = getattr(channels, f"{name}Channel")(topic, context=self._context)
            self._draws[topic] = partial(_log_message, channel.log)
            schema = getattr(messages, name).get_schema()  # one topic with one schema is one channel
            same = Channel(topic, schema=schema, message_encoding="protobuf", context=self._context)
            self._draw_bytes[topic] = same.base.log
            self._channels += [channel, same]
        drawn = {
            TruthSample: self._drawings.truth,
            NavSolution: self._drawings.navigation,
            GpsFix: self._drawings.gps,
            Frame: self._drawings.frame,
            StarFix: self._drawings.star_fix,
            GateResult: self._drawings.gate,
            Event: self._drawings.event,
            topics.Mission: self._drawings.calibration,
        }
        of_columns = {
            TruthSample: self._drawings.truth_columns,
            NavSolution: self._drawings.navigation_columns,
        }
        self._routes = {}
        for topic in topics.topics():
            name = f"{wire.PACKAGE}.{topic.schema}"
            schema = Schema(name=name, encoding="protobuf", data=wire.schema_bytes(topic))
            channel = Channel(topic.topic, schema=schema, message_encoding="protobuf", context=self._context)
            self._channels.append(channel)
            self._routes[topic.record] = _Route(
                wire.codec(topic),
                channel.base.log,
                attrgetter(topic.time),
                drawn.get(topic.record),
                of_columns.get(topic.record),
            )

    def _describe(self):
        """Metadata, the scenario and the constants, on disk before the first record."""
        mission = self._mission
        own = {"plugins": mission.plugins, "software": mission.software, "distortion": mission.distortion}
        plugged = {key: json.dumps(value) for key, value in own.items() if value}
        self._file.write_metadata(
            topics.METADATA,
            plugged
            | {
                "format": topics.FORMAT,
                "scenario": mission.scenario,
                "seed": str(mission.seed),
                "version": mission.version,
                "epoch_utc": mission.epoch_utc,
                "start_s": repr(float(mission.start_s)),
            },
        )
        start_ns = int(topics.log_time_ns(self._epoch, mission.start_s))
        self._file.attach(
            log_time=start_ns,
            create_time=start_ns,
            name=topics.ATTACHMENT,
            media_type="application/yaml",
            data=mission.scenario_text.encode(),
        )
        self.write(mission)
        self.flush()

    def _flush_if_due(self, kind, t_s):
        now, t_s = time.monotonic(), t_s + SAME_S
        if kind is Event or t_s >= self._next_flush_s or now - self._flushed_at >= _FLUSH_WALL_S:
            self.flush()
            self._flushed_at = now
            self._next_flush_s = (t_s // self._every_s + 1.0) * self._every_s


def _log_message(log, message, ns):
    """Log a message of Foxglove's. log : of its channel"""
    log(message, log_time=ns)
