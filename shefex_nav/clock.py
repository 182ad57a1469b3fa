"""The one clock: its rates, and when two of its instants are one.

Every tick of the on-board computer takes the samples that the IMU has made since the last; truth is kept at
the instants of these samples. Times are counted from lift-off in floating point: one instant that was come by
in two ways differs in its last digits.
"""

TICK_HZ = 100  # of the on-board computer
SAMPLES_PER_TICK = 4  # of the IMU
IMU_HZ = TICK_HZ * SAMPLES_PER_TICK
SAME_EVENT_S = 1e-9  # rounding of sums of times in a scenario: events that are closer together are one
SAME_S = 1e-6  # rounding of instants: those that are closer together are one


def sample_s(t_s):
    """Duration of a sample, of samples at one rate that end at the instants t_s: (N,) s -> s"""
    return float((t_s[-1] - t_s[0]) / (len(t_s) - 1))
