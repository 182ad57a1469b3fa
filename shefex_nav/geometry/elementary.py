"""Elementary functions of numbers and arrays, as the C library computes them.

NumPy has its own for processors with AVX-512, of arrays and of single numbers, and they end in other last
digits than those for other processors. What goes into a record is computed with the functions here; Python's
`math` and kernels agree with them. NumPy's sin, cos and sqrt in float64 are the same on all processors.

Arguments outside a function's domain give NaN or infinity, without a warning.
"""

import math

import numpy as np

from shefex_nav.compiled import kernel

_EXP, _LOG, _LOG10, _ARCSIN, _ARCCOS, _POWER, _ARCTAN2 = range(7)


@kernel
def _each(which, x, y, out):
    """Write a function of each number x, or of each pair x, y."""
    for k in range(len(x)):
        if which == _EXP:
            out[k] = math.exp(x[k])
        elif which == _LOG:
            out[k] = math.log(x[k])
        elif which == _LOG10:
            out[k] = math.log10(x[k])
        elif which == _ARCSIN:
            out[k] = math.asin(x[k])
        elif which == _ARCCOS:
            out[k] = math.acos(x[k])
        elif which == _POWER:
            out[k] = math.pow(x[k], y[k])
        else:
            out[k] = math.atan2(x[k], y[k])


def _of(which, x, y=None):
    """A function of numbers or arrays of shapes that go together. -> float64 or an array of them"""
    x = np.asarray(x, dtype=np.float64)
    if y is not None:
        x, y = np.broadcast_arrays(x, np.asarray(y, dtype=np.float64))
    out, x = np.empty(x.shape), x.ravel()
    _each(which, x, x if y is None else y.ravel(), out.reshape(-1))
    return out[()]


def exp(x):
    """e to the power x."""
    return _of(_EXP, x)


def log(x):
    """Natural logarithm."""
    return _of(_LOG, x)


def log10(x):
    """Logarithm to the base 10."""
    return _of(_LOG10, x)


def arcsin(x):
    """Angle [rad], -pi/2 to pi/2."""
    return _of(_ARCSIN, x)


def arccos(x):
    """Angle [rad], 0 to pi."""
    return _of(_ARCCOS, x)


def power(x, y):
    """x to the power y."""
    return _of(_POWER, x, y)


def arctan2(y, x):
    """Angle of the point (x, y) from the x axis [rad], -pi to pi."""
    return _of(_ARCTAN2, y, x)
