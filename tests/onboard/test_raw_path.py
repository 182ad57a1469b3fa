"""The path that the inertial sensors alone would have taken, against a filter that is never corrected."""

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS, alignment, fly, gps_fix

from shefex_nav.onboard.navigation import fusion


@pytest.mark.parametrize("latency_s", [0.0, 0.25])
def test_it_is_the_path_of_a_filter_without_fixes(latency_s):
    """Fixes are off by 3 m and 0.15 m/s, and are used: the difference of two instants is what it was."""
    blocks, states = fly(6.0)
    off = np.array([20.0, -20.0, 10.0])
    params = PARAMS._replace(sigma_accel_bias=1e-9, sigma_gyro_bias=1e-12)  # only the path is corrected
    aligned = alignment(states[0])._replace(P_theta_b=1e-18 * np.eye(3))
    corrected, free = (fusion.start(params, aligned, EARTH) for _ in range(2))
    fixes = [gps_fix(blocks, states, t_s, latency_s) for t_s in (1.0, 2.0, 3.0, 4.0)]
    fixes = [fix._replace(r_ea_e=fix.r_ea_e + 0.1 * off, v_ea_e=fix.v_ea_e + 0.005 * off) for fix in fixes]
    at = {}
    for k, block in enumerate(blocks):
        for nav in (corrected, free):
            fusion.advance(nav, block)
        arrived = [fix for fix in fixes if abs(fix.t_available_s - block.t_valid_s) < 1e-6]
        if arrived:
            results = fusion.fuse(corrected, [("gps", fix) for fix in arrived])
            assert all(result.accepted for result in results)
        if k in (49, 599):
            for name, nav in (("corrected", corrected), ("free", free)):
                history = nav.history
                sums, t_s = history.corrections.until(history.newest), history.ends_s[-1]
                x, off = history.x, (sums.dr + t_s * sums.dv, sums.dv)
                at[name, k] = np.concatenate([x[0:3] - off[0], x[3:6] - off[1]])
    moved, expected = (at[name, 599] - at[name, 49] for name in ("corrected", "free"))
    assert np.linalg.norm(corrected.history.x[:3] - free.history.x[:3]) > 1.0
    assert np.abs((moved - expected)[:3]).max() < 0.02
    assert np.abs((moved - expected)[3:]).max() < 0.01
