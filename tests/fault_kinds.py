"""Faults by their kind, for tests."""

from typing import get_args

from shefex_nav.settings import declared
from shefex_nav.world import fault_settings


def kinds(union):
    """{kind: class} of a union of faults."""
    return {get_args(declared(cls)["fault"][0])[0]: cls for cls in get_args(union)}


IMU, GPS, STARS = (kinds(union) for union in (fault_settings.Imu, fault_settings.Gps, fault_settings.Stars))


def imu_fault(kind, start, end, **rest):
    return IMU[kind](fault=kind, start=start, end=end, **rest)


def gps_fault(kind, start, end, **rest):
    rest = {"freeze": {"time": "runs"}, "delay": {"time": "right"}, "drift": {"velocity_too": False}}.get(
        kind, {}
    ) | rest
    return GPS[kind](fault=kind, start=start, end=end, **rest)


def star_fault(kind, start, end, **rest):
    return STARS[kind](fault=kind, start=start, end=end, **rest)


def wrong_reading(kind, sensor, axis, start, end, error):
    """Wrong bias, rad/s or m/s^2, or scale of an axis of the IMU."""
    key = "factor" if kind == "scale" else {"gyro": "rate", "accelerometer": "acceleration"}[sensor]
    return imu_fault(f"{sensor}_{kind}", start, end, axis="xyz"[axis], **{key: error})
