"""The mean rate of an interval that has passed, as the star camera needs it: that of one exposure.

In: the IMU increments that the filter keeps, and its estimates of the gyro errors and of the camera's
mounting. Out: the rate of the camera in its own axes, and the covariance of its error. The mean over an
exposure is far quieter than one sample: white noise falls with the duration, and of the quantisation, whose
remainder is carried on, only the two ends are left.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import inner
from shefex_nav.geometry import rotation
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation import momentary
from shefex_nav.onboard.navigation.calibration import (
    acting,
    correct_increments,
    free_increment,
    jacobians_packed,
    triads,
)
from shefex_nav.onboard.navigation.state import MOUNTING
from shefex_nav.onboard.navigation.strapdown import BEFORE

SEEN = 16.3  # chi-square of three axes that noise exceeds once in a thousand exposures
SHARE = 0.05  # [E] of the mean, by which a fit of a bent streak may see it wrong
AT_END = 0.999  # of the range of a gyro, from which a reading counts as its end
CHANGE = 1.0  # 1/s [E], change of a rate in a second over the rate, at most, where no more is seen


class Estimates(NamedTuple):
    """What the filter estimates in a tick, and what drives the increments in it."""

    x: np.ndarray  # (X,) packed nominal values
    P: np.ndarray  # (n, n)
    vibration: float
    drive: np.ndarray  # (6, m) of ImuWindow


class Samples(NamedTuple):
    """IMU samples of some ticks, one after the other; none where they do not cover an interval."""

    increments: np.ndarray  # (N, 6) rad and m/s, as measured
    dt_s: np.ndarray  # (N,) of each
    end_s: float  # mission time at which the last one ends
    vibration: float  # largest level
    doubtful: bool  # whether a gyro is not trusted in one of the ticks
    drive: np.ndarray  # (6, m) of ImuWindow, mean of the ticks


@inner
def camera_rate(constants, memory, ticks, tick, C_bc, interval_s):
    """Mean inertial rate of the star camera over an interval, in camera axes.

    omega_c = C_cb omega_b. An error of the mounting turns it: with C_bc(true) = exp(skew(dm)) C_bc,

        d omega_c = C_cb (J_omega dx + omega_b x d mounting + noise),   J_omega of `calibration.jacobians`

    Parameters
    ----------
    constants, memory : prediction.Constants, prediction.Memory
    ticks : numbers of the oldest and of the newest tick in the memory
    tick : Estimates of a tick near the interval
    C_bc : (3, 3) estimated mounting
    interval_s : mission times of begin and end, and of the instant from which turns count

    Returns
    -------
    known : bool, False where the memory does not cover the interval
    omega_c : (3,) rad/s
    P_omega_c : (3, 3) (rad/s)^2
    unsteady_c : (m, 4) s and rad, table of `geometry.unsteady`
    variance : rad^2, of the error of its mean on each axis; NaN where nothing is known of it
    """
    begin_s, end_s, _ = interval_s
    samples = _samples(memory, ticks, begin_s, end_s)
    if len(samples.dt_s) == 0:
        return False, np.full(3, np.nan), np.full((3, 3), np.nan), np.empty((0, 4)), np.nan
    acts, model = acting(tick.x, samples.vibration, samples.drive), constants.model[0]
    _, attitude2 = momentary.variances(constants.momentary, samples.vibration)
    omega_b, f_b, noise = _body_rate(model, samples, acts, attitude2, begin_s, end_s)
    H, _ = jacobians_packed(constants.at, tick.P.shape[0], tick.x, omega_b, f_b, tick.vibration, tick.drive)
    first = constants.at[MOUNTING]
    if first >= 0:
        H[:, first : first + 3] = rotation.skew(omega_b)
    P_b = H @ tick.P @ H.T + noise * np.eye(3)
    turned, variance = _unsteady(model, samples, acts, attitude2, omega_b, interval_s)
    for k in range(turned.shape[0]):
        turned[k, 1:] = C_bc.T @ turned[k, 1:]
    return True, C_bc.T @ omega_b, C_bc.T @ P_b @ C_bc, turned, variance


@inner
def _body_rate(model, samples, acts, attitude2, begin_s, end_s):
    """Mean rate and specific force of an interval, corrected with estimates.

    model : of `error_model.record`, what NavParams say;  samples : Samples, which cover it
    acts : (X,), packed values whose gyro errors are taken out;  attitude2 : of `momentary.variances`
    -> omega_b (3,) rad/s, f_b (3,) m/s^2; variance on each axis of what is no state of the filter, (rad/s)^2
    """
    duration_s, increments = _between(samples, begin_s, end_s)
    free = correct_increments(acts, increments.reshape((1, 6)), duration_s)[0] / duration_s
    omega_b, f_b = free[:3], free[3:]
    noise = rate_noise(model, omega_b, f_b, samples.vibration, duration_s) + 2.0 * attitude2 / duration_s**2
    if samples.doubtful:
        noise += model.saturated_rate**2
    return omega_b, f_b, noise


@inner
def _unsteady(model, samples, acts, attitude2, omega_b, interval_s):
    """How the body turns in an interval besides its mean rate.

    -> (m, 4) s from the instant, rad in body axes; variance of the error of its mean over the interval on
    each axis, NaN where a gyro is not trusted. The angle between the instant and the mean of an interval T is
    that of a random walk with N^2 T / 12; that at its ends, three times as much.

    What is no more than this noise is left alone: the prediction of the filter has the same noise, of which
    fixes must be independent. The rate is then taken to change by no more than itself in a second.
    """
    begin_s, end_s, instant_s = interval_s
    n, angle = len(samples.dt_s), (0.0, 0.0, 0.0)
    times, angles = np.empty(n + 1), np.zeros((n + 1, 3))
    times[0] = samples.end_s - samples.dt_s.sum()
    inverses = triads(acts)
    for k in range(n):
        dtheta, _ = free_increment(acts, inverses, samples.increments, k, samples.dt_s[k])
        angle = t3.plus(angle, 1.0, dtheta)
        times[k + 1] = times[k] + samples.dt_s[k]
        t3.put(angles[k + 1], angle)
    inside = np.empty(n + 3)
    m = 0
    for k in range(n + 1):
        if begin_s + SAME_S < times[k] < end_s - SAME_S:
            inside[m + 1] = times[k]
            m += 1
    inside[0], inside[m + 1] = begin_s, end_s
    turned = np.empty((m + 2, 4))
    since_s = inside[: m + 2] - instant_s
    for j in range(3):
        at_instant = np.interp(instant_s, times, angles[:, j])
        turned[:, 1 + j] = np.interp(inside[: m + 2], times, angles[:, j]) - at_instant - omega_b[j] * since_s
    turned[:, 0] = since_s
    if samples.doubtful:
        return turned[:0], np.nan
    duration_s = end_s - begin_s
    noise = model.gyro_random_walk**2 * duration_s / 12.0 + attitude2
    largest = 0.0
    for k in range(m + 2):
        largest = max(largest, turned[k, 1] ** 2 + turned[k, 2] ** 2 + turned[k, 3] ** 2)
    if largest > 3.0 * SEEN * noise:
        of_bend = SHARE**2 / 9.0 * largest  # at a steady change the mean is a third of the ends
        return turned, noise + of_bend
    unseen = (omega_b @ omega_b) * (CHANGE * duration_s**2 / 24.0) ** 2
    return turned[:0], min(noise, unseen)


@inner
def _samples(memory, ticks, begin_s, end_s):
    """Samples of the ticks that an interval touches."""
    numbers, (oldest, newest) = memory.numbers, ticks
    size, first, last, count, first_s = numbers.shape[0], newest + 1, newest, 0, np.inf
    for number in range(newest, oldest - 1, -1):
        k = number % size
        n = int(numbers[k, 2])
        if numbers[k, 0] <= begin_s or n == 0:
            break
        first_s = numbers[k, 0] - numbers[k, 2] * numbers[k, 1]
        if first_s < end_s:
            last = number if first > newest else last
            first, count = number, count + n
    covered = begin_s < end_s <= numbers[newest % size, 0] + SAME_S
    if not covered or first > newest or first_s > begin_s + SAME_S:
        first, last, count = newest, newest - 1, 0
    found, dt_s, drive = np.empty((count, 6)), np.empty(count), np.zeros(memory.drives.shape[1:])
    at, vibration, doubtful = 0, 0.0, False
    for number in range(first, last + 1):
        k = number % size
        n = int(numbers[k, 2])
        found[at : at + n] = memory.increments[k, BEFORE : BEFORE + n]
        dt_s[at : at + n] = numbers[k, 1]
        at, vibration = at + n, max(vibration, numbers[k, 3])
        doubtful = doubtful or memory.extra[k, 0].any()
        drive += memory.drives[k]
    drive /= max(last + 1 - first, 1)
    return Samples(found, dt_s, numbers[last % size, 0], vibration, doubtful, drive)


@inner
def _between(samples, begin_s, end_s):
    """Time and increments of an interval that Samples cover: s, (6,)"""
    dt_s = samples.dt_s
    weight, sample_s = np.empty(len(dt_s)), np.cumsum(dt_s[::-1])[::-1] - dt_s
    for k in range(len(dt_s)):
        sample_end_s = samples.end_s - sample_s[k]
        inside_s = min(sample_end_s, end_s) - max(sample_end_s - dt_s[k], begin_s)
        weight[k] = min(max(inside_s / dt_s[k], 0.0), 1.0)
    return dt_s @ weight, weight @ samples.increments


@inner
def rate_noise(model, omega_b, f_b, vibration, duration_s):
    """Variance of the mean rate on each axis from what the filter counts as noise, (rad/s)^2.

    `process_noise.densities` has the same errors as densities: here those that keep their sign over the
    interval count in full. Errors of the moment, which are in both of its ends, are not in it.

    model : row of `error_model.record`;  omega_b, f_b : (3,) rad/s, m/s^2
    """
    variance = model.gyro_random_walk**2 / duration_s
    variance += model.gyro_cross**2 * (omega_b[1] ** 2 + omega_b[2] ** 2)
    variance += model.gyro_g_sensitivity**2 * (f_b @ f_b)
    return variance + (model.gyro_rectification * vibration**2) ** 2


@inner
def unread(dtheta, extra, dt_s, gyros):
    """Variance of the rate about an axis whose gyro may not be read, rad^2/s^2; 0 where it is.

    dtheta : (n,) rad, increments of a tick;  extra : of its ImuWindow, about this axis
    gyros : (3,) rad/s of `integrity_imu.ImuRules`: range, and sigmas of the error of a reading that means
        nothing and of one at the end of the range
    """
    if not extra > 0.0:
        return 0.0
    for angle in dtheta:
        if abs(angle) >= AT_END * gyros[0] * dt_s:
            return gyros[2] ** 2
    return gyros[1] ** 2
