"""How processes end: at once. Alone in its file, for every command loads it."""

import atexit
import gc


def end_quickly():
    """Let this process end without a last search for cycles among all that it has loaded: a second.

    What hangs in cycles is then not finalised: files have to be closed by then.
    """
    atexit.register(gc.freeze)
