"""Gravitation of the Earth: spherical harmonics for the truth, the J2 closed form for on board, and the
gravity of the ellipsoid.

In: position in frame e. Out: gravitation in frame e, without the centrifugal acceleration; normal gravity
alone is with it.

Table: Lemoine et al., NASA/TP-1998-206861 (EGM96, tide-free, fully normalised, to degree and order 36).
Formulae: Cunningham (1970), as in Montenbruck & Gill, Satellite Orbits, section 3.2.4: solid harmonics V, W
by recursion in Cartesian components, therefore without a singularity at the poles. Normal gravity: Heiskanen
& Moritz, Physical Geodesy, section 2-8; NIMA TR8350.2, section 4.
"""

import csv
from importlib import resources
from math import factorial, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.environment.models import BUILT_IN, Coefficients, Gravity
from shefex_nav.geometry import wgs84

GM_EGM96 = 3.986004415e14  # m^3/s^2
RADIUS_EGM96 = 6378136.3  # m, of the coefficients
J2_WGS84 = 1.08262982e-3  # from the normalised C20 = -0.484166774985e-3, NIMA TR8350.2
FOCUS = wgs84.A * sqrt(wgs84.E2)  # m, linear eccentricity E of the ellipsoid


class GravityModel(NamedTuple):
    """Harmonics made ready for the recursion; terms ordered by order k, then degree j = k ... degree + 1.

    The gravitation is a sum over solid harmonics, g = GM/R^2 sum_jk (p_jk V_jk + q_jk W_jk), each term of
    which gathers what up to three coefficients C, S contribute.
    """

    gm: float  # m^3/s^2
    radius: float  # m
    degree: int
    recursion: np.ndarray  # (n, 2) factors of V_j-1,k and V_j-2,k in V_jk; at j = k of V_k-1,k-1, and 0
    p: np.ndarray  # (n, 3) of V_jk in the three components
    q: np.ndarray  # (n, 3) of W_jk


def load(kind, degree=12, fields=BUILT_IN[Gravity]):
    """GravityModel of the field a scenario asks for; fields : {name: models.Gravity}

    egm96 has degree and order 2 to 36; j2 and the point mass are those of WGS 84, whatever the degree.
    """
    if degree < 2:
        raise ValueError(f"degree {degree}: a field is given from degree 2 on; 'point' is the point mass")
    if kind not in fields:
        raise ValueError(f"unknown field of gravity '{kind}'; choose from: {', '.join(fields)}")
    return from_normalised(*fields[kind].coefficients(degree))


def egm96(degree):
    """Coefficients of EGM96 to the given degree and order, 0 (point mass) to 36."""
    if not 0 <= degree <= 36:
        raise ValueError(f"degree {degree}: the EGM96 table goes from 0 to 36")
    cosine, sine = np.zeros((degree + 1, degree + 1)), np.zeros((degree + 1, degree + 1))
    cosine[0, 0] = 1.0
    table = resources.files("shefex_nav") / "data" / "egm96_36x36.csv"
    with table.open(newline="") as lines:
        for row in csv.DictReader(lines):
            n, m = int(row["n"]), int(row["m"])
            if n <= degree:
                cosine[n, m], sine[n, m] = float(row["C_normalised"]), float(row["S_normalised"])
    return Coefficients(GM_EGM96, RADIUS_EGM96, cosine, sine)


def j2(degree):
    """Coefficients of WGS 84 with J2 alone."""
    cosine = np.zeros((3, 3))
    cosine[0, 0], cosine[2, 0] = 1.0, -J2_WGS84 / sqrt(5.0)
    return Coefficients(wgs84.GM, wgs84.A, cosine, np.zeros((3, 3)))


def point(degree):
    """Coefficients of the point mass of WGS 84."""
    return Coefficients(wgs84.GM, wgs84.A, np.ones((1, 1)), np.zeros((1, 1)))


def from_normalised(gm, radius, cosine, sine):
    """GravityModel of fully normalised coefficients cosine[n, m], sine[n, m], (N + 1, N + 1) each.

    Differentiating the potential shifts degree and order by one: coefficient (n, m) acts through the solid
    harmonics (n + 1, m - 1), (n + 1, m) and (n + 1, m + 1).
    """
    degree = cosine.shape[0] - 1
    place = {}
    for k in range(degree + 2):
        for j in range(k, degree + 2):
            place[j, k] = len(place)
    recursion, p, q = (np.zeros((len(place), columns)) for columns in (2, 3, 3))
    for (j, k), i in place.items():
        recursion[i] = (2 * k - 1, 0) if j == k else ((2 * j - 1) / (j - k), (j + k - 1) / (j - k))
    for n in range(degree + 1):
        for m in range(n + 1):
            factor = (1 if m == 0 else 2) * (2 * n + 1) * factorial(n - m) / factorial(n + m)
            c, s = cosine[n, m] * sqrt(factor), sine[n, m] * sqrt(factor)
            up = place[n + 1, m + 1]
            half = 1.0 if m == 0 else 0.5
            p[up] += half * np.array([-c, s, 0.0])
            q[up] += half * np.array([-s, -c, 0.0])
            p[place[n + 1, m], 2] -= (n - m + 1) * c
            q[place[n + 1, m], 2] -= (n - m + 1) * s
            if m > 0:
                down = place[n + 1, m - 1]
                half = 0.5 * (n - m + 1) * (n - m + 2)
                p[down] += half * np.array([c, s, 0.0])
                q[down] += half * np.array([s, -c, 0.0])
    return GravityModel(float(gm), float(radius), degree, recursion, p, q)


@kernel
def gravity_e(model, r_e):
    """Gravitation at r_e outside the Earth: (3,) m -> (3,) m/s^2, frame e."""
    r2 = r_e[0] ** 2 + r_e[1] ** 2 + r_e[2] ** 2
    x, y, z = r_e[0] * model.radius / r2, r_e[1] * model.radius / r2, r_e[2] * model.radius / r2
    rho = model.radius**2 / r2
    last = model.degree + 1
    gx, gy, gz = 0.0, 0.0, 0.0
    v_sector, w_sector = model.radius / np.sqrt(r2), 0.0
    i = 0
    for k in range(last + 1):
        if k > 0:
            a = model.recursion[i, 0]
            v_sector, w_sector = a * (x * v_sector - y * w_sector), a * (x * w_sector + y * v_sector)
        v, w = v_sector, w_sector
        v_before, w_before = 0.0, 0.0
        for j in range(k, last + 1):
            if j > k:
                a, b = model.recursion[i, 0] * z, model.recursion[i, 1] * rho
                v, v_before = a * v - b * v_before, v
                w, w_before = a * w - b * w_before, w
            gx += model.p[i, 0] * v + model.q[i, 0] * w
            gy += model.p[i, 1] * v + model.q[i, 1] * w
            gz += model.p[i, 2] * v + model.q[i, 2] * w
            i += 1
    scale = model.gm / model.radius**2
    return np.array([scale * gx, scale * gy, scale * gz])


@kernel
def gravity_j2_e(r_e):
    """Gravitation of the WGS 84 Earth with J2 alone: (3,) m -> (3,) m/s^2, frame e.

    g = -GM/r^3 (1 + 3/2 J2 (A/r)^2 ((1, 1, 3) - 5 (z/r)^2)) r, component by component.
    """
    r2 = r_e[0] ** 2 + r_e[1] ** 2 + r_e[2] ** 2
    k = 1.5 * J2_WGS84 * wgs84.A**2 / r2
    s2 = r_e[2] ** 2 / r2
    c = -wgs84.GM / (r2 * np.sqrt(r2))
    across = c * (1.0 + k * (1.0 - 5.0 * s2))
    return np.array([across * r_e[0], across * r_e[1], c * (1.0 + k * (3.0 - 5.0 * s2)) * r_e[2]])


@inner
def _focal_series(t):
    """q = sum 2 n s_n t^(2n+1) and q' = sum 6 s_n t^2n, with s_n = (-1)^(n+1) / ((2n+1)(2n+3)), n from 1.

    The closed forms q = ((1 + 3/t^2) atan t - 3/t)/2 and q' = 3 (1 + 1/t^2)(1 - atan(t)/t) - 1 lose seven
    digits for the t = E/u <= 0.08 of the Earth; the series has all of them after eight terms.
    """
    q, q_prime = 0.0, 0.0
    power = t * t
    sign = 1.0
    for n in range(1, 9):
        term = sign * power / ((2 * n + 1) * (2 * n + 3))
        q += 2.0 * n * term * t
        q_prime += 6.0 * term
        power *= t * t
        sign = -sign
    return q, q_prime


@kernel
def normal_gravity_e(r_e):
    """Gravity of the WGS 84 ellipsoid, with the centrifugal acceleration: (3,) m -> (3,) m/s^2, frame e.

    Exact on and above the ellipsoid, which is a surface of constant potential: in the ellipsoidal coordinates
    u (semi-minor axis of the confocal ellipsoid) and beta (reduced latitude) the field is a closed form.
    """
    x2 = r_e[0] ** 2 + r_e[1] ** 2
    across, z = np.sqrt(x2), r_e[2]
    e2 = FOCUS**2
    difference = x2 + z * z - e2
    u2 = 0.5 * (difference + np.sqrt(difference**2 + 4.0 * e2 * z * z))
    u, v2 = np.sqrt(u2), u2 + e2
    v = np.sqrt(v2)
    length = np.sqrt((z / u) ** 2 + x2 / v2)  # 1 but for rounding
    sine, cosine = z / (u * length), across / (v * length)
    q, q_prime = _focal_series(FOCUS / u)
    q_0, _ = _focal_series(FOCUS / wgs84.B)
    turning = (wgs84.OMEGA * wgs84.A) ** 2 / q_0
    # gradient along u and beta, but for the common 1/w
    along = -wgs84.GM / v2 - turning * FOCUS / v2 * q_prime * (0.5 * sine**2 - 1.0 / 6.0)
    along += wgs84.OMEGA**2 * u * cosine**2
    aside = (turning * q / v - wgs84.OMEGA**2 * v) * sine * cosine
    w2 = (u2 + e2 * sine**2) / v2
    # unit vectors: d/du = (u/v cos, sin) / w, d/dbeta = (-sin, u/v cos) / w
    outward = (along * u / v * cosine - aside * sine) / w2
    up = (along * sine + aside * u / v * cosine) / w2
    if across == 0.0:
        return np.array([0.0, 0.0, up])
    return np.array([outward * r_e[0] / across, outward * r_e[1] / across, up])
