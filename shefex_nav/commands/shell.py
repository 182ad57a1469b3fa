"""What a shell gives the process of a command, looked at before one runs: environment variables and memory.

What a library cannot read ends in a traceback of its own, somewhere in a flight; here it is one message. A
library is imported for that only where the user has set a variable of it. Where they get too little memory,
libraries end in a crash or wait for ever; that is one message too.
"""

import os
import warnings

from shefex_nav.errors import UserError

LEAST = 4 << 30  # bytes of addresses, most of which are never filled: libraries reserve them
LATEST_S = 253_402_300_799  # the last second of the year 9999
OF_PROGRAM = {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_DISABLE_INTEL_SVML"}  # by `compiled.target`
WITHOUT_SCREEN = {"agg", "cairo", "pdf", "pgf", "ps", "svg", "template"}


class VariableError(UserError):
    """An environment variable that a library cannot read."""


def check(environ=os.environ):
    """VariableError of the first variable that cannot be read."""
    _whole(environ, "SOURCE_DATE_EPOCH", 0, LATEST_S, "of seconds since 1970")
    _whole(environ, "NUMBA_NUM_THREADS", 1, 10_000, "of threads")
    if any(name.startswith("NUMBA_") and name not in OF_PROGRAM for name in environ):
        _of_numba(environ)
    backend = environ.get("MPLBACKEND", "")
    if backend and backend.lower() not in WITHOUT_SCREEN and not backend.startswith("module://"):
        _of_matplotlib(backend)


def _refused(name, value, expected):
    return VariableError(
        f"environment variable {name}: got {value!r}, expected {expected}; correct it, or unset it"
    )


def _whole(environ, name, least, most, what):
    """Refuse a value that is no whole number between two."""
    value = environ.get(name)
    if value is not None and not (value.isascii() and value.isdigit() and least <= int(value[:20]) <= most):
        raise _refused(name, value, f"a whole number {what}, {least} to {most}")


def _of_numba(environ):
    """Refuse a value that numba warns of, and does without."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        import numba  # noqa: F401 it reads its variables
    for one in said:
        words = str(one.message)
        name = words.removeprefix("Environment variable '").partition("'")[0]
        if words.startswith("Environment variable") and name in environ:
            raise _refused(name, environ[name], "a value that numba can read, such as 1")


def _of_matplotlib(backend):
    """Refuse a backend that matplotlib does not know."""
    try:
        import matplotlib  # noqa: F401 it reads the variable
    except ValueError as error:
        if "backend" not in str(error):
            raise
        raise _refused("MPLBACKEND", backend, "a backend that matplotlib knows, such as agg") from None


class MemoryLimitError(UserError):
    """Less memory than a command needs."""


def check_memory():
    """MemoryLimitError where a limit of the shell leaves less than LEAST."""
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most != resource.RLIM_INFINITY and most < LEAST:
        raise MemoryLimitError(
            f"memory is limited to {most >> 10} kB; expected at least {LEAST >> 10} kB: "
            f"ulimit -v {LEAST >> 10}, or ulimit -v unlimited"
        )
