"""Ctrl-C and SIGTERM as a wish that is asked for between two steps, not an exception in the middle of one."""

import os
import signal
import threading
from contextlib import contextmanager

WORDS = b"\nstopping after this step; what is done is kept. Once more: at once\n"


@contextmanager
def stopping():
    """A function that says whether somebody wants the end; the second wish raises KeyboardInterrupt."""
    wishes = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def take(number, frame):
        wishes.append(number)
        if len(wishes) > 1:
            raise KeyboardInterrupt
        os.write(2, WORDS)  # not print: the signal may have come in the middle of one

    before = {number: signal.signal(number, take) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(wishes)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
