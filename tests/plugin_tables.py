"""What plug-ins add in one test is not there in the next one of the same process."""

from contextlib import contextmanager

from shefex_nav import instruments, plugins
from shefex_nav.onboard.startracker.methods import STEPS


@contextmanager
def restored():
    """Tables as they were before."""
    tables = (
        instruments.TABLE,
        instruments.OWN_STATES,
        plugins._LOADED,
        plugins._MODULES,
        *(step.ways() for step in STEPS.values()),
    )
    kept = [dict(one) for one in tables]
    try:
        yield
    finally:
        for one, before in zip(tables, kept, strict=True):
            one.clear()
            one.update(before)
