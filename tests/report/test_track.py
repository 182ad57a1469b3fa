"""The Earth-fixed path against one point at a time; distances over the ellipsoid against published ones."""

import math

import numpy as np
import pytest
import synthetic_run

from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import ecef_from_inertial
from shefex_nav.geometry.wgs84 import geodetic_from_ecef
from shefex_nav.log.run_data import stack
from shefex_nav.records import TruthSample
from shefex_nav.report.track import earth_fixed
from shefex_nav.report.track import ground_distance as distance


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


def degrees(d, m, s):
    return math.copysign(abs(d) + m / 60.0 + s / 3600.0, d) * math.pi / 180.0


def test_vincenty_1975_example_a():
    """Survey Review XXIII 176, table of results, line (a): Bessel ellipsoid, 14110526.170 m."""
    found = distance(
        degrees(55, 45, 0.0),
        0.0,
        degrees(-33, 26, 0.0),
        degrees(108, 13, 0.0),
        a=6377397.155,
        f=1 / 299.1528128,
    )
    assert found == pytest.approx(14110526.170, abs=1e-3)


def test_flinders_peak_to_buninyong():
    """GDA94 Technical Manual (ICSM), chapter 4: GRS80, 54972.271 m."""
    found = distance(
        degrees(-37, 57, 3.72030),
        degrees(144, 25, 29.52440),
        degrees(-37, 39, 10.15610),
        degrees(143, 55, 35.38390),
        f=1 / 298.257222101,
    )
    assert found == pytest.approx(54972.271, abs=1e-3)


def test_along_the_equator_and_a_meridian():
    assert distance(0.0, 0.1, 0.0, 0.4) == pytest.approx(0.3 * wgs84.A, abs=1e-6)
    # quarter meridian of WGS 84: 10001965.729 m (NIMA TR8350.2, table of derived constants)
    assert distance(0.0, 0.0, math.pi / 2, 0.0) == pytest.approx(10001965.729, abs=1e-3)
    assert distance(0.7, 0.3, 0.7, 0.3) == 0.0


def test_across_the_date_line():
    assert distance(0.5, 3.1, 0.6, -3.1) == pytest.approx(
        distance(0.5, 0.0, 0.6, 2 * math.pi - 6.2), abs=1e-6
    )


def test_antipodes_are_refused():
    with pytest.raises(ValueError, match="antipodal"):
        distance(0.0, 0.0, 1e-4, math.pi - 1e-4)
