"""How far a long experiment is, in lines, where there is no terminal for a bar: in a file, a job, a pipe."""

import time

QUIET_S = 5.0  # at least, between two lines
LONGEST_S = 60.0  # without one


def lines(total, say, clock=time.monotonic):
    """A function for `engine.run`'s progress that says a line for each tenth of the work, or each minute.

    total : int, samples
    say : called with each line
    clock : function that gives seconds
    """
    done, shown, said_s = 0, 0, clock()

    def progress(samples):
        nonlocal done, shown, said_s
        done += samples
        now, tenth = clock(), 10 * done // total
        if done < total and now - said_s >= (QUIET_S if tenth > shown else LONGEST_S):
            say(f"{done} of {total} done")
            shown, said_s = tenth, now

    return progress
