"""The largest errors of the phases POINTING, by which `report.while_pointing` judges a run, predicted.

The largest error over a time is larger than that of the worst instant, the more so the less errors of two
instants have to do with each other: a constant error of the mounting does not add, noise of GPS does. So
histories are drawn that obey the matrices of the covariance (`linear.outputs`), and the median of their
largest errors says how many independent instants the time is worth. Rarer errors follow from the
distribution at the worst instant and that number.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import sample_s
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.records import Phase
from shefex_nav.verify.bound_model import POS, PSI, VEL

EVERY_S = 1.0  # between two instants that are predicted
HISTORIES = 200


class Largest(NamedTuple):
    """Largest errors of each history over m instants, (HISTORIES,); attitude: about one axis."""

    instants: int
    position: np.ndarray  # m
    velocity: np.ndarray  # m/s
    attitude: np.ndarray  # rad


def samples(trajectory, every_s=EVERY_S):
    """Samples of a Trajectory at which errors while pointing are predicted: list of int.

    They are multiples of a time, as those of star fixes are: errors are largest just before a fix.
    """
    step = round(every_s / sample_s(trajectory.t_s))
    k = np.arange(step, len(trajectory.t_s), step)
    return k[trajectory.phase[k] == Phase.POINTING].tolist()


def histories(t_s, rng):
    """Arguments of `linear.outputs` for errors at some times; {} of none. (m,) s, Generator"""
    if not len(t_s):
        return {}
    return {"rng": rng, "number": HISTORIES, "between": (float(t_s[0]), float(t_s[-1]))}


def sizes(q_ib, momentary, errors, rng):
    """Size of the errors of position and velocity, and of the largest angle about an axis, of each history.

    q_ib : (4,) truth;  momentary : errors of the moment of velocity and attitude, 1 sigma about each axis
    errors : (n, N) of `linear.Output`;  rng : of these momentary -> (3, N)
    """
    velocity, angle = (one * rng.standard_normal((3, errors.shape[1])) for one in momentary)
    attitude_b = dcm_from_quat(q_ib).T @ errors[PSI] + angle
    return np.array(
        [
            np.linalg.norm(errors[POS], axis=0),
            np.linalg.norm(errors[VEL] + velocity, axis=0),
            np.abs(attitude_b).max(axis=0),
        ]
    )


def independent(probability, variances, largest, instants):
    """How many independent instants as the worst one give the median of the largest errors that were drawn.

    probability : of `within`;  variances : (3,) at the worst instant;  largest : (N,);  instants : at most
    """
    inside = probability(variances, float(np.median(largest)))
    if inside >= 1.0:
        return 1.0
    return min(max(math.log(0.5) / math.log(inside), 1.0), float(instants)) if inside > 0.0 else 1.0
