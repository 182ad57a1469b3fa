"""Root mean square and largest size of errors, and figures for people."""

import math

import numpy as np

LARGE = 1e9  # from here on a figure for people has three digits and an exponent


def rms(values):
    """Of (N,) values; NaN without any."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def largest(values):
    """Largest absolute value of (N,); NaN without any."""
    return float(np.abs(values).max()) if len(values) else math.nan


def number(value, digits, unit=""):
    """A figure with its unit, for people; '-' of None."""
    if value is None:
        return "-"
    said = f"{value:.3g}" if abs(value) >= LARGE else f"{value:,.{digits}f}".replace(",", " ")
    return f"{said}{' ' if unit else ''}{unit}"
