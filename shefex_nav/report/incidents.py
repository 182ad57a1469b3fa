"""What went wrong in a run, and when: one list out of all the places of a log that say so."""

from collections import Counter
from itertools import groupby
from typing import NamedTuple

import numpy as np

from shefex_nav.records import QUANTITIES, Reason, protected
from shefex_nav.report import doubts, star_metrics, trust
from shefex_nav.report.configured import configured
from shefex_nav.report.pairing import stretches

_TOGETHER_S = (
    2.5  # refusals of one sensor, or doubts about one quantity, that are not farther apart are one incident
)


class Incident(NamedTuple):
    """Something out of order."""

    from_s: float
    until_s: float | None  # None: it lasted to the end of the log
    what: str


def incidents(data):
    """Incidents of a RunData by time: list of Incident, empty where all went well."""
    found = [*_noticed(data), *_refused(data), *_resets(data), *_doubts(data), *_imu(data), *_stars(data)]
    if data.ended_early:
        why = data.failure.partition("\n")[0] or "the run was cut off"
        found.append(Incident(_end(data), None, f"the log ends here: {why}"))
    return sorted(found, key=lambda incident: (incident.from_s, incident.what))


def _end(data):
    known = [t for t in (data.last_t_s, *data.nav.t_s[-1:], data.mission.start_s) if np.isfinite(t)]
    return float(known[0])


def _noticed(data):
    for entry in trust.noticed(data.health):
        name = entry["source"].replace("_", " ")
        yield Incident(entry["from_s"], entry["until_s"], f"{name} out of use: {entry['reason']}")


def _refused(data):
    """Refused measurements, those of a sensor in a row together."""
    by_sensor = {}
    for gate in data.gates:
        if not gate.accepted and gate.dof > 0:
            by_sensor.setdefault(gate.sensor, []).append(gate)
    for sensor, gates in by_sensor.items():
        times = np.array([gate.t_valid_s for gate in gates])
        for group in np.split(np.arange(len(gates)), np.flatnonzero(np.diff(times) > _TOGETHER_S) + 1):
            notes = Counter(gates[k].note for k in group)
            why = "; ".join(note for note, _ in notes.most_common(2) if note)
            plural = "s" if len(group) > 1 else ""
            what = f"{len(group)} measurement{plural} of {sensor.replace('_', ' ')} refused"
            yield Incident(float(times[group[0]]), float(times[group[-1]]), f"{what}: {why}" if why else what)


def _resets(data):
    """Measurements that were used in an unusual way."""
    for gate in data.gates:
        if gate.accepted and gate.note:
            yield Incident(gate.t_s, gate.t_s, f"{gate.sensor.replace('_', ' ')}: {gate.note}")


def _doubts(data):
    nav = data.nav
    if not len(nav.t_s):
        return
    limits = trust.limits_of(configured(data))
    for quantity in QUANTITIES:
        said = protected(nav, quantity)
        limit, by_default = limits[quantity].values()
        for doubt in doubts.WORDS:
            text = doubts.words(doubt, quantity, limit, by_default)
            for start, end in _joined(_runs(nav.t_s, said.do_not_use & (said.doubt == doubt))):
                yield Incident(start, end, f"{quantity} not to be used: {text}")


def _joined(spans):
    """Spans of time, those that follow soon as one: a level grows and shrinks from fix to fix."""
    whole = []
    for start, end in spans:
        if whole and start - whole[-1][1] < _TOGETHER_S:
            start = whole.pop()[0]
        whole.append((start, end))
    return whole


def _imu(data):
    imu = data.imu
    for flags, text in ((imu.saturated, "IMU at the end of its range"), (~imu.valid, "IMU silent")):
        for start, end in _runs(imu.t_valid_s, flags):
            yield Incident(start, end, text)


def _runs(t_s, flags):
    """(first, last or None at the end of the samples) of every run of flagged samples."""
    for a, b in stretches(flags):
        yield float(t_s[a]), None if b == len(t_s) else float(t_s[b])


def _stars(data):
    """Frames of the window without an attitude, in runs of one reason, and wrong attitudes."""
    window, _ = star_metrics.window_frames(data)
    errors = star_metrics.star_errors(data)
    wrong = errors.t_s[np.linalg.norm(errors.rotation_c, axis=1) > star_metrics.WRONG_ANGLE]
    for t_s in wrong.tolist():
        yield Incident(t_s, t_s, "wrong star fix, given as good")
    for (bad, _), fixes in groupby(data.star_fixes, lambda fix: (_is_bad(fix, window), fix.reason)):
        if bad:
            yield _without(list(fixes))


def _is_bad(fix, window):
    return fix.number in window and fix.reason != Reason.NONE


def _without(fixes):
    n, reason = len(fixes), Reason(fixes[0].reason).name.lower().replace("_", " ")
    what = f"{n} frame{'s' if n > 1 else ''} in the window without a star fix: {reason}"
    return Incident(fixes[0].t_valid_s, fixes[-1].t_valid_s, what)
