"""Section `faults` of a scenario -> what is done to the sensors, in SI."""

import numpy as np

AXES = "xyz"


def faults(scenario):
    """world.faults.Faults of a scenario."""
    from shefex_nav.world.faults import Faults

    section = scenario.faults
    return Faults(
        tuple(_imu(fault) for fault in section.imu),
        tuple(_gps(fault) for fault in section.gps),
        tuple(_stars(fault) for fault in section.star_tracker),
    )


def _imu(fault):
    """ImuFault of one entry."""
    from shefex_nav.world.faults import ImuFault

    plain = ImuFault(fault.fault, fault.start, fault.end)
    if fault.fault in ("dropout", "repeat"):
        return plain
    if fault.fault in ("gyro_bias", "gyro_scale"):
        error = fault.rate if fault.fault == "gyro_bias" else fault.factor
        kind = fault.fault.removeprefix("gyro_")
        return plain._replace(kind=kind, sensor="gyro", axis=AXES.index(fault.axis), error=error)
    return plain._replace(sensor=fault.sensor, axis=AXES.index(fault.axis))


def _gps(fault):
    """GpsFault of one entry."""
    from shefex_nav.world.faults import GpsFault

    plain = GpsFault(fault.fault, fault.start, fault.end)
    if fault.fault == "freeze":
        return plain._replace(time_stands=fault.time == "stands")
    if fault.fault == "jump":
        return plain._replace(moved_n=np.array(fault.position))
    if fault.fault == "drift":
        return plain._replace(moved_n=np.array(fault.rate), velocity_too=fault.velocity_too)
    return plain


def _stars(fault):
    """StarFault of one entry."""
    from shefex_nav.world.faults import StarFault

    plain = StarFault(fault.fault, fault.start, fault.end)
    if fault.fault == "bias":
        return plain._replace(bias_c=np.array(fault.angles))
    if fault.fault == "wrong_fixes":
        return plain._replace(every=fault.every, smallest=fault.smallest, largest=fault.largest)
    return plain
