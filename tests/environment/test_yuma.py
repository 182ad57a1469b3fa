"""YUMA almanacs: reading, errors with their lines, weeks, and orbits against independent mechanics."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from shefex_nav.environment import gnss, yuma
from shefex_nav.geometry import wgs84

EPOCH = "2012-06-22T19:18:00Z"
BLOCK = """******** Week {week} almanac for PRN-{prn:02d} ********
ID:                         {prn:02d}
Health:                     {health:03d}
Eccentricity:               {e}
Time of Applicability(s):  {time}
Orbital Inclination(rad):   {i}
Rate of Right Ascen(r/s):  -0.7737465154E-008
SQRT(A)  (m 1/2):           5153.642090
Right Ascen at Week(rad):   0.2345197091E+001
Argument of Perigee(rad):   {perigee}
Mean Anom(rad):             {anomaly}
Af0(s):                     0.6494522095E-003
Af1(s/s):                  -0.1091393642E-010
week:                        {week}
"""
DEFAULT = dict(
    week=669, prn=1, health=0, e="0.1102590561E-001", time="319488.0000", i="0.9847221889",
    perigee="0.863190763", anomaly="0.1332284785E+001",
)  # fmt: skip


def text(**values):
    return BLOCK.format(**DEFAULT | values)


def test_reading_what_is_written():
    found = yuma.read(text(prn=7) + "\n" + text(health=63, e="0.2E-1"))
    assert found.prn.tolist() == [1, 7] and found.health.tolist() == [63, 0]
    np.testing.assert_array_equal(found.eccentricity, [0.02, 0.01102590561])
    assert found.root_semi_major_axis[0] == 5153.642090 and found.node_rate[1] == -0.7737465154e-8
    assert found.week.tolist() == [669, 669]
    assert yuma.constellation(found, EPOCH).prn.tolist() == [7]  # the other one is not healthy


@pytest.mark.parametrize(
    ("broken", "line", "words"),
    [
        (text(e="nothing"), 4, "expected a number such as 12.5, got 'nothing'"),
        (text(e="0.7"), 4, "must be between 0 and 0.5, got 0.7"),
        (text(e="nan"), 4, "expected a number"),
        (text().replace("Mean Anom", "Mean Anomaly"), 11, "expected a line such as"),
        (text().replace("week:                        669\n", ""), 1, "has no week"),
        (text().replace("ID:  ", "ID: 1.5 #"), 2, "expected a number"),
        (text() + text(), 16, "PRN 1 stands in line 2 already"),
        (text() + text(prn=2).split("\n", 1)[1], 15, "given twice"),
        ("", 1, "no satellite"),
        ("hello\n", 1, "expected a line such as"),
    ],
)
def test_errors_name_the_line(broken, line, words):
    with pytest.raises(yuma.BadYuma) as caught:
        yuma.read(broken)
    assert any(at == line and words in said for at, _, said in caught.value.errors), caught.value.errors


@pytest.mark.parametrize(
    ("epoch", "gps_s"),
    [
        ("1980-01-06T00:00:00Z", 0.0),
        ("2012-06-22T19:18:00Z", 1693 * 604800 + 5 * 86400 + 19 * 3600 + 18 * 60 + 15),  # 15 s ahead
        ("2012-07-01T00:00:00Z", 1695 * 604800 + 16),  # after the leap second
        ("2026-01-01T02:00:00+02:00", 2399 * 604800 + 4 * 86400 + 18),
    ],
)
def test_gps_time_counts_leap_seconds(epoch, gps_s):
    assert yuma.gps_seconds(epoch) == gps_s


def test_week_of_the_file_is_the_nearest_to_the_mission():
    """Week 1693 is broadcast as 669; the rollovers of 1999 and 2019 may lie between almanac and mission."""
    week = 604800.0
    assert yuma.full_week(669, 1693 * week) == 1693
    assert yuma.full_week(1693, 1693 * week) == 1693
    assert yuma.full_week(1023, 1024 * week) == 1023  # the day after the rollover of 21 August 1999
    assert yuma.full_week(0, 1023.9 * week) == 1024
    assert yuma.full_week(1, 2047.5 * week) == 2049  # 6 April 2019
    assert yuma.full_week(5, 5 * week) == 5
    assert yuma.full_week(1000, 5 * week) == 1000  # there was no GPS before its week 0
    weeks = np.arange(1400, 2400)
    assert np.array_equal(yuma.full_week(weeks % 1024, (weeks + 100) * week), weeks)


def inertial(constellation, t_s, rate=yuma.OMEGA_GPS):
    """Position and velocity in axes that do not turn and that are those of e at t = 0."""
    r_e, v_e = gnss.states_e(constellation, np.atleast_1d(t_s))
    angle = rate * np.atleast_1d(t_s)[:, None]
    c, s = np.cos(angle), np.sin(angle)

    def turned(x):
        return np.stack([c * x[..., 0] - s * x[..., 1], s * x[..., 0] + c * x[..., 1], x[..., 2]], axis=-1)

    return turned(r_e), turned(v_e + np.cross([0.0, 0.0, rate], r_e))


@pytest.mark.parametrize("e", ["0.0", "0.1102590561E-001", "0.3", "0.5"])
def test_motion_is_that_of_two_bodies(e):
    """Against numerical integration from the first state, five hours; the node's drift is left out."""
    almanac = yuma.read(text(e=e))._replace(node_rate=np.zeros(1))
    constellation = yuma.constellation(almanac, EPOCH)
    t_s = np.linspace(0.0, 18000.0, 7)
    r, v = inertial(constellation, t_s)

    def acceleration(t, y):
        return np.concatenate([y[3:], -yuma.GM_GPS * y[:3] / np.linalg.norm(y[:3]) ** 3])

    y0 = np.concatenate([r[0, 0], v[0, 0]])
    path = solve_ivp(acceleration, (0.0, t_s[-1]), y0, t_eval=t_s, rtol=1e-12, atol=1e-6).y.T
    np.testing.assert_allclose(r[:, 0], path[:, :3], atol=0.05)
    np.testing.assert_allclose(v[:, 0], path[:, 3:], atol=1e-5)


def test_elements_come_out_of_the_state_at_the_time_of_applicability():
    """The classical formulas, from r and v back to the elements that the file gives."""
    almanac = yuma.read(text())._replace(node_rate=np.zeros(1))
    constellation = yuma.constellation(almanac, EPOCH)
    at_s = -yuma.age_s(almanac, EPOCH)[0]
    (r,), (v,) = (x[0] for x in inertial(constellation, at_s))
    # axes of e at the time of applicability: the longitude of the node there
    mu, a = yuma.GM_GPS, 5153.642090**2
    h = np.cross(r, v)
    e_vector = np.cross(v, h) / mu - r / np.linalg.norm(r)
    assert np.linalg.norm(e_vector) == pytest.approx(0.01102590561, abs=1e-9)
    assert 1.0 / (2.0 / np.linalg.norm(r) - v @ v / mu) == pytest.approx(a, rel=1e-9)
    assert np.arccos(h[2] / np.linalg.norm(h)) == pytest.approx(0.9847221889, abs=1e-9)
    node = np.array([-h[1], h[0], 0.0]) / np.hypot(h[0], h[1])
    perigee = np.arccos(node @ e_vector / np.linalg.norm(e_vector))
    assert perigee == pytest.approx(0.863190763, abs=1e-7)
    E = brentq(lambda x: x - 0.01102590561 * np.sin(x) - 1.332284785, 0.0, 3.0)
    true = 2.0 * np.arctan2(
        np.sqrt(1.01102590561) * np.sin(E / 2), np.sqrt(1 - 0.01102590561) * np.cos(E / 2)
    )
    along = np.arccos(node @ r / np.linalg.norm(r))
    assert along == pytest.approx(0.863190763 + true, abs=1e-8)
    (r_e,) = gnss.positions_e(constellation, np.array([at_s]))[0]
    longitude_of_node = 2.345197091 - yuma.OMEGA_GPS * 319488.0
    x = np.cos(along) * np.cos(longitude_of_node) - np.sin(along) * np.cos(0.9847221889) * np.sin(
        longitude_of_node
    )
    assert r_e[0] / np.linalg.norm(r_e) == pytest.approx(x, abs=1e-6)


def test_velocity_is_the_derivative_of_the_position():
    constellation = yuma.constellation(yuma.read(text(e="0.2") + text(prn=2, e="0.0")), EPOCH)
    for which in (constellation, gnss.nominal_24(EPOCH)):
        t_s = np.array([0.0, 3000.0])
        _, v_e = gnss.states_e(which, t_s)
        slope = (gnss.positions_e(which, t_s + 0.5) - gnss.positions_e(which, t_s - 0.5)) / 1.0
        np.testing.assert_allclose(v_e, slope, atol=2e-5)


def test_nominal_slots_as_an_almanac_are_the_nominal_constellation():
    """The table of the performance standard written as YUMA: the same sky, hours apart from its date."""
    epoch = "1993-07-01T06:00:00Z"
    week_s = (
        yuma.gps_seconds("1993-07-01T00:00:00Z") % 604800.0
    )  # 9 s after that midnight of UTC, in GPS time
    nodes = np.repeat(np.deg2rad(gnss.NODES_DEG), 4) - gnss.GREENWICH_HOUR_ANGLE
    slots = yuma.almanac(
        {
            "prn": np.arange(1, 25), "health": np.zeros(24), "eccentricity": np.zeros(24),
            "time": np.full(24, week_s), "inclination": np.full(24, gnss.INCLINATION),
            "node_rate": np.full(24, gnss.NODE_RATE), "root_semi_major_axis": np.full(24, np.sqrt(26559.7e3)),
            "node": nodes + yuma.OMEGA_GPS * week_s, "perigee": np.zeros(24),
            "anomaly": np.deg2rad(gnss.SLOTS_DEG.ravel()), "week": np.full(24, 703),
        }
    )  # fmt: skip
    apart = gnss.positions_e(yuma.constellation(slots, epoch), np.zeros(1)) - gnss.positions_e(
        gnss.nominal_24(epoch), np.zeros(1)
    )
    # six hours at a mean motion that differs by J2's share, 4e-5 of 84 000 km
    assert np.linalg.norm(apart, axis=-1).max() < 5e3
    at_once = gnss.positions_e(yuma.constellation(slots, "1993-07-01T00:00:00Z"), np.zeros(1))
    nominal = gnss.positions_e(gnss.nominal_24("1993-07-01T00:00:00Z"), np.zeros(1))
    np.testing.assert_allclose(at_once, nominal, atol=1.0)
    assert wgs84.OMEGA == pytest.approx(yuma.OMEGA_GPS, rel=1e-7)
