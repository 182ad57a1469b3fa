"""A program of somebody's own, as the simulator sees it: navigation, computer or star tracker.

Lockstep: a tick is sent, and nothing happens until its answer has come.
"""

import time

from shefex_nav import plugins
from shefex_nav.clock import SAME_S
from shefex_nav.errors import CodeError
from shefex_nav.onboard.own_tracker import Solved
from shefex_nav.onboard.startracker.tracker import Context
from shefex_nav.records import Frame
from shefex_nav.software import channels, messages
from shefex_nav.software.messages import Begin, Done, End, Failed, Query, Ready, Solve, Tick

MOST_MESSAGES, MOST_BYTES = 1000, 1 << 26  # of an answer


def started(words, sha256):
    """Function that starts a program and opens the channel to it. words : of its command; sha256 : its own"""
    words, _ = plugins.program(words, sha256)
    return lambda _: channels.Pipe(words)


def reached(address):
    """Function that opens the channel to a program that listens at an address, 'tcp://127.0.0.1:5005'."""
    plugins.address(address)
    return lambda until_s: channels.connected(address, until_s)


class _Wire:
    """What a program is asked, and what it answers.

    open_channel : function of the time by which it must be open, time.monotonic()
    answer_within_s : an answer that comes later is a failure;  start_within_s : likewise of the first
    """

    def __init__(self, open_channel, answer_within_s, start_within_s):
        self._open, self._within_s, self._start_s = open_channel, answer_within_s, start_within_s
        self._channel = None

    def _start(self, told):
        """Open the channel and tell the program everything that there is beforehand. -> Ready"""
        until_s = time.monotonic() + self._start_s
        try:
            self._channel = self._open(until_s)
        except (OSError, channels.Silent) as error:
            raise CodeError(f"cannot be reached: {error}") from None
        try:
            return self._ask(told, Ready, until_s)[0]
        except CodeError:
            self.close()
            raise

    def close(self):
        """Say that there are no more ticks, and let the program end."""
        if self._channel is None:
            return
        try:
            self._channel.send(messages.pack(End(0.0)), time.monotonic() + 1.0)
        except (OSError, channels.Silent):
            pass
        self._channel.close()
        self._channel = None

    def _ask(self, records, last, until_s=None):
        """Send records; what comes until a record of type `last`, that included: list of records."""
        is_tick = until_s is None
        until_s = until_s or time.monotonic() + self._within_s
        try:
            self._channel.send(b"".join(map(messages.pack, records)), until_s)
            return self._until(last, until_s)
        except channels.Late:
            key, limit_s = ("answer_within", self._within_s) if is_tick else ("start_within", self._start_s)
            raise CodeError(f"no answer in time ({key}: {limit_s:g} s)") from None
        except channels.Silent as error:
            raise CodeError(str(error)) from None

    def _until(self, last, until_s):
        """What comes until a record of type `last`, that included: list of records."""
        found, size = [], 0
        while len(found) < MOST_MESSAGES and size <= MOST_BYTES:
            name, body = self._channel.receive(until_s)
            found.append(self._record(name, body))
            size += messages.HEAD.size + len(name) + len(body)
            if isinstance(found[-1], last):
                return found
            channels.check_in_time(until_s)  # what has come already is not waited for
        words = f"sent {len(found)} messages of {size} bytes without {last.__name__}"
        raise CodeError(f"{words}; {MOST_MESSAGES} messages and {MOST_BYTES >> 20} MiB are the most")

    def _one(self, records, kind, t_s):
        """The one record of a type that is the answer to records about a time."""
        found = self._ask(records, Done)
        _check_answer(found[-1], t_s)
        if [type(one) for one in found] != [kind, Done]:
            raise CodeError(f"must answer a {type(records[-1]).__name__} by one {kind.__name__} and Done")
        return found[0]

    def _record(self, name, body):
        try:
            record = messages.unpack(name, body)
        except Exception as error:
            raise CodeError(f"sent a message '{name}' that cannot be read: {error}") from None
        if record is None:
            raise CodeError(f"sent a message '{name}', which there is not")
        if isinstance(record, Failed):
            raise CodeError(f"failed:\n{record.words}")
        return record


class Remote(_Wire):
    """A program that navigates, a `Navigation`, or a whole `Computer`."""

    _ticks = 0

    def start(self, alignment, mission):
        """As of `Navigation`."""
        if self._start([messages.start_of(mission), alignment, Begin(alignment.t_valid_s)]).gives_context:
            self.context = self._context

    def step(self, imu, arrived):
        """As of `Navigation` and `Computer`."""
        self._ticks += 1
        come = [part for one in arrived for part in _sent(one)]
        found = self._ask([imu, *come, Tick(imu.t_valid_s, self._ticks)], Done)
        _check_answer(found[-1], imu.t_valid_s)
        return [
            messages.estimate_received(one) if isinstance(one, messages.Estimate) else one
            for one in found[:-1]
        ]

    def _context(self, frame, sky, predicts):
        """What the software knows of a picture: tracker.Context."""
        query = Query(sky.sun_i, sky.earth_velocity_i, predicts, len(frame.image_dn))
        return self._one([frame, query], Context, frame.t_available_s)


class RemoteTracker(_Wire):
    """A program that searches pictures, a `StarTracker`."""

    def start(self, mission):
        """As of `StarTracker`."""
        self._start([messages.start_of(mission), Begin(mission.start_s)])

    def step(self, frame, context):
        """As of `StarTracker`."""
        told = [*_sent(frame), context, Solve(frame.t_available_s)]
        return self._one(told, Solved, frame.t_available_s)


def _sent(record):
    """A record as it is sent: a picture in two."""
    return [record, messages.pixels_of(record)] if isinstance(record, Frame) else [record]


def _check_answer(done, t_s):
    """CodeError if a Done is not that of what was asked: later answers would be those of other ticks."""
    if abs(done.t_s - t_s) > SAME_S:
        raise CodeError(f"said Done of T{done.t_s:+.3f} s where that of T{t_s:+.3f} s was due")
