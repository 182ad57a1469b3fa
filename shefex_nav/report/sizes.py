"""Root mean square and largest size of errors, and figures for people."""

import math

import numpy as np

MOST_DIGITS = 7  # of a percentage that is nearly 0 or 100
LARGE = 1e9  # from here on a figure for people has three digits and an exponent


def rms(values):
    """Of (N,) values; NaN without any."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def largest(values):
    """Largest absolute value of (N,); NaN without any."""
    return float(np.abs(values).max()) if len(values) else math.nan


def percent(share, digits=1):
    """A share for people: 100 % is all, 0 % is nothing; what is nearly so has as many digits as say it."""
    value, said = 100.0 * share, ""
    for more in range(digits, MOST_DIGITS):
        said = f"{value:.{more}f}"
        if float(said) not in (0.0, 100.0) or share in (0.0, 1.0):
            break
    return f"{said} %"


def number(value, digits, unit=""):
    """A figure with its unit, for people; '-' of None."""
    if value is None:
        return "-"
    said = f"{value:.3g}" if abs(value) >= LARGE else f"{value:,.{digits}f}".replace(",", " ")
    return f"{said}{' ' if unit else ''}{unit}"
