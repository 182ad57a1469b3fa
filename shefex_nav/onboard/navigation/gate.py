"""The gate: what becomes of a new measurement, and what is said about it.

A measurement passes if its normalised innovation squared, or that of each group of its rows, stays below the
chi-square limit. The rest is a matter of trust: `integrity` says when a sensor that contradicts the filter is
believed after all, and when a fix inside the gate is not enough; `integrity_gps` when a receiver drifts.
"""

import numpy as np

from shefex_nav.onboard.navigation import eskf, integrity, integrity_gps, integrity_watch
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.sensors import SENSORS, Measurement
from shefex_nav.records import GateResult

NOTES = {
    Fate.USED: "",
    Fate.REJECTED: "rejected",
    Fate.HELD: "held: waits for a second fix that agrees",
    Fate.DOUBTED: "drifts: its innovations keep their sign",
}


def decide(nav, now, z, H, R, measurement):
    """Fate of a new measurement; that of its sensor's health is kept.

    nav : Filter;  now : Moment;  z, H, R : of the measurement
    -> Measurement, GateResult, whether another fix has confirmed it
    """
    name, fix = measurement.sensor, measurement.fix
    sensor, now_s = SENSORS[name], nav.history.ends_s[-1]
    S, nis = eskf.innovation(now.P, z, H, R)
    limit, alone = nav.limit(len(z)), sensor.alone is None or sensor.alone(nav, S)
    rows, passed = _passed(nav, S, z, sensor.rows) if sensor.rows else (None, nis <= limit)
    trial = None if passed and alone else sensor.trial(nav, now, z, R, fix)
    nis_judged = 0.0 if passed else np.inf
    fate, nav.health[name] = integrity.judge(nav.health[name], trial, nis_judged, limit, fix.t_valid_s, alone)
    admitted = sensor.admits(nav, z) if fate == Fate.RESET and sensor.admits else None
    if name == integrity_watch.DRIFTS:
        fate, admitted = _drifts(nav, fate, z, S, admitted)
    note = NOTES.get(fate, sensor.reset_note)
    if fate == Fate.RESET and admitted is not None:
        note += ", or the camera has moved"
    _tell(nav, now_s, name, fate, note)
    if rows is not None:
        note = f"rejected: {', '.join(_rejected(sensor, fix, rows))}"
        z, limit = z[rows], nav.limit(int(rows.sum()))
        nis = eskf.normalised(S[np.ix_(rows, rows)], z)
    accepted = fate in (Fate.USED, Fate.RESET)
    result = GateResult(now_s, fix.t_valid_s, name, len(z), nis, limit, accepted, note, z)
    confirmed = not alone or (fate == Fate.RESET and sensor.confirmed is not None)
    return Measurement(name, fix, fate, rows, admitted), result, confirmed


def _tell(nav, now_s, name, fate, note):
    """Let the log know what is thought of a sensor, if that has changed; one rejected fix changes nothing."""
    if fate == Fate.USED:
        nav.watch.tell(now_s, name, "")
    elif fate in (Fate.DOUBTED, Fate.RESET):
        nav.watch.tell(now_s, name, note)
    elif nav.health[name].rejected >= integrity_watch.CONTRADICTIONS:
        nav.watch.tell(now_s, name, integrity_watch.reason(name, nav.health))


def _drifts(nav, fate, z, S, admitted):
    """Fate of a measurement that passed, if its sensor drifts; what is admitted when that is noticed."""
    watch = nav.watch
    if fate != Fate.USED:
        watch.drift = integrity_gps.QUIET
        return fate, admitted
    before = watch.drift.suspected
    watch.drift = integrity_gps.follow(watch.drift, z, S, watch.drift_limit)
    if not watch.drift.suspected:
        return fate, admitted
    return Fate.DOUBTED, 0.0 if before else integrity_gps.followed(watch.drift, S)


def _passed(nav, S, z, size):
    """Which rows pass the gate, in groups of `size`, each against its own limit. -> rows, whether any does

    rows : (m,) bool; None if all pass, or none
    """
    limit, rows = nav.limit(size), np.empty(len(z), dtype=bool)
    for first in range(0, len(z), size):
        group = slice(first, first + size)
        rows[group] = eskf.normalised(S[group, group], z[group]) <= limit
    return (rows if rows.any() and not rows.all() else None), bool(rows.any())


def _rejected(sensor, fix, rows):
    """Names of the groups of rows that did not pass."""
    groups = rows[:: sensor.rows]
    labels = sensor.labels(fix) if sensor.labels else [f"row {k}" for k in range(len(groups))]
    return [label for label, passed in zip(labels, groups, strict=True) if not passed]
