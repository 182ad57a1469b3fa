"""Errors of the moment in velocity and attitude: they come and go, and nothing of them stays.

Vibration swings the sensors to and fro, and the strapdown follows. A sensor counts whole quanta and carries
the remainder into the next sample: the sum of its increments has a rounding error, even within half a
quantum. The filter counts neither as an error that grows. What is reported of an instant contains both. So
does what is predicted for the instant of a measurement, where it is noise of the measurement.
"""

import numpy as np

from shefex_nav.compiled import kernel

VELOCITY, ATTITUDE = 0, 1  # rows of variances on each axis: m^2/s^2, rad^2
# columns: of rounding; of vibration while no motor burns, on the pad too, and while the strongest one burns
ROUNDING, COAST, MOTOR = range(3)
NONE = np.zeros((2, 3))


def of(params):
    """The variances (2, 3) of NavParams."""
    model, (angle, velocity) = params.imu, params.swing_at_rest.tolist()
    return np.array(
        [
            [model.accel_quantum**2 / 12.0, velocity**2, model.accel_vibration**2],
            [model.gyro_quantum**2 / 12.0, angle**2, model.gyro_vibration**2],
        ]
    )


@kernel
def variances(momentary, vibration):
    """Of one instant, on each axis of velocity and of attitude: m^2/s^2, rad^2.

    momentary : (2, 3) of `of`;  vibration : relative to that of the strongest motor, 0 if none burns
    """
    velocity, attitude = momentary[VELOCITY, COAST], momentary[ATTITUDE, COAST]
    if vibration > 0.0:
        velocity = vibration**2 * momentary[VELOCITY, MOTOR]
        attitude = vibration**2 * momentary[ATTITUDE, MOTOR]
    return velocity + momentary[VELOCITY, ROUNDING], attitude + momentary[ATTITUDE, ROUNDING]
