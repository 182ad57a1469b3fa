"""How far long work is: a bar where stderr is a terminal, a line now and then where it is none."""

import time
from contextlib import contextmanager

QUIET_S = 5.0  # at least, between two lines
LONGEST_S = 60.0  # without one


def lines(total, say, done=0, clock=time.monotonic):
    """A function of how many are done, and of words that it says: for each tenth of the work, or each minute.

    total : int, how many there are
    say : called with each line
    done : int, how many are done now
    clock : function that gives seconds
    """
    shown, said_s = 10 * done // total, clock()

    def note(done, words):
        nonlocal shown, said_s
        now, tenth = clock(), 10 * done // total
        if done < total and now - said_s >= (QUIET_S if tenth > shown else LONGEST_S):
            say(words)
            shown, said_s = tenth, now

    return note


@contextmanager
def bar(*columns):
    """rich Progress on stderr, gone when it is over; `disable` where that is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield progress
