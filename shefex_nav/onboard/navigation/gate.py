"""The gate: what becomes of a new measurement, and what is said about it.

A measurement passes if its normalised innovation squared stays below the chi-square limit; one of several
groups of rows without those that contradict the others, as long as most are left (`integrity_rows`). The rest
is a matter of trust: `integrity` says when a sensor that contradicts the filter is believed after all, and
when a fix inside the gate is not enough; `integrity_gps` when a receiver drifts; `integrity_gyro` when it is
the gyros that are wrong. What the covariance loses before a measurement is used that is believed so is said
last.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import frames
from shefex_nav.onboard.navigation import (
    adaptation,
    eskf,
    integrity,
    integrity_drift,
    integrity_gps,
    integrity_learnt,
    integrity_rows,
    integrity_watch,
    measurements,
)
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.integrity_gyro import StarSight
from shefex_nav.onboard.navigation.quantity import ATTITUDE, PLACE, POSITION, VELOCITY, about, fix_of
from shefex_nav.onboard.navigation.sensor import Admitted, Innovation
from shefex_nav.onboard.navigation.state import POS, VEL, initial_covariance
from shefex_nav.records import GateResult, Reason

ACCEPTED = (Fate.USED, Fate.RESET)
LONGEST_S = 300.0  # [E] that a gyro which is found wrong has been so, if stars have never checked it
FAR = 1e-12  # probability: a rejected fix that is less likely needs no second one to raise doubt
SURPRISING = 1e-2  # [E] probability: a confirmed fix that is less likely teaches with more doubt
EXPLAINED = 1.5  # [E] times the rate by which the stars find a gyro wrong, since it was right
MOST_HELD = 5  # [E] positions that wait for what becomes of their velocity
WAITS = "held: its velocity contradicts the filter"
SIGHTS_WAIT = "held: the ranges contradict the place from which its lines of sight are"
NOTES = {
    Fate.USED: "",
    Fate.REJECTED: "rejected",
    Fate.HELD: "held: waits for a second fix that agrees",
    Fate.DOUBTED: "drifts: its innovations keep their sign",
}


class Verdict(NamedTuple):
    """What becomes of a measurement."""

    fate: Fate
    rows: np.ndarray | None  # as in sensors.Measurement
    admitted: Admitted | None  # likewise
    note: str
    alone: bool  # whether one fix inside the gate was enough
    doubts: dict | None = None  # likewise
    # whether a GPS velocity says what it said when it was rejected, or a GPS position that was rejected
    # passes because the gate has become wider
    insisted: bool = False
    # (3,) m, Earth-fixed axes, what ranges that are believed against the filter say its position is off by
    offset: np.ndarray | None = None


def decide(nav, now, z, H, R, measurement):
    """Fate of a new measurement; that of its sensor's health is kept.

    nav : Filter;  now : Moment;  z, H, R : of the measurement
    -> Measurement, GateResult, whether another fix has confirmed it
    """
    name, sensor = measurement.sensor, nav.sensors[measurement.sensor]
    S, nis = eskf.innovation(now.P, z, H, R)
    innovation = Innovation(z, H, R, S, nis, nav.limits[len(z), sensor.gate_probability])
    if nav.judged is not None:
        nav.judged(name, S, nis)
    verdict = _verdict(nav, now, innovation, measurement)
    if nav.watch.drifts:
        verdict = integrity_drift.weigh(nav, now, innovation, measurement, verdict)
    attitude = _attitude(nav, now, z, R, measurement, verdict.fate)
    found = _gyros_wrong(nav, now, *attitude, verdict.fate) if attitude else None
    _report(nav, nav.history.ends_s[-1], name, Fate.USED if found else verdict.fate, verdict.note)
    if found:
        verdict = _find_again(nav, now, verdict, found, measurement, attitude[0])
        nav.bank.explained(nav, "star_tracker")
    else:
        verdict = adaptation.weigh(nav, now, innovation, measurement, verdict)
        verdict = _doubted(nav, now, z, nis, name, verdict)
        verdict = nav.bank.take(nav, now, z, R, S, measurement, verdict)
    grown = isinstance(verdict.admitted, Grown)  # the model was at fault, the measurement was used
    counted = measurements.counted_covariance(nav, measurement, innovation)
    weighed = verdict._replace(fate=Fate.USED) if grown else verdict
    nav.watch.constants.take(nav, now, name, innovation, counted, weighed)
    if fix_of(name) is ATTITUDE and verdict.fate in ACCEPTED:
        _settle_single_stars(nav)
    result = _result(nav, innovation, measurement, verdict)
    believed = verdict.fate == Fate.RESET and not grown and sensor.confirmed is not None
    confirmed = not verdict.alone or believed
    decided = measurement._replace(
        fate=verdict.fate, rows=verdict.rows, admitted=verdict.admitted, doubts=verdict.doubts,
        teaches=not nav.watch.replaced,
    )  # fmt: skip
    return decided, result, confirmed


def _settle_single_stars(nav):
    """An attitude is used: what single stars of its frame have said against the filter is over with it."""
    for name, record in nav.health.items():
        if about(name) is ATTITUDE and not fix_of(name) and record.in_a_row:
            nav.health[name] = record._replace(rejected=0, evidence=None, in_a_row=0, far=False)


def _verdict(nav, now, innovation, measurement):
    """Verdict by the gate, by the record of the sensor, and by the means of its innovations."""
    z, _, R, S, nis, limit = innovation
    name, fix, sensor = measurement.sensor, measurement.fix, nav.sensors[measurement.sensor]
    nav.watch.far = nav.health[name].far
    alone = sensor.alone is None or sensor.alone(nav, S)
    rows, passed = (
        integrity_rows.passed(nav.limits, S, z, sensor.rows) if sensor.rows else (None, nis <= limit)
    )
    before = nav.health[name]
    if fix_of(name) is POSITION and _receiver_is_doubtful(nav, fix):
        return Verdict(Fate.HELD, None, None, WAITS, alone)
    if name in PLACE and not before.rejected and _waits_for_ranges(nav, now, innovation, name, passed):
        return Verdict(Fate.HELD, None, None, SIGHTS_WAIT, alone)
    trial = None if passed and alone and not before.rejected else sensor.trial(nav, now, z, R, fix)
    judged = 0.0 if passed else np.inf
    fate, nav.health[name] = integrity.judge(nav.health[name], trial, judged, limit, fix.t_valid_s, alone)
    if fate == Fate.REJECTED and (before.far or nis > nav.limits[len(z), FAR]):
        nav.health[name] = nav.health[name]._replace(far=True)
    admitted = sensor.admits(nav, z) if fate == Fate.RESET and sensor.admits else None
    if fix_of(name) is POSITION:
        fate, admitted = _drifts(nav, fate, z, S, admitted)
    note = NOTES.get(fate, sensor.reset_note)
    if fate == Fate.RESET and admitted is not None:
        note += ", or the camera has moved"
    narrow = fate == Fate.USED and nis > nav.limits[len(z), SURPRISING]
    insisted = fate in ACCEPTED and before.rejected > 0 and _insists(name, before, trial.evidence, narrow)
    offset = _offset(nav, name, before, trial) if fate in ACCEPTED and before.rejected else None
    return Verdict(fate, rows, admitted, note, alone, insisted=insisted, offset=offset)


def _offset(nav, name, before, trial):
    """Verdict.offset of ranges; None if the first of those that were refused was off by the clock alone."""
    if about(name) is not POSITION or fix_of(name):
        return None
    return trial.evidence.z if before.first.is_off(nav.limits[3]) else None


def _receiver_is_doubtful(nav, fix):
    """Whether the velocities that come with positions have just been refused, one of them far off.

    Positions that run away with their velocity would bring the velocity of the filter to it, fix by fix, each
    inside the gate. A receiver whose velocities alone are wrong has its positions used again after a while.
    """
    velocity = nav.health["gps_velocity"]
    if not velocity.far or velocity.in_a_row > MOST_HELD or np.isnan(fix.v_ea_e[0]):
        return False
    return fix.t_valid_s - velocity.evidence.fix.t_valid_s < integrity.LONGEST_PAIR_S


def _waits_for_ranges(nav, now, innovation, name, passed):
    """Whether range rates wait for what becomes of their ranges, which have just been refused as far off.

    They are told along lines of sight from the place: 3 km off is up to 1 m/s. So they are not used where the
    place that the ranges say makes them others; and they contradict nothing if they pass from there.
    """
    record = nav.health[PLACE[name]]
    if not record.far or not record.in_a_row or record.evidence is None:
        return False
    if now.t_s - record.evidence.fix.t_valid_s >= integrity.LONGEST_PAIR_S:
        return False
    z, H, R, S, _, _ = innovation
    off_i = frames.dcm_ie(nav.earth, now.t_s) @ record.evidence.z
    # with the same velocity against the Earth, which is what a receiver goes on to say
    changes = H[:, POS] @ off_i + H[:, VEL] @ np.cross(frames.omega_ie_i(nav.earth), off_i)
    if np.all(np.abs(changes) < np.sqrt(np.diag(R))):
        return False
    # few satellites do not say the place: NaN, which does not pass
    return passed or integrity_rows.passed(nav.limits, S, z - changes, nav.sensors[name].rows)[1]


def _insists(name, before, evidence, narrow):
    """Verdict.insisted of a sensor with rejected fixes.

    str, Health before the fix, evidence of the fix, whether it has passed the gate only just
    """
    if fix_of(name) is VELOCITY:
        if before.far and narrow and integrity.same_direction(before.first, evidence):
            return True
        return integrity.same_velocity_offset(before.first, evidence)
    if about(name) is POSITION and integrity_watch.contradicts(name, before):
        return integrity.has_widened(before.evidence, evidence)
    return False


def _find_again(nav, now, verdict, found, measurement, z):
    """Verdict on a star fix by which the gyros are found wrong: their bias is unknown from here on."""
    name = measurement.sensor
    health = nav.health[name]
    counted = verdict.fate in ACCEPTED
    nav.health[name] = integrity.HEALTHY._replace(used=health.used if counted else health.used + 1)
    admitted = {"attitude": np.full(3, np.sqrt(z @ z)), "gyro_bias": found.admitted}
    note = f"{' '.join(found.axes)} wrong: bias to be found again"
    watch, angle = nav.watch, float(np.sqrt(z @ z))
    # since the stars last agreed with the gyros, if they ever did
    explains = EXPLAINED * found.largest * np.fmin(now.t_s - watch.gyros.checked_s, LONGEST_S)
    explained = counted or angle < explains
    if watch.disputed < explains:
        watch.disputed = 0.0
    if not explained:
        watch.gyros.doubt(angle)
    doubts = integrity_learnt.by_stars(nav, now, z, explained)
    return verdict._replace(fate=Fate.RESET, admitted=admitted, doubts=doubts, note=note)


def _doubted(nav, now, z, nis, name, verdict):
    """Verdict with what is to be doubted: for a sensor that is believed at last, or for a surprise."""
    watch = nav.watch
    if isinstance(verdict.admitted, Grown):
        return verdict  # the model is at fault: all that it has done has grown
    off = z if fix_of(name) is POSITION else verdict.offset
    if verdict.insisted and verdict.fate == Fate.USED and off is not None:
        if not watch.unread:
            watch.moved.add(off)
    elif verdict.insisted and verdict.fate == Fate.USED:
        watch.accept_velocity(name, z, watch.learnt.pushed(now.t_s, now.x))
    if fix_of(name) is ATTITUDE and verdict.fate in ACCEPTED:
        watch.attitude_was_wrong(float(np.sqrt(z @ z)))
    if verdict.fate == Fate.RESET and fix_of(name) is ATTITUDE:
        watch.gyros.doubt(np.sqrt(z @ z))
        return verdict._replace(doubts=integrity_learnt.by_stars(nav, now, z, verdict.admitted is not None))
    if verdict.fate == Fate.RESET and about(name) is VELOCITY:
        watch.gyros.doubt()
        watch.accept_velocity(name, z, watch.learnt.pushed(now.t_s, now.x))
        return verdict._replace(doubts=integrity_learnt.by_velocity(nav, now, z))
    if verdict.fate == Fate.RESET and off is not None and verdict.admitted is None:
        watch.accept_position(off)
    if verdict.fate == Fate.USED and not verdict.alone and nis > nav.limits[len(z), SURPRISING]:
        return verdict._replace(doubts=integrity_learnt.by_surprise(nav, now, nis / len(z)))
    return verdict


def _result(nav, innovation, measurement, verdict):
    """GateResult for the log."""
    z, _, _, S, nis, limit = innovation
    name, fix, note = measurement.sensor, measurement.fix, verdict.note
    if verdict.rows is not None:
        rows, refused = verdict.rows, _rejected(nav.sensors[name], fix, verdict.rows)
        note = "; ".join(filter(None, (note, f"rejected: {', '.join(refused)}")))
        z, limit = z[rows], nav.limits[int(rows.sum())]
        nis = eskf.normalised(S[np.ix_(rows, rows)], z)
    accepted = verdict.fate in ACCEPTED
    return GateResult(nav.history.ends_s[-1], fix.t_valid_s, name, len(z), nis, limit, accepted, note, z)


def _report(nav, now_s, name, fate, note):
    """Let the log know what is thought of a sensor, if that has changed; one rejected fix changes nothing."""
    if fate == Fate.USED:
        nav.watch.accept(now_s, name)
    elif fate in (Fate.DOUBTED, Fate.RESET):
        nav.watch.report(now_s, name, note)
    elif integrity_watch.contradicts(name, nav.health[name]):
        nav.watch.report(now_s, name, integrity_watch.reason(name, nav.health))


def _attitude(nav, now, z, R, measurement, fate):
    """Innovation of the attitude that a measurement says, and its noise; or None.

    Of stars that are used one by one it is that of their frame; of stars that are not used, the attitude is
    judged next (`sensors.attitudes_instead`).
    """
    if fix_of(measurement.sensor) is ATTITUDE:
        return z, R
    fix = measurement.fix
    if about(measurement.sensor) is ATTITUDE and fate == Fate.USED and fix.reason == Reason.NONE:
        z, _, R = nav.sensors["star_tracker"].linearise(nav, now, fix)
        return z, R
    return None


def _gyros_wrong(nav, now, z, R, fate):
    """What the stars find the gyros wrong by: integrity_gyro.Finding, or None."""
    watch = nav.watch
    if watch.unread or now.vibration > 0.0 or fate == Fate.RESET:
        watch.gyros.forget()
        return None
    turned = np.sqrt(z @ z) if fate == Fate.REJECTED else 0.0  # the camera may be, and turns about other axes
    f_b, A = now.sensed_packed[3:], nav.history.corrections.kept[-1].A
    found = watch.gyros.compare(StarSight(now.t_s, now.x, now.P, z, R, f_b), A, turned)
    if found:
        watch.gyros_wrong(nav.history.ends_s[-1], found)
    elif watch.gyros.checked_s == now.t_s:
        watch.learnt.confirmed(now.t_s, now.x, now.P)
    return found


def _drifts(nav, fate, z, S, admitted):
    """Fate of a measurement that passed, if its sensor drifts; what is admitted when that is noticed."""
    watch = nav.watch
    if fate != Fate.USED:
        watch.gps_drift = integrity_gps.QUIET
        return fate, admitted
    before = watch.gps_drift.suspected
    watch.gps_drift = integrity_gps.follow(watch.gps_drift, z, S, watch.drift_limit, nav.params.lasting_share)
    if not watch.gps_drift.suspected:
        return fate, admitted
    return Fate.DOUBTED, 0.0 if before else integrity_gps.followed(watch.gps_drift, S)


def _rejected(sensor, fix, rows):
    """Names of the groups of rows that did not pass."""
    groups = rows[:: sensor.rows]
    labels = sensor.labels(fix) if sensor.labels else [f"row {k}" for k in range(len(groups))]
    return [label for label, passed in zip(labels, groups, strict=True) if not passed]


def forgotten(nav, P, measurement, H):
    """Covariance in which nothing is known of what a sensor measures, or less by a sigma that is admitted.

    And less of what is doubted with it. Of a position without height the height stays known: H (2, n) says
    where it lies.
    -> (n, n), slices of the blocks whose ties to others are cut
    """
    if measurement.fate == Fate.USED and not measurement.doubts:
        return P, ()
    sensor, admitted = nav.sensors[measurement.sensor], measurement.admitted
    order, x, P, cut = nav.layout, nav.history.x, P.copy(), ()
    places = order.places
    named = [name for name in (sensor.block, *sensor.with_it) if places[name] is not None]
    if isinstance(admitted, integrity_drift.Followed):
        P += np.outer(admitted.done, admitted.done)
    elif isinstance(admitted, Grown):
        P = admitted.of(P)
    elif admitted is not None:
        added = admitted if isinstance(admitted, dict) else dict.fromkeys(named, np.full(3, admitted))
        integrity_learnt.add(P, order, x, added)
    elif measurement.fate != Fate.USED and len(H) == 2 and fix_of(measurement.sensor) is POSITION:
        level = H[:, places[sensor.block]]
        P[places[sensor.block], places[sensor.block]] += sensor.forgotten**2 * (level.T @ level)
    elif measurement.fate != Fate.USED:
        for name in named:
            known = sensor.forgotten**2
            if name != sensor.block:  # as at the start, about the estimate of the start: zero
                known = initial_covariance(nav.params, name) + np.diag(x[order.values[name]] ** 2)
            P = eskf.forget(P, places[name], known)
        cut = tuple(places[name] for name in named)
    integrity_learnt.add(P, order, x, measurement.doubts or {})
    return P, cut
