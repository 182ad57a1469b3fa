"""Ctrl-C and SIGTERM: the end of a process, an exception, or a wish that is asked for between two steps.

`of_process` is for a program of its own: while it starts, and when its work is done, a signal ends it at
once. `interruptible` is for the work itself: a signal raises KeyboardInterrupt, and is noted, since
compilers, destructors and loaders of libraries lose that or make another exception of it. `stopping` and
`wishes` are for long work in steps.
"""

import _thread
import atexit
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager

WORDS = b"\nstopping after this step; what is done is kept. Once more: at once\n"
INTERRUPTED, CODE = "interrupted", 130  # what a process says, and its exit code: 128 + SIGINT
AGAIN_S = 0.05  # after which an exception that was lost is raised again
SIGNALS = signal.SIGINT, signal.SIGTERM  # Ctrl-C, and that of `kill`, a batch system, a container
COMPILER = tuple(f"{os.sep}{package}{os.sep}" for package in ("numba", "llvmlite"))
LONGEST_S = 3.0  # for which an exception waits for the compiler
PATIENCE_S = 3.0  # for which a step may go on after the first signal, where `at_once_if_waiting` takes it
GIVEN_UP = f"\nthe step has not ended within {PATIENCE_S:g} s and is given up\n".encode()
_put_off = []  # when signals came that wait so
_waiting = []  # an entry for each `waiting`
_wished = []  # for each `wishes` that ends them: the list of it
_said = []  # an entry once the process has said that it was interrupted
_raised = []  # for each `interruptible`: a list with an entry for each signal that raised an exception


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

    _wished.append(asked if take is at_once_if_waiting else [])
    try:
        with handled(dict.fromkeys(signals, wish)):
            yield asked
    finally:
        _wished.pop()


def of_process():
    """Signals end this process at once, with a line and exit code 130, but for work that is `interruptible`.

    At the very end of Python, when all is done, they are ignored: only the memory is left to tidy up.
    """
    if any(signal.getsignal(number) is _end_at_once for number in SIGNALS):
        return
    for number in _heard():
        signal.signal(number, _end_at_once)
    atexit.register(_ignore)  # the first that is registered is the last that is called


def _heard():
    """Those of SIGNALS that whoever started this process has not told it to ignore, as shells do with `&`."""
    return [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]


def _end_at_once(_number, _frame):
    try:
        if not _said:
            os.write(2, f"{INTERRUPTED}\n".encode())  # not print: the signal may have come within one
    finally:
        os._exit(CODE)


def said():
    """This process has said that it was interrupted: a signal that comes after that adds no word."""
    _said.append(True)


def _ignore():
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):  # Python kills itself by a SIGINT that went through its `exec`
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


@contextmanager
def interruptible():
    """A list that has entries if signals have raised KeyboardInterrupt inside: whatever comes out of the
    context is then an interruption. One that is lost in a destructor is raised again a moment later.
    """
    asked, before = [], sys.unraisablehook

    def lost(found):
        if not asked or not issubclass(found.exc_type, KeyboardInterrupt):
            before(found)
        else:
            _soon()

    _raised.append(asked)
    sys.unraisablehook = lost
    try:
        with handled(dict.fromkeys(_heard(), interrupt)):
            yield asked
    finally:
        sys.unraisablehook = before
        _raised.remove(asked)


def _again():
    """In another thread: Ctrl-C for the main one, also while it waits for something."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
    else:
        _thread.interrupt_main()


def interrupt(number=signal.SIGINT, frame=None):
    """Raise KeyboardInterrupt, and note it; as a handler of signals, too: then not within the compiler."""
    for asked in _raised:
        asked.append(number)
    if _is_within_compiler(frame):
        _put_off.append(time.monotonic())
        if _put_off[-1] - _put_off[0] < LONGEST_S:
            _soon()
            return
    _put_off.clear()
    raise KeyboardInterrupt


def _is_within_compiler(frame):
    """Whether numba is at work: C code of it that calls Python crashes where that raises an exception."""
    while frame is not None:
        if any(one in frame.f_code.co_filename for one in COMPILER):
            return True
        frame = frame.f_back
    return False


def _soon():
    """Let the signal come again in a moment."""
    timer = threading.Timer(AGAIN_S, _again)
    timer.daemon = True
    timer.start()


def at_once(asked):
    """KeyboardInterrupt at the second wish, wherever that is. asked : of `wishes`"""
    if len(asked) > 1:
        interrupt(frame=sys._getframe())


def at_once_if_waiting(asked):
    """The same, and at the first wish while the program is `waiting`. asked : of `wishes`

    A step that does not end, such as one of software of a user's own, is given up as by a second wish.
    """
    if _waiting or asked[1:]:
        interrupt(frame=sys._getframe())
    else:
        timer = threading.Timer(PATIENCE_S, _give_up, (asked,))
        timer.daemon = True
        timer.start()


def _give_up(asked):
    """In another thread: wish once more, unless the work that was to end has ended."""
    if any(one is asked for one in _wished):
        os.write(2, GIVEN_UP)
        _again()


@contextmanager
def waiting():
    """Context in which another program is waited for: nothing is in the middle of being done."""
    _waiting.append(True)
    try:
        if any(_wished):  # that came just before
            interrupt()
        yield
    finally:
        _waiting.pop()


@contextmanager
def together():
    """Context of what must not be done by half, such as the start of a process: signals wait for its end.

    Ctrl-C in a terminal is for all of its processes. One that is started inside is deaf to it.
    """
    mask = getattr(signal, "pthread_sigmask", lambda how, signals: ())  # Windows has none
    with wishes(signals=SIGNALS) as asked:
        before = mask(getattr(signal, "SIG_BLOCK", 0), {signal.SIGINT})
        try:
            yield
        finally:
            mask(getattr(signal, "SIG_SETMASK", 0), before)
    for number in asked:
        signal.raise_signal(number)


def deaf():
    """In a process that another one has started and ends: Ctrl-C is not for it, from `together` on."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def stopping():
    """A function that says whether somebody wants the end; the second wish raises KeyboardInterrupt."""

    def take(asked):
        at_once(asked)
        os.write(2, WORDS)  # not print: the signal may have come in the middle of one

    with wishes(take, SIGNALS) as asked:
        yield lambda: bool(asked)
