"""What a process of the program is told at its start: cycles among what it holds are searched for seldom, and
not at its end; what astropy says of folders of its own is not shown.

Alone in its file, for every command loads it.
"""

import atexit
import gc
import warnings

NEW_OBJECTS = 400_000  # after which it is searched; Python does so after 700, a flight starts with 275 000


def search_seldom():
    """Search less often for cycles of objects that nobody uses: what imports make, all stays.

    The searches took a tenth of the time until the first tick of a flight; with this, there is none before.
    """
    gc.set_threshold(NEW_OBJECTS, *gc.get_threshold()[1:])


def without_folders_of_astropy():
    """Show no warning that XDG_CONFIG_HOME is not there: astropy keeps nothing of ours in it."""
    words = r"(XDG|ASTROPY)_\w+ is set to .*This environment variable will be ignored"
    warnings.filterwarnings("ignore", message=words)


def end_quickly():
    """Let this process end without a last search for cycles among all that it has loaded: a second.

    What hangs in cycles is then not finalised: files have to be closed by then.
    """
    atexit.register(gc.freeze)
