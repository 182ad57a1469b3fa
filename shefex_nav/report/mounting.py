"""How far the star camera of a run is turned from its nominal mounting.

An attitude of the camera has no part of this error; one of the body, made of it, has all that the filter does
not find. The true attitudes of camera and body say it: q_bc = q_bi q_ic.
"""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry.rotation import (
    quat_conjugate,
    quat_from_dcm,
    quat_from_rotvec,
    quat_multiply,
    rotvec_between,
)


def mounting_error_deg(data):
    """Rotation from the nominal to the true mounting, [x, y, z] deg in camera axes; None if it is not known.

    RunData. A frame between two samples of truth takes the nearest one, rotated on at its rate; the median is
    over the frames that are as near to theirs as any.
    """
    truth, frames = data.truth, data.frame_truths
    if not frames or not len(truth.t_s):
        return None
    t_s = np.array([frame.t_valid_s for frame in frames])
    nearest = np.searchsorted(0.5 * (truth.t_s[1:] + truth.t_s[:-1]), t_s)
    gap_s = t_s - truth.t_s[nearest]
    chosen = np.flatnonzero(np.abs(gap_s) <= np.abs(gap_s).min() + SAME_S).tolist()
    nominal_q_bc, errors = quat_from_dcm(data.mission.C_bc), []
    for k in chosen:
        since = quat_from_rotvec(truth.omega_ib_b[nearest[k]] * gap_s[k])
        q_ib = quat_multiply(truth.q_ib[nearest[k]], since)
        errors.append(rotvec_between(nominal_q_bc, quat_multiply(quat_conjugate(q_ib), frames[k].q_ic)))
    return np.degrees(np.median(errors, axis=0)).tolist()
