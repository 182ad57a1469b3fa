"""Does the attitude of the solution contradict that of the truth? Then one of them is read wrongly.

A wrong sense of an axis, or of an angle, leaves position and velocity good, for GNSS holds them. It is told
here by the solution itself, wherever the specific force alone did not show it (`imu_axes`).
"""

import numpy as np

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation.state import ATT
from shefex_nav.report.navigation_errors import nees
from shefex_nav.report.pairing import same_times

FAR, SIGMAS, SHARE = np.radians(30.0), 10.0, 0.5  # [E] error and sigmas, both over so much of the time
FEWEST = 5  # instants


def oddities(data):
    """(field, text) to warn of. data : RunData of a replay"""
    found = errors(data)
    if found is None:
        return
    angle, sigmas = found
    far = (angle > FAR) & (sigmas > SIGMAS)
    if np.count_nonzero(far) < FEWEST or far.mean() <= SHARE:
        return
    words = (
        f"the attitude is {np.degrees(np.median(angle[far])):.0f} deg from that of the truth, "
        f"{np.median(sigmas[far]):.0f} times its sigma (medians), for {100.0 * far.mean():.0f} % of the time"
    )
    likely = "check data.axes, order, sense and unit of the truth's roll, pitch and heading"
    yield "data.axes", f"{words}; {likely}, and a heading that the alignment is told"


def errors(data):
    """Angle [rad] between solution and truth, and how many of its sigmas that is, at the instants that have
    truth, solution and covariance: (N,), (N,); None where there is no covariance.
    """
    truth, nav, known = data.truth, data.nav, data.covariance
    if known is None:
        return None
    i, j = same_times(truth.t_s, nav.t_s)
    a, b = same_times(truth.t_s[i], known.t_s)
    if not len(a):
        return None
    error_b = rotation.rotvec_between(nav.q_ib[j[a]], truth.q_ib[i[a]])
    squares = nees(error_b, known.P[b][:, ATT, ATT])
    return np.linalg.norm(error_b, axis=1), np.sqrt(np.where(squares > 0.0, squares, 0.0))
