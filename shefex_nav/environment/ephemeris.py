"""Earth orientation, Sun, Moon and planets, frozen at the epoch of the mission.

In: UTC of lift-off and the Earth orientation parameters of that day. Out: plain arrays in the axes of
the GCRS. All astronomy is ERFA's (IAU 2006/2000A; epv00, moon98, plan94); nothing here touches the
network or sets a global.
"""

import math
import warnings
from contextlib import contextmanager
from datetime import datetime
from typing import NamedTuple

import erfa
import numpy as np

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry.frames import EarthRotation

AU = 149597870700.0  # m, IAU 2012 resolution B2
DAY = 86400.0  # s
ERA_RATE = 2.0 * np.pi * 1.00273781191135448 / DAY  # rad per second of UT1, IAU 2000 resolution B1.8

PLANETS = ("Mercury", "Venus", "Mars", "Jupiter", "Saturn")
PLAN94 = (1, 2, 4, 5, 6)  # numbers of the PLANETS in ERFA
SATURN_POLE_I = np.array([0.08547883, 0.07323576, 0.99364475])  # RA 40.589 deg, Dec 83.537 deg (IAU WGCCRE)


class SkyBodies(NamedTuple):
    """Bright bodies of the solar system seen from the centre of the Earth, without aberration."""

    sun_u_i: np.ndarray  # (3,) unit vector
    moon_r_i: np.ndarray  # (3,) m
    planet_r_i: np.ndarray  # (5, 3) m, in the order of PLANETS, where the light left them
    planet_vmag: np.ndarray  # (5,) apparent V
    earth_v_i: np.ndarray  # (3,) m/s, barycentric velocity of the Earth


@contextmanager
def quiet():
    """ERFA warns in every call of years whose leap seconds it does not know; `is_utc_known` says it once.

    epv00 warns before 1900 and after 2100, for which it was fitted. Against plan94, which holds from 1000 to
    3000, its velocity is within 1.6 m/s from 1850 to 2200 as in between: 1 mas of aberration.
    """
    with warnings.catch_warnings():
        for words in (".*dubious year", ".*1900-2100 AD"):
            warnings.filterwarnings("ignore", words, erfa.ErfaWarning)
        yield


def is_utc_known(epoch_utc):
    """Whether the leap seconds of a day are known: until some years after the release of ERFA."""
    when = datetime.fromisoformat(epoch_utc)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        erfa.dat(when.year, when.month, when.day, 0.0)
    return not said


@quiet()
def _utc(epoch_utc):
    """Two-part Julian date UTC of an ISO 8601 string; a string without a zone is UTC."""
    when = datetime.fromisoformat(epoch_utc)
    if when.tzinfo is not None and when.utcoffset().total_seconds() != 0.0:
        raise ValueError(f"epoch {epoch_utc!r} is not in UTC")
    seconds = when.second + 1e-6 * when.microsecond
    return erfa.dtf2d("UTC", when.year, when.month, when.day, when.hour, when.minute, seconds)


@quiet()
def _tt(epoch_utc):
    """Two-part Julian date TT."""
    return erfa.taitt(*erfa.utctai(*_utc(epoch_utc)))


def julian_year(epoch_utc):
    """Julian epoch, e.g. 2012.47, of an ISO 8601 string in UTC."""
    return float(erfa.epj(*_tt(epoch_utc)))


@quiet()
def earth_rotation(epoch_utc, dut1_s, xp_rad, yp_rad):
    """Orientation of the Earth at t = 0 for `geometry.frames`.

    C_ie(t) = C_iq R3(-(ERA_0 + rate t)) C_re with the matrices of the CIO-based transformation
    (IERS Conventions 2010, chapter 5) of the epoch.

    Parameters
    ----------
    epoch_utc : str, ISO 8601, instant of t = 0
    dut1_s : float, UT1 - UTC [s]
    xp_rad, yp_rad : float, coordinates of the pole [rad]
    """
    tt = _tt(epoch_utc)
    ut1 = erfa.utcut1(*_utc(epoch_utc), dut1_s)
    return EarthRotation(
        C_iq=np.ascontiguousarray(erfa.c2i06a(*tt).T),
        C_re=np.ascontiguousarray(erfa.pom00(xp_rad, yp_rad, erfa.sp00(*tt)).T),
        angle_0=float(erfa.era00(*ut1)),
        rate=ERA_RATE,
    )


@quiet()
def sky_bodies(epoch_utc):
    """Directions and brightness of Sun, Moon and naked-eye planets at the epoch: SkyBodies.

    TT stands in for TDB (2 ms). Seen from the vehicle the Moon is up to 1 deg elsewhere: subtract the
    vehicle's position.
    """
    tt = _tt(epoch_utc)
    earth_heliocentric, earth_barycentric = erfa.epv00(*tt)
    earth_au = earth_heliocentric["p"]
    planet_au, magnitudes = [], []
    for name, number in zip(PLANETS, PLAN94, strict=True):
        geocentric_au = np.zeros(3)
        for _ in range(3):  # light time: the second pass is within 1e-4 s
            light_time_days = np.linalg.norm(geocentric_au) * AU / SPEED_OF_LIGHT / DAY
            heliocentric_au = erfa.plan94(tt[0], tt[1] - light_time_days, number)["p"]
            geocentric_au = heliocentric_au - earth_au
        planet_au.append(geocentric_au)
        magnitudes.append(planet_magnitude(name, heliocentric_au, geocentric_au))
    return SkyBodies(
        sun_u_i=-earth_au / np.linalg.norm(earth_au),
        moon_r_i=erfa.moon98(*tt)["p"] * AU,
        planet_r_i=np.array(planet_au) * AU,
        planet_vmag=np.array(magnitudes),
        earth_v_i=earth_barycentric["v"] * AU / DAY,
    )


def apparent_sun(bodies):
    """Direction in which the Sun is seen, of SkyBodies: (3,) unit vector, what a Sun sensor measures.

    Aberrated by the velocity of the Earth, 20 arcsec; that of a vehicle in a low orbit would add 5 at most.
    Stray light, limb and phase of the Moon go without.
    """
    v = bodies.earth_v_i / SPEED_OF_LIGHT
    return erfa.ab(bodies.sun_u_i, v, 1.0, math.sqrt(1.0 - v @ v))


def planet_magnitude(name, heliocentric_au, geocentric_au):
    """Apparent V of a planet from its position with respect to the Sun and to the observer, in au.

    V = 5 log10(r d) + V(1, phase angle) of Mallama & Hilton 2018 (Astronomy and Computing 25, 10), with
    Saturn's rings; without the 0.1 mag that Mars' rotation and season make.
    """
    r, d = np.linalg.norm(heliocentric_au), np.linalg.norm(geocentric_au)
    phase = math.degrees(math.acos(min(max(heliocentric_au @ geocentric_au / (r * d), -1.0), 1.0)))
    if name == "Mercury":
        series = [-3.0334e-12, 1.6893e-9, -3.4265e-7, 3.3644e-5, -1.6336e-3, 6.328e-2, -0.613]
    elif name == "Venus" and phase < 163.7:
        series = [8.938e-9, -2.814e-6, 3.687e-4, -1.044e-3, -4.384]
    elif name == "Venus":  # forward scattering in the clouds
        series = [8.39034e-3, -2.81914, 236.05828]
    elif name == "Mars" and phase <= 50.0:
        series = [-1.302e-4, 2.267e-2, -1.601]
    elif name == "Mars":
        series = [3.445e-4, -2.573e-2, -0.367]
    elif name == "Jupiter":  # the phase seen from the Earth stays below 12 deg
        series = [6.16e-4, -3.7e-4, -9.395]
    elif name == "Saturn":
        # tilt of the rings: geometric mean of those seen from Sun and Earth, none when they see two faces
        tilts = SATURN_POLE_I @ heliocentric_au / r * (SATURN_POLE_I @ geocentric_au / d)
        sin_tilt = np.sqrt(max(tilts, 0.0))
        series = [0.026, -8.914 - 1.825 * sin_tilt - 0.378 * sin_tilt * math.exp(-2.25 * phase)]
    else:
        raise ValueError(f"no photometry for {name!r}")
    return 5.0 * math.log10(r * d) + float(np.polyval(series, phase))
