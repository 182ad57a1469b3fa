"""Apogees are turning points: the highest point of a part of an orbit, or of a descent, is none."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.geometry import wgs84
from shefex_nav.report import flight
from shefex_nav.report.table import rows

SEMI_AXIS, ECCENTRICITY = 6_928_137.0, 7.2e-4  # m; 545 by 555 km


def orbit(anomalies):
    """r_i, v_i of the two-body orbit at true anomalies [rad]: (N, 3) each."""
    p = SEMI_AXIS * (1.0 - ECCENTRICITY**2)
    c, s, zero = np.cos(anomalies), np.sin(anomalies), np.zeros(len(anomalies))
    r = p / (1.0 + ECCENTRICITY * c)
    r_i = np.column_stack([r * c, r * s, zero])
    v_i = np.sqrt(wgs84.GM / p) * np.column_stack([-s, ECCENTRICITY + c, zero])
    return r_i, v_i


def risen(r_i, v_i, height=None):
    """What `flight` says of the rise of states; the Earth is a sphere here."""
    n = len(r_i)
    height = np.linalg.norm(r_i, axis=1) - wgs84.A if height is None else height
    data = SimpleNamespace(ended_early=False, until_s=None, events=[])
    track = SimpleNamespace(height=height, v_e=v_i, latitude=np.zeros(n), longitude=np.zeros(n))
    states = SimpleNamespace(t_s=np.arange(float(n)), r_i=r_i, v_i=v_i)
    return flight._rise(data, states, track, *np.zeros((2, n)))


@pytest.mark.parametrize(("first", "last"), [(-14, 0), (-14, 5), (10, 170), (200, 350)])
def test_a_part_of_an_orbit_without_its_apogee(first, last):
    found = risen(*orbit(np.radians(np.linspace(first, last, 500))))
    assert found["apogee_km"] is None and found["at_apogee"] is None and found["climbs_at_km"] is None
    assert found["height_km"]["max"] > found["height_km"]["min"] > 540.0


def test_the_apogee_of_an_orbit():
    """Where the distance is greatest, a (1 + e), at the anomaly of 180 deg."""
    found = risen(*orbit(np.radians(np.linspace(-14.0, 346.0, 3601))))
    assert 1e3 * found["apogee_km"] == pytest.approx(SEMI_AXIS * (1 + ECCENTRICITY) - wgs84.A, abs=1.0)
    assert found["at_apogee"]["t_s"] == pytest.approx(1940.0, abs=1.0)


def test_what_only_descends_has_no_apogee():
    t_s = np.arange(60.0)
    for speed, given in ((-10.0, False), (300.0, True)):
        height = 10e3 + speed * t_s - 4.9 * t_s**2
        r_i = np.outer(wgs84.A + height, [1.0, 0.0, 0.0])
        v_i = np.outer(speed - 9.8 * t_s, [1.0, 0.0, 0.0])
        found = risen(r_i, v_i, height)
        assert (found["apogee_km"] is not None) == given


def test_orbits_and_throws():
    assert flight.in_orbit(*(one[0] for one in orbit(np.zeros(1))))
    assert not flight.in_orbit(np.array([wgs84.A + 177e3, 0.0, 0.0]), np.array([0.0, 2500.0, 0.0]))
    assert not flight.in_orbit(np.array([wgs84.A, 0.0, 0.0]), np.zeros(3))


def test_the_table_names_the_heights_where_there_is_no_apogee():
    none = dict.fromkeys(("apogee_km", "climbs_at_km", "range_km", "max_speed_m_s", "at_impact"))
    seen = none | {"of": "truth", "events": [], "height_km": {"min": 544.71, "max": 552.3}}
    summary = {"flight": seen, "simulated_s": 0.0, "attitude_control": None, "software": {}}
    section, lines = next(rows(summary))
    assert (section, dict(lines)) == ("flight", {"height": "544.7 to 552.3 km above the ellipsoid"})
    polar = seen | {"apogee_km": 503.2}  # over the equator; the ellipsoid is lower under the poles
    lines = dict(next(rows(summary | {"flight": polar}))[1])
    assert lines["height"].startswith("544.7 to 552.3 km") and lines["apogee"].startswith("503.2 km")
    launched = seen | {"apogee_km": 552.3}
    assert "height" not in dict(next(rows(summary | {"flight": launched}))[1])
