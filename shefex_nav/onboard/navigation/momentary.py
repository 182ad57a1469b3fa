"""Errors of the moment in velocity and attitude: they come and go, and nothing of them stays.

Vibration swings the sensors to and fro, and the strapdown follows. Of what a sensor counts, a part of a
quantum waits for the next sample: the sum of its increments is off by what is left, evenly within half a
quantum. The filter counts neither as an error that grows. What is reported of a moment contains both. So does
what is predicted for the instant of a measurement, where it counts as noise of the measurement.
"""

from typing import NamedTuple

from shefex_nav.compiled import kernel


class Momentary(NamedTuple):
    """Variances of each axis, of velocity in m^2/s^2 and of attitude in rad^2."""

    velocity_left: float  # of what is left of a quantum
    velocity_at_rest: float  # of vibration while no motor burns
    velocity_shaken: float  # of vibration while the strongest motor burns
    attitude_left: float
    attitude_at_rest: float
    attitude_shaken: float


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
    """Of one instant, of velocity and of attitude: m^2/s^2, rad^2.

    momentary : Momentary;  vibration : relative to that of the strongest motor, 0 if none burns
    """
    if vibration > 0.0:
        velocity, attitude = momentary.velocity_shaken, momentary.attitude_shaken
        velocity, attitude = velocity * vibration**2, attitude * vibration**2
    else:
        velocity, attitude = momentary.velocity_at_rest, momentary.attitude_at_rest
    return velocity + momentary.velocity_left, attitude + momentary.attitude_left
