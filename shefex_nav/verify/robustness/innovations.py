"""What a filter expected of each measurement: innovation and its covariance, seen from beside it.

The filter's records say of an innovation how large it is by its own covariance, not that covariance itself.
Every linearisation passes through the filter's table of sensors, so that is where it is looked at; the filter
does what it did before.
"""

from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

import numpy as np


class Innovation(NamedTuple):
    """One innovation, when it met the gate."""

    z: np.ndarray  # (m,)
    S: np.ndarray  # (m, m)


@contextmanager
def watched(seen):
    """While a filter flies in this process, `seen` is filled: dict, (sensor, t_valid_s) -> Innovation."""
    from shefex_nav.onboard.navigation import fusion

    table = fusion.table

    def noting(params):
        return {
            name: sensor._replace(linearise=partial(_noted, name, sensor.linearise, seen))
            for name, sensor in table(params).items()
        }

    fusion.table = noting
    try:
        yield
    finally:
        fusion.table = table


def _noted(name, linearise, seen, nav, now, fix):
    z, H, R = linearise(nav, now, fix)
    if (name, fix.t_valid_s) not in seen:
        seen[name, fix.t_valid_s] = Innovation(z.copy(), H @ now.P @ H.T + R)
    return z, H, R
