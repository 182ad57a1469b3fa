"""How long what J2 leaves out of gravity keeps its value: the filter's constant against the field itself."""

import numpy as np
import pytest

from shefex_nav.environment import gravity
from shefex_nav.onboard.navigation import laws

RADIUS_M = 6378e3 + 100e3
TRACK_M, SPEED = 800e3, 1600.0  # of a ballistic flight of eight minutes


def beyond_j2(field, u):
    return np.array([gravity.gravity_e(field, r) - gravity.gravity_j2_e(r) for r in RADIUS_M * u])


def test_memory_of_the_gravity_state_is_that_of_the_field_along_a_flight():
    """Mean squared change from end to end of 2000 tracks anywhere on the Earth, in any direction.

    A Gauss-Markov process changes by 2 sigma^2 (1 - exp(-T/tau)); the tracks know tau to some 4 %.
    """
    rng, field, n = np.random.default_rng(1), gravity.load("egm96", 12), 2000
    start, along = rng.standard_normal((2, n, 3))
    start /= np.linalg.norm(start, axis=1)[:, None]
    along -= np.einsum("ni,ni->n", start, along)[:, None] * start
    along /= np.linalg.norm(along, axis=1)[:, None]
    angle = TRACK_M / RADIUS_M
    first, last = (beyond_j2(field, u) for u in (start, np.cos(angle) * start + np.sin(angle) * along))
    variance = 0.5 * ((first**2).mean() + (last**2).mean())
    change = ((last - first) ** 2).mean()
    tau_s = -TRACK_M / SPEED / np.log(1.0 - 0.5 * change / variance)
    assert laws.FIELD_TIME_S == pytest.approx(tau_s, rel=0.1)
    assert 10e-6 < np.sqrt(variance) / 9.80665 < 25e-6
