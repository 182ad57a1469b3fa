"""What a replay says of its start, how it was aligned and what its clocks differ by, and of its end.

Does the attitude of the solution contradict that of the truth? Then one of them is read wrongly. A wrong
sense of an axis, or of an angle, leaves position and velocity good, for GNSS holds them. It is told here by
the solution itself, wherever the specific force alone did not show it (`imu_axes`).
"""

import numpy as np

from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.onboard.navigation.blocks import OPTIONAL
from shefex_nav.onboard.navigation.state import ATT
from shefex_nav.report.navigation_errors import nees
from shefex_nav.report.pairing import same_times

FAR, SIGMAS, SHARE = np.radians(30.0), 10.0, 0.5  # [E] error and sigmas, both over so much of the time
FEWEST = 5  # instants


def alignment(found, earth, method, since_s):
    """JSON object about an Alignment.

    since_s : time of the alignment that was too uncertain to start from [s]; None if there was none
    """
    C_ie = frames.dcm_ie(earth, found.t_valid_s)
    C_nb = (C_ie @ wgs84.level_axes(C_ie.T @ found.r_i)).T @ rotation.dcm_from_quat(found.q_ib)
    sigma = np.sqrt(np.diag(C_nb @ found.P_theta_b @ C_nb.T))
    roll, pitch, heading = np.degrees(euler.euler_from_dcm(C_nb)).tolist()
    with_bias = len(found.gyro_bias) > 0
    return {
        "method": method,
        "t_s": found.t_valid_s,
        "searched_from_s": since_s,
        "roll_pitch_heading_deg": [roll, pitch, heading % 360.0],
        "sigma_north_east_down_deg": np.degrees(sigma).tolist(),
        "gyro_bias_deg_s": np.degrees(found.gyro_bias).tolist() if with_bias else None,
        "sigma_gyro_bias_deg_s": float(np.degrees(found.sigma_gyro_bias)) if with_bias else None,
    }


def clocks(common, data):
    """JSON object about the clocks: what was found before the filter, what was done, what the filter says.

    common : clocks.Clocks;  data : RunData
    """
    covariance = data.covariance
    states = covariance.states[-1].split() if covariance is not None and len(covariance.t_s) else []
    latency = (None, None)
    if "gps_latency" in states:
        k = sum(OPTIONAL[name] for name in states[: states.index("gps_latency")])
        latency = float(covariance.estimates[-1][k]), float(covariance.sigmas[-1][k])
    found = common.found
    return {
        "applied_s": common.applied_s,
        "found_s": None if found is None else found.offset_s,
        "sigma_s": None if found is None else found.sigma_s,
        "gps_latency_s": latency[0],
        "sigma_gps_latency_s": latency[1],
    }


def contradiction(data):
    """(field, text) to warn of. data : RunData of a replay"""
    found = attitude_errors(data)
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


def attitude_errors(data):
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
