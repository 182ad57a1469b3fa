"""Software of somebody's own, called with care: what goes wrong in it is told with its name and the time."""

import os
import sys
from contextlib import redirect_stdout

import numpy as np

from shefex_nav.errors import CodeError, SoftwareError

SYMMETRIC = 1e-6  # of the product of two sigmas
LEAST_EIGENVALUE = 1e-12  # of a matrix of correlations: the rounding of 9 by 9 numbers is below it
UNIT = 1e-3  # by which the norm of a quaternion may differ from one


_AS_MADE = {}  # class of what is given to software: its attributes before that


def _is_open(number):
    """Whether a file descriptor is open."""
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _attributes(kind):
    """{name: value} of the attributes of a class, but for those that Python makes when they are asked for."""
    return {name: value for name, value in vars(kind).items() if not name.startswith("__")}


def _put_back(kind):
    """Names of the attributes of a class that were changed, which are as before then."""
    made, now = _AS_MADE[kind], _attributes(kind)
    if made.keys() == now.keys() and all(now[name] is value for name, value in made.items()):
        return ""
    names = [name for name in made | now if name not in made or now.get(name) is not made[name]]
    for name in names:
        if name in made:
            setattr(kind, name, made[name])
        else:
            delattr(kind, name)
    return ", ".join(names)


class OwnSoftware:
    """An object that somebody wrote.

    software : the object
    name : what it is and its name, for messages: 'navigation software my_filter.py:MyFilter'
    """

    def __init__(self, software, name):
        self._software, self._name = software, name

        self._streams = [number for number in (1, 2) if _is_open(number)]

    def has(self, method):
        """Whether it has a method."""
        return hasattr(self._software, method)

    def ask(self, now_s, method, *given):
        """What a method gives; an exception becomes a SoftwareError with its frames.

        So does what would let the program fail later, and far away: standard output closed, a class changed.
        """
        kinds = {type(one) for part in given for one in (part, *(part if isinstance(part, list) else ()))}
        for kind in kinds - _AS_MADE.keys():
            _AS_MADE[kind] = _attributes(kind)
        answer = self._answer(now_s, method, given)
        for kind in kinds:
            if names := _put_back(kind):
                raise self.error(now_s, f"changes the class {kind.__name__} of what it is given: {names}")
        for number in self._streams:
            if not _is_open(number):
                raise self.error(now_s, f"has closed file descriptor {number}, a stream of the program")
        return answer

    def _answer(self, now_s, method, given):
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
        array = self.real(now_s, what, value)
        if array.shape != shape or not np.isfinite(array).all():
            got = f"shape {array.shape}" if array.shape != shape else "NaN or infinity"
            raise self.error(now_s, f"{what} must be finite, shape {shape}, got {got}")
        return array

    def real(self, now_s, what, value):
        """Array of real numbers, NaN and infinity among them; SoftwareError."""
        try:
            array = np.asarray(value)
        except ValueError:  # rows of several lengths
            array = np.asarray(None)
        if array.dtype.kind not in "iuf":  # digits as text, None and whole numbers of 400 digits are none
            raise self.error(now_s, f"{what} must be numbers, got {value!r}")
        return array.astype(float)

    def quaternion(self, now_s, what, value):
        """Unit quaternion, normalised; SoftwareError."""
        q = self.numbers(now_s, what, value, 4)
        norm = float(np.linalg.norm(q))
        if abs(norm - 1.0) > UNIT:
            raise self.error(now_s, f"{what} must be a unit quaternion, its norm is {norm:.6g}")
        return q / norm


def covariance_fault(P):
    """What keeps a matrix of finite numbers from being a covariance, in words; '' if it is one. (n, n)"""
    variances = P.diagonal()
    if (variances < 0.0).any():
        return "has a negative variance"
    if not variances.all():
        return "has a variance of zero"
    sigma = np.sqrt(variances)
    correlation = P / np.outer(sigma, sigma)
    if (np.abs(correlation - correlation.T) > SYMMETRIC).any():
        return "is not symmetric"
    try:
        np.linalg.cholesky(correlation - LEAST_EIGENVALUE * np.eye(len(P)))
    except np.linalg.LinAlgError:
        return "is not positive definite"
    return ""
