"""Attitudes and positions of somebody's own software that are right in another convention than ours.

Read as it stands, such an attitude is simply wrong, and what follows from it too. Software may well know
less than it is told; so it is refused only if what it gives is far from what is known, and near it in another
convention. By chance that happens in less than one of 100 000 attitudes.
"""

import numpy as np

from shefex_nav.geometry import rotation

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


def of_estimate(estimate, alignment, now_s, C_ei):
    """What an Estimate soon after the alignment has in another convention, in words; '' if nothing.

    estimate : own_navigation.Estimate, of arrays;  alignment : Alignment
    C_ei : (3, 3) inertial to Earth-fixed axes, now
    """
    if now_s - alignment.t_valid_s > MEANT_S:
        return ""
    is_known = np.sqrt(np.trace(alignment.P_theta_b)) < KNOWN
    if is_known and (words := of_attitude(estimate.q_ib, alignment.q_ib)):
        return f"q_ib of its Estimate is the attitude of the alignment {words}"
    r_i = alignment.r_i + (now_s - alignment.t_valid_s) * alignment.v_i
    for scale, words in ((1.0, "in Earth-fixed axes"), (1e-3, "in kilometres")):
        meant = scale * (r_i if scale < 1.0 else C_ei @ r_i)
        near, far = scale * NEAR_M, FAR_M
        if np.linalg.norm(estimate.r_i - r_i) > far and np.linalg.norm(estimate.r_i - meant) < near:
            return f"r_i of its Estimate is the position of the alignment {words}; it is in m, inertial axes"
    return ""


def _angle(q_ab, q_known):
    """Angle between two attitudes [rad]."""
    return 2.0 * np.arccos(min(1.0, abs(float(q_ab @ q_known))))
