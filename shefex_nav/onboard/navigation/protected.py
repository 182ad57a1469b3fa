"""What has a protection level: position and velocity, each horizontal and vertical, attitude about body axes.

Horizontal and vertical are what users of satellite navigation know as HPL and VPL (RTCA DO-229, appendix J):
a circle in the local level plane, whose radius says the same whatever way the vehicle flies, and the height
by itself, which GPS knows half as well. Three level axes would need as many limits, and north is no direction
that a rocket cares for. Velocity is that against the Earth. The sigma of the plane is that of its worst
direction.

What a wrong fix could have done is followed along nine axes, north, east, down of position and velocity and
x, y, z, and taken together where a level is told.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import frames, wgs84
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation.state import ATT, POS, VEL, X_R

N_FOLLOWED, N_TOLD = 9, 7
POSITION, VELOCITY, ATTITUDE = slice(0, 2), slice(2, 4), slice(4, 7)  # among the seven that are told
P_NED, V_NED, BODY = slice(0, 3), slice(3, 6), slice(6, 9)  # among the nine that are followed


def level_axes(earth, t_s, x):
    """Directions in which `parts` looks: (4, 3), inertial axes.

    Rows north, east, down at the position of packed values x, and the turn of the Earth, rad/s.
    earth : EarthRotation;  t_s : s
    """
    out = np.empty((4, 3))
    _level_axes(*earth, t_s, x, out)
    return out


@kernel
def _level_axes(C_iq, C_re, angle_0, rate, t_s, x, out):
    """`level_axes` with the fields of EarthRotation; out is written."""
    earth = frames.EarthRotation(C_iq, C_re, angle_0, rate)
    C_ei = t3.transposed(t3.matrix(frames.dcm_ie(earth, t_s)))
    r_e = np.array(t3.rotated(C_ei, t3.vector(x, X_R.start)))
    put_level_axes(C_ei, r_e, t3.vector(frames.omega_ie_i(earth), 0), out)


@inner
def put_level_axes(C_ei, r_e, turn, out):
    """Write `level_axes` of a place r_e (3,) into out (4, 3); the turn of the Earth as three numbers.

    -> C_ni, nine numbers as C_ei
    """
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    C_ni = t3.product(t3.transposed(t3.matrix(wgs84.dcm_en(latitude, longitude))), C_ei)
    t3.store(out[:3], C_ni)
    t3.put(out[3], turn)
    return C_ni


@inner
def gradients(axes, out):
    """Errors north, east, down of position and velocity by those in inertial axes: out (6, 6) is written."""
    turn = t3.row(axes, 3)
    for k in range(3):
        row = t3.row(axes, k)
        turned = t3.cross(turn, row)  # row . (dv - omega x dr) = row . dv + (omega x row) . dr
        for i in range(3):
            out[k, i], out[k, 3 + i] = row[i], 0.0
            out[3 + k, i], out[3 + k, 3 + i] = turned[i], row[i]


@inner
def variances(P, axes, out):
    """Variances along the nine axes of a covariance (n, n): out (9,) is written. axes : `level_axes`

    -> those of north and east together, of position and of velocity
    """
    east, turn, both_r, both_v = t3.row(axes, 1), t3.row(axes, 3), 0.0, 0.0
    for k in range(3):
        row = t3.row(axes, k)
        seen = _by(P, POS.start, POS.start, row)
        out[k] = t3.dot(seen, row)
        turned = t3.cross(turn, row)  # as in `gradients`
        of_r = t3.plus(_by(P, POS.start, VEL.start, row), 1.0, _by(P, POS.start, POS.start, turned))
        of_v = t3.plus(_by(P, VEL.start, VEL.start, row), 1.0, _by(P, VEL.start, POS.start, turned))
        out[V_NED.start + k] = t3.dot(of_v, row) + t3.dot(of_r, turned)
        if k == 0:
            both_r, both_v = t3.dot(seen, east), t3.dot(of_v, east) + t3.dot(of_r, t3.cross(turn, east))
        out[BODY.start + k] = P[ATT.start + k, ATT.start + k]
    return both_r, both_v


@inner(forceinline=True)
def _by(P, first, second, row):
    """A block (3, 3) of P times three numbers."""
    x, y, z = row
    return (  # by elements: a view of a row would be counted as a reference
        P[first, second] * x + P[first, second + 1] * y + P[first, second + 2] * z,
        P[first + 1, second] * x + P[first + 1, second + 1] * y + P[first + 1, second + 2] * z,
        P[first + 2, second] * x + P[first + 2, second + 1] * y + P[first + 2, second + 2] * z,
    )


@kernel
def sigmas(P, axes):
    """Standard deviations along the nine axes of a covariance (n, n): (9,) m, m/s, rad. axes: `level_axes`"""
    out = np.empty(N_FOLLOWED)
    variances(P, axes, out)
    return np.sqrt(out)


@inner
def worst_sigmas(nine, both, out):
    """Standard deviations of what is told, that of the plane in its worst direction: out (7,) is written.

    nine, both : of `variances`
    """
    for block in range(2):
        a, b, c = nine[3 * block], nine[3 * block + 1], both[block]
        out[2 * block] = np.sqrt(0.5 * (a + b) + np.sqrt(0.25 * (a - b) ** 2 + c * c))
        out[2 * block + 1] = np.sqrt(nine[3 * block + 2])
    for k in range(3):
        out[ATTITUDE.start + k] = np.sqrt(nine[BODY.start + k])
