"""Protection levels of software of a user's own that asks for them: k sigma of its covariance.

k is that of the built-in filter (`integrity_protection`), from `requirements.integrity_risk`. What a fault
may do that nobody notices is not in it: only the software knows which of its measurements it would notice.
Levels so made are right as far as P is, and errors of a fault exceed them.
"""

import numpy as np

from shefex_nav.onboard.navigation import protected
from shefex_nav.records import QUANTITIES, Doubt


def added(told, P, wanted, earth):
    """NavSolution with levels of a covariance, and with doubts where they exceed what is required.

    told : NavSolution without levels;  P : (9, 9) as of Estimate
    wanted : integrity_protection.Requirement;  earth : EarthRotation
    """
    levels = wanted.k * sigmas(told, P, earth)
    parts = protected.POSITION, protected.VELOCITY, protected.ATTITUDE
    fields = {}
    for quantity, part, limit in zip(QUANTITIES, parts, wanted.limits, strict=True):
        fields[f"protection_{quantity}"] = levels[part]
        size = np.linalg.norm(levels[part]) if part is not protected.ATTITUDE else levels[part].max()
        if size > limit and not getattr(told, f"do_not_use_{quantity}"):
            fields |= {f"do_not_use_{quantity}": True, f"doubt_{quantity}": int(Doubt.LEVEL)}
    return told._replace(**fields)


def sigmas(told, P, earth):
    """Standard deviations along the seven axes of `protected`: (7,). Arguments as of `added`"""
    x = np.concatenate([told.r_i, told.v_i, told.q_ib])
    *level, turn = protected.level_axes(earth, told.t_s, x)
    level = np.array(level)
    G = np.zeros((6, 6))
    G[:3, :3] = G[3:, 3:] = level
    G[3:, :3] = np.cross(turn, level)  # of dr in the velocity against the Earth
    P_ned = G @ P[:6, :6] @ G.T
    out = np.empty(protected.N_TOLD)
    for k, first in ((0, 0), (2, 3)):
        plane = P_ned[first : first + 2, first : first + 2]
        out[k] = np.sqrt(np.linalg.eigvalsh(plane)[-1])
        out[k + 1] = np.sqrt(P_ned[first + 2, first + 2])
    out[protected.ATTITUDE] = np.sqrt(P.diagonal()[6:])
    return out
