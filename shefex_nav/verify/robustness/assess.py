"""What a flight and its twin say: how long the solution misled, when it was withdrawn, by which words.

Errors are held against the protection levels at each instant: horizontally and vertically, about body axes.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import QUANTITIES, Doubt, protected
from shefex_nav.report import pairing
from shefex_nav.report.navigation_errors import nees
from shefex_nav.verify.robustness import detect, happenings

ALERT_S = 1.0  # for so long an error may be beyond its level, or beyond what can be noticed
FIRST_INNOVATIONS = 100  # before these the NEES is that of the alignment
TRUE_WORDS = "no fix", "at the end of its range"  # begin of reasons that are no alarms
STEP_S = 0.1


class Quantity(NamedTuple):
    """Over the instants of a flight, along the axes of its protection level."""

    error: np.ndarray  # (n, axes) sizes
    level: np.ndarray  # (n, axes)
    usable: np.ndarray  # (n,) bool
    doubt: np.ndarray  # (n,) Doubt of it

    @property
    def beyond(self):
        """(n,) bool: the error along an axis exceeds its level, or its level is no number."""
        return ~(self.error <= self.level).all(axis=1)

    @property
    def ratio(self):
        """(n,) the largest error over its level while it may be used, 0 elsewhere."""
        return np.where(self.usable, (self.error / self.level).max(axis=1), 0.0)


class Flown(NamedTuple):
    """Errors of a flight."""

    t_s: np.ndarray  # (n,)
    quantities: dict  # name -> Quantity
    nees: np.ndarray  # (n,) of position, velocity and attitude, 9 degrees of freedom


def of_flight(kept):
    """Flown of a flight.Kept."""
    truth, solution = kept.truth, kept.solution
    n = min(len(truth.t_s), len(solution.t_s), len(kept.covariance.t_s))
    t_s = solution.t_s[:n]
    if not (np.allclose(truth.t_s[:n], t_s) and np.allclose(kept.covariance.t_s[:n], t_s)):
        raise ValueError("truth, solution and covariance are of different instants")
    attitude = rotation.rotvec_between(solution.q_ib[:n], truth.q_ib[:n])
    error = np.hstack([truth.r_i[:n] - solution.r_i[:n], truth.v_i[:n] - solution.v_i[:n], attitude])
    along = {"position": np.empty((n, 2)), "velocity": np.empty((n, 2)), "attitude": np.abs(attitude)}
    true = truth.t_s[:n], truth.r_i, truth.v_i
    _along_axes(kept.earth, *true, solution.r_e, solution.v_e, along["position"], along["velocity"])
    quantities = {}
    for name in QUANTITIES:
        said = protected(solution, name)
        quantities[name] = Quantity(along[name], said.level[:n], ~said.do_not_use[:n], said.doubt[:n])
    return Flown(t_s, quantities, nees(error, kept.covariance.P[:n]))


@kernel
def _along_axes(earth, t_s, r_i, v_i, said_r_e, said_v_e, position, velocity):
    """Errors of position and velocity against the Earth, horizontal and vertical where the vehicle truly is.

    t_s, r_i, v_i : (n,), (n, 3) the truth;  said_r_e, said_v_e : (n, 3) the solution
    position, velocity : (n, 2) m, m/s, sizes, are written
    """
    for k in range(len(t_s)):
        r_e, v_e = frames.ecef_from_inertial(earth, t_s[k], r_i[k], v_i[k])
        latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
        C_ne = wgs84.dcm_en(latitude, longitude).T
        for row, of_earth in ((position[k], r_e - said_r_e[k]), (velocity[k], v_e - said_v_e[k])):
            north, east, down = C_ne @ of_earth
            row[0], row[1] = np.hypot(north, east), abs(down)


def stretches(flags):
    """Begin and end of each run of True: list of (first, last) indices."""
    return [(first, end - 1) for first, end in pairing.stretches(flags)]


def compared(situation, flown, twin, alone=()):
    """Figures of a flight, for JSON: dict.

    flight.Situation, flight.Kept of it, of its twin or None, and of several faults that of each alone
    """
    read = of_flight(flown)
    told, risk = situation.told, situation.scenario.requirements.integrity_risk
    record = {"told_kind": told.kind, "noise_told": told.residuals, "risk": risk} | _figures(flown, read)
    if twin is None:
        return record | {"twin": None, "fault": None}
    healthy = of_flight(twin)
    families = tuple(name for device in situation.sources for name in happenings.SOURCES[device])
    doubts = {doubt for device in situation.sources for doubt in happenings.DOUBTS[device]}
    found = detectable(situation, flown, twin, alone)
    noticed = [(span[1].start_s, one.t_s) for span, one in zip(situation.spans, found, strict=True)]
    fault = {
        "start_s": situation.window.start_s,
        "end_s": situation.window.end_s,
        "settings": list(situation.settings),
        "detectable": [
            {"what": what.words, "start_s": begin_s, "t_s": one.t_s, "by": one.by, "sum": _finite(one.total)}
            for (what, (begin_s, _)), one in zip(situation.spans, found, strict=True)
        ],
        "alarm": {
            name: _alarm(read, healthy, name, noticed, situation.window, _named(flown, families), doubts)
            for name in read.quantities
        },
        "usable_again_s": _usable_again(read, healthy, situation.window),
    }
    record["alarms"] = [f"{one.source}: {one.reason}" for one in alarms(flown.health, families)]
    return record | {"twin": _figures(twin, healthy), "fault": fault}


def detectable(situation, flown, twin, alone):
    """detect.Detectable of each fault: list. Of several, each is compared as it flies alone."""
    found = []
    for (what, window), kept in zip(situation.spans, alone or [flown], strict=True):
        innovations = detect.instant(_seen(kept), _seen(twin), window.start_s)
        readings = detect.of_readings(what, window, situation.scenario, kept.fixes)
        found.append(detect.earliest(innovations, readings))
    return found


def _seen(kept):
    return detect.Flown(kept.seen, kept.gates, kept.health)


def alarms(health, families):
    """Statements against sensors that are healthy: list of NavHealth. families : begins of those that are not

    What is true of a healthy sensor, no fix or a reading at its range, is none.
    """
    return [
        one
        for one in health
        if not one.healthy and not one.reason.startswith(TRUE_WORDS) and not one.source.startswith(families)
    ]


def _figures(kept, read):
    """Of a flight alone: dict."""
    late = _after_innovations(kept, read.t_s)
    figures = {"quantities": {name: _quantity(one, read.t_s) for name, one in read.quantities.items()}}
    usable = np.all([one.usable for one in read.quantities.values()], axis=0)
    chosen = read.nees[late & usable]
    return figures | {
        "alarms": [f"{one.source}: {one.reason}" for one in alarms(kept.health, ())],
        "sigma_deg": _finite(np.degrees(np.sqrt(np.trace(kept.covariance.P[len(read.t_s) - 1][6:, 6:])))),
        "nees_end": _finite(read.nees[-1]),
        "nees_usable": _finite(chosen.mean()) if len(chosen) else None,
        "end_s": float(read.t_s[-1]),
    }


def _after_innovations(kept, t_s):
    """(n,) bool: the filter has met `FIRST_INNOVATIONS` measurements."""
    met = sorted(gate.t_s for gate in kept.gates if gate.dof)
    return t_s >= (met[FIRST_INNOVATIONS - 1] if len(met) >= FIRST_INNOVATIONS else np.inf)


def _quantity(one, t_s):
    """Of one quantity: dict."""
    long = [pair for pair in stretches(one.beyond & one.usable) if _lasts(pair, t_s) > ALERT_S]
    return {
        "usable_s": float(STEP_S * one.usable.sum()),
        "misleading_s": float(sum(_lasts(pair, t_s) for pair in long)),
        "misleading_times": len(long),
        "misleading_from_s": float(t_s[long[0][0]]) if long else None,
        "largest_ratio": _finite(one.ratio.max()),
    }


def _lasts(pair, t_s):
    return float(t_s[pair[1]] - t_s[pair[0]] + STEP_S)


def _named(kept, families):
    """When a sensor of some families is said not to be healthy: list of (from, until) s."""
    since, spans = {}, []
    for one in kept.health:
        if not one.source.startswith(families) or one.reason.startswith(TRUE_WORDS[0]):
            continue
        if not one.healthy:
            since.setdefault(one.source, one.t_s)
        elif one.source in since:
            spans.append((since.pop(one.source), one.t_s))
    return spans + [(t_s, np.inf) for t_s in since.values()]


def _alarm(read, healthy, name, noticed, window, named, doubts):
    """Whether a quantity that a fault made wrong was withdrawn in time, and by the right words: dict.

    The fault is to blame where the error is beyond its level and that of the twin is not. Of several faults
    all that have begun by then have to be detectable. Right words name the device that failed. Any words are
    right where the twin is withdrawn as well and the fault makes no difference: both levels are too high, or
    the error of the twin is beyond the level of the flight, too.

    noticed : (begin, instant from which on it can be noticed or None) of each fault
    """
    one, other, t_s = read.quantities[name], healthy.quantities[name], read.t_s
    n = min(len(one.usable), len(other.usable))
    beyond = one.beyond[:n] & ~other.beyond[:n] & (t_s[:n] >= window.start_s)
    blamed = np.zeros(n, dtype=bool)
    for begin_s, end_s in named:
        blamed |= (t_s[:n] >= begin_s - STEP_S) & (t_s[:n] <= end_s)
    high = (one.doubt[:n] == Doubt.LEVEL) & (other.doubt[:n] == Doubt.LEVEL)
    alike = (np.minimum(one.error[:n], other.error[:n]) > one.level[:n]).any(axis=1)
    anyway = ~other.usable[:n] & (high | alike)
    told = ~one.usable[:n] & (blamed | anyway | np.isin(one.doubt[:n], list(doubts)))
    found = {"beyond_s": 0.0, "late_s": 0.0, "undetected_s": 0.0, "wrong_words": 0, "after_s": None}
    for pair in stretches(beyond):
        found["beyond_s"] += _lasts(pair, t_s)
        begun = [t_d for begin_s, t_d in noticed if begin_s <= t_s[pair[0]] + STEP_S]
        detectable_s = None if None in begun else max(begun, default=None)
        _judge(found, pair, t_s, one.usable, told, detectable_s)
    return found


def _judge(found, pair, t_s, usable, told, detectable_s):
    """Add one stretch of errors beyond their level to what `_alarm` gives."""
    rows = np.arange(pair[0], pair[1] + 1)
    from_s = max(float(t_s[pair[0]]), np.inf if detectable_s is None else detectable_s)
    unnoticed = rows[(t_s[rows] < from_s + ALERT_S) & usable[rows]]
    late = rows[(t_s[rows] >= from_s + ALERT_S) & usable[rows]]
    if _lasts(pair, t_s) > ALERT_S:
        if detectable_s is None or t_s[pair[0]] < detectable_s:
            found["undetected_s"] += STEP_S * len(unnoticed)
        found["late_s"] += STEP_S * len(late)
    after = rows[t_s[rows] >= from_s - STEP_S]
    silent = after[~usable[after]]
    if len(silent):
        words = after[told[after]]
        due_s = float(t_s[words[0]]) if len(words) else np.inf
        found["wrong_words"] += int(due_s > from_s + ALERT_S and t_s[pair[1]] > from_s + ALERT_S)
        if len(words):
            found["after_s"] = max(found["after_s"] or 0.0, float(t_s[words[0]]) - from_s)


def _usable_again(read, healthy, window):
    """How long after the end of a fault all quantities may be used again and are right, s.

    Counted from where those of the twin may be used; None where these never may, inf (-1.0) if never again.
    """
    n = min(len(read.t_s), len(healthy.t_s))
    good, there = (
        np.all([one.usable[:n] & ~one.beyond[:n] for one in found.quantities.values()], axis=0)
        & (read.t_s[:n] >= window.end_s)
        for found in (read, healthy)
    )
    if not there.any():
        return None
    t_s = read.t_s[:n]
    first_s = t_s[np.flatnonzero(there)[0]]
    later = t_s[good & (t_s >= first_s)]
    return float(later[0] - first_s) if len(later) else -1.0


def _finite(value):
    return float(value) if np.isfinite(value) else None
