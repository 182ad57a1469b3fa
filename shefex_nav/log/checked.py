"""What a log says, looked at before anything is computed of it: `LogError` names topic, message and field.

A log of ours holds finite numbers where it says that there are some, unit quaternions, and times that go on.
One that somebody has changed may hold anything; then no figure of it means what it says.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from shefex_nav.fields import UNIT
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
    where = rule.where(given) if are_arrays else np.array([rule.where(one) for one in given], dtype=bool)
    for name in rule.finite + rule.unless_nan:
        values = _of_arrays(getattr(given, name)) if are_arrays else _of_list(given, name)
        bad = _bad(name, values) & where
        if name in rule.unless_nan:
            bad &= ~np.isnan(values).all(axis=1)
        if bad.any():
            k = int(bad.argmax())
            got = np.array2string(values[k], precision=4, threshold=12)
            expected = "a unit quaternion" if name.startswith("q_") else f"numbers below {LARGEST:g}"
            raise LogError(f"{path}: {topic}: message {k + 1}: {name}: got {got}, expected {expected}")
    if rule.goes_on and are_arrays:
        _goes_on(path, topic, rule.goes_on, getattr(given, rule.goes_on))


def _of_arrays(values):
    """Values of a field of N records: (N, n)"""
    return values.reshape(len(values), values.size // max(len(values), 1))


def _of_list(given, name):
    """The same of a list of records; of lists that are not of one length the largest size alone, (N, 1)."""
    rows = [np.ravel(getattr(one, name)) for one in given]
    if len({len(row) for row in rows}) > 1:
        rows = [[np.abs(row).max(initial=0.0)] for row in rows]
    return np.array(rows, dtype=float).reshape(len(rows), -1 if rows else 0)


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
        k = int(back.argmax()) + 1
        words = f"got {values[k]:.10g} after {values[k - 1]:.10g}, expected more"
        raise LogError(f"{path}: {topic}: message {k + 1}: {name}: {words}")
