"""Roll, pitch and heading of a body against local level axes: n north-east-down, b forward-right-down.

C_nb = R3(heading) R2(pitch) R1(roll), as turns of the body: first heading about down, then pitch about the
new right, then roll about the new forward axis.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry.rotation import rows


@kernel
def dcm_from_euler(roll, pitch, heading):
    """C_nb of three angles [rad]: (3, 3)."""
    cr, sr = np.cos(roll), np.sin(roll)
    cp, sp = np.cos(pitch), np.sin(pitch)
    ch, sh = np.cos(heading), np.sin(heading)
    return rows(
        (cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh),
        (cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch),
        (-sp, sr * cp, cr * cp),
    )


@kernel
def euler_from_dcm(C_nb):
    """(roll, pitch, heading) of C_nb [rad], pitch within a quarter turn. (3, 3) -> three floats."""
    pitch = np.arctan2(-C_nb[2, 0], np.sqrt(C_nb[2, 1] ** 2 + C_nb[2, 2] ** 2))
    return np.arctan2(C_nb[2, 1], C_nb[2, 2]), pitch, np.arctan2(C_nb[1, 0], C_nb[0, 0])


@kernel
def euler_jacobian(roll, pitch):
    """d(roll, pitch, heading) of a small rotation vector in body axes: (3, 3); singular at pitch 90 deg.

    C_nb -> C_nb exp(skew(d)) (Groves, 2nd ed., section 2.3.1, rates of the Euler angles).
    """
    cr, sr, tp, cp = np.cos(roll), np.sin(roll), np.tan(pitch), np.cos(pitch)
    return rows((1.0, sr * tp, cr * tp), (0.0, cr, -sr), (0.0, sr / cp, cr / cp))
