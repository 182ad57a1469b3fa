"""Constants of the receiver that were told wrongly: the instant that its fixes belong to, and its lever arm.

A wrong constant c shows in every fix alike. Its time shows as the motion of the vehicle meanwhile, its lever
arm as the motion of another point: z = s c + noise, with the columns

    of position  s = H_r [-v, C_ib],    of velocity  s = H_v [-a - C_ib omega x (omega x l), C_ib (omega x)]

for a fix measured c_1 seconds before the instant that it names, and an arm that is longer by c_2...4; v and a
are those over the turning Earth. A range is a position along its line of sight. A range rate is a velocity
against axes that do not turn (a + omega_ie x v for a), along a line of sight that goes with the position.
What the filter has learnt of it already shows no more. That is its response B to a unit of c, which goes
through the filter as an error of the state does (separate bias: Friedland, IEEE TAC 14, 1969)::

    B <- Phi B,    h = s - H B,    B <- B + K h

Innovations of a filter whose constants are right are white with covariance S, so that over all fixes

    J = sum h^T S^-1 h,    y = sum h^T S^-1 z,    y^T J^-1 y ~ chi-square

for any h that does not correlate with z. Motion as the filter estimates it does: the sensors swing with the
vibration, and the velocity is off by what z is to correct. With fixes 20 ms apart that made a right time look
8 ms wrong, with a velocity known to 2 cm/s a right arm of 1.8 m look 2.7 m wrong. So rate and acceleration
are what the sensors have read until the longest period of the vibration before, after which swings do not
correlate, and a time shows only in a vehicle that moves. Where the memory does not reach so far back, or that
period is longer than `LONGEST_S`, velocities show nothing. B is followed through position, velocity, attitude
and clock only; that makes h less sharp, not the chance of a false alarm larger. Fixes whose errors last are
not white: they count with the noise that the filter gives them (`Sensor.counted`). Whoever else is at
fault leaves innovations of another form: a constant is found only where it explains most of what is more than
chance in all innovations since the start. Where a sensor was believed against the filter, something else may
be wrong, and what was gathered says nothing any more: `QUIET_S` after the last such time the sums begin anew.
What was found by then stays.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import inner, kernel, lent
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation.integrity import Fate, chi_square_limit
from shefex_nav.onboard.navigation.state import ATT, POS, VEL, X_Q, X_R, X_V
from shefex_nav.onboard.navigation.strapdown import BEFORE

PROBABILITY = 1e-10  # of finding a right constant wrong, per fix
FEWEST = 5  # [E] innovations of GPS
LEAST = 2e-3, 0.2  # [E] s, m: an error below is no matter
EXPLAINED = 0.7  # [E] share of the squares beyond chance
OVER = 0.25  # of the limit, below which a constant is right after all
QUIET_S = 30.0  # s [E], since a sensor was last believed against the filter
LONGEST_ARM_M = 100.0  # [E] beyond which another error passes for an arm
LONGEST_S = 1.0  # [E] period of vibration, beyond which readings tell too little of the motion
SPAN_S = 0.1  # s [E], of the readings that are taken
MOVES = 10.0  # [E] sigma of the velocity, over ground
UNREAD = np.full(3, np.nan), np.full(3, np.nan)
CONDITION = 1e8  # of J, beyond which nothing is said
TIME, ARM = slice(0, 1), slice(1, 4)
NOTHING, POSITION, VELOCITY, RATES = 0, 1, 2, 3  # what a sensor shows of a wrong constant
SHOWS = {"gps_position": POSITION, "gps_velocity": VELOCITY, "gps_range": POSITION, "gps_range_rate": RATES}


class Sums(NamedTuple):
    """What is carried from measurement to measurement, in arrays that are changed in place."""

    J: np.ndarray  # (4, 4)
    y: np.ndarray  # (4,)
    v_i: np.ndarray  # (3,) m/s, at the latest measurement
    C_ib: np.ndarray  # (3, 3) likewise


class Shown(NamedTuple):
    """A measurement, before it corrects the state."""

    x: np.ndarray  # (X,) packed values
    P: np.ndarray  # (n, n)
    z: np.ndarray  # (m,)
    H: np.ndarray  # (m, n)
    S: np.ndarray  # (m, m)
    omega_b: np.ndarray  # (3,) rad/s, of the body, until shortly before
    f_i: np.ndarray  # (3,) m/s^2, specific force likewise; NaN: not known
    omega_ie_i: np.ndarray  # (3,) rad/s
    l_ba_b: np.ndarray  # (3,) m, IMU to GPS antenna
    clock: int  # place of the receiver's clock and its drift among the errors; -1: none
    dt_s: float  # since the latest one, below 0 of a late one, NaN: it is the first


class Constants:
    """Memory, changed in place.

    found : '' or what is wrong
    """

    def __init__(self):
        self.B, self.seen_s = None, np.nan  # (n, 4); s, of the latest measurement
        self.omega_ie_i = None  # (3,) rad/s
        self.sums = Sums(*(np.zeros(shape) for shape in ((4, 4), 4, 3, (3, 3))))
        self.beyond, self.count = 0.0, 0
        self.found, self.wrong = "", None  # words, and which constants
        self.begins_s = -np.inf  # when what innovations show counts again

    def take(self, nav, now, name, innovation, counted, verdict):
        """Take a measurement in, before it corrects the state.

        nav : Filter;  now : Moment;  innovation : sensor.Innovation
        counted : (m, m) `measurements.counted_covariance`;  verdict : fate, and rows that are used, None: all
        """
        (z, H, _, gate, *_), fate, used, S = innovation, verdict.fate, verdict.rows, counted
        if self.B is None:
            self.B, self.omega_ie_i = np.zeros((H.shape[1], 4)), frames.omega_ie_i(nav.earth)
        what = SHOWS.get(name, NOTHING)
        begun = now.t_s >= self.begins_s and not nav.watch.imu_blind
        judges = what != NOTHING and fate != Fate.HELD and begun
        motion = UNREAD
        if what in (VELOCITY, RATES) and nav.params.vibration_period_s <= LONGEST_S:
            ticks = nav.history.oldest, nav.history.number(now.k)
            motion = _read(nav.history.arrays, *ticks, now.t_s - nav.params.vibration_period_s)
        if used is not None:
            z, H, S, gate = z[used], H[used], *(one[np.ix_(used, used)] for one in (S, gate))
        # than m is the mean of z^T S^-1 z, by noise that counts for more than it is
        less = 0.0 if counted is innovation.S else len(z) - float(np.trace(np.linalg.solve(S, gate)))
        clock = nav.layout.places["clock"]
        constant = self.omega_ie_i, nav.params.l_ba_b, -1 if clock is None else clock.start
        seen = Shown(now.x, now.P, z, H, S, *motion, *constant, now.t_s - self.seen_s)
        beyond, *found = _take(self.B, self.sums, seen, what, judges, fate == Fate.USED)
        if not now.t_s < self.seen_s:  # a late one is taken in where the response is
            self.seen_s = now.t_s
        if judges:
            self.beyond += beyond + less
            self.count += 1
            self._judge(found)
            nav.watch.report(nav.history.ends_s[-1], "gps_constants", self.found)
        if fate == Fate.RESET:
            self._begin_anew(now.t_s + QUIET_S if not self.found else np.inf)

    def _begin_anew(self, t_s):
        """Forget what the innovations have shown; from t_s [s] on they count again."""
        self.sums.J[:], self.sums.y[:] = 0.0, 0.0
        self.beyond, self.count, self.begins_s = 0.0, 0, t_s

    def _judge(self, found):
        """Whether a constant is wrong; one that was stays so while anything speaks for it.

        found : of TIME and of ARM, their values and by how much they make the squares of the innovations less
        """
        best, words = 0.0, ""
        parts = (TIME, LEAST[0], _time), (ARM, LEAST[1], _arm)
        for (part, least, say), (value, explained) in zip(parts, (found[:2], found[2:]), strict=True):
            if self.wrong == part and explained > OVER * _limit(part):
                self.found = say(value)
                return
            enough = explained > _limit(part) and explained > EXPLAINED * self.beyond
            if enough and np.sqrt(value @ value) > least and explained - _limit(part) > best:
                best, words, self.wrong = explained - _limit(part), say(value), part
        self.found = words if self.count >= FEWEST else ""
        self.wrong = self.wrong if self.found else None


@kernel
def _take(B, sums, seen, what, judges, learns):
    """Take a measurement in: B, sums in place. seen : Shown;  what : of `SHOWS`;  judges, learns : bool

    -> by how much the square of the innovation is beyond its mean; values of TIME and by how much they make
    the squares less; likewise of ARM
    """
    B, sums, seen = lent((B, sums, seen))
    x, z, H, beyond = seen.x, seen.z, seen.H, 0.0
    v_i, C_ib = x[X_V].copy(), rotation.dcm_from_quat(x[X_Q])
    if seen.dt_s > 0.0:
        _carry(B, sums.v_i, sums.C_ib, x[X_R], v_i, C_ib, seen.dt_s)
        if seen.clock >= 0:
            B[seen.clock] += seen.dt_s * B[seen.clock + 1]
    if not seen.dt_s < 0.0:  # else the time until then would be carried again
        sums.v_i[:], sums.C_ib[:] = v_i, C_ib
    h, both = _shown(seen, what) - H @ B, np.empty((len(z), 5))
    if what >= VELOCITY and np.isnan(seen.f_i[0]):
        h[:] = 0.0  # whatever it shows is not known
    both[:, :4], both[:, 4] = h, z
    solved = np.linalg.solve(seen.S, both)
    by_h, by_z = np.ascontiguousarray(solved[:, :4]), np.ascontiguousarray(solved[:, 4])
    J, y = sums.J, sums.y
    time, by_time, arm, by_arm = np.zeros(1), 0.0, np.zeros(3), 0.0
    if judges:
        J += h.T @ by_h
        y += h.T @ by_z
        beyond = z @ by_z - len(z)
        time, by_time = _best(J[:1, :1].copy(), y[:1].copy())
        arm, by_arm = _best(J[1:, 1:].copy(), y[1:].copy())
    if learns:
        B += seen.P @ H.T @ by_h
    return beyond, time, by_time, arm, by_arm


@inner
def _best(J, y):
    """The value that explains most, and how much; nothing where J (k, k) does not tell. y : (k,)"""
    tells = np.isfinite(J).all() and np.isfinite(y).all() and (np.diag(J) > 0.0).all()
    if not tells or (len(y) > 1 and np.linalg.cond(J) > CONDITION):
        return np.zeros(len(y)), 0.0
    value = np.linalg.solve(J, y)
    return value, y @ value


@inner
def _carry(B, before_v_i, before_C_ib, r_i, v_i, C_ib, dt_s):
    """The response on by dt_s, in place.

    B : (n, 4);  before_v_i, before_C_ib : at the last measurement;  r_i, v_i, C_ib : now
    """
    sensed = v_i - before_v_i - _gravity(r_i) * dt_s  # vibration, which is noise, has no part in the mean
    turn_i = before_C_ib @ B[ATT]
    gained = -rotation.skew(sensed) @ turn_i
    B[POS] += dt_s * (B[VEL] + 0.5 * gained)
    B[VEL] += gained
    B[ATT] = C_ib.T @ turn_i


@inner
def _gravity(r_i):
    """(3,) m/s^2 at r_i [m]."""
    return -wgs84.GM / (r_i @ r_i) ** 1.5 * r_i


@kernel
def _read(memory, oldest, newest, t_s):
    """Means of what the sensors have read in the `SPAN_S` before an instant, as far as the memory has it: of
    the ticks that end in it, or of the last one before the instant.

    memory : prediction.Memory;  oldest, newest : numbers of ticks;  t_s : s
    -> omega_b (3,) rad/s, body axes; f_i (3,) m/s^2, inertial axes; NaN: the memory has nothing
    """
    memory = lent(memory)
    turned_b, gained_i, covered_s = np.zeros(3), np.zeros(3), 0.0
    for number in range(newest, oldest - 1, -1):
        k = number % len(memory.numbers)
        end_s, dt_s, n = memory.numbers[k, 0], memory.numbers[k, 1], int(memory.numbers[k, 2])
        if n == 0 or (covered_s > 0.0 and end_s < t_s - SPAN_S + SAME_S):
            break
        if end_s > t_s + SAME_S:
            continue
        increments = memory.increments[k, BEFORE : BEFORE + n].sum(axis=0)
        turned_b += increments[:3]
        gained_i += rotation.dcm_from_quat(memory.xs[k, X_Q]) @ increments[3:]
        covered_s += n * dt_s
    if covered_s == 0.0:
        return np.full(3, np.nan), np.full(3, np.nan)
    return turned_b / covered_s, gained_i / covered_s


@inner
def _shown(seen, what):
    """What a unit of each constant shows in a measurement, (m, 4). seen : Shown;  what : of `SHOWS`"""
    x, H, turns_i = seen.x, seen.H, seen.omega_ie_i
    s = np.zeros((len(H), 4))
    if what == NOTHING:
        return s
    v_r = x[X_V] - np.cross(turns_i, x[X_R])
    if what == POSITION:
        s = _of_position(H, x, v_r)
    else:
        a_i = seen.f_i + _gravity(x[X_R])
        a_r = a_i - np.cross(turns_i, x[X_V] + v_r)
        if what == RATES:
            s = _of_position(H, x, v_r)
            a_r += np.cross(turns_i, v_r)
        s += _of_velocity(H, x, a_r, seen.omega_b, seen.l_ba_b)
    if v_r @ v_r <= MOVES**2 * np.trace(seen.P[VEL, VEL]):
        s[:, TIME] = 0.0
    return s


@inner
def _of_position(H, x, v_r):
    """(m, 4) of the position of a GPS fix, what a unit of each constant shows in it.

    H : (m, n);  x : (X,) packed values;  v_r : (3,) m/s, over ground, inertial axes
    """
    shown = np.empty((3, 4))
    shown[:, 0] = -v_r
    shown[:, 1:] = rotation.dcm_from_quat(x[X_Q])
    return np.ascontiguousarray(H[:, POS]) @ shown


@inner
def _of_velocity(H, x, a_r, omega_b, l_ba_b):
    """Likewise of its velocity.

    a_r : (3,) m/s^2, of the IMU over ground, inertial axes;  omega_b : (3,) rad/s;  l_ba_b : (3,) m
    """
    shown, turning = np.empty((3, 4)), rotation.dcm_from_quat(x[X_Q]) @ rotation.skew(omega_b)
    shown[:, 0] = -a_r - turning @ np.cross(omega_b, l_ba_b)
    shown[:, 1:] = turning
    return np.ascontiguousarray(H[:, VEL]) @ shown


def _limit(part):
    """Of chi-square."""
    return chi_square_limit(PROBABILITY, part.stop - part.start)


def _time(value):
    side = "before" if value[0] > 0.0 else "after"
    return f"time of its fixes wrong: measured about {1e3 * abs(value[0]):.0f} ms {side} it"


def _arm(value):
    off_m = np.sqrt(value @ value)
    about = f"by about {float(f'{off_m:.2g}'):g} m"
    if off_m > LONGEST_ARM_M:
        return f"its fixes are off {about} in the axes of the body: no lever arm is so long"
    return f"lever arm wrong: {about}"
