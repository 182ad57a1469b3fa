"""Inertial measurement unit: the ideal increments of the flight in, what the instrument reports out.

For the gyro triad and, without its g-sensitivity, for the accelerometer triad::

    dtheta = (I + diag(s) + M) dtheta_ideal + (b + b(t) + k a_rms^2) dt + G dv_ideal
             + sigma_random_walk sqrt(dt) w + vibration

s scale factor, M misalignment, b turn-on bias, b(t) in-run bias (first-order Gauss-Markov), k vibration
rectification, G sensitivity to specific force, w white noise; then clipped to the range and counted in whole
quanta, the remainder being carried into the next sample (Groves, Principles of GNSS, Inertial and Multisensor
Integrated Navigation Systems, 2nd ed., section 4.4). A faulty sensor (`faults`) has a wrong bias or scale
before range and quanta; what a faulty unit repeats or leaves out are readings as it sends them.

Vibration. The case of the instrument is shaken at random, its acceleration a having a flat spectrum of
one-sided density S = a_rms^2/(f_high - f_low) between two frequencies and none outside (after the shock
mount). The instrument does measure that motion, and the truth, the motion of the vehicle as a rigid body,
does not contain it. Integrated over dt, flat acceleration gives increments of variance S dt/2 without
correlation, what lies above half the sampling rate being folded into the band below; what lies below f_low
is taken out by a fourth-order high-pass filter. A band that ends below 2 kHz, or begins above 50 Hz, is made
at a rate that holds it, and then summed to samples (`vibration`). It matters: 7 g rms make increments of
0.05 m/s, which would add up to a random walk of 8 m/s within 56 s; without the part below f_low the sum stays
within 0.06 m/s (1 sigma), and spin does not turn it into a walk either. What a burn does leave behind is
the rectification, a bias. Angular vibration is treated alike, as a flat spectrum of rate in proportion to the
linear one.

Hours of samples fill gigabytes, so everything but what goes in and comes out is made in pieces of `PIECE`
samples; the numbers drawn for a seed do not depend on their length.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAMPLES_PER_TICK, sample_s
from shefex_nav.compiled import kernel
from shefex_nav.records import ImuBlock
from shefex_nav.world import faults, vibration
from shefex_nav.world.noise import gauss_markov

PIECE = 1 << 16  # samples handled at a time


class ImuErrors(NamedTuple):
    """The errors drawn for one run: what a filter may estimate, what a report compares with."""

    gyro_bias: np.ndarray  # (3,) rad/s
    gyro_scale_factor: np.ndarray  # (3,)
    gyro_misalignment: np.ndarray  # (3, 3) zero diagonal; element ij: rate about j seen on axis i
    gyro_g_sensitivity: np.ndarray  # (3, 3) rad/s per m/s^2
    gyro_vibration_rectification: np.ndarray  # (3,) rad/s per (m/s^2 rms)^2
    accel_bias: np.ndarray  # (3,) m/s^2
    accel_scale_factor: np.ndarray  # (3,)
    accel_misalignment: np.ndarray  # (3, 3)
    accel_vibration_rectification: np.ndarray  # (3,) m/s^2 per (m/s^2 rms)^2


class Sensed(NamedTuple):
    """What a healthy unit would read without end of range and quanta, and the errors that are in it."""

    dtheta_b: np.ndarray  # (N, 3) rad
    dv_b: np.ndarray  # (N, 3) m/s
    errors: ImuErrors


class ImuData(NamedTuple):
    """What the instrument reports over the whole flight; row 0, before its first sample, is zero."""

    t_s: np.ndarray  # (N,) end of each sample
    dtheta_b: np.ndarray  # (N, 3) rad
    dv_b: np.ndarray  # (N, 3) m/s
    saturated: np.ndarray  # (N,) bool
    errors: ImuErrors
    missing: np.ndarray | None = None  # (N,) bool, the unit did not answer; None: it always did


def measure(settings, trajectory, rng, biases=None, wrong=()):
    """IMU samples along a trajectory.

    Parameters
    ----------
    settings : settings.Imu
    trajectory : Trajectory, at the sampling rate of the instrument
    rng : Generator; the order of the draws does not depend on `settings`
    biases : (N, 6), written if it is given: sum of turn-on and in-run bias of gyros and accelerometers in
        each sample, rad/s, m/s^2; in row 0, before the first, that of the first
    wrong : tuple of fault_settings.Imu

    Returns
    -------
    ImuData
    """
    return reported(settings, trajectory.t_s, sense(settings, trajectory, rng, biases), wrong)


def sense(settings, trajectory, rng, biases=None, shaken=True):
    """What the unit senses before anything fails; arguments as of `measure`. -> Sensed

    shaken : False: vibration is no noise; what rectifies it is still there
    """
    errors, of_gyros, of_accels = draw_errors(settings, rng), None, None
    dt_s = sample_s(trajectory.t_s)
    rms = vibration_rms(settings, trajectory.burning)
    if biases is not None:
        biases[:] = np.concatenate([errors.gyro_bias, errors.accel_bias]) * dt_s
        of_gyros, of_accels = biases[:, :3], biases[:, 3:]
    levels = rms, rms if shaken else np.zeros_like(rms)
    dtheta_b = _sensed_rotation(settings, errors, trajectory, levels, dt_s, rng, of_gyros)
    dv_b = _sensed_velocity_gain(settings, errors, trajectory, levels, dt_s, rng, of_accels)
    dtheta_b[0] = dv_b[0] = 0.0
    if biases is not None:
        biases /= dt_s
        biases[0] = biases[1]
    return Sensed(dtheta_b, dv_b, errors)


def reported(settings, t_s, sensed, wrong=()):
    """What the unit sends of what it senses, faults included.

    settings : settings.Imu;  t_s : (N,) of the trajectory;  wrong : tuple of fault_settings.Imu
    sensed : Sensed, whose arrays are used up
    -> ImuData
    """
    dtheta_b, dv_b = sensed.dtheta_b, sensed.dv_b
    dt_s = sample_s(t_s)
    faults.imu_sensed(wrong, t_s, dtheta_b, dv_b)
    at_range = _clip(dtheta_b, settings.gyro.range * dt_s), _clip(dv_b, settings.accelerometer.range * dt_s)
    quantise(dtheta_b, settings.gyro.quantum)
    quantise(dv_b, settings.accelerometer.quantum)
    missing = faults.imu_sent(wrong, t_s, dtheta_b, dv_b, at_range)
    saturated = at_range[0].any(axis=1) | at_range[1].any(axis=1)
    return ImuData(t_s, dtheta_b, dv_b, saturated, sensed.errors, missing)


def _sensed_rotation(settings, errors, trajectory, levels, dt_s, rng, bias):
    """What the gyros would read without end of range and quanta: (N, 3) rad; bias : of `_add_in_run_bias`.

    levels : (N,) m/s^2 rms of the vibration that is rectified, and of that which is noise
    """
    rms, shaking = levels
    dtheta_b = _apply(_response(errors.gyro_scale_factor, errors.gyro_misalignment), trajectory.dtheta_b)
    _add_response(dtheta_b, errors.gyro_g_sensitivity, trajectory.dv_b)
    _add_bias(dtheta_b, errors.gyro_bias, errors.gyro_vibration_rectification, rms, dt_s)
    add_vibration(dtheta_b, settings, settings.vibration.angular * shaking, dt_s, rng)
    _add_in_run_bias(dtheta_b, settings.gyro, dt_s, rng, bias)
    _add_random_walk(dtheta_b, settings.gyro.random_walk, dt_s, rng)
    return dtheta_b


def _sensed_velocity_gain(settings, errors, trajectory, levels, dt_s, rng, bias):
    """Likewise the accelerometers: (N, 3) m/s."""
    rms, shaking = levels
    dv_b = _apply(_response(errors.accel_scale_factor, errors.accel_misalignment), trajectory.dv_b)
    _add_bias(dv_b, errors.accel_bias, errors.accel_vibration_rectification, rms, dt_s)
    add_vibration(dv_b, settings, shaking, dt_s, rng)
    _add_in_run_bias(dv_b, settings.accelerometer, dt_s, rng, bias)
    _add_random_walk(dv_b, settings.accelerometer.random_walk, dt_s, rng)
    return dv_b


def draw_errors(settings, rng):
    """The constant errors of one run: ImuErrors."""
    return ImuErrors(
        gyro_bias=settings.gyro.bias * rng.standard_normal(3),
        gyro_scale_factor=np.array(
            [settings.gyro.scale_factor_roll, settings.gyro.scale_factor, settings.gyro.scale_factor]
        )
        * rng.standard_normal(3),
        gyro_misalignment=settings.gyro.misalignment * _off_diagonal(rng),
        gyro_g_sensitivity=settings.gyro.g_sensitivity * rng.standard_normal((3, 3)),
        gyro_vibration_rectification=settings.gyro.vibration_rectification * rng.standard_normal(3),
        accel_bias=settings.accelerometer.bias * rng.standard_normal(3),
        accel_scale_factor=settings.accelerometer.scale_factor * rng.standard_normal(3),
        accel_misalignment=settings.accelerometer.misalignment * _off_diagonal(rng),
        accel_vibration_rectification=settings.accelerometer.vibration_rectification * rng.standard_normal(3),
    )


def vibration_rms(settings, burning):
    """Level of the linear vibration at each sample. (N,) stage that burns, or 0 -> (N,) m/s^2 rms."""
    return np.concatenate([[settings.vibration.coast], settings.vibration.boost])[burning]


def quantise(increments, quantum):
    """Whole quanta, in place; what is left over is counted in the next sample, so that no drift arises.

    The sum of the output is the sum of the input rounded to the nearest quantum, at every sample. (N, 3)
    """
    if quantum > 0.0:
        _count(increments, quantum)


@kernel
def _count(increments, quantum):
    """As `quantise`, of a quantum above zero."""
    for j in range(increments.shape[1]):
        total, counted = 0.0, 0.0
        for k in range(increments.shape[0]):
            total += increments[k, j]
            count = np.rint(total / quantum)
            increments[k, j], counted = (count - counted) * quantum, count


def stacked(data):
    """The samples as the on-board computer gets them, four to a block; the first row, at the start, in none.

    Block k, counted from 0, ends at sample 4 (k + 1). A block of which a sample is missing is not valid as a
    whole, and its increments are NaN.

    ImuData -> ImuBlock of arrays, a row a block; increments are views into `data` unless samples are missing
    """
    n = (len(data.t_s) - 1) // SAMPLES_PER_TICK
    used = slice(1, 1 + n * SAMPLES_PER_TICK)
    t_s = data.t_s[used][SAMPLES_PER_TICK - 1 :: SAMPLES_PER_TICK]
    dt_s = sample_s(data.t_s)
    dtheta_b = data.dtheta_b[used].reshape(n, SAMPLES_PER_TICK, 3)
    dv_b = data.dv_b[used].reshape(n, SAMPLES_PER_TICK, 3)
    saturated, valid = _any_of_block(data.saturated[used]), np.ones(n, dtype=bool)
    if data.missing is not None:
        valid = ~_any_of_block(data.missing[used])
        saturated = saturated & valid
        dtheta_b, dv_b = (np.where(valid[:, None, None], rows, np.nan) for rows in (dtheta_b, dv_b))
    return ImuBlock(t_s, t_s, np.full(n, dt_s), dtheta_b, dv_b, saturated, valid)


def _any_of_block(flags):
    """Whether one of the samples of each block is flagged. (n SAMPLES_PER_TICK,) bool -> (n,) bool"""
    return flags.reshape(-1, SAMPLES_PER_TICK).any(axis=1)


def _response(scale_factor, misalignment):
    """(3,), (3, 3) -> (3, 3) what a unit input about each axis gives on each axis."""
    return np.eye(3) + np.diag(scale_factor) + misalignment


@kernel
def _apply(M, v_b):
    """M @ v for every row; not through BLAS, whose rounding depends on its threads. (N, 3) -> (N, 3)."""
    out = np.empty(v_b.shape)
    for k in range(len(v_b)):
        for i in range(3):
            out[k, i] = (M[i, 0] * v_b[k, 0] + M[i, 2] * v_b[k, 2]) + M[i, 1] * v_b[k, 1]
    return out


def _pieces(n):
    """Slices that cover n rows."""
    return (slice(k, min(k + PIECE, n)) for k in range(0, n, PIECE))


def _off_diagonal(rng):
    """(3, 3) standard normal numbers with a zero diagonal."""
    M = rng.standard_normal((3, 3))
    np.fill_diagonal(M, 0.0)
    return M


def _add_response(increments, M, v_b):
    """Add M @ v of every row, in place."""
    for piece in _pieces(len(increments)):
        increments[piece] += _apply(M, v_b[piece])


def _add_bias(increments, bias, rectification, rms, dt_s):
    """Add turn-on bias and rectified vibration, in place. (N, 3), (3,), (3,), (N,) rms."""
    for piece in _pieces(len(increments)):
        increments[piece] += (bias + np.outer(rms[piece] ** 2, rectification)) * dt_s


def _add_in_run_bias(increments, triad, dt_s, rng, alone):
    """Add the in-run bias of a triad's settings, in place; to `alone` as well, unless it is None."""
    correlation, last = math.exp(-dt_s / triad.in_run_bias_time), None
    for piece in _pieces(len(increments)):
        bias = gauss_markov(correlation, rng.standard_normal(increments[piece].shape), last)
        last = bias[-1].copy()
        bias *= triad.in_run_bias * dt_s
        increments[piece] += bias
        if alone is not None:
            alone[piece] += bias


def _add_random_walk(increments, sigma, dt_s, rng):
    """Add white noise of the density sigma, in place."""
    for piece in _pieces(len(increments)):
        increments[piece] += sigma * np.sqrt(dt_s) * rng.standard_normal(increments[piece].shape)


def add_vibration(increments, settings, rms, dt_s, rng):
    """Add what the vibration makes, in place. (N, 3), (N,) rms of what the increments integrate.

    A band that is not wide (`vibration.is_wide`) is made in pieces of each sample, between two filters.
    """
    m, axes = vibration.pieces(settings.vibration, dt_s), increments.shape[1]
    scale, sections = _band(settings.vibration, dt_s, m)
    # a generator of its own, so that what is drawn later does not depend on the band
    fine = None if m == 1 else rng.spawn(1)[0]
    state = np.zeros((len(sections), 2, axes))
    for piece in _pieces(len(increments)):
        density = rms[piece] ** 2 / vibration.bandwidth(settings.vibration)
        sigma, n = np.sqrt(0.5 * density * dt_s), len(increments[piece])
        white = rng.standard_normal((n, axes))
        if fine is not None:
            sigma, white = scale * np.repeat(sigma, m), fine.standard_normal((n * m, axes))
        drive = sigma[:, None] * white
        if piece.start == 0:
            drive[:m] = 0.0  # the first sample starts at row 0
        _filter(sections, drive, state)
        increments[piece] += drive if fine is None else drive.reshape(n, m, axes).sum(axis=1)


def _band(band, dt_s, m):
    """What the white noise of m pieces of a sample is multiplied by, and the filters of their band."""
    high_pass = _butterworth(band.lowest_frequency * dt_s / m)
    if m == 1:
        return 1.0, high_pass
    low_pass = _butterworth(min(band.highest_frequency, vibration.HIGH) * dt_s / m, high=False)
    return math.sqrt(vibration.gain(band, dt_s / m) / m), np.concatenate([high_pass, low_pass])


@kernel
def _filter(sections, x, state):
    """Filter each column of x in place by second-order sections, in Direct Form II transposed.

    sections : (S, 6) b_0, b_1, b_2, 1, a_1, a_2;  x : (N, m);  state : (S, 2, m) of before, and then of after
    """
    for j in range(x.shape[1]):
        for k in range(x.shape[0]):
            for s in range(len(sections)):
                b_0, b_1, b_2, _, a_1, a_2 = sections[s]
                fed, x[k, j] = x[k, j], b_0 * x[k, j] + state[s, 0, j]
                state[s, 0, j] = b_1 * fed - a_1 * x[k, j] + state[s, 1, j]
                state[s, 1, j] = b_2 * fed - a_2 * x[k, j]


def _butterworth(cycles, high=True):
    """High or low pass of fourth order by the bilinear transformation, as sections of SciPy: (2, 6).

    cycles : corner frequency, cycles per sample. The same as `scipy.signal.butter`, whose tangent is NumPy's,
    the last digits of which depend on the processor.
    """
    k = math.tan(math.pi * cycles)
    sections = []
    for damping in (math.cos(math.pi / 8.0), math.cos(3.0 * math.pi / 8.0)):
        a_0 = 1.0 + 2.0 * damping * k + k * k
        a = 1.0, 2.0 * (k * k - 1.0) / a_0, (1.0 - 2.0 * damping * k + k * k) / a_0
        b = (1.0 / a_0, -2.0 / a_0) if high else (k * k / a_0, 2.0 * k * k / a_0)
        sections.append([*b, b[0], *a])
    return np.array(sections)


def _clip(increments, limit):
    """Hold (N, 3) increments within +-limit in place; -> (N, 3) bool, whether a sample reached it."""
    at_range = np.empty(increments.shape, dtype=bool)
    for j in range(increments.shape[1]):
        at_range[:, j] = np.abs(increments[:, j]) >= limit
    np.clip(increments, -limit, limit, out=increments)
    return at_range
