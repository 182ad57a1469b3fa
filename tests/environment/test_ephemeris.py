"""Earth orientation and bodies of the solar system against ERFA's full chain and published values."""

import erfa
import numpy as np
import pytest
from astropy import coordinates
from astropy.time import Time

from shefex_nav.environment import ephemeris
from shefex_nav.geometry import frames, wgs84

EPOCH = "2012-06-22T19:18:00"
DUT1 = -0.58479  # s, IERS finals2000A for the day, like the pole
XP, YP = np.radians(0.0787 / 3600.0), np.radians(0.4084 / 3600.0)


def full_chain(t_s):
    """C_ei from ERFA's complete IAU 2006/2000A transformation, t_s after the epoch."""
    utc = erfa.dtf2d("UTC", 2012, 6, 22, 19, 18, 0.0)
    tt = erfa.taitt(*erfa.utctai(*utc))
    ut1 = erfa.utcut1(*utc, DUT1)
    days = t_s / 86400.0
    return erfa.c2t06a(tt[0], tt[1] + days, ut1[0], ut1[1] + days, XP, YP)


@pytest.mark.parametrize(("t_s", "metres"), [(0.0, 1e-6), (-10.0, 1e-3), (300.0, 0.010), (600.0, 0.020)])
def test_frozen_earth_rotation_against_the_full_chain(t_s, metres):
    earth = ephemeris.earth_rotation(EPOCH, DUT1, XP, YP)
    difference = frames.dcm_ie(earth, t_s).T - full_chain(t_s)
    assert np.linalg.norm(difference, ord=2) * wgs84.A < metres


def test_polar_motion_and_ut1_matter_and_have_the_right_sign():
    earth = ephemeris.earth_rotation(EPOCH, DUT1, XP, YP)
    without_pole = ephemeris.earth_rotation(EPOCH, DUT1, 0.0, 0.0)
    without_both = ephemeris.earth_rotation(EPOCH, 0.0, 0.0, 0.0)
    launch_e = wgs84.ecef_from_geodetic(np.radians(69.2942), np.radians(16.0190), 10.0)
    r_i = frames.dcm_ie(earth, 0.0) @ launch_e
    assert 5.0 < np.linalg.norm(r_i - frames.dcm_ie(without_pole, 0.0) @ launch_e) < 13.0
    assert 80.0 < np.linalg.norm(r_i - frames.dcm_ie(without_both, 0.0) @ launch_e) < 115.0


def degrees(u_i):
    ra, dec = erfa.c2s(u_i)
    return np.degrees(ra) % 360.0, np.degrees(dec)


def test_sky_of_the_shefex_2_evening():
    bodies = ephemeris.sky_bodies(EPOCH)
    # astropy's get_body with its builtin ephemeris, to 0.1 deg
    assert degrees(bodies.sun_u_i) == pytest.approx((91.7, 23.4), abs=0.06)
    assert degrees(bodies.moon_r_i) == pytest.approx((129.2, 13.7), abs=0.06)
    expected = {"Venus": (66.5, 18.4), "Mars": (175.1, 2.8), "Jupiter": (60.4, 19.9), "Saturn": (201.9, -6.4)}
    for name, ra_dec in expected.items():
        planet_r_i = bodies.planet_r_i[ephemeris.PLANETS.index(name)]
        assert degrees(planet_r_i) == pytest.approx(ra_dec, abs=0.06), name
    assert 3.56e8 < np.linalg.norm(bodies.moon_r_i) < 4.07e8
    mercury = bodies.planet_r_i[0] / np.linalg.norm(bodies.planet_r_i[0])
    assert np.degrees(erfa.sepp(mercury, bodies.sun_u_i)) < 28.0


@pytest.mark.parametrize("year", [1995, 2004, 2012, 2020, 2025])
@pytest.mark.parametrize("day", ["01-05", "04-03", "06-22", "10-09"])
def test_sun_is_where_astropy_sees_it(year, day):
    """Its apparent place in the GCRS, with light time and aberration, to 0.15 arcsec.

    astropy bends the light of the Sun at the Sun, which is the rest; without aberration it is 20.5 arcsec.
    """
    epoch = f"{year}-{day}T07:00:00"
    seen = coordinates.get_body("sun", Time(epoch, scale="utc"), ephemeris="builtin").cartesian.xyz.value
    bodies = ephemeris.sky_bodies(epoch)
    assert np.degrees(erfa.sepp(ephemeris.apparent_sun(bodies), seen)) * 3600.0 < 0.15
    assert np.degrees(erfa.sepp(bodies.sun_u_i, seen)) * 3600.0 == pytest.approx(20.5, abs=0.4)


def test_sun_of_a_published_example():
    """Meeus, Astronomical Algorithms, 2nd ed., example 25.b: apparent place of 13 October 1992, 0 h TD."""
    sun_i = ephemeris.apparent_sun(ephemeris.sky_bodies("1992-10-12T23:59:00.816"))
    ra, dec = degrees(erfa.pnm06a(2448908.5, 0.0) @ sun_i)
    assert ra == pytest.approx(15.0 * (13.0 + 13.0 / 60.0 + 30.749 / 3600.0), abs=0.1 / 3600.0)
    assert dec == pytest.approx(-(7.0 + 47.0 / 60.0 + 1.74 / 3600.0), abs=0.1 / 3600.0)


def test_earth_velocity_is_the_derivative_of_its_position():
    velocity = ephemeris.sky_bodies(EPOCH).earth_v_i
    tt = ephemeris._tt(EPOCH)
    before, after = (erfa.epv00(tt[0], tt[1] + days)[1]["p"] for days in (-0.01, 0.01))
    np.testing.assert_allclose(velocity, (after - before) * ephemeris.AU / 1728.0, rtol=2e-6, atol=0.01)


def geometry(r, d, phase_deg):
    """Heliocentric and geocentric position of a planet at distances r and d with a phase angle."""
    phase = np.radians(phase_deg)
    return r * np.array([1.0, 0.0, 0.0]), d * np.array([np.cos(phase), np.sin(phase), 0.0])


@pytest.mark.parametrize(
    ("name", "r", "d", "phase", "vmag"),
    [  # test cases that Mallama & Hilton supply with their paper
        ("Mercury", 0.310295423552, 1.32182643625754, 1.1677, -2.477),
        ("Mercury", 0.413629222334, 0.92644808718613, 90.1662, 0.181),
        ("Mercury", 0.448947624811, 0.56004973217883, 178.7284, 7.167),
        ("Venus", 0.722722540169, 1.71607489554051, 1.3232, -3.917),
        ("Venus", 0.721480714554, 0.37762511206278, 124.1348, -4.916),
        ("Venus", 0.726166592736, 0.28889582420642, 179.1845, -3.090),
        ("Jupiter", 5.446231815414, 6.44985867459088, 0.2446, -1.667),
        ("Jupiter", 4.957681473205, 3.95393078136013, 0.3431, -2.934),
    ],
)
def test_planet_magnitudes_of_mallama_and_hilton(name, r, d, phase, vmag):
    assert ephemeris.planet_magnitude(name, *geometry(r, d, phase)) == pytest.approx(vmag, abs=6e-4)


def test_saturn_with_open_rings():
    """Rings open by 26.2 deg, r 9.015 au, d 8.032 au, phase angle 0.11 deg: V = -0.55 (same source)."""
    pole = ephemeris.SATURN_POLE_I
    across = np.cross(pole, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    tilt = np.radians(26.24)
    away = -np.sin(tilt) * pole + np.cos(tilt) * across
    sideways = np.cross(pole, across)
    phase = np.radians(0.1055)
    seen = np.cos(phase) * away + np.sin(phase) * sideways
    vmag = ephemeris.planet_magnitude("Saturn", 9.014989659493 * away, 8.03160470546889 * seen)
    assert vmag == pytest.approx(-0.552, abs=0.005)


def test_mars_at_opposition_2003():
    """r 1.381 au, d 0.373 au, phase angle about 5 deg: V = -2.9 (rotation and season make 0.1 mag)."""
    assert ephemeris.planet_magnitude("Mars", *geometry(1.381, 0.3727, 5.0)) == pytest.approx(-2.9, abs=0.12)


def test_unknown_planet_is_an_error():
    with pytest.raises(ValueError, match="Pluto"):
        ephemeris.planet_magnitude("Pluto", *geometry(30.0, 30.0, 1.0))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("year", [1880, 2012, 2099, 2150, 2190])
def test_velocity_of_the_earth_outside_the_years_of_its_fit(year):
    """Without a warning, and as right as within: against plan94 (1000 to 3000), less the Sun's 16 m/s."""
    tt = ephemeris._tt(f"{year}-03-01T00:00:00")
    sun = 12.5 + 4.0  # m/s, of the Sun about the barycentre, and what plan94 leaves
    moon = erfa.moon98(*tt)["v"] * 0.0121505843  # from the Earth to the barycentre of both
    v_i = (erfa.plan94(*tt, 3)["v"] - moon) * ephemeris.AU / ephemeris.DAY
    assert np.linalg.norm(ephemeris.sky_bodies(f"{year}-03-01T00:00:00").earth_v_i - v_i) < sun


def test_epoch_strings():
    assert ephemeris.julian_year("2000-01-01T12:00:00") == pytest.approx(2000.0, abs=3e-6)  # UTC, not TT
    assert ephemeris.julian_year(EPOCH) == pytest.approx(2012.4745, abs=1e-4)
    assert ephemeris.julian_year(EPOCH + "Z") == ephemeris.julian_year(EPOCH)
    with pytest.raises(ValueError, match="UTC"):
        ephemeris.julian_year(EPOCH + "+02:00")
