"""Bank of windows over the innovations of each sensor: what no single fix shows, several do.

A fault that begins inside the gate is followed by the filter, and each of its innovations can be believed.
With w = L^-1 z, S = L L^T, over the last n innovations of a sensor, d numbers each,

    size   sum |w_k|^2        ~ chi-square, n d degrees of freedom
    run    |sum w_k|^2 / n    ~ chi-square, d degrees of freedom

for every n of `WINDOWS`: short ones see a step soon, long ones see what lasts. The size is taken of position
and velocity of a fix together, too. A bank of windows is a generalised likelihood ratio test for a change at
an unknown instant (Willsky and Jones, IEEE TAC 21, 1976; Basseville and Nikiforov, Detection of Abrupt
Changes, 1993, section 2.4); a cumulative sum would have to be told how large the change is.

An alarm says that the solution and a sensor do not agree, not which of them is wrong. The solution is not to
be used then. Its covariance grows by what the innovations show, and what was learnt is doubted
(`integrity_learnt`), so that the next fixes put right what can be put right. The alarm is over when
`CALM` innovations of each sensor that still speaks have the size of healthy ones, and not before `LEAST_S`.

A fix or two that are refused are left to `integrity.judge`: each counts for no more than `CLIPPED`, which is
too little for an alarm. A sensor that is refused now and then, and used in between, is found here alone. Of a
star tracker only the fixes that are used count, and only their runs: single wrong fixes are its everyday
life, and ten fixes a second show every small mistake in what was told of the noise of the gyros. A GPS
position whose velocity goes on does not count while it is refused. Errors of a position that last make its
innovations hang together, and `integrity_gps` looks for drifts beyond them: such positions are not looked at
here. Nor are ranges, single stars, barometer and magnetometer.
"""

from collections import deque
from functools import cache
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.onboard.navigation import adaptation, eskf, integrity_learnt, integrity_watch
from shefex_nav.onboard.navigation.eskf import MOST_GROWN, Grown
from shefex_nav.onboard.navigation.integrity import Fate, Innovations, chi_square_limit
from shefex_nav.onboard.navigation.noise_evidence import CHANCE
from shefex_nav.onboard.navigation.quantity import ATTITUDE, POSITION, VECTORS, VELOCITY, fix_of

WINDOWS = np.array([3, 4, 6, 8, 12, 16, 24, 32, 48, 64])  # innovations
CALM = 10  # innovations after an alarm, whose size and run are healthy: it is over
CALM_CHANCE = 1e-2  # of not calling them healthy
CLIPPED = 25.0  # [E] squared length of an innovation at most: one, or two in a row, raise no alarm
LEAST_S = 5.0  # [E] that an alarm lasts
SPEAKS_S = 15.0  # [E] what a sensor said so long ago neither prolongs an alarm nor makes anything grow
LEAST, MOST = 2.0, 8.0  # [E] factor of sigma after an alarm
OWN = 0.95  # [E] share of a sensor's own noise in its innovations at most, when the factor is found
GPS = "gps"  # position and velocity together
GROUPS = {**dict.fromkeys((*VECTORS, GPS), GPS), "star_tracker": "star_tracker"}
WAITS_S = {GPS: 0.0, "star_tracker": 4.0}  # [E] until anything grows: stars tell of gyros by themselves


class Finding(NamedTuple):
    """A window whose innovations are too large."""

    words: str
    excess: float  # of the variance of an innovation, over what it should be, less one
    mean: np.ndarray  # (d,) whitened, of the window
    one_sided: bool


class Alarm(NamedTuple):
    """What is to be doubted."""

    t_s: float
    factor: float  # of all sigmas
    mean: np.ndarray  # mean innovation, in its own unit


class Stream(Innovations):
    """Innovations of a sensor, judged over `WINDOWS`.

    d : numbers of each;  sizes : whether their size counts, besides the run
    fed_s : s, of the last
    recent : the last ones, from before an alarm, too, and the share of the sensor's own noise in each
    """

    def __init__(self, d, sizes=True):
        super().__init__(WINDOWS[-1])
        self.d, self.fed_s = d, -np.inf
        self.recent = deque(maxlen=adaptation.RECENT)
        self.sizes, self.run = limits(d, CHANCE)
        if not sizes:
            self.sizes = np.full(len(WINDOWS), np.inf)

    def take(self, w, now_s=0.0, own=1.0):
        """Take a whitened innovation (d,) in. -> Finding or None"""
        self.add(w)
        self.recent.append((w, own))
        self.fed_s = now_s
        k, of_run, value = _worst(self.kept, self.n, WINDOWS, self.sizes, self.run)
        if k < 0:
            return None
        count = int(WINDOWS[k])
        excess = (value / self.d - 1.0) / count if of_run else value / (count * self.d) - 1.0
        what = "on one side" if of_run else "too large"
        return Finding(f"{what}: of {count} fixes", excess, self.last(count).mean(axis=0), of_run)

    def calm(self):
        """Whether the last innovations are healthy; not before there are `CALM`."""
        if self.n < CALM:
            return False
        last, (sizes, run) = self.last(CALM), limits(self.d, CALM_CHANCE, (CALM,))
        total = last.sum(axis=0)
        small = (last * last).sum() < sizes[0] or np.isinf(self.sizes[0])
        return bool(small and total @ total / CALM < run)


@cache
def limits(d, chance, windows=None):
    """Chi-square limits of the size of each window, and of the run. -> (len(windows),), float"""
    sizes = [chi_square_limit(chance, d * n) for n in (WINDOWS.tolist() if windows is None else windows)]
    return np.array(sizes), chi_square_limit(chance, d)


@kernel
def _worst(kept, n, windows, sizes, run):
    """Window that is furthest beyond its limit: its place or -1, whether by its run, and the value."""
    d, size, done, found, of_run, value, worst = kept.shape[1], 0.0, 0, -1, False, 0.0, 1.0
    total = np.zeros(d)
    for k in range(len(windows)):
        if windows[k] > n:
            break
        while done < windows[k]:
            done += 1
            for i in range(d):
                w = kept[n - done, i]
                size += w * w
                total[i] += w
        along = 0.0
        for i in range(d):
            along += total[i] * total[i]
        along /= windows[k]
        if size > worst * sizes[k]:
            found, of_run, value, worst = k, False, size, size / sizes[k]
        if along > worst * run:
            found, of_run, value, worst = k, True, along, along / run
    return found, of_run, value


class Bank:
    """Memory, changed in place. The alarms are in `integrity_watch.Watch.alarms`.

    streams : {sensor, or "gps" of position and velocity together: Stream}
    due : {group of sensors: Alarm}, for which the covariance has still to grow
    before : {group of sensors: s}, of the last alarm for which it has grown
    position : s, whitened innovation of the last GPS position
    """

    def __init__(self):
        self.streams, self.due, self.before, self.position = {}, {}, {}, (np.nan, None)

    def forget(self, group):
        """What came before was judged by another covariance."""
        for name, stream in self.streams.items():
            if GROUPS[name] == group:
                stream.forget()

    def begin_anew(self):
        """Another noise counts: what the innovations of GPS were says nothing any more."""
        self.forget(GPS)
        for name in VECTORS:
            if name in self.streams:
                self.streams[name].recent.clear()

    def explained(self, nav, group):
        """An alarm is over, if there is one: it is known what was wrong."""
        self.forget(group)
        self.due.pop(group, None)
        if nav.watch.alarms.pop(group, None) is not None:
            nav.watch.report(nav.history.ends_s[-1], f"{group} innovations", "")

    def take(self, nav, now, z, R, S, measurement, verdict):
        """Verdict on a new measurement after the bank has seen it.

        nav : Filter;  now : Moment;  z, R, S : of the measurement;  verdict : gate.Verdict so far
        -> gate.Verdict, the same unless there is an alarm, for which the covariance grows
        """
        name, fate = measurement.sensor, verdict.fate
        if name not in GROUPS:
            return verdict
        group, now_s = GROUPS[name], nav.history.ends_s[-1]
        if fate == Fate.RESET and (isinstance(verdict.admitted, Grown) or fix_of(name) is POSITION):
            self.forget(group)
            self.due.pop(group, None)
        elif fate == Fate.RESET:
            self.explained(nav, group)  # what is believed now has its own doubts
        elif _counts(nav, name, fate):
            w, own = eskf.weighed(z, R, S)
            found = self._found(nav, name, measurement.fix, _clipped(w), own)
            if found is not None:
                self._alarm(nav, group, name, found, own, S)
        if group in self.due and fate == Fate.USED and not _insists(nav, group):
            alarm = self.due[group]
            if now_s - alarm.t_s >= WAITS_S[group]:
                del self.due[group]
                if now_s - alarm.t_s < SPEAKS_S:
                    return self._doubted(nav, now, group, alarm, verdict)
        if group in nav.watch.alarms:
            self._look(nav, group, now_s)
        return verdict

    def _found(self, nav, name, fix, w, own):
        """Finding of a sensor, or of position and velocity of one fix, or None."""
        now_s, lasting = nav.history.ends_s[-1], nav.params.lasting_share > 0.0
        if fix_of(name) is POSITION and lasting:
            return None
        found = self._stream(name, len(w)).take(w, now_s, own)
        if fix_of(name) is POSITION:
            self.position = fix.t_valid_s, w
        elif fix_of(name) is VELOCITY and self.position[0] == fix.t_valid_s:
            both = np.concatenate([self.position[1], w])
            found = self._stream(GPS, len(both)).take(both, now_s, own) or found
        return found

    def _stream(self, name, d):
        if name not in self.streams or self.streams[name].d != d:
            self.streams[name] = Stream(d, fix_of(name) is not ATTITUDE)
        return self.streams[name]

    def _alarm(self, nav, group, name, found, own, S):
        """The solution is withdrawn; the covariance grows before the next fix that is used."""
        now_s = nav.history.ends_s[-1]
        nav.watch.alarms[group] = now_s
        nav.watch.report(now_s, f"{group} innovations", f"{name}: {found.words}")
        factor = np.sqrt(1.0 + max(found.excess, 0.0) / (1.0 - min(own, OWN)))
        mean = np.linalg.cholesky(S) @ found.mean[-len(S) :]
        if fix_of(name) is POSITION and found.one_sided and not nav.watch.moved:
            nav.watch.moved.add(mean)  # the filter has followed it, and follows it still
        self.due[group] = Alarm(now_s, float(np.clip(factor, LEAST, MOST)), mean)
        self.forget(group)

    def _doubted(self, nav, now, group, alarm, verdict):
        """Verdict on a fix before which the covariance grows, and what was learnt is doubted.

        Positions that scatter tell of their receiver at once. What was learnt from it was believed too much,
        and grows to what was known at the start at most: that was right. The second time within a minute says
        that the first has mended nothing: then noise was told too small. Vibration is noise of another kind.
        """
        of_receiver = False
        before, self.before[group] = self.before.get(group, -np.inf), alarm.t_s
        again = alarm.t_s - before < adaptation.LOOP_S
        if group == GPS:
            nav.watch.learnt.forget()
            doubts = integrity_learnt.doubts(nav.params, nav.layout, None, now.x, now.P)
            of_receiver = adaptation.blame_receiver(nav, self.streams)
            if again and not of_receiver and not now.vibration and not verdict.insisted:
                verdict = adaptation.too_large_again(nav, now, alarm.factor, verdict, self.streams)
        else:
            doubts = integrity_learnt.by_stars(nav, now, alarm.mean, False)
        if verdict.fate != Fate.RESET:
            admitted = integrity_learnt.widened(nav, now.P, alarm.factor, 1.0 if of_receiver else MOST_GROWN)
            verdict = verdict._replace(fate=Fate.RESET, admitted=admitted, note="what was learnt is doubted")
        return verdict._replace(doubts=doubts)

    def _look(self, nav, group, now_s):
        """Whether an alarm is over: every sensor of the group that still speaks is calm."""
        if now_s - nav.watch.alarms[group] < LEAST_S:
            return
        speaking = [
            stream
            for name, stream in self.streams.items()
            if GROUPS[name] == group and now_s - stream.fed_s < SPEAKS_S
        ]
        if speaking and all(one.calm() for one in speaking):
            del nav.watch.alarms[group]
            nav.watch.report(now_s, f"{group} innovations", "")


def _counts(nav, name, fate):
    """Whether an innovation counts. A refused star fix does not, nor a refused position that jumps alone."""
    if nav.watch.imu_blind or fate not in (Fate.USED, Fate.REJECTED):
        return False
    jumps = fix_of(name) is POSITION and integrity_watch.jumped(nav.health, name)
    alone = fix_of(name) is ATTITUDE or jumps
    return fate == Fate.USED or not alone


def _insists(nav, group):
    """Whether a sensor of a group has just been refused: the gate decides first what becomes of it."""
    return any(nav.health[name].in_a_row for name in nav.health if GROUPS.get(name) == group)


def _clipped(w):
    """A whitened innovation, its length bounded."""
    size = float(w @ w)
    return w if size <= CLIPPED else w * np.sqrt(CLIPPED / size)
