"""Root mean square and largest size of errors, and figures for people."""

import math

import numpy as np


def rms(values):
    """Of (N,) values; NaN without any."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def largest(values):
    """Largest absolute value of (N,); NaN without any."""
    return float(np.abs(values).max()) if len(values) else math.nan


def number(value, digits, unit=""):
    """A figure with its unit, for people; '-' of None."""
    return "-" if value is None else f"{value:,.{digits}f}{' ' if unit else ''}{unit}".replace(",", " ")
