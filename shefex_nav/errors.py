"""What is said to people instead of a traceback."""

import os
import sys
import traceback
from contextlib import redirect_stdout


class UserError(Exception):
    """Something from outside cannot be used: a file, a folder, data, what is asked of a flight.

    The message says what is wrong, where and what would be right; the command line prints it and ends with
    `exit_code`. Every exception of the package whose message is for people extends this one.
    """

    exit_code = 2


def shown(value, how=repr):
    """What a value of somebody's own code says of itself; that may fail, too. how : repr or str"""
    try:
        return how(value)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return f"a {type(value).__name__} whose __{how.__name__}__ raises {type(error).__name__}"


class CodeError(UserError):
    """Code of a user's own that has failed, or given something else than it must: what, and their frames."""

    def __init__(self, words, cause=None):
        if cause is not None:
            frames = traceback.extract_tb(cause.__traceback__)[1:]  # the first is the program's call
            own = [one for one in frames if one.filename == frames[0].filename]
            place = f" ({os.path.basename(own[-1].filename)}:{own[-1].lineno})" if own else ""
            where = "".join(traceback.format_list(frames))
            words = f"{words}{place}: {type(cause).__name__}: {shown(cause, str)}\n{where}".rstrip()
        super().__init__(words)


class SoftwareError(CodeError):
    """The same in flight, of software of a user's own on board; the log up to then is kept."""

    exit_code = 3


def called(words, function, *given):
    """What a function of somebody's own gives; CodeError if it fails. words : where it is called"""
    try:
        with redirect_stdout(sys.stderr):  # standard output is for results
            return function(*given)
    except KeyboardInterrupt:  # of the user
        raise
    except BaseException as error:  # SystemExit, too: the program would end as if all were done
        raise CodeError(words, error) from error
