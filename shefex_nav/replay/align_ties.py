"""How an alignment's attitude error goes with the biases of the sensors that it was made of.

Level is found by the accelerometers: one with a bias b tilts it by b/g, always. A filter that takes tilt and
bias for independent learns from the first fixes that they cancel each other, and halves the variance of both
out of nothing. Likewise north by the gyros, and the gyros' bias by the mean rate at rest less that of the
Earth, in an attitude that is not quite the true one.

With d down, tau = (b x d)/g turns the mean force that accelerometers with a bias b sense onto the true one.
"""

import numpy as np

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation.hypotheses import UNKNOWN

MOST_TURN = 1.5  # [E] rad, of an attitude that is not known: the chord of what the Earth's rate is off by
DOWN = np.array([0.0, 0.0, 1.0])
THETA, GYRO, ACCEL = slice(0, 3), slice(3, 6), slice(6, 9)


def spread(C_nb, azimuth, elevation, roll):
    """Covariance about north, east and down of sigmas about down, across the nose (level) and about it.

    C_nb : (3, 3);  azimuth, elevation, roll : rad -> (3, 3) rad^2
    """
    _, across = _level(C_nb)
    parts = ((azimuth, DOWN), (elevation, across), (roll, C_nb[:, 0]))
    return sum(size**2 * np.outer(axis, axis) for size, axis in parts)


def roll(C_nb, level):
    """1 sigma of the roll about the nose by a level of 1 sigma, rad: gravity shows little of it on a nose
    that points up."""
    return min(level / max(np.hypot(C_nb[0, 0], C_nb[1, 0]), 1e-6), UNKNOWN)


def of_tilt(C_nb, of_elevation, of_roll):
    """What of tau is in an attitude whose azimuth does not come from it: (3, 3), axes north, east, down.

    of_elevation : share in which the elevation is that of the accelerometers
    of_roll : turn about the nose for a tilt about the direction to which the nose leans
    """
    along, across = _level(C_nb)
    return of_elevation * np.outer(across, across) + of_roll * np.outer(C_nb[:, 0], along)


def _level(C_nb):
    """Unit vectors in the level: to where the nose points, and to the right of it."""
    heading = np.arctan2(C_nb[1, 0], C_nb[0, 0])
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    return along, np.cross(DOWN, along)


def of_mean_force(accelerometer, span_s):
    """1 sigma of the mean specific force over a time, m/s^2: biases and noise of the accelerometers."""
    bias = np.hypot(accelerometer.bias, accelerometer.in_run_bias)
    return np.hypot(bias, accelerometer.random_walk / np.sqrt(span_s))


def of_accelerometers(C_nb, of_tau, g):
    """Attitude error of a bias of the accelerometers, body axes: (3, 3) rad s^2/m.

    C_nb : (3, 3);  of_tau : as of `of_tilt`;  g : m/s^2
    """
    return C_nb.T @ of_tau @ -rotation.skew(DOWN / g) @ C_nb


def tied(alignment, sheet, of_accel, of_gyro):
    """Alignment with the covariance of its attitude error and the biases of the sensors.

    sheet : imu section of a ReplayScenario
    of_accel, of_gyro : (3, 3) attitude error of a bias, body axes
    """
    P = np.zeros((9, 9))
    P[THETA, THETA] = alignment.P_theta_b
    for place, of_bias, triad in ((GYRO, of_gyro, sheet.gyro), (ACCEL, of_accel, sheet.accelerometer)):
        variance = np.hypot(triad.bias, triad.in_run_bias) ** 2
        P[place, place] = variance * np.eye(3)
        P[THETA, place] = variance * of_bias
        P[place, THETA] = P[THETA, place].T
    return alignment._replace(P_with_biases=P)


def joint_at_rest(P, omega_b, sigma_gyro):
    """The same where the gyros' bias is the mean rate at rest less omega_b, that of the Earth in body axes.

    P : (9, 9) of `tied`, of which the gyros are replaced;  sigma_gyro : of the bias so found, each axis

    With the attitude off by dtheta the bias is off by dtheta x omega_b. An angle of which nothing is known
    has no such tie beyond MOST_TURN.
    """
    variances, axes = np.linalg.eigh(P[THETA, THETA])
    least = np.minimum(1.0, MOST_TURN / np.sqrt(np.maximum(variances, 1e-30)))
    of_theta = -rotation.skew(omega_b) @ (axes * least) @ axes.T
    P = P.copy()
    P[GYRO, GYRO] = sigma_gyro**2 * np.eye(3)
    for place in (THETA, ACCEL):
        P[GYRO, place] = of_theta @ P[THETA, place]
        P[place, GYRO] = P[GYRO, place].T
    return P
