"""A program of somebody's own that navigates, as the simulator sees it: a `Navigation` at the end of a wire.

Lockstep: a tick is sent, and nothing happens until its answer has come.
"""

import time

from shefex_nav import plugins
from shefex_nav.clock import SAME_S
from shefex_nav.errors import CodeError
from shefex_nav.software import channels, messages
from shefex_nav.software.messages import Begin, Done, End, Failed, Query, Ready, Tick

START_WITHIN_S = 120.0  # for a program to load what it needs


def started(words, sha256, answer_within_s):
    """Remote of a program that is started. words : of its command; sha256 : it must have"""
    words, _ = plugins.program(words, sha256)
    return Remote(lambda _: channels.Pipe(words), answer_within_s)


def reached(address, answer_within_s):
    """Remote of a program that listens at an address, 'tcp://127.0.0.1:5005'."""
    plugins.address(address)
    return Remote(lambda until_s: channels.connected(address, until_s), answer_within_s)


class Remote:
    """A program that navigates, a `Navigation`.

    open_channel : function of the time by which it must be open, time.monotonic()
    answer_within_s : an answer that comes later is a failure
    """

    def __init__(self, open_channel, answer_within_s):
        self._open, self._within_s = open_channel, answer_within_s
        self._channel, self._ticks = None, 0

    def start(self, alignment, mission):
        """As of `Navigation`."""
        until_s = time.monotonic() + START_WITHIN_S
        try:
            self._channel = self._open(until_s)
        except (OSError, channels.Silent) as error:
            raise CodeError(f"cannot be reached: {error}") from None
        told = [messages.start_of(mission), alignment, Begin(alignment.t_valid_s)]
        try:
            ready = self._ask(told, Ready, until_s)
        except CodeError:
            self.close()
            raise
        if not ready[0].gives_context:
            return
        self.context = self._context

    def step(self, imu, arrived):
        """As of `Navigation`."""
        self._ticks += 1
        found = self._ask([imu, *arrived, Tick(imu.t_valid_s, self._ticks)], Done)
        _check_answer(found[-1], imu.t_valid_s)
        return [
            messages.estimate_received(one) if isinstance(one, messages.Estimate) else one
            for one in found[:-1]
        ]

    def _context(self, frame, sky, predicts):
        """What the software knows of a picture: tracker.Context."""
        query = Query(sky.sun_i, sky.earth_velocity_i, predicts, len(frame.image_dn))
        found = self._ask([frame, query], Done)
        _check_answer(found[-1], frame.t_available_s)
        if [type(one) for one in found] != [messages.Context, Done]:
            raise CodeError("must answer a Query by one Context and Done")
        return messages.context_received(found[0])

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
        until_s, found = until_s or time.monotonic() + self._within_s, []
        try:
            self._channel.send(b"".join(map(messages.pack, records)), until_s)
            while not found or not isinstance(found[-1], last):
                found.append(self._record(*self._channel.receive(until_s)))
        except channels.Silent as error:
            raise CodeError(str(error)) from None
        return found

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


def _check_answer(done, t_s):
    """CodeError if a Done is not that of what was asked: later answers would be those of other ticks."""
    if abs(done.t_s - t_s) > SAME_S:
        raise CodeError(f"said Done of T{done.t_s:+.3f} s where that of T{t_s:+.3f} s was due")
