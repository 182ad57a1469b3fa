"""The gate: what becomes of a new measurement, and what is said about it.

A measurement passes if its normalised innovation squared stays below the chi-square limit. One of several
groups of rows passes group by group, as long as most of them do: where half of all satellites contradict the
filter, it is not for the filter to say which half is right. The rest is a matter of trust: `integrity` says
when a sensor that contradicts the filter is believed after all, and when a fix inside the gate is not enough;
`integrity_gps` when a receiver drifts; `integrity_gyro` when it is the gyros that are wrong.
"""

import numpy as np

from shefex_nav.onboard.navigation import eskf, integrity, integrity_gps, integrity_watch
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.sensors import SENSORS
from shefex_nav.records import GateResult

NOTES = {
    Fate.USED: "",
    Fate.REJECTED: "rejected",
    Fate.HELD: "held: waits for a second fix that agrees",
    Fate.DOUBTED: "drifts: its innovations keep their sign",
}


def decide(nav, state, P, z, H, R, imu, at_s, measurement):
    """Fate of a new measurement; that of its sensor's health is kept.

    -> Measurement, GateResult, whether another fix has confirmed it
    """
    name, fix = measurement.sensor, measurement.fix
    sensor, now_s = SENSORS[name], nav.history[-1].t_s
    nis, limit = eskf.innovation_statistics(P, z, H, R), nav.limit(len(z))
    passed = rows_passed(nav, P, z, H, R, sensor.rows) if sensor.rows else np.full(len(z), nis <= limit)
    trial = rows = None
    alone = _alone(nav, sensor, H, P, R)
    credible = 2 * np.count_nonzero(passed) > len(passed)
    if credible:
        nis_judged, rows = 0.0, None if passed.all() else passed
    else:
        nis_judged = np.inf
    if not (credible and alone):
        trial = sensor.trial(nav, state, P, z, R, imu, at_s, fix)
    fate, nav.health[name] = integrity.judge(nav.health[name], trial, nis_judged, limit, fix.t_valid_s, alone)
    admitted = sensor.admits(nav, z) if fate == Fate.RESET and sensor.admits else None
    if name == integrity_watch.DRIFTS:
        fate, admitted = _drifts(nav, fate, z, H @ P @ H.T + R, admitted)
    note = NOTES.get(fate, sensor.reset_note)
    if fate == Fate.RESET and admitted is not None:
        note += ", or the camera has moved"
    found = _gyros_wrong(nav, state, P, z, H, R, imu, fate) if name == "star_tracker" else None
    _tell(nav, now_s, name, Fate.USED if found else fate, note)
    if found:
        fate, rows, note = Fate.RESET, None, f"{' '.join(found.axes)} wrong: bias to be found again"
        admitted = {"attitude": np.full(3, np.sqrt(z @ z)), "gyro_bias": found.admitted}
        nav.health[name] = integrity.Health(nav.health[name].used + 1, 0, np.nan, None)
    if rows is not None:
        note = f"rejected: {', '.join(_rejected(sensor, fix, rows))}"
        z, H, R = z[rows], H[rows], R[np.ix_(rows, rows)]
        nis, limit = eskf.innovation_statistics(P, z, H, R), nav.limit(len(z))
    accepted = fate in (Fate.USED, Fate.RESET)
    result = GateResult(now_s, fix.t_valid_s, name, len(z), nis, limit, accepted, note, z)
    confirmed = not alone or (fate == Fate.RESET and sensor.confirmed is not None)
    return measurement._replace(fate=fate, rows=rows, admitted=admitted), result, confirmed


def _tell(nav, now_s, name, fate, note):
    """Let the log know what is thought of a sensor, if that has changed; one rejected fix changes nothing."""
    if fate == Fate.USED:
        nav.watch.tell(now_s, name, "")
    elif fate in (Fate.DOUBTED, Fate.RESET):
        nav.watch.tell(now_s, name, note)
    elif integrity_watch.contradicts(name, nav.health[name]):
        nav.watch.tell(now_s, name, integrity_watch.reason(name, nav.health))


def _gyros_wrong(nav, state, P, z, H, R, imu, fate):
    """What the stars find the gyros wrong by: integrity_gyro.Finding, or None."""
    watch = nav.watch
    if watch.unread or imu.vibration > 0.0 or fate == Fate.RESET:
        watch.gyros.forget()
        return None
    found = watch.gyros.compare(state, P, z, R, H @ P @ H.T + R if fate == Fate.USED else None)
    if found:
        watch.gyros_wrong(nav.history[-1].t_s, found)
    return found


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


def rows_passed(nav, P, z, H, R, size):
    """Which rows pass the gate, in groups of `size`, each against its own limit. -> (m,) bool"""
    S, limit = H @ P @ H.T + R, nav.limit(size)
    passed = np.empty(len(z), dtype=bool)
    for first in range(0, len(z), size):
        group = slice(first, first + size)
        passed[group] = z[group] @ np.linalg.solve(S[group, group], z[group]) <= limit
    return passed


def _rejected(sensor, fix, rows):
    """Names of the groups of rows that did not pass."""
    groups = rows[:: sensor.rows]
    labels = sensor.labels(fix) if sensor.labels else [f"row {k}" for k in range(len(groups))]
    return [label for label, passed in zip(labels, groups, strict=True) if not passed]


def _alone(nav, sensor, H, P, R):
    """Whether one fix inside the gate is enough."""
    return sensor.alone is None or sensor.alone(nav, H, P, R)
