"""Navigation errors in the phases POINTING, in which most payloads are used: largest, and rms."""

import numpy as np

from shefex_nav.records import Phase
from shefex_nav.report.pairing import phase_at


def errors(truth, found):
    """Figures of the errors while the vehicle points; None where it never does, or has no solution then.

    truth : of a RunData;  found : metrics.NavErrors
    -> from_s, to_s; position_m and velocity_m_s of the whole error; attitude_deg, its `max` about one axis
    """
    rows = phase_at(truth, found.t_s) == Phase.POINTING
    if not rows.any():
        return None
    t_s = found.t_s[rows]
    return {
        "from_s": float(t_s[0]),
        "to_s": float(t_s[-1]),
        "position_m": _figures(np.linalg.norm(found.position_i[rows], axis=1)),
        "velocity_m_s": _figures(np.linalg.norm(found.velocity_i[rows], axis=1)),
        "attitude_deg": _figures(
            np.degrees(np.linalg.norm(found.attitude_b[rows], axis=1)),
            np.degrees(np.abs(found.attitude_b[rows])),
        ),
    }


def _figures(sizes, about_axes=None):
    largest = sizes if about_axes is None else about_axes
    return {"rms": float(np.sqrt(np.mean(sizes**2))), "max": float(largest.max())}
