"""Ctrl-C and SIGTERM as a wish that is asked for between two steps, not an exception in the middle of one."""

import os
import signal
import threading
from contextlib import contextmanager

WORDS = b"\nstopping after this step; what is done is kept. Once more: at once\n"
_waiting = []  # an entry for each `waiting`


@contextmanager
def handled(handlers):
    """Handlers of signals for a while: {number: handler}; none outside of the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def wishes(take=lambda asked: None, signals=(signal.SIGINT,)):
    """A list that gets an entry with each signal; none outside of the main thread.

    take : called with the list after each
    """
    asked = []

    def wish(number, frame):
        asked.append(number)
        take(asked)

    with handled(dict.fromkeys(signals, wish)):
        yield asked


def at_once(asked):
    """KeyboardInterrupt at the second wish, wherever that is. asked : of `wishes`"""
    if len(asked) > 1:
        raise KeyboardInterrupt


def at_once_if_waiting(asked):
    """The same, and at the first wish while the program is `waiting`. asked : of `wishes`"""
    if _waiting or asked[1:]:
        raise KeyboardInterrupt


@contextmanager
def waiting():
    """Context in which another program is waited for: nothing is in the middle of being done."""
    _waiting.append(True)
    try:
        yield
    finally:
        _waiting.pop()


def terminable():
    """Context in which SIGTERM (of `kill`, a batch system, a container) is Ctrl-C: files are closed."""
    return handled({signal.SIGTERM: signal.default_int_handler})


@contextmanager
def stopping():
    """A function that says whether somebody wants the end; the second wish raises KeyboardInterrupt."""

    def take(asked):
        at_once(asked)
        os.write(2, WORDS)  # not print: the signal may have come in the middle of one

    with wishes(take, (signal.SIGINT, signal.SIGTERM)) as asked:
        yield lambda: bool(asked)
