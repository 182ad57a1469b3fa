"""Software of somebody's own, called with care: what goes wrong in it is told with its name and the time."""

import sys
from contextlib import redirect_stdout

import numpy as np

from shefex_nav.errors import CodeError, SoftwareError

SYMMETRIC = 1e-6  # of the product of two sigmas
UNIT = 1e-3  # by which the norm of a quaternion may differ from one


class OwnSoftware:
    """An object that somebody wrote.

    software : the object
    name : what it is and its name, for messages: 'navigation software my_filter.py:MyFilter'
    """

    def __init__(self, software, name):
        self._software, self._name = software, name

    def has(self, method):
        """Whether it has a method."""
        return hasattr(self._software, method)

    def ask(self, now_s, method, *given):
        """What a method gives; an exception becomes a SoftwareError with its frames."""
        try:
            with redirect_stdout(sys.stderr):  # standard output is for results
                return getattr(self._software, method)(*given)
        except CodeError as error:  # has its words already
            raise self.error(now_s, str(error)) from error
        except (Exception, SystemExit) as error:
            raise self.error(now_s, f"failed in {method}", error) from error

    def error(self, now_s, words, cause=None):
        """SoftwareError about something at a mission time."""
        return SoftwareError(f"{self._name}, T{now_s:+.2f} s: {words}", cause)

    def numbers(self, now_s, what, value, *shape):
        """Array of finite numbers of a shape; SoftwareError."""
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            raise self.error(now_s, f"{what} must be numbers, got {value!r}") from None
        if array.shape != shape or not np.isfinite(array).all():
            got = f"shape {array.shape}" if array.shape != shape else "NaN or infinity"
            raise self.error(now_s, f"{what} must be finite, shape {shape}, got {got}")
        return array

    def quaternion(self, now_s, what, value):
        """Unit quaternion, normalised; SoftwareError."""
        q = self.numbers(now_s, what, value, 4)
        norm = float(np.linalg.norm(q))
        if abs(norm - 1.0) > UNIT:
            raise self.error(now_s, f"{what} must be a unit quaternion, its norm is {norm:.6g}")
        return q / norm


def is_symmetric(P):
    """Whether a covariance is symmetric, each element against its own two sigmas. (n, n), diagonal >= 0"""
    sigma = np.sqrt(P.diagonal())
    return bool((np.abs(P - P.T) <= SYMMETRIC * np.outer(sigma, sigma)).all())
