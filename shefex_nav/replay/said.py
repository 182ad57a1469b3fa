"""What a replay says of its start: how it was aligned, and what its clocks differ by."""

import numpy as np

from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.onboard.navigation.blocks import OPTIONAL


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
