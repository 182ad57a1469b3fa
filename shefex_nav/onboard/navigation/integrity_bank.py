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
`CALM` innovations have the size of healthy ones, `LEAST_S` after it at the earliest.

Of a star tracker only the fixes that are used count, and only their runs: single wrong fixes are its everyday
life, those that insist are judged by `integrity.judge`, and ten fixes a second show every small mistake in
what was told of the noise of the gyros. So it is of a GPS position that contradicts while the velocity
does not. Errors of a position that last make its innovations hang together, and `integrity_gps` looks for
drifts beyond them: such positions are not looked at here.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.onboard.navigation import adaptation, integrity_learnt, integrity_watch
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.sensors import grown
from shefex_nav.onboard.navigation.state import ATT

WINDOWS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64])  # innovations
CHANCE = 1e-9  # of exceeding a limit, per innovation, window and statistic
CALM = 10  # innovations after an alarm, whose size and run are healthy: it is over
CALM_CHANCE = 1e-2  # of not calling them healthy
LEAST_S = 5.0  # [E] that an alarm lasts
CLIPPED = 60.0  # [E] |w|^2 of an innovation at most: a single one is the gate's matter
LEAST, MOST = 2.0, 8.0  # [E] factor of sigma after an alarm
OWN = 0.95  # [E] share of a sensor's own noise in its innovations at most, when the factor is found
GROUPS = {"gps_position": "gps", "gps_velocity": "gps", "gps": "gps", "star_tracker": "star_tracker"}
LIMITS = {}


class Finding(NamedTuple):
    """A window whose innovations are too large."""

    words: str
    of_run: bool  # they are on one side, each of them may be as large as it should
    excess: float  # of the variance of an innovation, over what it should be, less one
    mean: np.ndarray  # (d,) whitened, of the window


class Alarm(NamedTuple):
    """What is to be doubted."""

    factor: float  # of all sigmas
    mean: float  # length of the mean innovation, whitened
    again: bool  # whether innovations are too large for the second time in a minute


class Stream:
    """The last innovations of a sensor, changed in place.

    d : numbers of each;  sizes : whether their size counts, besides the run
    """

    def __init__(self, d, sizes=True):
        self.d, self.n, self.kept = d, 0, np.empty((2 * WINDOWS[-1], d))
        self.sizes, self.run = limits(d, CHANCE)
        if not sizes:
            self.sizes = np.full(len(WINDOWS), np.inf)

    def forget(self):
        """Begin anew."""
        self.n = 0

    def take(self, w):
        """Take a whitened innovation (d,) in. -> Finding or None"""
        if self.n == len(self.kept):
            self.n = len(self.kept) // 2
            self.kept[: self.n] = self.kept[-self.n :]
        self.kept[self.n] = w
        self.n += 1
        k, of_run, value = _worst(self.kept, self.n, WINDOWS, self.sizes, self.run)
        if k < 0:
            return None
        count = int(WINDOWS[k])
        excess = (value / self.d - 1.0) / count if of_run else value / (count * self.d) - 1.0
        what = "on one side" if of_run else "too large"
        words = f"innovations {what}: of {count} fix{'es' if count > 1 else ''}"
        return Finding(words, of_run, excess, self.kept[self.n - count : self.n].mean(axis=0))

    def calm(self):
        """Whether the last innovations have the size of healthy ones; not before there are `CALM`."""
        if self.n < CALM:
            return False
        last = self.kept[self.n - CALM : self.n]
        sizes, run = limits(self.d, CALM_CHANCE, (CALM,))
        total = last.sum(axis=0)
        return bool((last * last).sum() < sizes[0] and total @ total / CALM < run)


def limits(d, chance, windows=None):
    """Chi-square limits of the size of each window, and of the run. -> (len(windows),), float"""
    windows = tuple(WINDOWS) if windows is None else windows
    if (d, chance, windows) not in LIMITS:
        from scipy.special import chdtri

        LIMITS[d, chance, windows] = chdtri(d * np.array(windows), chance), float(chdtri(d, chance))
    return LIMITS[d, chance, windows]


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
        if k > 0 and along > worst * run:  # of one innovation both are the same
            found, of_run, value, worst = k, True, along, along / run
    return found, of_run, value


class Bank:
    """Memory, changed in place. The alarms are in `integrity_watch.Watch.alarms`.

    streams : {sensor, or "gps" of position and velocity together: Stream}
    due : {group of sensors: Alarm} whose doubts wait for a fix that is used
    before : {group of sensors: s}, of the last alarm
    position : s, whitened innovation of the last GPS position
    """

    def __init__(self):
        self.streams, self.due, self.before, self.position = {}, {}, {}, None

    def forget(self):
        """What came before was judged by another covariance."""
        for stream in self.streams.values():
            stream.forget()

    def take(self, nav, now, z, R, S, measurement, verdict):
        """Verdict on a new measurement after the bank has seen it.

        nav : Filter;  now : Moment;  z, R, S : of the measurement;  verdict : gate.Verdict so far
        -> gate.Verdict, the same unless there is an alarm, for which the covariance grows
        """
        name, fate = measurement.sensor, verdict.fate
        if name not in GROUPS or nav.watch.imu_blind or fate in (Fate.HELD, Fate.DOUBTED):
            return verdict
        if fate == Fate.RESET:
            self.forget()
            self.due.pop(GROUPS[name], None)  # what is believed now has its own doubts
            return verdict
        if fate == Fate.REJECTED and (name == "star_tracker" or _is_its_own(nav, name)):
            return verdict
        group, w = GROUPS[name], _whitened(z, S)
        lasting = nav.params.lasting_share > 0.0
        found = None if name == "gps_position" and lasting else self._of(name, w)
        found = (None if lasting else self._together(name, measurement.fix, w)) or found
        if found is not None:
            self._alarm(nav, group, name, found, _own(R, S))
        elif group in nav.watch.alarms:
            self._look(nav, group)
        if group in self.due and fate == Fate.USED and not _insists(nav, group):
            return _doubted(nav, now, group, self.due.pop(group), verdict)
        return verdict

    def _of(self, name, w):
        """Finding of one stream, or None."""
        if name not in self.streams or self.streams[name].d != len(w):
            self.streams[name] = Stream(len(w), name != "star_tracker")
        return self.streams[name].take(w)

    def _together(self, name, fix, w):
        """Finding of position and velocity of one fix, or None."""
        if name == "gps_position":
            self.position = fix.t_valid_s, w
        elif name == "gps_velocity" and self.position is not None and self.position[0] == fix.t_valid_s:
            return self._of("gps", np.concatenate([self.position[1], w]))
        return None

    def _alarm(self, nav, group, name, found, own):
        """The solution is withdrawn; what is to be doubted waits for the next fix that is used."""
        now_s = nav.history.ends_s[-1]
        again = now_s - self.before.get(group, -np.inf) < adaptation.LOOP_S
        nav.watch.alarms[group] = self.before[group] = now_s
        factor = np.sqrt(1.0 + max(found.excess, 0.0) / (1.0 - min(own, OWN)))
        factor, mean = float(np.clip(factor, LEAST, MOST)), float(np.linalg.norm(found.mean))
        self.due[group] = Alarm(factor, mean, again and not found.of_run)
        self.forget()
        nav.watch.tell(now_s, "innovations", f"{name}: {found.words}")

    def _look(self, nav, group):
        """Whether an alarm is over."""
        now_s = nav.history.ends_s[-1]
        streams = [stream for name, stream in self.streams.items() if GROUPS[name] == group]
        if now_s - nav.watch.alarms[group] >= LEAST_S and all(one.calm() for one in streams):
            del nav.watch.alarms[group]
            nav.watch.tell(now_s, "innovations", "")


def _insists(nav, group):
    """Whether a sensor of a group has just been rejected: the gate decides first what becomes of it."""
    return any(nav.health[name].in_a_row for name in nav.health if GROUPS.get(name) == group)


def _is_its_own(nav, name):
    """Whether a rejected GPS position is the receiver's fault: its velocity goes on."""
    return name == "gps_position" and integrity_watch.jumped(nav.health)


def _whitened(z, S):
    """L^-1 z, its length bounded."""
    w = np.linalg.solve(np.linalg.cholesky(S), z)
    size = float(w @ w)
    return w if size <= CLIPPED else w * np.sqrt(CLIPPED / size)


def _own(R, S):
    """Share of a sensor's own noise in its innovations."""
    return float(np.trace(np.linalg.solve(S, R))) / len(R)


def _doubted(nav, now, group, alarm, verdict):
    """Verdict on a fix before which the covariance grows, and what was learnt is doubted.

    The second alarm of GPS within a minute says that the first has mended nothing: then noise was told too
    small. Vibration is noise of another kind.
    """
    sigma, factor = np.sqrt(np.diag(now.P)[ATT]), alarm.factor
    if group == "gps":
        nav.watch.learnt.forget()
        doubts = integrity_learnt.doubts(nav.params, nav.layout, None, now.x, now.P)
        if alarm.again and not now.vibration and not verdict.insisted:
            verdict = adaptation.too_large_again(nav, now, factor, verdict)
    else:
        z = np.array([alarm.mean * float(sigma.max()), 0.0, 0.0])
        doubts = integrity_learnt.by_stars(nav, now, z, False)
    if verdict.fate != Fate.RESET:
        verdict = verdict._replace(
            fate=Fate.RESET, admitted=grown(now.P, factor), note="what was learnt is doubted"
        )
    return verdict._replace(doubts=doubts)
