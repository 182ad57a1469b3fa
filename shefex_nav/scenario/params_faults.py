"""Section `faults` of a scenario -> what is done to the sensors, in SI."""

import numpy as np

AXES = "xyz"
WRONG_BY = {  # key of what a sensor reads too much
    "gyro_bias": "rate",
    "gyro_scale": "factor",
    "accelerometer_bias": "acceleration",
    "accelerometer_scale": "factor",
}


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
    plain = plain._replace(axis=AXES.index(fault.axis))
    if name := WRONG_BY.get(fault.fault):
        sensor, kind = fault.fault.split("_")
        return plain._replace(kind=kind, sensor=sensor, error=getattr(fault, name))
    return plain._replace(sensor=fault.sensor)


def _gps(fault):
    """GpsFault of one entry."""
    from shefex_nav.world.faults import GpsFault

    plain = GpsFault(fault.fault, fault.start, fault.end)
    if fault.fault == "freeze":
        return plain._replace(time_stands=fault.time == "stands")
    if fault.fault == "delay":
        return plain._replace(later_s=fault.by, stamped_late=fault.time == "late")
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
