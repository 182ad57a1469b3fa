"""GPS fixes that are not what they say: older than their time, or noisier than the receiver reports."""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry import frames, rotation


def changed(world, arm, *, late_s=0.0, reported=1.0, window=None):
    """World whose receiver errs so.

    Parameters
    ----------
    world : prepare.World
    arm : (3,) m, true lever arm of the antenna
    late_s : fixes say what was true so long before the time they name; negative: after it
    reported : sigma that is reported, over the true one
    window : happenings.Window of this, None: the whole flight

    The noise of a fix stays its own: the antenna is another one, not the error.
    """
    if late_s == 0.0 and reported == 1.0:
        return world
    fixes = []
    for fix in world.gps_fixes:
        if fix.valid and (window is None or window.start_s <= fix.t_valid_s < window.end_s):
            fix = _late(world, arm, fix, late_s) if late_s else fix
            fix = fix._replace(R_r_e=reported**2 * fix.R_r_e, R_v_e=reported**2 * fix.R_v_e)
        fixes.append(fix)
    return world._replace(gps_fixes=fixes)


def _late(world, arm, fix, late_s):
    """A fix with the position and velocity of the antenna at another time, in the axes e of its own."""
    (r_now, v_now), (r_then, v_then) = (
        antenna(world, arm, t_s) for t_s in (fix.t_valid_s, fix.t_valid_s - late_s)
    )
    return fix._replace(r_ea_e=fix.r_ea_e + r_then - r_now, v_ea_e=fix.v_ea_e + v_then - v_now)


def antenna(world, arm, t_s):
    """Position and velocity of the antenna, as of `gps.antenna_states`: (3,) m, (3,) m/s, frame e.

    Within the trajectory; between two samples the nearer one is carried on.
    """
    truth = world.flight.trajectory
    t_s = min(max(t_s, truth.t_s[0]), truth.t_s[-1])
    k = min(int(np.searchsorted(truth.t_s, t_s - SAME_S)), len(truth.t_s) - 1)
    dt_s, arm = t_s - truth.t_s[k], np.asarray(arm, dtype=float)
    omega_b = truth.omega_ib_b[k]
    C_ib = rotation.dcm_from_quat(truth.q_ib[k]) @ rotation.dcm_from_rotvec(omega_b * dt_s)
    r_i = truth.r_i[k] + truth.v_i[k] * dt_s + C_ib @ arm
    v_i = truth.v_i[k] + C_ib @ rotation.cross(omega_b, arm)
    return frames.ecef_from_inertial(world.earth, t_s, r_i, v_i)
