"""The memory of everything that watches the sensors, and the list of what it has to say.

`fusion` asks it at each IMU block and each measurement; `computer` hands what it says to the log.
"""

from enum import IntFlag
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import (
    integrity_constants,
    integrity_drift,
    integrity_gps,
    integrity_gyro,
    integrity_imu,
    integrity_learnt,
    integrity_protection,
    integrity_unread,
)
from shefex_nav.onboard.navigation.integrity import BACK, Steps, chi_square_limit
from shefex_nav.onboard.navigation.quantity import (
    ATTITUDE,
    BESIDE,
    POSITION,
    SIGHTS,
    VECTORS,
    VELOCITY,
    about,
    fix_of,
)
from shefex_nav.onboard.navigation.settings import Release
from shefex_nav.onboard.navigation.state import X_Q
from shefex_nav.records import Doubt, NavHealth

CONTRADICTIONS = 3  # [E] rejected fixes in a row that agree with each other
WHY = {ATTITUDE: "contradicts the gyros", VELOCITY: "contradicts the accelerometers"}
UNCHECKED = "has been wrong before: no stars to check it by"
ALL_OF = {doubt: np.full(3, int(doubt)) for doubt in Doubt}  # about position, velocity and attitude alike
ONLY_ATTITUDE = np.array([Doubt.NONE, Doubt.NONE, Doubt.CONTRADICTED], dtype=np.int64)
ONLY_POSITION = np.array([Doubt.CONTRADICTED, Doubt.NONE, Doubt.NONE], dtype=np.int64)
ALSO_VELOCITY = np.array([Doubt.CONTRADICTED, Doubt.CONTRADICTED, Doubt.NONE], dtype=np.int64)
OF_FORCE = np.array([True, True, False])  # position, velocity, attitude: what runs away without it
ALONE = POSITION, VELOCITY  # of which one fix that is far off raises doubt
MEASURES = {ATTITUDE: 0, VELOCITY: 1}  # -> triad whose readings a fix says the sum of


class Blind(IntFlag):
    """Of what the IMU does not say what it is at the moment: of one, of both, or of none."""

    NOT = 0
    TO_RATE = 1
    TO_FORCE = 2


class IntegrityParams(NamedTuple):
    """What is expected of sensors and solution."""

    imu: integrity_imu.ImuRules
    wanted: integrity_protection.Requirement
    wrong_star_fix: float  # rad, smallest error of a star fix that must be noticed
    gps_jump: Release  # of a GPS position that contradicts the filter while its velocity does not


DEFAULT = IntegrityParams(
    imu=integrity_imu.NO_RULES,
    wanted=integrity_protection.requirement(100.0, 1.0, np.radians(0.17), 1e-5),
    wrong_star_fix=np.radians(0.5),
    gps_jump=Release(rejections=30, duration=29.0),
)


class Watch:
    """Memory, changed in place.

    params : IntegrityParams
    drift_limit : chi-square limit of the means of innovations
    gyros : integrity_gyro.GyroWatch
    """

    def __init__(self, params, drift_limit, gyros):
        self.params, self.drift_limit, self.gyros = params, drift_limit, gyros
        self.imu = None  # integrity_imu.ImuWatch, from the first block on
        self.learnt = integrity_learnt.Learnt()
        self.unread = Blind.NOT  # by readings of an axis that are replaced, or are at the end of its range
        self.uncounted = 0.0  # m/s, along the roll axis: corrections since a GPS velocity, blind to force
        self.replaced = False  # whether some have been replaced: axes that are silent or stuck
        self.gaps = False  # whether an axis has ever been anything but read
        self.disputed = 0.0  # rad, between stars and gyros, of which nothing says which is wrong
        self.distrusted = False  # whether the gyros say what cannot be relied on
        self.gps = integrity_gps.memory()
        self.constants = integrity_constants.Constants()
        self.far = False  # whether its sensor's rejected fixes before the one that is judged were far off
        self.alarms = {}  # of `integrity_bank`: group of sensors -> s, since when
        self.step = Steps()  # m/s, by which a GPS velocity was believed against the accelerometers
        self.moved = Steps()  # m, by which a GPS position was believed against the filter
        self.pushed = 0.0  # m/s, that specific force had added to the velocity before the last step of it
        self.gps_drift = integrity_gps.QUIET
        self.protection = integrity_protection.Protection()
        self.drifts = {}  # name of an instrument -> integrity_drift.Drift
        self.repeated = {}  # name of an instrument -> aiding.Repeated
        self.reasons = {}  # source -> why it is not healthy
        self.pending = []  # NavHealth not handed over yet

    def screen(self, block, readings, densities):
        """What of an ImuBlock can be used: `integrity_imu.screen`, which writes the two arrays."""
        if self.imu is None or len(self.imu.last) != len(block.dtheta_b):
            started = integrity_imu.start(self.params.imu, len(block.dtheta_b), self.gyros.sensed)
            kept = {} if self.imu is None else {"axes": self.imu.axes, "forces": self.imu.forces}
            self.imu = started._replace(**kept)
        changes = integrity_imu.screen(self.imu, block, readings, densities)
        if changes:
            self._changed(changes)
        self._gyros_now(block.t_valid_s)

    def is_calm(self, samples):
        """Whether blocks of so many samples can be screened without this object, which `screened` tells."""
        return self.imu is not None and len(self.imu.last) == samples

    def steady(self, ends_s):
        """How many ticks that end at the times ends_s (n,) may pass before `screened` is told of the last.

        At all of them but the last, gyros that have been wrong are what was last said of them.
        """
        gyros = self.gyros
        if not gyros.failed:
            return len(ends_s)
        if self._is_news(ends_s[0]):
            return 1
        # nothing changes between fixes but that the last check becomes too old
        if gyros.is_unchecked(ends_s[0]) or not gyros.is_unchecked(ends_s[-1]):
            return len(ends_s)
        return 1 + next(k for k, end_s in enumerate(ends_s) if gyros.is_unchecked(end_s))

    def screened(self, t_s, changed):
        """What `integrity_imu.screen_packed` found in the block that ends at t_s."""
        if changed:
            self._changed(integrity_imu.health(t_s, changed, self.imu.state))
        self._gyros_now(t_s)

    def _changed(self, changes):
        """The state of axes of the unit has changed."""
        self.pending += changes
        self.unread = blind(self.imu.state)
        if not self.unread & Blind.TO_FORCE:
            self.uncounted = 0.0
        self.replaced, self.gaps = integrity_imu.replaced(self.imu.state), True
        self.gyros.forget()

    @property
    def imu_blind(self):
        """Blind: what of the moment is not measured on an axis, or cannot be trusted."""
        if self.distrusted or self.disputed > 0.0:
            return self.unread | Blind.TO_RATE
        return self.unread

    def gyros_wrong(self, now_s, found):
        """An integrity_gyro.Finding of this tick."""
        for name in found.axes:
            k = integrity_gyro.AXES.index(name)
            words = f"turns otherwise than the stars: by {np.degrees(found.rate_b[k]):.3g} deg/s"
            self.report(now_s, name, words)
        self.distrusted = True

    def _gyros_now(self, now_s):
        """Gyros that have been wrong: right again, or wrong still, or not checked any more."""
        if self.gyros.failed and self._is_news(now_s):
            self.distrusted = not self.gyros.trust(now_s)
            for name in self.gyros.recovered:
                self.report(now_s, name, UNCHECKED if self.gyros.is_unchecked(now_s) else "")

    def _is_news(self, now_s):
        """Whether gyros that have been wrong are not what was last said of them."""
        reason = UNCHECKED if self.gyros.is_unchecked(now_s) else ""
        return self.distrusted == self.gyros.trust(now_s) or any(
            self.reasons.get(name, "") != reason for name in self.gyros.recovered
        )

    def used(self, sensor, t_valid_s, now_s, dv_i, x):
        """A measurement has just been used: it has corrected the velocity by dv_i (3,), m/s.

        x : (X,) packed values, with the correction
        """
        if self.unread & Blind.TO_FORCE:
            self.uncounted += float(dv_i @ rotation.dcm_from_quat(x[X_Q])[:, 0])
        quantity = fix_of(sensor)
        if quantity not in MEASURES or not self.gaps:
            return
        triad = 3 * MEASURES[quantity]
        integrity_unread.fixed(self.imu.axes[triad : triad + 3], t_valid_s)
        if not self.unread:
            return
        integrity_imu.fixed(self.imu, MEASURES[quantity], t_valid_s, now_s)
        if quantity is ATTITUDE:
            integrity_imu.turned(self.imu, t_valid_s, now_s)
        else:
            integrity_imu.pushed(self.imu, self.uncounted, t_valid_s, now_s)
            self.uncounted = 0.0

    def accept_velocity(self, name, z, pushed):
        """A GPS velocity is believed against the accelerometers, which show nothing wrong by themselves.

        Either may be wrong, and both agree from here on: the receiver that goes on with its error as well as
        the filter that was put right. Only a step back, as large, says that it was the receiver, and is over.
        """
        if fix_of(name) is not VELOCITY or self.unread or not self.far:
            return
        if not self.step.take_back(z):
            self.step.add(z)
        self.pushed = pushed

    def accept_position(self, z):
        """A GPS position is believed against the filter, which its velocity did not make wrong.

        As of a velocity: only a step back, as large, says that it was the receiver.
        """
        if not self.moved.take_back(z) and self.far and not self.unread:
            self.moved.add(z)

    def attitude_was_wrong(self, angle):
        """Stars have turned the attitude by an angle: if that explains a step of the velocity, it is over.

        Where no velocity was known before the step, nothing says what an angle would have done.
        """
        if not self.step or not np.isfinite(self.pushed):
            return
        if angle * self.pushed > BACK * self.step.largest:
            self.step.forget()
            self.moved.forget()  # the velocity has moved the position

    def graver_doubts(self, health, imu_blind=None):
        """Doubt about position, velocity and attitude whatever their protection levels: (3,) Doubt as int.

        {sensor: Health};  imu_blind : as the attribute, None: as it is now. While the gyros do not measure
        all three run away, without specific force position and velocity alone: the attitude is what gyros
        and stars say, and its level knows what the force turns gyros by (`integrity_unread`). A star tracker
        that contradicts says that the attitude is wrong, or itself; position and velocity are checked by GPS,
        where there is any. A GPS velocity contradicts an attitude as well, by the direction of the thrust:
        any other sensor makes all three doubtful. A GPS position whose velocity goes on contradicts the
        position alone: most likely it has jumped, but the filter may have followed it before. So does one
        that was believed in the end; where ranges have said it, lines of sight are wrong with the place, and
        the velocity that range rates tell along them: by 1 m/s where it is 3 km off.
        """
        imu_blind = self.imu_blind if imu_blind is None else imu_blind
        if not imu_blind:
            return self._contradicted(health)
        if imu_blind & Blind.TO_RATE:
            return ALL_OF[Doubt.IMU]
        return np.where(OF_FORCE, Doubt.IMU, self._contradicted(health))

    def _contradicted(self, health):
        """The same of what sensors say against each other."""
        drifted = any(one.is_disputed for one in self.drifts.values())
        if self.constants.found or self.step or "gps" in self.alarms or drifted:
            return ALL_OF[Doubt.CONTRADICTED]
        bad = contradicting(health)
        if not bad and not self.alarms and not self.moved:
            return ALL_OF[Doubt.NONE]
        others = [name for name in bad if about(name) is not ATTITUDE]
        jumps = [about(name) for name in others] == [POSITION] and jumped(health, others[0])
        if (others and not jumps) or ((bad or self.alarms) and self.reasons.get("gps")):
            return ALL_OF[Doubt.CONTRADICTED]
        of_attitude = self.alarms or len(bad) > len(others)
        of_position = jumps or bool(self.moved)
        by_sights = bool(self.moved) and any(health[name].used for name in SIGHTS if name in health)
        of_place = ALSO_VELOCITY if by_sights else ONLY_POSITION
        return (ONLY_ATTITUDE if of_attitude else 0) | (of_place if of_position else 0)

    def accept(self, t_s, sensor):
        """A sensor is used: it is healthy, but for what its earlier fixes have left in doubt."""
        self.report(t_s, sensor, self._left(sensor))

    def _left(self, sensor):
        """What is left to say of a sensor that is used; '' if nothing is."""
        if about(sensor) is POSITION and self.moved:
            return f"disputed: it or the filter was wrong by {self.moved.largest:.3g} m"
        if fix_of(sensor) is VELOCITY and self.step:
            return f"disputed: it or the accelerometers were wrong by {self.step.largest:.2g} m/s"
        if fix_of(sensor) is ATTITUDE and self.disputed > 0.0:
            return f"disputed: it or the gyros are wrong by {np.degrees(self.disputed):.2g} deg"
        return ""

    def report(self, t_s, source, reason):
        """A source is healthy, reason '', or not; it is said once, and again when the kind of reason changes.

        The kind of a reason is what stands before its colon.
        """
        before = self.reasons.get(source, "")
        self.reasons[source] = reason
        if before.split(":")[0] != reason.split(":")[0]:
            self.pending.append(NavHealth(t_s, source, not reason, reason))

    def changes(self):
        """The list of NavHealth since the last call."""
        changes, self.pending = self.pending, []
        return changes


def blind(state):
    """Blind, of the states (6,) of the axes of gyros and accelerometers."""
    rate = Blind.TO_RATE if state[:3].any() else Blind.NOT
    return rate | Blind.TO_FORCE if state[3:].any() else rate


def start(params):
    """Watch of a filter that starts. NavParams -> Watch"""
    relative, sensed = integrity_gyro.relative_error(params), integrity_gyro.sensed_error(params)
    gyros = integrity_gyro.GyroWatch(params.imu, relative, sensed)
    limit = chi_square_limit(integrity_gps.DRIFT_PROBABILITY, 3)
    watch = Watch(params.integrity or DEFAULT, limit, gyros)
    watch.drifts = {aid.name: integrity_drift.Drift(aid.drift) for aid in params.aids if aid.drift}
    return watch


def reason(name, health):
    """Why a sensor that insists on contradicting the filter is not used. str, {sensor: Health} -> str"""
    if about(name) is POSITION and jumped(health, name):
        return "moves without its velocity"
    return WHY.get(fix_of(name), "contradicts the filter")


def contradicts(name, record):
    """Whether a sensor insists on contradicting the solution. str, Health -> bool

    GPS fixes that were rejected agree with each other, or one of them is far off: at a fix a second the next
    one comes too late. Those of the star tracker need not agree: where gyros are wrong, star fixes that are
    right do not agree through them. Nor need ranges and single stars, of which few are compared with none,
    nor readings of an instrument, unless they may be believed against the filter.
    """
    if record.far and about(name) in ALONE:
        return True
    return (record.rejected if name in VECTORS else record.in_a_row) >= CONTRADICTIONS


def contradicting(health):
    """Sensors that contradict the solution. {sensor: Health} -> names"""
    if not any(record.rejected or record.in_a_row for record in health.values()):
        return ()  # as nearly always
    return [name for name, record in health.items() if contradicts(name, record)]


def jumped(health, name):
    """Whether a GPS position that contradicts the filter is the receiver's fault: its velocity does not.

    {sensor: Health}; sensor, of `quantity.BESIDE` -> bool
    """
    velocity, position = health[BESIDE[name]], health[name]
    return position.used > 0 and velocity.used > 0 and velocity.rejected == 0
