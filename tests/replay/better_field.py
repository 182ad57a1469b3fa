"""A better field of the Earth than the on-board one as increments of velocity."""

import numpy as np

from shefex_nav.environment import gravity
from shefex_nav.geometry import frames, rotation


def more_in_field(field, earth, state, dt_s, dtheta_b):
    """Velocity increments that a field gives on top of the filter's own: (n, 3) m/s.

    The difference of the two fields, taken in the middle of the tick, turned into the axes of the middle of
    each sample.

    state : NavState at the beginning of the block;  dt_s : of a sample;  dtheta_b : (n, 3) rad
    """
    half_s = 0.5 * dt_s * len(dtheta_b)
    C_ie = frames.dcm_ie(earth, state.t_s + half_s)
    r_e = C_ie.T @ (state.r_i + half_s * state.v_i)
    more_i = C_ie @ (gravity.gravity_e(field, r_e) - gravity.gravity_j2_e(r_e))
    more_b = rotation.dcm_from_quat(state.q_ib).T @ more_i
    turns = np.cumsum(dtheta_b, axis=0) - 0.5 * dtheta_b
    return dt_s * np.array([rotation.dcm_from_rotvec(turn).T @ more_b for turn in turns])
