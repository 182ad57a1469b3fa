"""An inertial unit without errors, and one with some: `imu_with(PERFECT, gyro_bias=1e-6)`."""

from math import inf

from shefex_nav.settings import changed, declared
from shefex_nav.world.settings import Accelerometer, Gyro, Imu, Vibration

TRIADS = {"gyro": "gyro", "accel": "accelerometer", "vibration": "vibration"}


def _calm(cls, **values):
    return cls(**dict.fromkeys(declared(cls), 0.0) | values)


PERFECT = Imu(
    gyro=_calm(Gyro, in_run_bias_time=1000.0, range=inf),
    accelerometer=_calm(Accelerometer, in_run_bias_time=1000.0, range=inf),
    vibration=_calm(Vibration, boost=(0.0, 0.0), lowest_frequency=20.0, highest_frequency=2000.0),
)


def imu_with(settings, **values):
    """Imu with other values, named `gyro_`, `accel_` or `vibration_` and the setting."""
    dotted = {}
    for name, value in values.items():
        triad, _, setting = name.partition("_")
        dotted[f"{TRIADS[triad]}.{setting}"] = value
    return changed(settings, dotted)
