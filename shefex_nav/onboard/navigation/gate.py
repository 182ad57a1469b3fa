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
from shefex_nav.records import GateResult, Reason

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
    found, attitude = None, _attitude(nav, now, z, R, S, measurement, fate)
    if attitude:
        found = _gyros_wrong(nav, now, *attitude, fate)
    _tell(nav, now_s, name, Fate.USED if found else fate, note)
    if found:
        fate, note = Fate.RESET, f"{' '.join(found.axes)} wrong: bias to be found again"
        admitted = {"attitude": np.full(3, np.sqrt(attitude[0] @ attitude[0])), "gyro_bias": found.admitted}
        nav.health[name] = integrity.Health(nav.health[name].used + 1, 0, np.nan, None)
    if rows is not None:
        note = "; ".join(filter(None, (note, f"rejected: {', '.join(_rejected(sensor, fix, rows))}")))
        z, limit = z[rows], nav.limit(int(rows.sum()))
        nis = eskf.normalised(S[np.ix_(rows, rows)], z)
    accepted = fate in (Fate.USED, Fate.RESET)
    result = GateResult(now_s, fix.t_valid_s, name, len(z), nis, limit, accepted, note, z)
    confirmed = not alone or (fate == Fate.RESET and sensor.confirmed is not None)
    decided = measurement._replace(fate=fate, rows=rows, admitted=admitted)
    return decided, result, confirmed


def _tell(nav, now_s, name, fate, note):
    """Let the log know what is thought of a sensor, if that has changed; one rejected fix changes nothing."""
    if fate == Fate.USED:
        nav.watch.tell(now_s, name, "")
    elif fate in (Fate.DOUBTED, Fate.RESET):
        nav.watch.tell(now_s, name, note)
    elif integrity_watch.contradicts(name, nav.health[name]):
        nav.watch.tell(now_s, name, integrity_watch.reason(name, nav.health))


def _attitude(nav, now, z, R, S, measurement, fate):
    """Innovation, its noise and its covariance of the attitude that a measurement says, or None.

    Of stars that are used one by one it is that of their frame; of stars that are not used, the attitude is
    judged next (`sensors.attitudes_instead`).
    """
    if measurement.sensor == "star_tracker":
        return z, R, S
    fix = measurement.fix
    if measurement.sensor == "star_vectors" and fate == Fate.USED and fix.reason == Reason.NONE:
        z, H, R = SENSORS["star_tracker"].linearise(nav, now, fix)
        return z, R, H @ now.P @ H.T + R
    return None


def _gyros_wrong(nav, now, z, R, S, fate):
    """What the stars find the gyros wrong by: integrity_gyro.Finding, or None."""
    watch = nav.watch
    if watch.unread or now.vibration > 0.0 or fate == Fate.RESET:
        watch.gyros.forget()
        return None
    found = watch.gyros.compare(now.state, now.P, z, R, S if fate == Fate.USED else None)
    if found:
        watch.gyros_wrong(nav.history.ends_s[-1], found)
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


def _passed(nav, S, z, size):
    """Which rows pass the gate, in groups of `size`, each against its own limit. -> rows, whether most do

    rows : (m,) bool; None if all pass, or not most of them
    """
    limit, rows = nav.limit(size), np.empty(len(z), dtype=bool)
    for first in range(0, len(z), size):
        group = slice(first, first + size)
        rows[group] = eskf.normalised(S[group, group], z[group]) <= limit
    credible = 2 * np.count_nonzero(rows) > len(rows)
    return (rows if credible and not rows.all() else None), credible


def _rejected(sensor, fix, rows):
    """Names of the groups of rows that did not pass."""
    groups = rows[:: sensor.rows]
    labels = sensor.labels(fix) if sensor.labels else [f"row {k}" for k in range(len(groups))]
    return [label for label, passed in zip(labels, groups, strict=True) if not passed]
