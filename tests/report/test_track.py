"""The Earth-fixed path against one point at a time."""

import numpy as np
import synthetic_run

from shefex_nav.geometry.frames import ecef_from_inertial
from shefex_nav.geometry.wgs84 import geodetic_from_ecef
from shefex_nav.log.run_data import stack
from shefex_nav.records import TruthSample
from shefex_nav.report.track import earth_fixed


def test_track_is_the_single_points():
    mission = synthetic_run.mission()
    samples = [synthetic_run.truth_at(mission, t) for t in (-3.0, 0.0, 250.0, 490.0)]
    track = earth_fixed(mission.earth, stack(TruthSample, samples))
    for k, sample in enumerate(samples):
        r_e, v_e = ecef_from_inertial(mission.earth, sample.t_s, sample.r_i, sample.v_i)
        np.testing.assert_array_equal(track.r_e[k], r_e)
        np.testing.assert_array_equal(track.v_e[k], v_e)
        expected = geodetic_from_ecef(r_e)
        np.testing.assert_array_equal([track.latitude[k], track.longitude[k], track.height[k]], expected)
    assert abs(track.height[0] - 10.0) < 1e-6
    np.testing.assert_allclose(track.v_e[0], 0.0, atol=1e-9)
