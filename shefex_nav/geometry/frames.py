"""Between the inertial axes (GCRS) and the rotating Earth (ITRS) during one mission.

Precession, nutation and polar motion are frozen at the epoch of the scenario and the Earth is turned by
its rotation angle alone: at most 16 mm off after 600 s, at a hundredth of the cost of the full chain.
`environment.ephemeris` builds the `EarthRotation`.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.fields import matrix, number
from shefex_nav.geometry.rotation import cross, rows


class EarthRotation(NamedTuple):
    """Orientation of the Earth at t = 0 and its rate."""

    # between GCRS and ITRS and their intermediate frames q and r; precession and polar motion frozen at t = 0
    C_iq: matrix("", "celestial intermediate frame to inertial axes")
    C_re: matrix("", "Earth-fixed axes to terrestrial intermediate frame")
    angle_0: number("rad", "Earth rotation angle at t = 0", name="earth_angle_0_rad")
    rate: number("rad/s", "rotation rate of the Earth", name="earth_rate_rad_s")


@kernel
def dcm_ie(earth, t_s):
    """C_ie at mission time t_s. EarthRotation, s -> (3, 3)."""
    angle = earth.angle_0 + earth.rate * t_s
    c, s = np.cos(angle), np.sin(angle)
    C_qr = rows((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))
    return earth.C_iq @ C_qr @ earth.C_re


@kernel
def omega_ie_i(earth):
    """Rotation of the Earth in inertial components: (3,) rad/s, constant within a mission."""
    return np.ascontiguousarray(earth.C_iq[:, 2]) * earth.rate


@kernel
def inertial_from_ecef(earth, t_s, r_e, v_e):
    """(r_i, v_i) of a point with position r_e and velocity v_e relative to the Earth."""
    C_ie = dcm_ie(earth, t_s)
    r_i = C_ie @ r_e
    return r_i, C_ie @ v_e + cross(omega_ie_i(earth), r_i)


@kernel
def ecef_from_inertial(earth, t_s, r_i, v_i):
    """(r_e, v_e), velocity relative to the rotating Earth, of an inertial state."""
    C_ei = dcm_ie(earth, t_s).T
    return C_ei @ r_i, C_ei @ (v_i - cross(omega_ie_i(earth), r_i))


def dcms_ie(earth, t_s):
    """C_ie at many mission times. EarthRotation, (N,) s -> (N, 3, 3)."""
    angle = earth.angle_0 + earth.rate * np.asarray(t_s)
    c, s = np.cos(angle), np.sin(angle)
    C_qr = np.zeros((len(angle), 3, 3))
    C_qr[:, 0, 0], C_qr[:, 0, 1], C_qr[:, 1, 0], C_qr[:, 1, 1], C_qr[:, 2, 2] = c, -s, s, c, 1.0
    return earth.C_iq @ C_qr @ earth.C_re
