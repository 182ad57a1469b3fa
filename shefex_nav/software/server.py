"""The other end of `remote`: a program whose navigation is an object in Python."""

import os
import sys
import traceback

import numpy as np

from shefex_nav import plugins
from shefex_nav.onboard.navigator import Sky
from shefex_nav.onboard.startracker.tracker import Context
from shefex_nav.records import Alignment, Frame, ImuBlock
from shefex_nav.scenario import plugged
from shefex_nav.software import channels, messages
from shefex_nav.software.messages import (
    FORMAT,
    Begin,
    Done,
    End,
    Failed,
    Pixels,
    Query,
    Ready,
    Solve,
    Start,
    Tick,
)


def serve(software, address):
    """As `shefex_nav.software.serve`."""
    if address is None:
        channel = channels.Stream(sys.stdin.fileno(), os.dup(sys.stdout.fileno()))
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what the software prints is no message
    else:
        channel = channels.listening(address)
    session = _Session(software, channel)
    try:
        session.run()
    except channels.Silent as error:
        print(f"the simulator is gone: {error}", file=sys.stderr)
    except Exception:
        if session.has_told and address is None:  # the simulator writes why to the same place
            sys.exit(1)
        raise
    finally:
        channel.close()


class _Session:
    """One flight."""

    def __init__(self, software, channel):
        self._software, self._channel = software, channel
        self._heard = []  # records since the last answer
        self.has_told = False  # why the software has failed

    def run(self):
        """Answer until there are no more ticks."""
        while True:
            name, body = self._channel.receive()
            record = messages.unpack(name, body)
            if record is None:
                raise ValueError(f"there is no message '{name}' here")
            if isinstance(record, End):
                return
            answer = _ANSWERS.get(type(record))
            if answer is None:
                if isinstance(record, Pixels):
                    record = messages.with_pixels(self._heard.pop(), record)
                self._heard.append(record)
                continue
            heard, self._heard = self._heard, []
            try:
                answers = answer(self._software, heard, record)
            except Exception:
                self._channel.send(messages.pack(Failed(traceback.format_exc())))
                self.has_told = True
                raise
            self._channel.send(b"".join(map(messages.pack, answers)))


def _begin(software, heard, _begin):
    start = next(one for one in heard if isinstance(one, Start))
    if start.format != FORMAT:
        raise ValueError(f"messages of format {start.format}; this program knows {FORMAT}")
    for plugin, sha256 in plugged.pinned_in(start.scenario, "the scenario"):
        plugins.load(plugin, sha256)  # whose instruments have messages
    alignment = [one for one in heard if isinstance(one, Alignment)]  # a star tracker gets none
    software.start(*alignment, messages.mission_of(start))
    return [Ready(hasattr(software, "context"))]


def _tick(software, heard, tick):
    imu = next(one for one in heard if isinstance(one, ImuBlock))
    given = software.step(imu, [one for one in heard if one is not imu])
    given = [] if given is None else given if isinstance(given, list) else [given]
    sent = [messages.estimate_to_send(one) if type(one).__name__ == "Estimate" else one for one in given]
    return [*sent, Done(tick.t_s)]


def _solve(software, heard, solve):
    frame = next(one for one in heard if isinstance(one, Frame))
    context = next(one for one in heard if isinstance(one, Context))
    return [software.step(frame, context), Done(solve.t_s)]


def _query(software, heard, query):
    frame = next(one for one in heard if isinstance(one, Frame))
    frame = frame._replace(image_dn=np.empty((query.rows, 0), np.uint8))
    context = software.context(frame, Sky(query.sun_i, query.earth_velocity_i), query.predicts)
    return [context, Done(frame.t_available_s)]


_ANSWERS = {Begin: _begin, Tick: _tick, Query: _query, Solve: _solve}
