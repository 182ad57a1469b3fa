"""Errors of a navigation near the ground: north, east, down, and roll, pitch, heading of the body.

Errors are truth minus estimate in the local level axes of the true position, angles those of the true
attitude less those of the estimated one. Their sigmas come from the logged covariance.
"""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.report import innovations
from shefex_nav.report.pairing import same_times

REPLAY_START = "replay_start"  # Event of a log whose data are not of the simulator


def is_replay(data):
    """Whether a RunData is of external data."""
    return any(event.name == REPLAY_START for event in data.events)


def title(data):
    """Scenario and seed of a RunData; of external data the scenario, because nothing in them was drawn."""
    name = data.mission.scenario
    return name if is_replay(data) else f"{name}, seed {data.mission.seed}"


def is_of_replay(summary):
    """Whether a summary is of external data."""
    return any(event["name"] == REPLAY_START for event in summary["flight"]["events"])


def done(summary):
    """What the program did with the time of a summary, in a word."""
    return "navigated" if is_of_replay(summary) else "simulated"


def title_of(summary):
    """The same title of a summary."""
    name = summary["scenario"]
    return name if is_of_replay(summary) else f"{name}, seed {summary['seed']}"


def summarise(data, from_s=None):
    """Entries for `navigation` in the summary of a RunData.

    from_s : s, mission time from which on errors count; from the start without it

    Returns
    -------
    dict: position_rms_ned_m, velocity_rms_ned_m_s, attitude_rms_rpy_deg, error_over_sigma (rms of the errors
    over their own sigmas), nis by sensor, statistics_from_s; None where there is no truth
    """
    begin_s = data.mission.start_s if from_s is None else max(from_s, data.mission.start_s)
    t_s, error, sigma_t_s, ratio = errors(data)
    late, late_sigma = t_s >= begin_s - SAME_S, sigma_t_s >= begin_s - SAME_S
    rms, over = _rms(error[late]), _rms(ratio[late_sigma])
    return {
        "statistics_from_s": float(begin_s),
        "position_rms_ned_m": rms and rms[:3],
        "velocity_rms_ned_m_s": rms and rms[3:6],
        "attitude_rms_rpy_deg": rms and np.degrees(rms[6:]).tolist(),
        "error_over_sigma": over
        and {"position_ned": over[:3], "velocity_ned": over[3:6], "attitude_rpy": over[6:]},
        "nis": innovations.summarise(data.gates, begin_s, data.mission.scenario_text),
    }


def _rms(values):
    """Root mean square of each column as a list; None without rows."""
    return np.sqrt(np.mean(values**2, axis=0)).tolist() if len(values) else None


def errors(data):
    """Errors and errors over sigma of a RunData.

    Returns
    -------
    t_s : (N,) ticks that have truth and estimate
    error : (N, 9) position [m] and velocity [m/s] north, east, down; roll, pitch, heading [rad]
    sigma_t_s : (K,) ticks that have a covariance too
    ratio : (K, 9) error over sigma
    """
    t_s, error, index, sigma_t_s, sigma = errors_and_sigmas(data)
    return t_s, error, sigma_t_s, error[index] / sigma


def errors_and_sigmas(data):
    """Errors and their sigmas of a RunData: t_s (N,), error (N, 9), index (K,), sigma_t_s (K,), sigma (K, 9).

    As in `errors`; row k of the sigmas belongs to row index[k] of the errors.
    """
    truth, earth = data.truth, data.mission.earth
    t_s, error = level_errors(data)
    i, _ = same_times(truth.t_s, t_s)
    states = (truth.r_i[i], truth.v_i[i], truth.q_ib[i])
    a, b = same_times(t_s, data.covariance.t_s)
    sigma = _sigmas_kernel(earth, t_s[a], *(state[a] for state in states), data.covariance.P[b])
    return t_s, error, a, t_s[a], sigma


def level_errors(data):
    """t_s (N,) and error (N, 9) of `errors`."""
    truth, nav = data.truth, data.nav
    i, j = same_times(truth.t_s, nav.t_s)
    t_s = truth.t_s[i]
    states = (truth.r_i[i], truth.v_i[i], truth.q_ib[i], nav.r_i[j], nav.v_i[j], nav.q_ib[j])
    return t_s, _errors_kernel(data.mission.earth, t_s, *states)


@inner
def _level_axes(earth, t_s, r_i):
    """C_ni at a position (3,) m in inertial axes."""
    C_ie = frames.dcm_ie(earth, t_s)
    latitude, longitude, _ = wgs84.geodetic_from_ecef(np.ascontiguousarray(C_ie.T) @ r_i)
    return np.ascontiguousarray((C_ie @ wgs84.dcm_en(latitude, longitude)).T)


@kernel
def _errors_kernel(earth, t_s, r_true, v_true, q_true, r_i, v_i, q_ib):
    """(N, 9) errors of `errors`."""
    out = np.empty((t_s.shape[0], 9))
    omega_ie_i = frames.omega_ie_i(earth)
    for k in range(t_s.shape[0]):
        C_ni = _level_axes(earth, t_s[k], r_true[k])
        dr_i = r_true[k] - r_i[k]
        out[k, :3] = C_ni @ dr_i
        out[k, 3:6] = C_ni @ (v_true[k] - v_i[k] - rotation.cross(omega_ie_i, dr_i))
        true = euler.euler_from_dcm(C_ni @ rotation.dcm_from_quat(q_true[k]))
        estimate = euler.euler_from_dcm(C_ni @ rotation.dcm_from_quat(q_ib[k]))
        for i in range(3):
            out[k, 6 + i] = (true[i] - estimate[i] + np.pi) % (2.0 * np.pi) - np.pi
    return out


@kernel
def _sigmas_kernel(earth, t_s, r_i, v_i, q_ib, P):
    """(K, 9) sigmas of these errors from covariances (K, 9, 9) of position i, velocity i, attitude b."""
    out = np.empty((t_s.shape[0], 9))
    turn = rotation.skew(frames.omega_ie_i(earth))
    for k in range(t_s.shape[0]):
        C_ni = _level_axes(earth, t_s[k], r_i[k])
        roll, pitch, _ = euler.euler_from_dcm(C_ni @ rotation.dcm_from_quat(q_ib[k]))
        T = np.zeros((9, 9))
        T[:3, :3] = C_ni
        T[3:6, :3] = -C_ni @ turn
        T[3:6, 3:6] = C_ni
        T[6:, 6:] = euler.euler_jacobian(roll, pitch)
        variances = T @ np.ascontiguousarray(P[k]) @ T.T
        for i in range(9):
            out[k, i] = np.sqrt(variances[i, i])
    return out
