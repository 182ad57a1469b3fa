"""Process noise of one interval of strapdown: what is no state, as white noise of attitude and velocity.

In: `error_model.record` and what the sensors read in the interval. Out: densities, and Qd of the first nine
errors. What comes and goes is no process noise but an error of the moment (`momentary`).
"""

from math import pi

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation import momentary
from shefex_nav.onboard.navigation.laws import FIELD_TIME_S
from shefex_nav.onboard.navigation.state import ATT, POS, VEL


@inner
def densities(model, vibration, share, sample_s, duration_s, dtheta, dv, sensed):
    """White noise that stands for everything which is not a state.

    An error of sigma s that keeps its sign for a time tau (Gauss-Markov) has the density
    2 s^2 tau/(1 + (w tau)^2) at the angular frequency w. An error fixed to a body axis across the roll axis
    is turned by the spin, so its slow effect has the density at the roll rate: spin averages it away. An
    error along the roll axis keeps its direction and has the density at zero.

    Parameters
    ----------
    model : row of `error_model.record`
    vibration : of the ImuWindow
    share : of the tick that is passed through; its angle is as uncertain by vibration as if all of it were
    sample_s : duration of one sample of the IMU
    duration_s, dtheta, dv : s, rad and m/s as three numbers: passed through in all
    sensed : rad/s, m/s^2, what gyros and accelerometers read across the roll axis, as they are

    Returns
    -------
    along, across : rad^2/s of attitude and m^2/s^3 of velocity, for the roll axis and for the others
    bias_walk : m^2/s^5 of the accelerometer bias
    """
    f2 = t3.dot(dv, dv) / duration_s**2
    # swinging is no turning: over a tick the angle at either end is off by as much on both axes
    swung2 = 4.0 * (share * model.gyro_vibration * vibration) ** 2
    across_rate = np.sqrt(max(dtheta[1] ** 2 + dtheta[2] ** 2 - swung2, 0.0)) / duration_s
    tau, roll_rate = model.thrust_time_s, dtheta[0] / duration_s
    slow, spun = 2.0 * tau, 2.0 * tau / (1.0 + (roll_rate * tau) ** 2)

    # fixed to the body: errors in proportion to specific force; vibration rectified, by its power
    gyro = model.gyro_g_sensitivity**2 * f2 + (model.gyro_rectification * vibration**2) ** 2
    shaken = (model.accel_rectification * vibration**2) ** 2
    accel_along = slow * (model.accel_scale**2 * f2 + shaken)
    accel_across = spun * (model.accel_misalignment**2 * f2 + shaken)
    cross_along, cross_across = _cross(model, roll_rate, across_rate)
    rates, of_gyro = (roll_rate, across_rate), (model.gyro_quantum, model.gyro_random_walk)
    gyro_along, gyro_across = _rounding(*of_gyro, sensed[0], sample_s, rates)
    of_accel = model.accel_quantum, model.accel_random_walk
    force_along, force_across = _rounding(*of_accel, sensed[1], sample_s, rates)
    gyro_white = model.gyro_random_walk**2
    rate = np.sqrt(t3.dot(dtheta, dtheta)) / duration_s
    left_along, left_across, bias_walk = _left_out(model, rate, across_rate)
    along = gyro_white + gyro_along + cross_along + slow * gyro, left_along + force_along + accel_along
    across = (
        gyro_white + gyro_across + cross_across + spun * gyro,
        left_across + force_across + accel_across,
    )
    return along, across, bias_walk


@inner(forceinline=True)
def _cross(model, roll_rate, across_rate):
    """What scale factors and misalignments do that are met by rates across the roll axis.

    Turning the roll axis by an angle a leaves an attitude error s a: sigma^2 grows to (s a)^2 at any rate.
    While the body rolls by more than a radian in the time of such a turn, the axes across share it.

    -> rad^2/s of attitude, about the roll axis and about each of the others
    """
    turned = model.gyro_cross**2 * model.manoeuvre_angle * across_rate
    rolled2 = (roll_rate * model.manoeuvre_angle) ** 2
    spun = rolled2 / max(rolled2 + across_rate**2, 1e-30)  # 0: no roll, 1: many turns
    along, across = 1.0 - spun + spun * model.spun_along, 1.0 - spun + spun * model.spun_across
    return turned * along, turned * across


@inner(forceinline=True)
def _rounding(quantum, walk, sensed, sample_s, rates):
    """Density of remainders of whole counts, variance q^2/12, that are counted when the body has turned.

    quantum, walk : q of a triad, and its white noise N, a root of a density
    sensed : what it reads across the roll axis, rad/s or m/s^2, its own errors as they are
    sample_s : of the IMU;  rates : rad/s of the body, about the roll axis and across it
    -> of errors along the roll axis and along each of the others
    """
    if quantum <= 0.0:
        return 0.0, 0.0
    of_roll = _turned(quantum, walk, sensed, sample_s, abs(rates[0]))
    of_others = _turned(quantum, walk, sensed, sample_s, rates[1])
    return of_others, of_roll + 0.5 * of_others


@inner(forceinline=True)
def _turned(quantum, walk, sensed, sample_s, rate):
    """Density of a remainder that is turned at a rate w.

    It is off by its product with the turn: a rate of w times the remainder. If each sample has a new one, the
    density is w^2 q^2 T/12. One that stays turns with the body. It is a sawtooth of what has been sensed, the
    sum of waves of variance q^2/(2 pi^2 n^2), which noise mixes at a_n = a n^2, a = 2 pi^2 N^2/q^2, and a
    steady input, 2 pi/q of it a second, sooner:

        sum of q^2/(2 pi^2 n^2) 2 a_n w^2/(a_n^2 + w^2) = 2 N^2 sum of 1/(1 + (n/m)^4),   m^2 = w/a,

    at most 2 N^2 times the smaller of pi m/sqrt(8) and pi^4 m^4/90.

    Not covered: an input that makes a count, or one in n, a turn of the body. Its wave then stands still in
    inertial axes, with w^2 q^2/(2 pi^2 n^2) 1/a_n for as long as the two rates agree to a_n; only quanta far
    above the noise have a wave that lasts so long.
    """
    density = (rate * quantum) ** 2 * sample_s / 12.0
    mixed = np.sqrt((pi * walk**2 / quantum) ** 2 + sensed**2)
    if mixed <= 0.0:
        return density  # nothing changes it
    m2 = rate * quantum / (2.0 * pi * mixed)
    return density + 2.0 * walk**2 * min(pi * np.sqrt(m2 / 8.0), pi**4 * m2**2 / 90.0)


@inner(forceinline=True)
def _left_out(model, rate, across_rate):
    """What white noise of the accelerometers and what the gravity model leaves out do, where it is no state.

    It is slow in inertial axes: while the attitude is held it is taken for accelerometer bias, which walks
    with the field and with the attitude; while the body turns it is noise. The roll axis may be held while
    the body turns about it.

    -> m^2/s^3 of velocity, along the roll axis and across it; m^2/s^5 of the accelerometer bias
    """
    held = 1.0 / (1.0 + (rate * model.gravity_time_s) ** 2)
    held_along = 1.0 / (1.0 + (across_rate * model.gravity_time_s) ** 2)
    density, white = 2.0 * model.gravity**2 * model.gravity_time_s, model.accel_random_walk**2
    bias_walk = model.accel_bias_walk**2 + model.gravity**2 * (2.0 / FIELD_TIME_S + held * rate)
    return white + (1.0 - held_along) * density, white + (1.0 - held) * density, bias_walk


@inner
def of_interval(top, along, across, extra, C, T, Q):
    """Qd of position, velocity and attitude by the trapezoidal rule: T/2 (Phi W Phi^T + W), W the densities.

    Parameters
    ----------
    top : (9, n) first rows of Phi
    along, across : of `densities`
    extra : (3, 3) white noise of more, per body axis: rad^2/s of the attitude by gyros that are not read,
        m^2/s^3 of the velocity, rad^2/s by the specific force that is not read and turns gyros
    C : C_ib at the start
    T : s
    Q : (9, 9), written
    """
    half, a = 0.5 * T, ATT.start
    w = (
        along[0] + extra[0, 0] + extra[2, 0],
        across[0] + extra[0, 1] + extra[2, 1],
        across[0] + extra[0, 2] + extra[2, 2],
    )
    d = along[1] + extra[1, 0], across[1] + extra[1, 1], across[1] + extra[1, 2]
    for i in range(ATT.stop):
        x, y, z = half * w[0] * top[i, a], half * w[1] * top[i, a + 1], half * w[2] * top[i, a + 2]
        for j in range(i + 1):
            Q[i, j] = Q[j, i] = x * top[j, a] + y * top[j, a + 1] + z * top[j, a + 2]
    D = (d[0], 0.0, 0.0, 0.0, d[1], 0.0, 0.0, 0.0, d[2])
    W = t3.product(t3.product(C, D), t3.transposed(C))
    for i in range(3):
        for j in range(3):
            density = W[3 * i + j]
            Q[POS.start + i, POS.start + j] += (
                half * T * T * density
            )  # Phi of velocity: T in position, 1 in velocity
            Q[POS.start + i, VEL.start + j] += half * T * density
            Q[VEL.start + i, POS.start + j] += half * T * density
            Q[VEL.start + i, VEL.start + j] += T * density
        Q[a + i, a + i] += half * w[i]


# ----------------------------------------------------------------------------------------------------------
# What of the measured rate is noise: scale factor and misalignment of the gyros are not driven by it.
#
# A scale factor s turns the attitude by s times the rate of the body. The rate that is measured has the
# noise which has turned the attitude, too. Taken as measured, each star fix that finds the angle of the
# noise again would teach a scale factor of -1, by as much as the noise of a tick is larger than that of the
# fix, and a body at rest under the stars would know the scale factors of its gyros.
#
# So these errors are driven by a rate w that follows the measured one and leaves its noise behind. It is the
# mean of the last `FOLLOWS_S`, but never further from what is measured than chance explains: `BAND` sigma of
# white noise and rounding. A turn is followed at once; what is left out of it is at most `BAND` times the
# noise of a tick for the time `FOLLOWS_S`, times a scale factor.
#
# Not covered: while the rate changes by more than the band within `FOLLOWS_S`, w has the noise of each tick.
# A longer mean would be a bias that the filter does not know yet, and a rate of zero within the band would
# leave out all that a slow turn does. Both taught more falsehoods than they avoided.


FOLLOWS_S = 1.0  # [E] longer than ten star fixes a second need to find the angle of the noise
BAND = 4.0  # sigma, which noise exceeds once in 16 000 ticks


@inner(forceinline=True)
def noise_of_rate(model, errors, extra, before, now, T):
    """The noise n of a tick, of one axis: rad/s.

    model : row of `error_model.record`;  errors : (2, 3) of `momentary`
    extra : rad^2/s, white noise of more, as of an ImuWindow
    before : w of the tick before;  now : measured_rate of what is measured in this one, T seconds
    """
    _, swing2 = momentary.variances(errors, 0.0)
    band = BAND * np.sqrt((model.gyro_random_walk**2 + extra) / T + 2.0 * swing2 / T**2)
    follows = before + min(T / FOLLOWS_S, 1.0) * (now - before)
    return now - min(max(follows, now - band), now + band)


@inner(forceinline=True)
def measured_rate(increments, first, n, axis, T):
    """Mean rate, as measured, of n samples of (N, 6) increments from `first` on, in all T seconds: rad/s."""
    turned = 0.0
    for k in range(first, first + n):
        turned += increments[k, axis]
    return turned / T
