"""The mean rate of an interval that has passed, as the star camera needs it: that of one exposure.

In: the IMU increments that the filter keeps, and its estimates of the gyro errors and of the camera's
mounting. Out: the rate of the camera in its own axes, and the covariance of its error. The mean over an
exposure is far quieter than one sample: white noise falls with the duration, and of the quantisation, whose
remainder is carried on, only the two ends are left.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import calibration


def body_rate(nav, x, begin_s, end_s):
    """Mean of omega_ib_b over an interval, corrected with estimates.

    Parameters
    ----------
    nav : fusion.Filter, advanced to the present tick
    x : (X,) packed nominal values, whose estimated gyro errors are taken out
    begin_s, end_s : mission times

    Returns
    -------
    omega_b : (3,) rad/s; NaN where the filter's memory does not cover the interval
    f_b : (3,) m/s^2, likewise
    noise : float, (rad/s)^2, variance on each axis of what is no state of the filter
    """
    samples = nav.history.samples(begin_s, end_s)
    if samples is None:
        return np.full(3, np.nan), np.full(3, np.nan), np.inf
    duration_s, increments = _between(samples.increments, samples.dt_s, samples.end_s, begin_s, end_s)
    omega_b, f_b = calibration.motion(x, increments, duration_s, samples.vibration, samples.drive)
    noise = _noise(nav.params.imu, omega_b, f_b, samples, duration_s)
    return omega_b, f_b, noise


@kernel
def _between(increments, dt_s, last_s, begin_s, end_s):
    """Time and increments of an interval. Samples (N, 6), their dt_s (N,), end of the last, interval"""
    weight, sample_s = np.empty(len(dt_s)), np.cumsum(dt_s[::-1])[::-1] - dt_s
    for k in range(len(dt_s)):
        sample_end_s = last_s - sample_s[k]
        inside_s = min(sample_end_s, end_s) - max(sample_end_s - dt_s[k], begin_s)
        weight[k] = min(max(inside_s / dt_s[k], 0.0), 1.0)
    return dt_s @ weight, weight @ increments


def _noise(model, omega_b, f_b, samples, duration_s):
    """Variance of the mean rate on each axis from what the filter counts as noise, (rad/s)^2.

    `error_model.noise_densities` has the same errors as densities: here those that keep their sign over the
    interval count in full, and those that swing by the angle they leave between its ends.
    """
    vibration, variance = samples.vibration, model.gyro_random_walk**2 / duration_s
    variance += (model.gyro_quantum**2 / 6.0 + 2.0 * (vibration * model.gyro_vibration) ** 2) / duration_s**2
    variance += model.gyro_cross**2 * (omega_b[1] ** 2 + omega_b[2] ** 2)
    variance += model.gyro_g_sensitivity**2 * (f_b @ f_b)
    variance += (model.gyro_rectification * vibration**2) ** 2
    if samples.doubtful:
        variance += model.saturated_rate**2
    return float(variance)


def camera_rate(nav, tick, C_bc, begin_s, end_s):
    """Mean inertial rate of the star camera over an interval, in camera axes.

    omega_c = C_cb omega_b. An error of the mounting turns it: with C_bc(true) = exp(skew(dm)) C_bc,

        d omega_c = C_cb (J_omega dx + omega_b x d mounting + noise),   J_omega of `calibration.jacobians`

    Parameters
    ----------
    nav : fusion.Filter, advanced to the present tick
    tick : fusion.Tick whose estimates and covariance are taken, near the interval
    C_bc : (3, 3) estimated mounting
    begin_s, end_s : mission times

    Returns
    -------
    omega_c : (3,) rad/s
    P_omega_c : (3, 3) (rad/s)^2; both None where the filter's memory does not cover the interval
    """
    omega_b, f_b, noise = body_rate(nav, tick.x, begin_s, end_s)
    if not np.isfinite(omega_b.sum()):
        return None, None
    vibration, drive = (
        (0.0, calibration.NO_DRIVE) if tick.imu is None else (tick.imu.vibration, tick.imu.drive)
    )
    H, _ = calibration.jacobians(nav.layout, tick.x, omega_b, f_b, vibration, drive)
    if mounting := nav.layout.places["mounting"]:
        H[:, mounting] = rotation.skew(omega_b)
    return _in_camera_axes(C_bc, omega_b, H, tick.P, noise)


@kernel
def _in_camera_axes(C_bc, omega_b, H, P, noise):
    """Rate and its covariance in camera axes. H : (3, n);  P : (n, n);  noise : (rad/s)^2 on each axis"""
    P_b = H @ P @ H.T + noise * np.eye(3)
    return C_bc.T @ omega_b, C_bc.T @ P_b @ C_bc
