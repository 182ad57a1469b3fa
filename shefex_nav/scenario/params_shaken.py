"""What the filter assumes of vibration: noise of samples, swings of the sensors, when a motor burns.

Acceleration of flat density S between f_low and f_high, as section `imu.vibration` has it.
"""

import numpy as np

from shefex_nav.world import vibration as spectrum


def strongest(vibration):
    """Vibration while the strongest motor burns, m/s^2 rms."""
    return max(vibration.boost, default=0.0)


def imu_fields(imu, dt_s):
    """Fields of ImuModel that follow from the vibration by the strongest motor. Section imu, s of a sample"""
    vibration = imu.vibration
    gyro_swing, accel_swing = swings(vibration, strongest(vibration)).tolist()
    return {
        "gyro_rectification": imu.gyro.vibration_rectification * strongest(vibration) ** 2,
        "gyro_vibration": gyro_swing,
        "accel_vibration": accel_swing,
        "shake_threshold": _shake_threshold(vibration, dt_s),
    }


def at_rest(vibration, dt_s):
    """What vibration without a motor does to a sample of gyros and accelerometers: rad, m/s rms."""
    velocity = float(np.sqrt(_in_increments(vibration, vibration.coast**2, dt_s)))
    return vibration.angular * velocity, velocity


def swings(vibration, level):
    """Angle and velocity of a vibration of some level [m/s^2 rms], (2,) rad, m/s rms.

    S integrated: sigma^2 = S/(2 pi)^2 (1/f_low - 1/f_high).
    """
    low, high = vibration.lowest_frequency, vibration.highest_frequency
    density = level**2 / (high - low)
    velocity = float(np.sqrt(density * (1.0 / low - 1.0 / high)) / (2.0 * np.pi))
    return np.array([vibration.angular * velocity, velocity])


def _shake_threshold(vibration, dt_s):
    """Noise of velocity increments that tells a burning motor from coasting, m/s rms.

    Half way, as levels go, between the weakest motor and coasting, of which at least a hundredth of the motor
    is assumed.
    """
    weakest = min((level for level in vibration.boost if level > 0.0), default=np.inf)
    level2 = weakest * max(vibration.coast, 0.01 * weakest)
    return float(np.sqrt(_in_increments(vibration, level2, dt_s)))


def _in_increments(vibration, level2, dt_s):
    """Variance of velocity increments over dt_s by a vibration of some mean square, m^2/s^4: m^2/s^2.

    S has the variance S dt/2 in the increment of dt, and the share of its band.
    """
    return 0.5 * level2 / spectrum.bandwidth(vibration) * dt_s * spectrum.share(vibration, dt_s)
