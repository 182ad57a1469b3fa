"""The sensors that the filter listens to: how each is linearised, gated and, in the end, believed.

GPS and stars stand here; an instrument that adds to them is an Aid (`aiding`). What arrives on board may hold
several measurements: `ARRIVALS` says which.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation import (
    aiding,
    calibration,
    integrity,
    integrity_watch,
    measure_ranges,
    measure_stars,
    measurements,
    momentary,
)
from shefex_nav.onboard.navigation.quantity import ATTITUDE, VECTORS, VELOCITY, about, fix_of
from shefex_nav.onboard.navigation.sensor import Sensor, Trial
from shefex_nav.onboard.navigation.settings import Release
from shefex_nav.onboard.navigation.state import POS
from shefex_nav.records import GpsFix, GpsRanges, Reason, StarFix

BEND_SHARE = 0.2  # [E] of the bend, that it may be wrong by: not all light of a streak counts alike
BEND_SEEN = 16.3  # of the gyros' noise in a bend, its normalised square that noise alone exceeds in 0.1 %
MOVED_CAMERA = np.radians(1.0)  # [E] by more than this a mounting does not give way


def _antenna(nav, now):
    """Antenna of the receiver at a Moment."""
    arm, sensed = nav.params.l_ba_b, now.sensed_packed
    return measurements.antenna(nav.layout, now.x, now.t_s, nav.earth, arm, sensed, now.vibration, now.drive)


def _gps_position(nav, now, fix):
    linearise = measurements.gps_horizontal if fix.horizontal else measurements.gps_position
    z, H, R = linearise(fix, _antenna(nav, now))
    return z, H, R + measurements.arm_in_position(nav, now, H)


def _gps_velocity(nav, now, fix):
    z, H, R = measurements.gps_velocity(fix, _antenna(nav, now))
    return z, H, R + measurements.arm_in_velocity(nav, now, H)


def _gps_range(nav, now, fix):
    sigma_bias = nav.params.range_bias_sigma
    z, H, R = measure_ranges.pseudoranges(nav.layout, now.state, fix, _antenna(nav, now), sigma_bias)
    return z, H, R + measurements.arm_in_position(nav, now, H)


def _gps_range_rate(nav, now, fix):
    z, H, R = measure_ranges.range_rates(nav.layout, now.state, fix, _antenna(nav, now))
    return z, H, R + measurements.arm_in_velocity(nav, now, H)


def straightened(nav, arrival, index, fix):
    """A StarFix as its instant shows it: what a rate that changes during the exposure does is taken out.

    The star tracker does so itself where it knows the rate (`StarFix.straight`); fixes by statistics, and
    those of other trackers, are the mean of the exposure, and are for this function. Once, when it arrives:
    later the memory may have lost the beginning of the exposure. Where the memory does not cover it, the rate
    is taken as steady, and the fix is what it was. So it is where no more is seen than the noise of the
    gyros: the prediction has that, too, and taking it out of the fix would make an error of the fix that is
    no longer independent of the prediction's.

    nav : fusion.Filter;  arrival : of `ARRIVALS`, of single stars or not;  index : of its tick in the History
    """
    if not fix.exposure_s > 0.0:
        return fix
    history, C_cb = nav.history, nav.params.C_bc.T
    now = history.moment(index, 0.0, fix.t_valid_s)
    bend_c = C_cb @ now.bend(fix.exposure_s)
    walk2 = nav.params.imu.gyro_random_walk**2 * fix.exposure_s / 12.0
    noise = walk2, nav.constants.momentary, now.vibration
    is_seen, q_ic, P_c, P = _rotated_back(fix.q_ic, fix.P_c, bend_c, noise)
    if not is_seen:
        return fix
    if fix.reason == Reason.NONE:
        fix = fix._replace(q_ic=q_ic, P_c=P_c)
    if _says_single_stars(arrival) and len(fix.stars.hip):
        fix = fix._replace(stars=measure_stars.rotated_back(fix.stars, bend_c, P))
    return fix


@kernel
def _rotated_back(q_ic, P_c, bend_c, noise):
    """Attitude without a bend (3,) rad, its covariance with what the bend may be wrong by, and that alone.

    noise : of the gyros in the bend, rad^2; errors of `momentary.of` and vibration, which add to it
    -> whether more of the bend is seen than that noise; (4,), (3, 3), (3, 3) rad^2
    """
    walk2, errors, vibration = noise
    noise2 = walk2 + momentary.variances(errors, vibration)[1]
    P = noise2 * np.eye(3)
    for i in range(3):
        for j in range(3):
            P[i, j] += BEND_SHARE**2 * (bend_c[i] * bend_c[j])
    is_seen = bend_c @ bend_c > BEND_SEEN * noise2
    return is_seen, rotation.quat_multiply(q_ic, rotation.quat_from_rotvec(-bend_c)), P_c + P, P


def _star_attitude(nav, now, fix):
    return measurements.star_attitude(nav.layout, now.x, fix, nav.params.C_bc, _shared_by_stars(nav, now))


def _star_vectors(nav, now, fix):
    return measure_stars.star_vectors(nav.layout, now.state, fix, nav.params.C_bc, _shared_by_stars(nav, now))


def _shared_by_stars(nav, now):
    """What turns all stars of a fix against the predicted attitude of a Moment: rad, each axis."""
    return _shared_kernel(nav.params.star_fix_floor, nav.constants.momentary, now.vibration)


@kernel
def _shared_kernel(floor, errors, vibration):
    """`_shared_by_stars` of the least of it [rad], errors of `momentary.of` and the vibration."""
    return math.sqrt(floor**2 + momentary.variances(errors, vibration)[1])


def _gps_trial(nav, now, z, R, fix):
    slack = nav.params.gps_agreement

    def agree(earlier, later):
        if np.isnan(earlier.fix.v_ea_e[0]) or np.isnan(later.fix.v_ea_e[0]):
            return integrity.positions_agree(earlier, later, slack)
        return integrity.gps_fixes_agree(earlier.fix, later.fix, slack)

    z_e = measurements.level_axes(fix) @ z if fix.horizontal else z
    return Trial(nav.params.release.gps, integrity.GpsEvidence(fix, z_e, now.P[POS, POS].copy()), agree)


def _gps_position_trial(nav, now, z, R, fix):
    """A position that jumps while the velocity goes on is hardly right: it must insist, without moving on."""
    trial = _gps_trial(nav, now, z, R, fix)
    return _insisting(nav, trial) if integrity_watch.jumped(nav.health, "gps_position") else trial


def _insisting(nav, trial):
    """Trial of a position that must be off by the same vector for longer."""
    limit = nav.limits[3]

    def steady(first, later):
        return integrity.offsets_agree(first, later, limit)

    rule = nav.watch.params.gps_jump
    return trial._replace(rule=rule, steady=steady, still=integrity.offset_remains)


def _range_trial(nav, now, z, R, fix):
    slack = nav.params.gps_agreement

    def agree(earlier, later):
        return measure_ranges.ranges_agree(earlier, later, slack)

    return Trial(nav.params.release.gps, fix, agree)


def _range_position_trial(nav, now, z, R, fix):
    """Ranges of a position that jumps must insist, as positions must; not those of a clock that jumps alone.

    Which of the two it is, the first of the refused says: later the filter knows less.
    """
    slack = nav.params.gps_agreement
    C_ie = frames.dcm_ie(nav.earth, now.t_s)
    found, R_found = measure_ranges.offset(fix, z, R, _antenna(nav, now).r_e)
    evidence = integrity.RangeEvidence(fix, found, R_found, C_ie.T @ now.P[POS, POS] @ C_ie)

    def agree(earlier, later):
        return measure_ranges.ranges_agree(earlier.fix, later.fix, slack)

    trial = Trial(nav.params.release.gps, evidence, agree)
    first = nav.health["gps_range"].first or evidence
    jumps = integrity_watch.jumped(nav.health, "gps_range") and first.is_off(nav.limits[3])
    return _insisting(nav, trial) if jumps else trial


def _satellites(fix):
    """Names of the rows of GpsRanges."""
    return [f"prn {prn}" for prn in fix.prn]


def _star_trial(nav, now, z, R, fix):
    params = nav.params
    used = nav.health["star_tracker"].used
    rule = params.release.star_fix if used else params.release.first_star_fix
    state = now.state
    P_rate = rate_covariance(nav.layout, now)
    limit = nav.limits[3]

    noise = (nav.noise.gyro * params.imu.gyro_random_walk) ** 2 + now.extra[0].max()

    def agree(earlier, later):
        return integrity.star_fixes_agree(earlier, later, P_rate, limit, noise)

    return Trial(rule, integrity.star_evidence(state, z, R, nav.history.corrections.kept[-1].A), agree)


def _vectors_trial(nav, now, z, R, fix):
    """Single stars never insist: what contradicts them is left to the attitudes, which stand alone."""
    return Trial(Release(rejections=2, duration=np.inf), None, lambda earlier, later: False)


def _hip(fix):
    """Names of the stars of a StarFix."""
    return [f"HIP {hip}" for hip in fix.stars.hip]


def _vectors_alone(nav, S):
    """While the gate stops every star that is off by as much as matters."""
    pairs = np.array([S[k : k + 2, k : k + 2] for k in range(0, len(S), 2)])
    return bool(np.linalg.eigvalsh(pairs).max() < nav.watch.params.wrong_star_fix**2 / nav.limits[2])


def _star_confirmed(nav, now, fix):
    z, _, R = _star_attitude(nav, now, fix)
    held = integrity.star_evidence(now.state, z, R, nav.history.corrections.kept[-1].A)
    return nav.health["star_tracker"]._replace(held=held)


def _star_alone(nav, S):
    """Once stars have been used, and while the gate stops every fix that is wrong by as much as matters."""
    if not nav.health["star_tracker"].used:
        return False
    most = nav.watch.params.wrong_star_fix**2 / nav.limits[len(S)]  # of the variance along any axis
    trace = S[0, 0] + S[1, 1] + S[2, 2]  # exceeds every eigenvalue
    return bool(trace < most or np.linalg.eigvalsh(S)[-1] < most)


def _star_admits(nav, z):
    """A small contradiction may be a camera that has moved or a wrong attitude: either is admitted."""
    angle, used = float(np.sqrt(z @ z)), nav.health["star_tracker"].used + nav.health["star_vectors"].used
    return angle if used > 1 and angle < MOVED_CAMERA else None


def rate_covariance(layout, now):
    """Covariance of the corrected rate of a Moment by the estimates of the gyro errors: (3, 3) rad^2/s^2."""
    J_omega, _ = calibration.jacobians(layout, now.x, *now.sensed, now.vibration, now.drive)
    return J_omega @ now.P @ J_omega.T


class Arrival(NamedTuple):
    """What arrives on board."""

    sensors: tuple[str, ...]  # whose measurements it holds
    empty: Callable[[Any], str] = lambda fix: ""  # why a fix holds no measurement, '' if it does


SENSORS = {
    "gps_position": Sensor(_gps_position, "position", 1e5, _gps_position_trial),
    "gps_velocity": Sensor(_gps_velocity, "velocity", 1e4, _gps_trial),
    "gps_range": Sensor(
        _gps_range,
        "position",
        1e5,
        _range_position_trial,
        with_it=("clock", "range_bias"),  # a clock that jumped misleads all ranges alike
        rows=1,
        labels=_satellites,
    ),
    "gps_range_rate": Sensor(
        _gps_range_rate, "velocity", 1e4, _range_trial, with_it=("clock",), rows=1, labels=_satellites
    ),
    "star_tracker": Sensor(
        _star_attitude,
        "attitude",
        np.pi,
        _star_trial,
        with_it=("mounting",),  # whatever misled the attitude has misled the mounting too
        reset_note="attitude reset",
        alone=_star_alone,
        confirmed=_star_confirmed,
        admits=_star_admits,
    ),
    "star_vectors": Sensor(
        _star_vectors, "attitude", np.pi, _vectors_trial, rows=2, labels=_hip, alone=_vectors_alone
    ),
}
ARRIVALS = {
    "gps": Arrival(VECTORS, lambda fix: "" if fix.valid else f"no fix: {fix.reason}"),
    "gps_ranges": Arrival(
        ("gps_range", "gps_range_rate"), lambda fix: "" if len(fix.prn) else f"no ranges: {fix.reason}"
    ),
    "star_tracker": Arrival(("star_tracker",)),
    "star_vectors": Arrival(
        ("star_vectors",), lambda fix: "" if len(fix.stars.hip) else "no stars by themselves"
    ),
}


def table(params):
    """The sensors of a filter: `SENSORS`, and behind them its aids. NavParams -> {name: Sensor}"""
    found = SENSORS | {aid.name: aiding.sensor(aid) for aid in params.aids}
    if params.lasting_share:
        found["gps_position"] = found["gps_position"]._replace(counted=_lasting_position)
    if params.range_bias_sigma and "range_bias" not in params.sigma_blocks:
        found["gps_range"] = found["gps_range"]._replace(counted=_lasting_ranges)
    return found


def _lasting_position(nav, fix, R, gap_s):
    """As `Sensor.counted`, of positions a part of whose errors lasts."""
    params = nav.params
    return measurements.lasting_factor(params.lasting_share, params.range_bias_time_s, gap_s) * R


def _lasting_ranges(nav, fix, R, gap_s):
    """As `Sensor.counted`, of ranges whose errors last and have no states."""
    params = nav.params
    factor = measurements.lasting_factor(1.0, params.range_bias_time_s, gap_s)
    return measure_ranges.counted(fix, R, params.range_bias_sigma, factor)


def arrivals(nav, arrived):
    """What the filter takes of what has arrived, in the same order, but stars last.

    Of GPS the fixes, or the ranges if it is coupled tightly; of a StarFix the attitude, or each star by
    itself; readings of aids. Before stars have been used for the first time it is the attitude in any case:
    one fix is compared with another one there, and single stars have been named with the filter's own
    prediction.

    fusion.Filter, sequence of records -> list of (arrival, fix)
    """
    params = nav.params
    takes = {GpsRanges: ("gps_ranges", None)} if params.gps == "tight" else {GpsFix: ("gps", None)}
    by_stars = params.stars != "attitude" and nav.health["star_tracker"].used
    takes[StarFix] = ("star_vectors", _has_stars) if by_stars else ("star_tracker", _has_attitude)
    takes |= {aid.record: (aid.name, aid.holds) for aid in params.aids}
    stars_last = sorted(arrived, key=lambda one: isinstance(one, StarFix))
    known = [(*takes[type(one)], one) for one in stars_last if type(one) in takes]
    return [(arrival, one) for arrival, holds, one in known if holds is None or holds(one)]


def _has_attitude(fix):
    return fix.reason == Reason.NONE


def _has_stars(fix):
    return fix.reason == Reason.NONE or len(fix.stars.hip)


def _says_single_stars(name):
    """Whether an arrival or a sensor says a direction for each star, and not the attitude."""
    return about(name) is ATTITUDE and not fix_of(name)


def attitudes_instead(nav, taken, results):
    """Attitudes of frames of which not one star was used, so that it shows whether they insist.

    A star that is used ends what attitudes may have said against the filter.

    taken : `arrivals` that were fused;  results : list in which their GateResult are
    -> list of (arrival, fix)
    """
    sent = {fix.t_valid_s: fix for arrival, fix in taken if _says_single_stars(arrival)}
    instead = []
    for result in results if sent else ():
        if not _says_single_stars(result.sensor):
            continue
        fix = sent[result.t_valid_s]
        if result.accepted:
            nav.health["star_tracker"] = nav.health["star_tracker"]._replace(
                rejected=0, evidence=None, in_a_row=0
            )
            nav.watch.report(result.t_s, "star_tracker", "")
        elif fix.reason == Reason.NONE:
            instead.append(("star_tracker", fix))
    return instead


def contents(nav, arrival, index, fix):
    """Names of the measurements that an arrival holds, and why they are not to be used, '' if they may.

    fusion.Filter; of `arrivals`; of the tick in the History in which the fix lies, or None; the fix
    """
    known = ARRIVALS.get(arrival) or Arrival((arrival,))
    names = tuple(name for name in known.sensors if fix_of(name) is not VELOCITY or _has_velocity(fix))
    return names, known.empty(fix) or _unfit(nav, names[0], index, fix)


def _has_velocity(fix):
    """Whether a GpsFix says one: receivers that give no velocity leave it NaN."""
    return not np.isnan(fix.v_ea_e[0])


def _unfit(nav, name, index, fix):
    """Why a measurement is not to be used where the vehicle was in tick `index`, if any; '' if it may."""
    judge = nav.sensors[name].unfit
    if judge is None or index is None:
        return ""
    return judge(nav, nav.history.ends_s[index], nav.history.xs[nav.history.place(index)], fix)
