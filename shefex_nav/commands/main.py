"""The entry point: Ctrl-C and SIGTERM end the program well from here on, while it imports its commands, too.

Nothing heavy is imported by this file: what comes before its first line ends with the words of Python.
"""

from shefex_nav import stopping
from shefex_nav.ending import search_seldom


def main():
    """A process of the command line, from its start to its end; `commands.app` has the commands."""
    stopping.of_process()
    search_seldom()
    from shefex_nav.commands import app

    app.main()
