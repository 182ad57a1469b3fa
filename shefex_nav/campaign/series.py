"""Errors and sigmas of one run over time, at the rate at which a campaign keeps them."""

import numpy as np

from shefex_nav.campaign.plan import BLOCKS
from shefex_nav.clock import SAME_S
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.report.pairing import phase_at, same_times


def series(data, trajectory, biases, rate_hz):
    """Arrays of a run by their names.

    Times are those of the logged covariance at whole multiples of 1 / rate_hz since the start of the run,
    so the epochs of all runs with the same start coincide.

    Parameters
    ----------
    data : RunData
    trajectory : true, of the run
    biases : (M, 6) rad/s, m/s^2, true, of gyros and accelerometers at the samples of the trajectory
    rate_hz : float

    Returns
    -------
    t_s : (N,)
    position_error_i, velocity_error_i, attitude_error_b, gyro_bias_error, accel_bias_error : (N, 3)
        truth minus estimate, in m, m/s, rad, rad/s, m/s^2
    position_sigma_i ... : (N, 3) as the filter reports them
    nees : (N, 5) squared normalised errors in the order of BLOCKS, three degrees of freedom each. Of
        position, velocity and attitude with their correlations; of the biases, whose correlations are not
        logged, without
    phase : (N,) records.Phase of the truth
    nis_sum.<sensor>, nis_dof.<sensor> : (N,) sums of the normalised squared innovations of the measurements
        that met the gate since the epoch before, and of their degrees of freedom
    """
    errors = navigation_errors(data)
    i, j = _epochs(errors, data, rate_hz)
    t_s = errors.t_s[i]
    of_sample = np.searchsorted(trajectory.t_s, t_s - SAME_S).clip(0, len(trajectory.t_s) - 1)
    kept = _errors_and_sigmas(errors, data.covariance, biases[of_sample], i, j)
    kept["phase"] = phase_at(data.truth, t_s).astype(np.int8)
    kept["nees"] = _nees(kept, data.covariance.P[j])
    return kept | _innovations(data.gates, t_s)


def _epochs(errors, data, rate_hz):
    """Places of the epochs that are kept, among the errors and among the covariances: (N,), (N,)."""
    of_errors, of_covariance = same_times(errors.t_s, data.covariance.t_s)
    since_s = errors.t_s[of_errors] - data.mission.start_s
    wanted = np.abs(since_s * rate_hz - np.round(since_s * rate_hz)) <= SAME_S * rate_hz
    return of_errors[wanted], of_covariance[wanted]


def _errors_and_sigmas(errors, covariance, biases, i, j):
    """Arrays of the epochs i of the errors, j of the covariance; biases (N, 6) true, of these epochs."""
    P, sigma = covariance.P[j], covariance.sigma[j]
    standard = np.sqrt(np.einsum("kii->ki", P))
    return {
        "t_s": errors.t_s[i],
        "position_error_i": errors.position_i[i],
        "velocity_error_i": errors.velocity_i[i],
        "attitude_error_b": errors.attitude_b[i],
        "gyro_bias_error": biases[:, :3] - covariance.gyro_bias[j],
        "accel_bias_error": biases[:, 3:] - covariance.accel_bias[j],
        "position_sigma_i": standard[:, 0:3],
        "velocity_sigma_i": standard[:, 3:6],
        "attitude_sigma_b": standard[:, 6:9],
        "gyro_bias_sigma": sigma[:, 0:3],
        "accel_bias_sigma": sigma[:, 3:6],
    }


def _nees(kept, P):
    """(N, 5) in the order of BLOCKS."""
    columns = []
    for name, place in (("attitude_error_b", 6), ("velocity_error_i", 3), ("position_error_i", 0)):
        block, error = P[:, place : place + 3, place : place + 3], kept[name]
        columns.append(np.einsum("ki,ki->k", error, np.linalg.solve(block, error[:, :, None])[:, :, 0]))
    for name in ("gyro_bias", "accel_bias"):
        columns.append(np.sum((kept[f"{name}_error"] / kept[f"{name}_sigma"]) ** 2, axis=1))
    return np.column_stack(columns) if len(P) else np.zeros((0, len(BLOCKS)))


def _innovations(gates, t_s):
    """Sums of NIS and of degrees of freedom of each sensor between the epochs."""
    met = [gate for gate in gates if gate.dof > 0 and np.isfinite(gate.nis)]
    sums = {}
    for sensor in sorted({gate.sensor for gate in met}):
        of_sensor = [gate for gate in met if gate.sensor == sensor]
        k = np.searchsorted(t_s, np.array([gate.t_s for gate in of_sensor]) - SAME_S)
        inside = k < len(t_s)
        for name, values in (
            ("nis_sum", [gate.nis for gate in of_sensor]),
            ("nis_dof", [gate.dof for gate in of_sensor]),
        ):
            sums[f"{name}.{sensor}"] = np.bincount(k[inside], np.array(values)[inside], minlength=len(t_s))
    return sums
