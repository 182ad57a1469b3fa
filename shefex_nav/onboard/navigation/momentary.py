"""Errors of the moment in velocity and attitude: they come and go, and nothing of them stays.

Vibration swings the sensors to and fro, and the strapdown follows. A sensor counts whole quanta and carries
the remainder into the next sample: the sum of its increments has a rounding error, even within half a
quantum. The filter counts neither as an error that grows. What is reported of an instant contains both. So
does what is predicted for the instant of a measurement, where it is noise of the measurement.
"""

from typing import NamedTuple

from shefex_nav.compiled import kernel


class Momentary(NamedTuple):
    """Variances on each axis, of velocity in m^2/s^2 and of attitude in rad^2."""

    velocity_rounding: float
    velocity_coast: float  # vibration while no motor burns, on the pad too
    velocity_motor: float  # vibration while the strongest motor burns
    attitude_rounding: float
    attitude_coast: float
    attitude_motor: float


NONE = Momentary(*[0.0] * len(Momentary._fields))


def of(params):
    """NavParams -> Momentary"""
    model, (angle, velocity) = params.imu, params.swing_at_rest.tolist()
    return Momentary(
        model.accel_quantum**2 / 12.0,
        velocity**2,
        model.accel_vibration**2,
        model.gyro_quantum**2 / 12.0,
        angle**2,
        model.gyro_vibration**2,
    )


@kernel
def variances(momentary, vibration):
    """Of one instant, on each axis of velocity and of attitude: m^2/s^2, rad^2.

    momentary : Momentary;  vibration : relative to that of the strongest motor, 0 if none burns
    """
    velocity, attitude = momentary.velocity_coast, momentary.attitude_coast
    if vibration > 0.0:
        velocity = vibration**2 * momentary.velocity_motor
        attitude = vibration**2 * momentary.attitude_motor
    return velocity + momentary.velocity_rounding, attitude + momentary.attitude_rounding
