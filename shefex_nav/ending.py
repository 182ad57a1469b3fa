"""When Python searches for cycles among what a process holds: seldom, and not at its end.

Alone in its file, for every command loads it.
"""

import atexit
import gc

NEW_OBJECTS = 400_000  # after which it is searched; Python does so after 700, a flight starts with 275 000


def search_seldom():
    """Search less often for cycles of objects that nobody uses: what imports make, all stays.

    The searches took a tenth of the time until the first tick of a flight; with this, there is none before.
    """
    gc.set_threshold(NEW_OBJECTS, *gc.get_threshold()[1:])


def end_quickly():
    """Let this process end without a last search for cycles among all that it has loaded: a second.

    What hangs in cycles is then not finalised: files have to be closed by then.
    """
    atexit.register(gc.freeze)
