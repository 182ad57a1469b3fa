"""The filter concludes that its own model is at fault: noise that is larger than it was told.

Three things show it. **Innovations** of the velocity that are too large and hang together, or keep their sign
(`noise_evidence`): the noise of the IMU. **Resets**: a sensor that was believed after it had contradicted
the filter, and contradicts it again within `LOOP_S`: then it is not the sensor. **Rest**: the vehicle
stands still, and its readings scatter more than they should (likewise). Innovations that are too large and
white are the noise of the sensor itself.

What follows is said, logged, and bounded by `MOST_GROWN`: from that tick on the noise of the IMU counts `imu`
times (a row of `error_model.record`, which the smoother gets, too), the covariance grows as if it always had,
that of calibration errors to `MOST_GROWN` times their sigma at the start, and the share of process noise in
the innovations says whether that was right (`noise_evidence`). The factor rises at once and falls slowly. It
never falls below 1: noise that is told too large costs accuracy, and a covariance that shrinks by what
innovations say may be too small.

Without an alarm nothing is touched.
"""

from collections import deque

import numpy as np

from shefex_nav.onboard.navigation import error_model, eskf, integrity_learnt, integrity_watch, noise_evidence
from shefex_nav.onboard.navigation.eskf import MOST_GROWN
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.measurements import counted_covariance
from shefex_nav.onboard.navigation.noise_evidence import LENGTHS, WHITE, Share, Window, neighbours
from shefex_nav.onboard.navigation.quantity import POSITION, RATES, VECTORS, VELOCITY, fix_of
from shefex_nav.records import NavHealth

WATCHED = VECTORS  # sensors whose windows are kept: one fix, three numbers
JUDGED = (*WATCHED, *RATES)  # the inertial sensors are held against those of the velocity
YOUNG = 5  # [E] measurements of a sensor that were used, this one too: the filter has only begun
LOOP_S = 60.0  # [E] two resets of a sensor within it are one too many
STEP = 2.0  # [E] factor after an alarm that does not say how large it is
BOLDEST = 4.0  # [E] largest factor after innovations that have all passed the gate
FEW = 6  # [E] innovations of a position; fewer accuse nobody
RECENT = 10  # innovations, rejected ones too: the largest of them says how far off a loop is
SETTLING = 10  # innovations after an alarm that say nothing yet
FEWEST, ENOUGH = 30, 100  # innovations before the factor changes, and before it is told
LEAST_SHARE = 0.1  # [E] of process noise in the innovations, below which they do not change the factor
TOLD_SHARE = 0.3  # of process noise in the innovations, below which the factor cannot be told
SLOW = 0.7  # the factor falls to no less than this share of itself at a time
OWN_SHARE = 0.6  # [E] of its own noise in the innovations of a sensor, below which they do not accuse it
ALIKE = 1.5  # [E] times the growth of a receiver's noise that its positions say, of its velocities
RIGHT = 1.15  # a factor below is none
IMU, CANNOT, ABOUT = "IMU noise", "cannot be told by how much", "about"


class Noise:
    """Memory of a filter, changed in place.

    imu : factor of all noise of the IMU, by innovations
    rest : factors of the white noise of gyros and accelerometers, by readings at rest
    sensors : {sensor: factor of its noise}
    schedule : list of (s, imu, rest) from when on they counted
    """

    def __init__(self):
        self.imu, self.rest, self.sensors, self.schedule = 1.0, (1.0, 1.0), {}, []
        self.windows = {name: Window() for name in WATCHED}
        self.by_noise = {name: deque(maxlen=60) for name in WATCHED}  # share of the sensor's noise in S
        self.recent, self.resets, self.share = {}, {}, None
        self.still = noise_evidence.Still()
        self.told = ""  # the last remark on the IMU
        self.confirmed = False  # whether innovations have told the factor of the IMU

    @property
    def gyro(self):
        """Factor of the white noise of the gyros."""
        return max(self.imu, self.rest[0])

    def of_sensor(self, name):
        """Factor of the noise of a sensor, standard deviation."""
        return self.sensors.get(name, 1.0)


def weigh(nav, now, innovation, measurement, verdict):
    """Verdict on a new measurement, when the filter has asked itself whether its own model is right.

    nav : Filter;  now : Moment;  innovation : sensor.Innovation;  verdict : gate.Verdict of the gate
    -> gate.Verdict, the same unless the model is found wrong
    """
    noise, name = nav.noise, measurement.sensor
    if noise.share is not None:
        _learn(nav, now, innovation, measurement, verdict.fate)
    if name not in JUDGED or nav.watch.imu_blind or verdict.fate in (Fate.HELD, Fate.DOUBTED):
        return verdict
    whitened, own = eskf.weighed(innovation.z, innovation.R, innovation.S)
    noise.recent.setdefault(name, deque(maxlen=RECENT)).append(whitened)
    if fix_of(name) is VELOCITY:
        _rest(nav, measurement.fix)
    if verdict.fate == Fate.RESET:
        if fix_of(name) is POSITION and nav.watch.moved.is_back(innovation.z):
            return verdict  # it was the receiver
        return _second_reset(nav, now, name, verdict)
    if now.vibration > 0.0 or verdict.fate != Fate.USED or name not in WATCHED:
        return verdict
    return _windows(nav, now, whitened, own, name, verdict)


def _second_reset(nav, now, name, verdict):
    """Verdict on a measurement that is believed against the filter: the second time it is the filter.

    So it is the first time, if the sensor has contradicted it nearly from the start on, or by so little that
    noise explains it.
    """
    noise = nav.noise
    if verdict.admitted is not None or verdict.insisted:
        return verdict
    before, noise.resets[name] = noise.resets.get(name, -np.inf), now.t_s
    young = name in RATES and nav.health[name].used <= YOUNG
    recent = noise.recent[name]
    largest = float(np.sqrt(max(w @ w / len(w) for w in recent)))
    again = now.t_s - before <= LOOP_S
    if not again and not young and largest > BOLDEST:
        return verdict
    if name in WATCHED and _is_white(recent):
        if noise.share is None:  # while the IMU is in doubt no sensor is
            _count_sensor(nav, name, noise.of_sensor(name) * float(np.sqrt(np.mean(np.square(recent)))))
        return verdict
    if not (name in RATES or _alone(nav)):
        return verdict
    noise.resets.pop(name, None)
    if young:
        why = "contradicted from the start"
    else:
        why = "second reset" if again else "contradicted by little"
    return widen(nav, now, float(np.clip(largest, STEP, MOST_GROWN)), verdict, why)


def too_large_again(nav, now, factor, verdict, streams):
    """Verdict when innovations of GPS are too large for the second time within `LOOP_S`: noise is to blame.

    That of the IMU, if those of the velocity hang together or hardly show the receiver's own noise; else that
    of each of the receiver's sensors whose innovations are white and mostly its own noise.

    nav : Filter;  now : Moment;  factor : of sigmas, by the innovations;  verdict : gate.Verdict
    streams : {sensor: integrity_bank.Stream} -> gate.Verdict
    """
    known = [name for name in WATCHED if name in streams and len(streams[name].recent) == RECENT]
    recent = {name: np.array([w for w, _ in streams[name].recent]) for name in known}
    own = {name: float(np.mean([share for _, share in streams[name].recent])) for name in known}
    large = [name for name in known if np.mean(np.square(recent[name])) > RIGHT**2]
    white = [name for name in large if _is_white(recent[name]) and own[name] > OWN_SHARE]
    if "gps_velocity" in large and "gps_velocity" not in white:
        return widen(nav, now, factor, verdict, "innovations are too large again")
    for name in white if nav.noise.share is None else ():  # while the IMU is in doubt no sensor is
        excess = float(np.mean(np.square(recent[name]))) - 1.0
        _count_sensor(nav, name, nav.noise.of_sensor(name) * np.sqrt(1.0 + excess / own[name]))
        streams[name].recent.clear()
    return verdict


def blame_receiver(nav, streams):
    """Blame the noise of the receiver for innovations of GPS that are too large, if it explains them.

    streams : as `too_large_again` -> whether it does
    """
    known = [streams[name].recent for name in WATCHED if name in streams]
    if len(known) < len(WATCHED) or not all(known):
        return False
    position, velocity = (np.array([w for w, _ in one]) for one in known)
    return _blame_if_white(nav, position, float(np.mean([own for _, own in known[0]])), velocity)


def _blame_if_white(nav, position, own, velocity):
    """Let the noise of the receiver count more, if it explains velocities whose innovations are too large.

    A receiver that says too little of its noise does so of position and velocity alike, and what the inertial
    sensors do hardly shows in an innovation of the position that is its own noise for the most part. An
    accusation of the IMU that nothing has confirmed is taken back.

    position, velocity : (n, 3) whitened innovations;  own : mean share of the receiver's noise in the first
    -> whether it does
    """
    noise = nav.noise
    if len(position) < FEW or own <= OWN_SHARE or noise.confirmed:
        return False
    if min(noise.of_sensor(name) for name in WATCHED) >= MOST_GROWN:
        return False
    size, of_velocity = float(np.mean(np.square(position))), float(np.mean(np.square(velocity)))
    growth = 1.0 + (size - 1.0) / own
    if size < RIGHT**2 or of_velocity > ALIKE * growth or not neighbours(np.array(position)) < WHITE:
        return False
    for name in WATCHED:
        _count_sensor(nav, name, noise.of_sensor(name) * float(np.sqrt(growth)))
    if noise.share is not None:
        noise.share = None
        _count(nav, 1.0, noise.rest)
        _report(nav, _at_rest(noise.rest))
    nav.bank.begin_anew()
    return True


def _is_white(recent):
    """Whether the last innovations of a sensor do not hang together; not before there are `RECENT`."""
    return len(recent) == RECENT and neighbours(np.array(recent)) < WHITE


def _alone(nav):
    """Whether a GPS position speaks for the velocity too: no velocity says otherwise."""
    return not integrity_watch.jumped(nav.health, "gps_position")


def _windows(nav, now, whitened, own, name, verdict):
    """Verdict on a measurement that was used, by the windows over the innovations of its sensor.

    whitened, own : of `eskf.weighed`
    """
    noise = nav.noise
    found, shares = noise.windows[name].take(whitened), noise.by_noise[name]
    shares.append(own)
    own = float(np.mean(shares))  # where it is small, innovations are white whoever makes them too large
    if noise.share is None and found.full and own > OWN_SHARE:  # while the IMU is in doubt no sensor is
        _blame(nav, name, found, own)
    process = found.process or (found.large and (own <= OWN_SHARE or noise.share is not None))
    if not process or name not in RATES:
        return verdict
    velocity = noise.windows[name].last(LENGTHS[0])
    if fix_of(name) is VELOCITY and _blame_if_white(nav, *_of_position(noise), velocity):
        return verdict
    growth = 1.0 + (found.excess - 1.0) / max(1.0 - own, LEAST_SHARE)
    step = float(np.clip(np.sqrt(max(growth, 1.0)), STEP, BOLDEST))
    return widen(nav, now, step, verdict, "innovations are too large")


def _of_position(noise):
    """Innovations of the GPS position that its window has, and the share of its own noise in them."""
    name, count = "gps_position", LENGTHS[0]
    found, shares = noise.windows[name].last(count), list(noise.by_noise[name])[-count:]
    return found, float(np.mean(shares)) if shares else 0.0


def widen(nav, now, step, verdict, why):
    """The noise of the IMU counts so many times more from here on, and so does what it has done already.

    -> gate.Verdict: used after the covariance has grown, or as it was if the factor is as large as may be
    """
    noise, before = nav.noise, nav.noise.imu
    for window in noise.windows.values():
        window.forget()
    if min(before * step, MOST_GROWN) == before:
        return verdict
    _count(nav, min(before * step, MOST_GROWN), noise.rest)
    if noise.share is None:
        noise.share = Share(nav.history)
    noise.share.begin(SETTLING)
    _report(nav, f"{IMU} told too small: counts {noise.imu:.2g} times, {CANNOT} yet")
    admitted, note = integrity_learnt.widened(nav, now.P, step), f"{IMU} told too small: {why}"
    return verdict._replace(fate=Fate.RESET, admitted=admitted, note=note)


def _count(nav, imu, rest):
    """Let the noise of the IMU count so many times from the next tick on."""
    noise, model, told, now_s = nav.noise, nav.constants.model, nav.params.imu, nav.history.ends_s[-1]
    noise.imu, noise.rest = imu, rest
    noise.schedule.append((now_s, imu, rest))
    scheduled(model, told, noise.schedule, nav.history.ends_s[0])
    nav.watch.gyros.noise[0] = (noise.gyro * told.gyro_random_walk) ** 2


def scheduled(model, told, schedule, since_s=-np.inf):
    """Write a schedule of factors into the rows of an `error_model.record` that counts from since_s on.

    told : ImuModel;  schedule : as `Noise.schedule`
    """
    first = sum(from_s <= since_s for from_s, _, _ in schedule)  # the last of these counts at since_s
    rows = [(-np.inf, *(schedule[first - 1][1:] if first else (1.0, (1.0, 1.0)))), *schedule[first:]]
    rows = [rows[0], *rows[max(1, len(rows) - len(model) + 1) :]]
    model["from_s"] = np.inf
    for k, (from_s, imu, (gyro, accel)) in enumerate(rows):
        model["from_s"][k] = from_s
        model["gyro_random_walk"][k] = max(imu, gyro) * told.gyro_random_walk
        model["accel_random_walk"][k] = max(imu, accel) * told.accel_random_walk
        model["gyro_bias_walk"][k] = imu * told.gyro_bias_walk
        model["accel_bias_walk"][k] = imu * told.accel_bias_walk


def replayed(nav, schedule):
    """Filter that begins, with the noise that another found on its way. Filter, `Noise.schedule` -> Filter"""
    if not schedule:
        return nav
    model = error_model.record(nav.params, len(schedule))
    scheduled(model, nav.params.imu, schedule)
    return nav._replace(constants=nav.constants._replace(model=model))


def carry(nav):
    """Before ticks are forgotten: the share of process noise, where it is followed, goes with them."""
    nav.noise.share.carry(nav, nav.history.oldest)


def _learn(nav, now, innovation, measurement, fate):
    """What a measurement says of the share of process noise; the factor when there are enough."""
    z, H, _, S, *_ = innovation
    name, number = measurement.sensor, nav.history.number(now.k)
    noise, share = nav.noise, nav.noise.share
    if fate not in (Fate.USED, Fate.RESET) or H.shape[0] == 0:
        return
    share.carry(nav, number)
    if number < share.number:
        return
    if fate == Fate.USED:
        if name in RATES or (name in JUDGED and _alone(nav)):
            share.innovation(z, H, S)
        share.corrected(now.P, H, counted_covariance(nav, measurement, innovation))
    found = share.estimate()
    if found is None or found.count < FEWEST:
        return
    best = noise.imu * np.sqrt(max(found.growth, 0.01))
    far = found.share > LEAST_SHARE and abs(found.growth - 1.0) > 2.0 * found.sigma
    if far or found.count >= ENOUGH:
        _refine(nav, found, float(np.clip(best, SLOW * noise.imu, MOST_GROWN)) if far else noise.imu)


def _refine(nav, found, factor):
    """Another factor, by enough innovations."""
    noise, before = nav.noise, nav.noise.imu
    if factor < RIGHT:
        noise.share, factor, noise.confirmed = None, 1.0, False
    if factor != before:
        _count(nav, factor, noise.rest)
        for window in noise.windows.values():
            window.forget()
    if noise.share is None:
        _report(nav, _at_rest(noise.rest))
        return
    if found.count >= ENOUGH:
        known = found.share >= TOLD_SHARE
        noise.confirmed |= known
        if known or ABOUT not in noise.told:
            _report(nav, f"{IMU} told too small: " + (f"{ABOUT} {factor:.2g} times" if known else CANNOT))
        noise.share.fade()
    if factor != before:
        noise.share.begin()


def _blame(nav, name, found, own):
    """The noise of a sensor by its innovations: more at once, and less and less where that was too much.

    found : noise_evidence.Finding;  own : share of the sensor's noise in its innovations
    """
    noise = nav.noise
    before = noise.sensors.get(name, 1.0)
    factor = before * np.sqrt(max(1.0 + (found.excess - 1.0) / own, SLOW**2))
    factor = float(factor) if factor > RIGHT else 1.0
    if not (found.sensor or factor < 0.5 * (1.0 + SLOW) * before):
        return
    _count_sensor(nav, name, factor)


def _count_sensor(nav, name, factor):
    """The noise of a sensor counts so many times from the next fix on."""
    noise, factor = nav.noise, float(min(factor, MOST_GROWN))
    noise.sensors[name] = factor
    noise.windows[name].forget()
    noise.by_noise[name].clear()
    words = f"{name.replace('_', ' ')} noise told too small: about {factor:.2g} times" if factor > 1.0 else ""
    nav.watch.pending.append(NavHealth(nav.history.ends_s[-1], f"{name} noise", not words, words))


def _rest(nav, fix):
    """Compare the scatter of readings at rest with the noise that was told."""
    noise = nav.noise
    rest = noise.still.look(nav.history, nav.params, fix)
    if rest is None:
        return
    rest = tuple(min(max(found, old), MOST_GROWN) for found, old in zip(rest, noise.rest, strict=True))
    if rest == noise.rest:
        return
    _count(nav, noise.imu, rest)
    _report(nav, _at_rest(rest))


def _at_rest(factors):
    """What the factors at rest say, '' if they are right."""
    named = zip(("gyros", "accelerometers"), factors, strict=True)
    words = ", ".join(f"{what} {ABOUT} {factor:.2g} times" for what, factor in named if factor > 1.0)
    return f"{IMU} told too small: at rest {words}" if words else ""


def _report(nav, words):
    """Let the log know what is thought of the noise of the IMU, if that has changed."""
    noise = nav.noise
    if words != noise.told:
        noise.told = words
        nav.watch.pending.append(NavHealth(nav.history.ends_s[-1], "imu noise", not words, words))
