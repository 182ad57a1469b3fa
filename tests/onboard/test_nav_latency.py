"""Fixes that are older than they say: the block `gps_latency`. Its Jacobians are in test_nav_blocks."""

import numpy as np
import pytest
from test_nav_blocks import ALL, fixes_of, linearised, state_with_errors
from test_nav_blocks import RNG as RNG  # begins anew with each test of this module, too


@pytest.mark.parametrize("latency_s", [5e-3, 0.1])
def test_latency_is_what_a_fix_is_older_than_it_says(latency_s):
    """A fix taken so much before its time is explained by that latency, and by none other.

    However far the spin has turned the lever arm meanwhile: 54 deg in 0.1 s, of a swing of 1.5 m/s.
    """
    truth = state_with_errors(ALL.names, latency_s)
    fixes = fixes_of(truth)
    z_r, z_v = (linearised(ALL, truth, fixes)[k][0] for k in (0, 1))
    assert np.abs(z_r).max() < 1e-5 and np.abs(z_v).max() < 2e-4  # differences in time of a rounded position
    z_r, z_v = (linearised(ALL, truth._replace(gps_latency=np.zeros(1)), fixes)[k][0] for k in (0, 1))
    assert np.linalg.norm(z_r) > 5.0 and np.linalg.norm(z_v) > 0.2
