"""Navigation errors in the phases POINTING, in which most payloads are used: largest, and rms."""

import numpy as np

from shefex_nav.records import Phase
from shefex_nav.report.pairing import phase_at


def errors(truth, found):
    """Figures of the errors while the vehicle points; None where it never does, or has no solution then.

    truth : of a RunData;  found : navigation_errors.NavErrors
    -> solution_share, of its ticks; from_s, to_s; position_m and velocity_m_s of the whole error;
    attitude_deg, its `max` about one axis; each with rms, max, and max_at_s, when that was
    """
    rows = phase_at(truth, found.t_s) == Phase.POINTING
    if not rows.any():
        return None
    t_s = found.t_s[rows]
    return {
        "solution_share": float(rows.sum() / (truth.phase == Phase.POINTING).sum()),
        "from_s": float(t_s[0]),
        "to_s": float(t_s[-1]),
        "position_m": _figures(t_s, np.linalg.norm(found.position_i[rows], axis=1)),
        "velocity_m_s": _figures(t_s, np.linalg.norm(found.velocity_i[rows], axis=1)),
        "attitude_deg": _figures(
            t_s,
            np.degrees(np.linalg.norm(found.attitude_b[rows], axis=1)),
            np.degrees(np.abs(found.attitude_b[rows])).max(axis=1),
        ),
    }


def _figures(t_s, sizes, judged=None):
    """rms of sizes (N,) at t_s (N,), the largest of `judged` (N,) and its time; judged : None: the sizes"""
    judged = sizes if judged is None else judged
    k = int(np.argmax(judged))
    return {
        "rms": float(np.sqrt(np.mean(sizes**2))),
        "max": float(judged[k]),
        "max_at_s": float(t_s[k]),
    }
