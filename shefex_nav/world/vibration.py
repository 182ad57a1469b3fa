"""Flat random vibration as an IMU's increments have it: how its band is made, and how much of it they have.

An increment over T has of an acceleration of the frequency f the part sin(pi f T)/(pi f), so that of a band
of the one-sided density S the mean square is

    S integral of (sin(pi f T)/(pi f))^2 df = c S T/2

with c = 1 of a band without ends (Parseval; Bendat and Piersol, Random Data, 4th ed., chapter 5). A band that
begins at `LOW` or below and reaches `HIGH` or beyond counts as one of these: its increments are white to 1 %
but for what lies below its lower end. What lies beyond `HIGH` is less than 1 % of what a sample has.
"""

import math

import numpy as np

LOW, HIGH = 50.0, 2000.0  # Hz
SPARE = 1.25  # half the rate at which a band is made, over its upper end
FEWEST = 4  # pieces of a sample at least: its mean over them is then within 2 % that over its time
PARTS = 4000  # of sums over frequencies


def bandwidth(vibration):
    """Width of the flat spectrum, Hz. settings Vibration"""
    return vibration.highest_frequency - vibration.lowest_frequency


def is_wide(vibration):
    """Whether the increments are white but for what lies below the lower end."""
    return vibration.lowest_frequency <= LOW and vibration.highest_frequency >= HIGH


def share(vibration, T):
    """c of the module's text: mean square of increments over T [s], over that of a band without ends."""
    if is_wide(vibration):
        return 1.0
    low, high = vibration.lowest_frequency, min(vibration.highest_frequency, HIGH)
    step = (high - low) / PARTS
    return float(2.0 * T * step * (np.sinc((low + step * (np.arange(PARTS) + 0.5)) * T) ** 2).sum())


def pieces(vibration, dt_s):
    """In how many pieces a sample of dt_s is made, so that what the sample folds is in them.

    1 of a wide band, whose samples are white.
    """
    if is_wide(vibration):
        return 1
    return max(FEWEST, math.ceil(SPARE * 2.0 * min(vibration.highest_frequency, HIGH) * dt_s))


def gain(vibration, step_s):
    """Mean square of the band over what fourth-order filters at both of its ends leave of white noise.

    step_s : s, of the pieces; the response of a Butterworth filter by the bilinear transformation
    """
    low, high = (
        math.tan(math.pi * f * step_s)
        for f in (vibration.lowest_frequency, min(vibration.highest_frequency, HIGH))
    )
    passed = 0.0
    for k in range(PARTS):
        w = math.tan(0.5 * math.pi * (k + 0.5) / PARTS)
        passed += 1.0 / ((1.0 + (low / w) ** 8) * (1.0 + (w / high) ** 8))
    made = min(vibration.highest_frequency, HIGH) - vibration.lowest_frequency
    return made / (passed * 0.5 / step_s / PARTS)
