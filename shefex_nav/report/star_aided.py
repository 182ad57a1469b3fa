"""Navigation errors since the stars are known: those before are of the start alone.

They are known with the second star fix, because an attitude begins with two that agree. That depends on the
star tracker alone, so that two filters of one flight are compared over the same time.
"""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.onboard.navigation.quantity import ATTITUDE, fix_of
from shefex_nav.report import sensor_use
from shefex_nav.report.sizes import largest, rms


def errors(data, found):
    """Figures of the errors from the second star fix to the end; None if there are no two.

    data : RunData;  found : navigation_errors.NavErrors
    -> from_s; position_m, velocity_m_s, attitude_deg: rms and max of the whole error
    """
    given = sorted(fix.t_available_s for fix in sensor_use.good_fixes(data))
    since = given[1] if len(given) > 1 else None
    rows = np.zeros(len(found.t_s), dtype=bool) if since is None else found.t_s >= since - SAME_S
    if not rows.any():
        return None
    sizes = {
        "position_m": np.linalg.norm(found.position_i[rows], axis=1),
        "velocity_m_s": np.linalg.norm(found.velocity_i[rows], axis=1),
        "attitude_deg": np.degrees(np.linalg.norm(found.attitude_b[rows], axis=1)),
    }
    return {"from_s": float(since)} | {
        name: {"rms": rms(size), "max": largest(size)} for name, size in sizes.items()
    }


def begins(data):
    """Mission time from which a solution knows the stars; None if it never does, as far as it says.

    Of a solution that did not fly, which cannot say it, that of the first star fix.
    """
    accepted = [gate.t_s for gate in data.gates if fix_of(gate.sensor) is ATTITUDE and gate.accepted]
    if data.gates:
        return accepted[0] if accepted else None
    aided = data.nav.t_s[np.asarray(data.nav.star_aided, dtype=bool)]
    if not len(aided) and not sensor_use.flew(data):
        return min((fix.t_available_s for fix in sensor_use.good_fixes(data)), default=None)
    return float(aided[0]) if len(aided) else None
