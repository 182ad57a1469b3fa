"""Software of somebody's own, called with care: what goes wrong in it is told with its name and the time."""

import os
import sys
import weakref
from contextlib import redirect_stdout

import numpy as np

from shefex_nav.errors import CodeError, SoftwareError, shown
from shefex_nav.fields import LARGEST, UNIT
from shefex_nav.geometry import rotation
from shefex_nav.geometry.elementary import arccos

SYMMETRIC = 1e-6  # of the product of two sigmas
LEAST_EIGENVALUE = 1e-12  # of a matrix of correlations: the rounding of 9 by 9 numbers is below it
MOST_WHOLE = 2**31 - 1  # that a log holds
LEAST_VARIANCE = 1e-60  # SI; of a smaller one squares of errors over it are too large for any figure
NO_NUMBERS = str | bytes | None | complex | np.complexfloating


def _is_open(number):
    """Whether a file descriptor is open."""
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _close(numbers):
    for number in numbers:
        os.close(number)


class OwnSoftware:
    """An object that somebody wrote.

    software : the object
    name : what it is and its name, for messages: 'navigation software my_filter.py:MyFilter'
    """

    def __init__(self, software, name):
        self._software, self._name = software, name
        self._streams = {number: os.dup(number) for number in (1, 2) if _is_open(number)}
        weakref.finalize(self, _close, tuple(self._streams.values()))

    def has(self, method):
        """Whether it has a method."""
        return hasattr(self._software, method)

    def ask(self, now_s, method, *given):
        """What a method gives; an exception becomes a SoftwareError with its frames.

        So does standard output or error that it has closed: the program would fail far away.
        """
        answer = self._answer(now_s, method, given)
        for number, kept in self._streams.items():
            if not _is_open(number):
                os.dup2(kept, number)
                raise self.error(now_s, f"has closed file descriptor {number}, a stream of the program")
        return answer

    def _answer(self, now_s, method, given):
        try:
            with redirect_stdout(sys.stderr):  # standard output is for results
                return getattr(self._software, method)(*given)
        except CodeError as error:  # has its words already
            raise self.error(now_s, str(error)) from error
        except KeyboardInterrupt:  # of the user
            raise
        except BaseException as error:  # SystemExit, GeneratorExit, a class of its own
            raise self.error(now_s, f"failed in {method}", error) from error

    def error(self, now_s, words, cause=None):
        """SoftwareError about something at a mission time."""
        return SoftwareError(f"{self._name}, T{now_s:+.2f} s: {words}", cause)

    def numbers(self, now_s, what, value, *shape):
        """Array of finite numbers of a shape, none larger than a log may hold; SoftwareError."""
        array = self.real(now_s, what, value)
        if array.shape == shape and (np.abs(array) < LARGEST).all():
            return array
        if array.shape != shape or not np.isfinite(array).all():
            got = f"shape {array.shape}" if array.shape != shape else "NaN or infinity"
            raise self.error(now_s, f"{what} must be finite, shape {shape}, got {got}")
        raise self.error(now_s, f"{what} must be below {LARGEST:g}, got {np.abs(array).max():.4g}")

    def real(self, now_s, what, value):
        """Array of real numbers, NaN and infinity among them; SoftwareError."""
        try:
            array = np.asarray(value)
            if array.dtype.kind in "biuf" or _are_numbers(array):
                return array.astype(float)
        except Exception:  # rows of different lengths, numbers of 400 digits, an error of its own __array__
            pass
        raise self.error(now_s, f"{what} must be numbers, got {shown(value)}")

    def text(self, now_s, what, value):
        """A text that a log can hold; SoftwareError."""
        if not isinstance(value, str):
            raise self.error(now_s, f"{what} must be a text, got {shown(value)}")
        try:
            value.encode()
        except UnicodeEncodeError:  # a lone surrogate
            raise self.error(now_s, f"{what} must be a text of Unicode, got {value!r:.80}") from None
        return value

    def quaternion(self, now_s, what, value):
        """Unit quaternion, normalised; SoftwareError."""
        q = self.numbers(now_s, what, value, 4)
        norm = float(np.linalg.norm(q))
        if abs(norm - 1.0) > UNIT:
            raise self.error(now_s, f"{what} must be a unit quaternion, its norm is {norm:.6g}")
        return q / norm


def sealed(record):
    """The same record, with arrays that cannot be written: what flies must not change what is logged."""
    if isinstance(record, np.ndarray):
        view = record.view()
        view.flags.writeable = False
        return view
    if isinstance(record, tuple) and hasattr(record, "_fields"):
        return type(record)(*map(sealed, record))
    return record


def _are_numbers(array):
    """Whether an array of objects holds numbers alone, such as fractions; float() takes text, too."""
    return array.dtype.kind == "O" and not any(isinstance(one, NO_NUMBERS) for one in array.flat)


def _least(variances):
    """The smallest and where it stands, for people."""
    k = int(np.argmin(variances))
    return f"{variances[k]:.3g} at [{k}, {k}]"


def covariance_fault(P):
    """What keeps a matrix of finite numbers from being a covariance, in words; '' if it is one. (n, n)"""
    variances = P.diagonal()
    if (variances < 0.0).any():
        return f"has a negative variance, {_least(variances)}"
    if (variances < LEAST_VARIANCE).any():
        return f"has a variance below {LEAST_VARIANCE:g}, {_least(variances)}"
    sigma = np.sqrt(variances)
    correlation = P / np.outer(sigma, sigma)
    if (np.abs(correlation - correlation.T) > SYMMETRIC).any():
        return "is not symmetric"
    try:
        np.linalg.cholesky(correlation - LEAST_EIGENVALUE * np.eye(len(P)))
    except np.linalg.LinAlgError:
        return "is not positive definite"
    return ""


# ----------------------------------------------------------------------------------------------------------
# Attitudes and positions of somebody's own software that are right in another convention than ours.
#
# Read as it stands, such an attitude is simply wrong, and what follows from it too. Software may well know
# less than it is told; so it is refused only if what it gives is far from what is known, and near it in
# another convention. By chance that happens in less than one of 100 000 attitudes.


FAR = np.radians(10.0)  # from what is known,
NEAR = np.radians(2.0)  # in another convention
KNOWN = np.radians(1.0)  # sigma with which an attitude must be known for that
NEAR_M, FAR_M = 200.0, 10_000.0  # likewise of a position
MEANT_S = 1.0  # after the alignment a vehicle is still where it was
XYZW = "the scalar last; it is [w, x, y, z]"
BACKWARDS = "the other way round (its conjugate)"


def of_attitude(q, q_known):
    """In which convention an attitude is what is known of it, in words; '' if it is so, or in none.

    q, q_known : (4,) unit quaternions, of the same two axes
    """
    if _angle(q, q_known) < FAR:
        return ""
    moved = np.roll(q, 1)
    meant = {
        f"with {XYZW}": moved,
        BACKWARDS: rotation.quat_conjugate(q),
        f"{BACKWARDS} and with {XYZW}": rotation.quat_conjugate(moved),
    }
    return next((words for words, one in meant.items() if _angle(one, q_known) < NEAR), "")


def of_start_attitude(q_ib, alignment):
    """What a first attitude is of the Alignment in another convention, in words; '' if nothing. (4,)"""
    if np.sqrt(np.trace(alignment.P_theta_b)) > KNOWN:
        return ""
    words = of_attitude(q_ib, alignment.q_ib)
    return words and f"q_ib is the attitude of the alignment {words}"


def of_start_position(r_i, alignment, now_s, C_ei):
    """The same of a first position (3,). C_ei : (3, 3) inertial to Earth-fixed axes, now"""
    known_i = alignment.r_i + (now_s - alignment.t_valid_s) * alignment.v_i
    if np.linalg.norm(r_i - known_i) < FAR_M:
        return ""
    meant = (
        ("in Earth-fixed axes", C_ei @ known_i, NEAR_M),
        ("in kilometres", 1e-3 * known_i, 1e-3 * NEAR_M),
    )
    for words, one, near in meant:
        if np.linalg.norm(r_i - one) < near:
            return f"r_i is the position of the alignment {words}; it is in m, inertial axes"
    return ""


def _angle(q_ab, q_known):
    """Angle between two attitudes [rad]."""
    return 2.0 * arccos(min(1.0, abs(float(q_ab @ q_known))))
