"""How much memory a process may take, looked at before a command runs.

Libraries of others end in a crash or wait for ever where they get none; here it is one message.
"""

from shefex_nav.errors import UserError

LEAST = 4 << 30  # bytes of addresses, most of which are never filled: libraries reserve them


class MemoryLimitError(UserError):
    """Less memory than a command needs."""


def check():
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
