"""Attitudes and positions of somebody's own software that are right in another convention than ours.

Read as it stands, such an attitude is simply wrong, and what follows from it too. Software may well know
less than it is told; so it is refused only if what it gives is far from what is known, and near it in another
convention. By chance that happens in less than one of 100 000 attitudes.
"""

import numpy as np

from shefex_nav.geometry import rotation
from shefex_nav.geometry.elementary import arccos

FAR = np.radians(10.0)  # from what is known,
NEAR = np.radians(2.0)  # in another convention
KNOWN = np.radians(1.0)  # sigma with which an attitude must be known for that
NEAR_M, FAR_M = 200.0, 10_000.0  # likewise of a position
MEANT_S = 1.0  # after the alignment a vehicle is still where it was
XYZW = "the scalar last; it is [w, x, y, z]"
BACKWARDS = "the other way round (its conjugate)"


def of_attitude(q, q_known):
    """In which convention an attitude is what is known of it, in words; '' if it is so, or in none.

    q, q_known : (4,) unit quaternions, of the same two axes
    """
    if _angle(q, q_known) < FAR:
        return ""
    moved = np.roll(q, 1)
    meant = {
        f"with {XYZW}": moved,
        BACKWARDS: rotation.quat_conjugate(q),
        f"{BACKWARDS} and with {XYZW}": rotation.quat_conjugate(moved),
    }
    return next((words for words, one in meant.items() if _angle(one, q_known) < NEAR), "")


def of_start_attitude(q_ib, alignment):
    """What a first attitude is of the Alignment in another convention, in words; '' if nothing. (4,)"""
    if np.sqrt(np.trace(alignment.P_theta_b)) > KNOWN:
        return ""
    words = of_attitude(q_ib, alignment.q_ib)
    return words and f"q_ib is the attitude of the alignment {words}"


def of_start_position(r_i, alignment, now_s, C_ei):
    """The same of a first position (3,). C_ei : (3, 3) inertial to Earth-fixed axes, now"""
    known_i = alignment.r_i + (now_s - alignment.t_valid_s) * alignment.v_i
    if np.linalg.norm(r_i - known_i) < FAR_M:
        return ""
    meant = (
        ("in Earth-fixed axes", C_ei @ known_i, NEAR_M),
        ("in kilometres", 1e-3 * known_i, 1e-3 * NEAR_M),
    )
    for words, one, near in meant:
        if np.linalg.norm(r_i - one) < near:
            return f"r_i is the position of the alignment {words}; it is in m, inertial axes"
    return ""


def _angle(q_ab, q_known):
    """Angle between two attitudes [rad]."""
    return 2.0 * arccos(min(1.0, abs(float(q_ab @ q_known))))
