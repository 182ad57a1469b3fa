"""How a receiver has a satellite or has it not: reacquisition and limits; and a solution that freezes."""

from typing import NamedTuple

import numpy as np

EARLY_S = 1e-6  # rounding of the times of epochs


class Only(NamedTuple):
    """No more than some satellites for a time."""

    from_s: float
    until_s: float
    satellites: int  # those that are tracked longest in it; prn decides where it is not empty
    prn: tuple[int, ...] = ()


class Freeze(NamedTuple):
    """The receiver repeats what it last had, with the flag that says it is good."""

    from_s: float
    until_s: float


class Reacquisition(NamedTuple):
    """How long a signal must be there, after it was not, before it is tracked."""

    shortest_s: float
    longest_s: float


def reacquired(present, t_s, reacquisition, fractions):
    """Which signals are tracked: those that have been there for long enough since they came back.

    Parameters
    ----------
    present : (m, n) bool, signals that could be tracked
    t_s : (m,) s
    reacquisition : Reacquisition
    fractions : (m, n) in [0, 1), where the time lies that a signal coming back at an epoch needs

    Returns
    -------
    (m, n) bool; what is there at the first epoch is tracked at once
    """
    wait_s = reacquisition.shortest_s + fractions * (reacquisition.longest_s - reacquisition.shortest_s)
    tracked = np.zeros_like(present)
    ready_s, before = np.full(present.shape[1], -np.inf), present[0]
    for k, now in enumerate(present):
        back = now & ~before
        ready_s[back] = t_s[k] + wait_s[k, back]
        tracked[k] = now & (t_s[k] >= ready_s - EARLY_S)
        before = now
    return tracked


def limited(tracked, t_s, limits, prn):
    """The same without the satellites that `limits`, a sequence of Only, leave out. -> (m, n) bool"""
    tracked = tracked.copy()
    for limit in limits:
        during = _during(t_s, limit)
        if limit.prn:
            kept = np.isin(prn, limit.prn)
        else:
            seconds = tracked[during].sum(axis=0)
            kept = np.zeros(len(prn), dtype=bool)
            kept[np.argsort(-seconds, kind="stable")[: limit.satellites]] = True
        tracked[during] &= kept
    return tracked


def frozen(messages, freezes):
    """The messages with those during a freeze replaced by the last good one before it, at their own times.

    messages : GpsFix or GpsRanges of all epochs; without a good one before it, a freeze does nothing -> list
    """
    result = list(messages)
    for freeze in freezes:
        last = None
        for k, message in enumerate(messages):
            if message.t_valid_s < freeze.from_s - EARLY_S:
                last = result[k] if not message.reason else last
            elif message.t_valid_s < freeze.until_s - EARLY_S and last is not None:
                times = {name: getattr(message, name) for name in ("t_valid_s", "t_available_s")}
                result[k] = last._replace(**times)
    return result


def _during(t_s, span):
    """(m,) bool: epochs from from_s on and before until_s."""
    return (t_s >= span.from_s - EARLY_S) & (t_s < span.until_s - EARLY_S)
