"""What the computer makes of a receiver's message by what it was told of the receiver.

By default a message is taken as it says itself: its instant and its covariances. A computer that was told
other noise scales the covariances; one that was told an offset of the receiver's clock takes it out; one that
was told a latency does not look at the stamp but counts back from the arrival.
"""

from math import isnan, nan
from typing import NamedTuple

from shefex_nav.records import GpsFix, GpsRanges


class GpsTold(NamedTuple):
    """What the computer was told of its GPS receiver; the defaults change nothing."""

    position_factor: float = 1.0  # on the standard deviations of positions and ranges that are reported
    velocity_factor: float = 1.0  # on those of velocities and range rates
    clock_offset_s: float = 0.0  # stamps are later than the instants that are measured by so much
    latency_s: float = nan  # from the instant that is measured to the arrival; NaN: the stamp says it


NOTHING = GpsTold()


def understood(told, message):
    """A message as the filter takes it; what is of another sensor, or where nothing is told, passes.

    GpsTold, record -> record
    """
    if told is NOTHING or not isinstance(message, GpsFix | GpsRanges):
        return message
    t_valid_s = message.t_valid_s - told.clock_offset_s
    if not isnan(told.latency_s):
        t_valid_s = message.t_available_s - told.latency_s
    near, fast = told.position_factor, told.velocity_factor
    if isinstance(message, GpsRanges):
        sigmas = {
            "sigma_range": near * message.sigma_range,
            "sigma_range_rate": fast * message.sigma_range_rate,
        }
        return message._replace(t_valid_s=t_valid_s, **sigmas)
    return message._replace(t_valid_s=t_valid_s, R_r_e=near**2 * message.R_r_e, R_v_e=fast**2 * message.R_v_e)
