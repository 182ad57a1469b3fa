"""What a log says, looked at before anything is computed of it: `LogError` names topic, message and field.

A log of ours holds finite numbers where it says that there are some, unit quaternions, and times that go on.
One that somebody has changed may hold anything; then no figure of it means what it says.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from shefex_nav.log.topics import LogError
from shefex_nav.records import (
    Alignment,
    Frame,
    FrameTruth,
    GpsFix,
    GpsRanges,
    ImuBlock,
    NavCovariance,
    NavSolution,
    Reason,
    StarFix,
    TruthSample,
)

LARGEST = 1e15  # SI; no position, rate, variance or time of a mission is larger
UNIT = 1e-3  # by which the norm of a quaternion may differ from one


class Rule(NamedTuple):
    """What holds for the records of a type."""

    finite: tuple[str, ...]  # fields
    unless_nan: tuple[str, ...] = ()  # likewise, or NaN: not known, as of truth that others have measured
    goes_on: str = ""  # field that grows from record to record
    where: Callable = lambda record: True  # record of arrays, or one -> where there are such numbers


MOTION = ("r_i", "v_i", "q_ib")
RULES = {
    TruthSample: Rule(("t_s", *MOTION), ("omega_ib_b", "f_b"), "t_s"),
    NavSolution: Rule(("t_s", *MOTION, "r_e", "v_e"), goes_on="t_s"),
    NavCovariance: Rule(("t_s",), goes_on="t_s"),
    ImuBlock: Rule(("t_valid_s", "dt_s", "dtheta_b", "dv_b"), where=lambda one: one.valid),
    Frame: Rule(("t_valid_s", "exposure_s"), goes_on="number"),
    Alignment: Rule((*MOTION, "sigma_r", "sigma_v", "P_theta_b")),
    FrameTruth: Rule(("t_valid_s", "q_ic")),
    GpsFix: Rule(("t_valid_s", "r_ea_e", "R_r_e"), where=lambda one: one.valid),
    GpsRanges: Rule(("t_valid_s", "pseudorange", "range_rate", "r_es_e", "v_es_e", "sigma_range")),
    StarFix: Rule(("t_valid_s", "q_ic", "P_c"), where=lambda one: one.reason == Reason.NONE),
}


def check(path, topic, record, given):
    """LogError unless the records of a topic can be meant.

    path, topic : for the message;  record : their type;  given : list of them, or one of arrays
    """
    rule = RULES.get(record)
    if rule is None:
        return
    are_arrays = not isinstance(given, list)
    for number, one in enumerate([given] if are_arrays else given, 1):
        for name in rule.finite + rule.unless_nan:
            values = _rows(getattr(one, name), are_arrays)
            bad = _bad(name, values) & rule.where(one)
            if name in rule.unless_nan:
                bad &= ~np.isnan(values).all(axis=1)
            if bad.any():
                at = number + int(bad.argmax())
                expected = "a unit quaternion" if name.startswith("q_") else "finite numbers of a mission"
                raise LogError(f"{path}: {topic}: message {at}: {name}: expected {expected}")
    if rule.goes_on and are_arrays:
        _goes_on(path, topic, rule.goes_on, getattr(given, rule.goes_on))


def _rows(values, are_several):
    """Values of one record, or of several one after the other: (N, n)"""
    array = np.asarray(values, dtype=float)
    rows = len(array) if are_several else 1
    return array.reshape(rows, array.size // max(rows, 1))


def _bad(name, values):
    """Rows that cannot be meant: (N, n) -> (N,) bool"""
    bad = ~(np.abs(values) < LARGEST).all(axis=1)
    if name.startswith("q_"):
        bad |= ~(np.abs(np.linalg.norm(np.where(bad[:, None], 0.0, values), axis=1) - 1.0) < UNIT)
    return bad


def _goes_on(path, topic, name, values):
    """LogError unless the values grow."""
    back = ~(np.diff(values) > 0)
    if back.any():
        number, words = int(back.argmax()) + 2, "expected more than in the message before"
        raise LogError(f"{path}: {topic}: message {number}: {name}: {words}")
