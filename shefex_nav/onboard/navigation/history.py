"""The memory of the filter: its last ticks, in arrays that the kernels of `prediction` read and write.

Tick k, counted from the start, stands in place k modulo the size of the arrays, which grow when they must.
What leaves this module is copied, so later ticks and later measurements do not change it.
"""

from bisect import bisect_left
from collections import deque
from itertools import islice
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation.calibration import acting, correct_increments
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.prediction import RATE_NOISE, Memory
from shefex_nav.onboard.navigation.state import X_MOUNTING, X_Q, X_R, X_V, unpack
from shefex_nav.onboard.navigation.strapdown import BEFORE, ImuWindow

NOTHING = np.empty(0)  # in the place of a sample


class Tick(NamedTuple):
    """The filter at the end of a tick."""

    t_s: float
    x: np.ndarray  # (X,) packed nominal state
    P: np.ndarray  # (n, n)
    imu: ImuWindow | None  # that led here; None at the start

    @property
    def state(self):
        """NavState."""
        return unpack(self.t_s, self.x)


class Corrected(NamedTuple):
    """All that the filter has corrected until the end of a tick, inertial axes."""

    number: int  # of the tick
    A: np.ndarray  # (4,) by what the camera was turned, one rotation after the other (`integrity_gyro`)
    dr: np.ndarray  # (3,) m, sum of dr_k - t_k dv_k over the corrections of the position and of the velocity
    dv: np.ndarray  # (3,) m/s


class Corrections:
    """What the filter has corrected: without it, the state is where the inertial sensors alone had led.

    kept : deque of Corrected, as far back as the filter may go
    """

    def __init__(self):
        self.kept = deque([Corrected(-1, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))])

    def back_to(self, number):
        """The filter goes back to the end of a tick: corrections after it are not made yet."""
        while self.kept[-1].number > number:
            self.kept.pop()

    def add(self, number, oldest, t_s, x_before, x_after):
        """The filter has corrected its packed values at t_s in a tick; `oldest`: first it may go back to."""
        _, A, dr, dv = self.kept[-1]
        self.kept.append(Corrected(number, *_corrected(A, dr, dv, t_s, x_before, x_after)))
        while self.kept[1].number <= oldest:
            self.kept.popleft()

    def until(self, number):
        """Corrected until the end of a tick."""
        return next((one for one in reversed(self.kept) if one.number <= number), self.kept[0])


@inner
def camera_attitude(x):
    """Attitude of the camera, but for its nominal mounting, by packed values: (4,)."""
    return rotation.quat_multiply(x[X_Q], rotation.quat_from_rotvec(x[X_MOUNTING]))


@kernel
def _corrected(A, dr, dv, t_s, x_before, x_after):
    """A, dr, dv of a Corrected after an update at t_s, from packed values."""
    before = rotation.quat_conjugate(camera_attitude(x_before))
    moved = rotation.quat_multiply(camera_attitude(x_after), before)
    more = x_after[X_V] - x_before[X_V]
    dr = dr + (x_after[X_R] - x_before[X_R] - t_s * more)
    return rotation.quat_normalise(rotation.quat_multiply(moved, A)), dr, dv + more


class History:
    """Ticks, oldest first, at least one.

    ends_s : deque of the mission times at which they end
    measurements : deque of tuples, what is valid within each, in the order of their instants
    oldest, newest : numbers of the first and of the last tick
    x, P : (X,), (n, n) of the instant that has been reached: the end of the last tick, but for `fusion` on
        its way
    numbers : (size, 7) mission time of the end [s], s of a sample, number of samples, vibration, rate noise
    increments : (size, 2 + samples, 6) of ImuWindow;  extra, drives : (size, 3, 3), (size, 6, m) likewise
    xs, Ps : (size, X), (size, n, n)
    arrays : these and x, P as `prediction.propagate` takes them, Memory
    corrections : Corrections until the instant that has been reached
    used_s : {sensor: instant of its last fix that was used before the instant that has been reached}; kept
        where a fix counts by how long ago that was (`sensor.Sensor.counted`)
    """

    def __init__(self, tick, driving=0, used_s=None):
        """tick : the first;  driving : m of the ImuWindows;  used_s : at the first, None: nothing"""
        self.ends_s, self.measurements = deque([tick.t_s]), deque([()])
        self.oldest = self.newest = 0
        self.x, self.P = tick.x.copy(), tick.P.copy()
        self.used_s, self._gone_used_s = {}, dict(used_s or {})
        self.corrections = Corrections()
        samples = 0 if tick.imu is None else tick.imu.n
        self._allocate(2, samples, driving)
        self.numbers[0, :2] = tick.t_s, 1.0
        if tick.imu is not None:
            self.numbers[0, 1:] = tick.imu.dt_s, samples, tick.imu.vibration, *tick.imu.rate_noise
            self.increments[0], self.extra[0] = tick.imu.increments, tick.imu.extra
            self.drives[0] = tick.imu.drive
        self.xs[0], self.Ps[0] = tick.x, tick.P

    def _allocate(self, size, samples, driving):
        """Make the arrays."""
        self.numbers, self.extra = np.zeros((size, RATE_NOISE.stop)), np.zeros((size, 3, 3))
        self.increments, self.drives = np.zeros((size, BEFORE + samples, 6)), np.zeros((size, 6, driving))
        self.xs, self.Ps = np.empty((size, *self.x.shape)), np.empty((size, *self.P.shape))
        self.arrays = Memory(
            self.numbers, self.increments, self.extra, self.xs, self.Ps, self.x, self.P, self.drives
        )

    def __len__(self):
        return len(self.ends_s)

    def __getitem__(self, k):
        """Tick k, 0 the oldest, -1 the last."""
        place = self.place(k)
        return Tick(self.ends_s[k], self.xs[place].copy(), self.Ps[place].copy(), self.imu(k))

    def number(self, k):
        """Number of tick k since the start."""
        return self.oldest + k if k >= 0 else self.newest + 1 + k

    def place(self, k):
        """Where tick k stands in the arrays."""
        return self.number(k) % len(self.numbers)

    def imu(self, k):
        """ImuWindow of tick k, None at the start."""
        place = self.place(k)
        _, dt_s, n, vibration, *noise = self.numbers[place].tolist()
        if n == 0:
            return None
        increments = self.increments[place, : BEFORE + int(n)].copy()
        extra, drive = self.extra[place].copy(), self.drives[place].copy()
        return ImuWindow(self.ends_s[k], dt_s, increments, vibration, extra, drive, np.array(noise))

    def length_s(self, k):
        """Duration of tick k."""
        place = self.place(k)
        return float(self.numbers[place, 2] * self.numbers[place, 1])

    def since(self, k, begin_s, t_s):
        """Where an instant lies in tick k: s from its start, with what is nearer than `SAME_S` taken for
        begin_s, or for the end of the tick."""
        length_s = self.length_s(k)
        at_s = t_s - (self.ends_s[k] - length_s)
        if at_s > length_s - SAME_S:
            return length_s
        return at_s if at_s - begin_s > SAME_S else begin_s

    def moment(self, k, begin_s, t_s):
        """The Moment of an instant in tick k, for when it has been reached; as `since`."""
        return Moment(self, k, self.since(k, begin_s, t_s))

    def make_room(self, samples, ticks=1):
        """Place of the next tick, with places for `ticks`; what stands there is to be overwritten."""
        size = len(self.numbers)
        while len(self.ends_s) + ticks > size or BEFORE + samples > self.increments.shape[1]:
            size = 2 * size
            self._grow(size, max(samples, self.increments.shape[1] - BEFORE))
        return (self.newest + 1) % len(self.numbers)

    def _grow(self, size, samples):
        """Larger arrays."""
        before = self.numbers, self.increments, self.extra, self.xs, self.Ps, self.drives
        old = [self.place(k) for k in range(len(self))]
        self._allocate(size, samples, self.drives.shape[2])
        new = [self.place(k) for k in range(len(self))]
        self.numbers[new], self.extra[new] = before[0][old], before[2][old]
        self.increments[new, : before[1].shape[1]] = before[1][old]
        self.xs[new], self.Ps[new], self.drives[new] = before[3][old], before[4][old], before[5][old]

    def extend(self, ends_s):
        """The next ticks, which end at the times of a list, have been filled in."""
        self.newest += len(ends_s)
        self.ends_s.extend(ends_s)
        self.measurements.extend([()] * len(ends_s))

    def forget_until(self, t_s):
        """Let the ticks go before the last that ends at t_s or earlier."""
        ends_s, measurements = self.ends_s, self.measurements
        while len(ends_s) > 1 and ends_s[1] <= t_s:
            ends_s.popleft()
            self.oldest += 1
            if gone := measurements.popleft():
                self._gone_used_s |= _used_s(gone)

    def used_before(self, k):
        """`used_s` where tick k begins."""
        used_s = self._gone_used_s.copy()
        for measurements in islice(self.measurements, k):
            used_s |= _used_s(measurements)
        return used_s

    def go_to(self, k):
        """Begin again at the end of tick k."""
        place = self.place(k)
        self.x[:], self.P[:] = self.xs[place], self.Ps[place]

    def back_to(self, k):
        """As `go_to`; what was corrected after it is to be corrected anew."""
        self.go_to(k)
        self.corrections.back_to(self.number(k))

    def within(self, t_s):
        """Index of the tick in which t_s lies, after the tick before and not after its own end; or None."""
        if not self.ends_s[0] + SAME_S < t_s <= self.ends_s[-1] + SAME_S:
            return None
        return bisect_left(self.ends_s, t_s - SAME_S)

    def nearest(self, t_s):
        """Place of the tick whose end is nearest to t_s, of those that have IMU samples."""
        first = 1 if self.numbers[self.place(0), 2] == 0 else 0
        later = min(max(bisect_left(self.ends_s, t_s), first), len(self) - 1)
        earlier = max(later - 1, first)
        return self.place(earlier if t_s - self.ends_s[earlier] <= self.ends_s[later] - t_s else later)


def _used_s(measurements):
    """{sensor: instant of its last fix that was used} of the measurements of a tick."""
    return {one.sensor: one.fix.t_valid_s for one in measurements if one.fate in (Fate.USED, Fate.RESET)}


class Moment:
    """The instant that a filter on its way through its history has reached, at_s in its tick k.

    x, P : (X,), (n, n), the present values of the History, not copied
    place : of the tick in its arrays;  dt_s, vibration : of a sample, level in the tick
    """

    def __init__(self, history, k, at_s):
        self.history, self.k, self.at_s = history, k, at_s
        self.x, self.P, self.place = history.x, history.P, history.place(k)
        _, self.dt_s, n, self.vibration = history.numbers[self.place, : RATE_NOISE.start].tolist()
        self.t_s = history.ends_s[k] - (n * self.dt_s - at_s)

    @property
    def state(self):
        """NavState, a copy."""
        return unpack(self.t_s, self.x.copy())

    @property
    def imu(self):
        """ImuWindow of the tick."""
        return self.history.imu(self.k)

    def bend(self, exposure_s):
        """By how much the mean attitude over an exposure around this instant differs from that at it.

        A camera that turns at a steady rate shows the attitude in the middle of its exposure; while the rate
        changes, by a in a second, the mean is off by about a T^2/24.

        exposure_s : s -> (3,) rad, body axes; nothing where the memory does not cover the exposure
        """
        return _bend(self._samples, self._ticks, self.t_s, 0.5 * exposure_s)

    @property
    def drive(self):
        """Of the ImuWindow of the tick, not copied."""
        return self.history.drives[self.place]

    @property
    def extra(self):
        """Of the ImuWindow of the tick, not copied."""
        return self.history.extra[self.place]

    @property
    def sensed(self):
        """Corrected rate and specific force about the instant, omega_ib_b (3,) rad/s, f_b (3,) m/s^2."""
        sensed = self.sensed_packed
        return sensed[:3], sensed[3:]

    @property
    def sensed_packed(self):
        """`sensed` in one array, (6,)."""
        return _sensed(self._samples, self._ticks, self.at_s, self.x, self.vibration, self.drive)

    def about(self):
        """What the IMU measured in the time of one sample about the instant. -> Readings"""
        return Readings(self.dt_s, *_about(self._samples, self._ticks, self.at_s))

    @property
    def _samples(self):
        """Of the History, for kernels."""
        return self.history.numbers, self.history.increments, self.history.extra

    @property
    def _ticks(self):
        """Numbers of the oldest tick of the History, of its newest and of that of the instant."""
        return self.history.oldest, self.history.newest, self.history.number(self.k)


class Readings(NamedTuple):
    """What the IMU measured in the time of one sample about an instant, rad and m/s.

    Half of it lies after the instant. Where that has not been measured, or a gyro was not read in the tick
    beside, it is the sample in which the instant lies.
    """

    dt_s: float
    increments: np.ndarray  # (6,)
    share: float  # of the second of the two samples that it is made of
    missed: np.ndarray  # (6,) error of `increments` by their change so far; all of them if it is not known


@kernel
def _sensed(samples, ticks, at_s, x, vibration, drive):
    """`Moment.sensed_packed`, corrected with the estimates of packed values x; as `_about`."""
    increments, dt_s = _about(samples, ticks, at_s)[0], samples[0][ticks[2] % len(samples[0]), 1]
    return correct_increments(acting(x, vibration, drive), increments.reshape(1, 6), dt_s)[0] / dt_s


@kernel
def _about(samples, ticks, at_s):
    """`Moment.about` but for the duration. samples, ticks, at_s : of a Moment"""
    numbers, increments, _ = samples
    place = ticks[2] % len(numbers)
    own, dt_s, n = increments[place], numbers[place, 1], int(numbers[place, 2])
    at = at_s / dt_s
    k = BEFORE - 1 + min(max(int(np.ceil(at - 1e-6)), 1), n)
    past = at - (k - BEFORE + 0.5) if n > 0 else 0.0  # the middle of the sample in which it lies
    before = own[k - 1] if k > BEFORE or _is_read(samples, ticks, -1) else NOTHING
    after = own[k + 1] if k + 1 < BEFORE + n else _next_sample(samples, ticks, dt_s)
    beside, other, share = (after, before, past) if past > 0.0 else (before, after, -past)
    if len(beside) == 0:
        return own[k].copy(), 0.0, share * (own[k] if len(other) == 0 else own[k] - other)
    return (1.0 - share) * own[k] + share * beside, share, np.zeros(6)


@inner
def _is_read(samples, ticks, step):
    """Whether the gyros were read in the tick `step` after that of an instant, and it is remembered."""
    (_, _, extra), (oldest, newest, number) = samples, ticks
    return oldest <= number + step <= newest and not extra[(number + step) % len(extra), 0].any()


@inner
def _next_sample(samples, ticks, dt_s):
    """The first of the tick that follows, for a duration of dt_s; NOTHING: there is none to rely on."""
    if not _is_read(samples, ticks, 1):
        return NOTHING
    numbers, increments, _ = samples
    place = (ticks[2] + 1) % len(numbers)
    return dt_s / numbers[place, 1] * increments[place, BEFORE]


@kernel
def _bend(samples, ticks, t_s, half_s):
    """`Moment.bend`: the integral of the rate with the weight that a turn at each time has in the mean.

    A turn before the middle is in the attitude at the middle, but only in the later part of the exposure:
    -(half + t)/(2 half); one after it is in the rest of the exposure alone: (half - t)/(2 half).
    """
    (numbers, increments, _), (oldest, newest, _) = samples, ticks
    out, size, covered_s = np.zeros(3), len(numbers), 0.0
    for number in range(newest, oldest - 1, -1):
        k = number % size
        h, n = numbers[k, 1], int(numbers[k, 2])
        if n == 0 or numbers[k, 0] <= t_s - half_s:
            break
        for m in range(n):
            end_s = numbers[k, 0] - (n - 1 - m) * h
            a, b = max(end_s - h, t_s - half_s) - t_s, min(end_s, t_s + half_s) - t_s
            if b <= a:
                continue
            covered_s += b - a
            weight = 0.0
            if a < 0.0:
                c = min(b, 0.0)
                weight -= ((half_s + c) ** 2 - (half_s + a) ** 2) / (4.0 * half_s)
            if b > 0.0:
                c = max(a, 0.0)
                weight += ((half_s - c) ** 2 - (half_s - b) ** 2) / (4.0 * half_s)
            for i in range(3):
                out[i] += weight / h * increments[k, BEFORE + m, i]
    if covered_s < 2.0 * half_s - SAME_S:
        out[:] = 0.0
    return out
