"""Alignment of a rocket on its rail: where the nose points is known, the roll about it is seen by gravity.

The nose points to the rail's azimuth and elevation. At rest the accelerometers sense gravity across the nose,
f_y = -sin(roll) cos(elevation) g and f_z = -cos(roll) cos(elevation) g, so a bias b turns the roll by
b/(g cos(elevation)): on a rail that is nearly vertical, little or nothing is known of it. The mean rate at
rest, less that of the Earth, is the gyros' bias.
"""

import numpy as np

from shefex_nav.geometry import euler, wgs84
from shefex_nav.replay import align_ties, imu_axes
from shefex_nav.scenario.data_table import DataError

DISAGREE = 5.0  # [E] sigma by which accelerometers and rail may disagree about the elevation


def of_mean_force(accelerometer, span_s):
    """1 sigma of the mean specific force over a time, m/s^2: biases and noise of the accelerometers."""
    bias = np.hypot(accelerometer.bias, accelerometer.in_run_bias)
    return np.hypot(bias, accelerometer.random_walk / np.sqrt(span_s))


def attitude(scenario, f_b, span_s, g):
    """C_nb of the mean specific force at rest, its covariance about north, east and down, (3, 3) rad^2, and
    what of it is a tilt by the accelerometers, as `align_ties.of_tilt` says."""
    settings, accelerometer = scenario.alignment, scenario.imu.accelerometer
    acceleration = of_mean_force(accelerometer, span_s)
    level = float(np.hypot(acceleration / g, settings.disturbance))
    sensed = float(np.arctan2(f_b[0], np.hypot(f_b[1], f_b[2])))
    sigma = float(np.hypot(level, settings.elevation_error))
    if abs(sensed - settings.elevation) > DISAGREE * sigma:
        words = f"the accelerometers sense {np.degrees(sensed):.1f} deg, alignment.elevation says"
        up = imu_axes.of_file(f_b / np.linalg.norm(f_b), scenario.data.axes)
        raise DataError(
            f"alignment: {words} {np.degrees(settings.elevation):.1f} deg; check elevation, its error, "
            f"imu.accelerometer.bias and data.axes: the first is the nose, axis {up} of the file points up"
        )
    weight = settings.elevation_error**2 / sigma**2
    elevation = settings.elevation + weight * (sensed - settings.elevation)
    elevation_sigma = level * settings.elevation_error / sigma
    C_nb = euler.dcm_from_euler(np.arctan2(-f_b[1], -f_b[2]), elevation, settings.azimuth)
    roll_sigma = align_ties.roll(C_nb, level)
    return (
        C_nb,
        align_ties.spread(C_nb, settings.azimuth_error, elevation_sigma, roll_sigma),
        align_ties.of_tilt(C_nb, weight, roll_sigma / level),
    )


def sigma_gyro_bias(scenario, span_s, P_n):
    """1 sigma of the gyros' bias by their mean rate at rest, rad/s.

    The rate of the Earth is taken out as far as the attitude is known; what is not known of it, with the
    angular random walk, the bias that changes, a quantum and the swaying, is the sigma.
    """
    gyro = scenario.imu.gyro
    turned = wgs84.OMEGA * min(float(np.sqrt(np.linalg.eigvalsh(P_n)[-1])), align_ties.MOST_TURN)
    sway = np.sqrt(2.0) * scenario.alignment.disturbance / span_s
    parts = (gyro.random_walk / np.sqrt(span_s), gyro.in_run_bias, sway, gyro.quantum / span_s, turned)
    return float(np.linalg.norm(parts))
