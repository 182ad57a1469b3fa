"""Who is believed: gate, and release of the gate when a sensor insists.

A measurement whose normalised innovation squared exceeds the chi-square limit is rejected. A filter that
has gone wrong would reject everything from then on, so a sensor that keeps contradicting it is believed in
the end, but only if its rejected fixes agree with each other: GPS fixes through the velocity that
they report, star fixes through the gyros. A lone wrong fix, or a receiver that repeats its last fix,
never gets through.

Inside the gate a fix may be wrong, too, as long as the gate is wide: before the first star fix, and after a
long time without stars. Then a star fix is held until a second one agrees with it through the gyros; the
second is used, the first never. What a sensor that was believed has left open is in `Steps`.
"""

from enum import IntEnum
from functools import cache
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry import rotation
from shefex_nav.late_packages import special
from shefex_nav.records import GpsFix, GpsRanges

LONGEST_PAIR_S = 10.0  # [E] GPS fixes further apart than this are not compared
WIDER = 4.0  # [E] times the variance
SAME = 0.5  # [E] share of an offset, by which one that is the same may differ
LONGEST_STAR_PAIR_S = 60.0  # [E] nor star fixes further apart than this


class Fate(IntEnum):
    """What became of a measurement; decided once, repeated whenever the interval is integrated again."""

    PENDING = 0
    USED = 1
    RESET = 2  # used after everything known of its block was forgotten
    REJECTED = 3
    HELD = 4  # inside a gate that is too wide to trust a fix alone; kept for comparison, never used
    DOUBTED = 5  # not used; what it has misled before is known less well from here on


class GpsEvidence(NamedTuple):
    """A GPS fix against the state that the filter had."""

    fix: GpsFix
    z: np.ndarray  # (3,) m or m/s, innovation
    P: np.ndarray  # (3, 3) of what the filter said of it

    @property
    def R(self):
        """Noise of the position, (3, 3) m^2."""
        return self.fix.R_r_e


class RangeEvidence(NamedTuple):
    """The pseudoranges of an epoch against the state that the filter had, Earth-fixed axes."""

    fix: GpsRanges
    z: np.ndarray  # (3,) m, by what they say that the position is off, whatever the clock; NaN: they do not
    R: np.ndarray  # (3, 3) m^2 of their noise in that
    P: np.ndarray  # (3, 3) m^2 of the position that the filter had

    def is_off(self, limit):
        """Whether it is the position that is off, and not the clock alone. limit : chi-square"""
        return bool(self.z @ np.linalg.solve(self.R + self.P, self.z) > limit)


class StarEvidence(NamedTuple):
    """A star fix against the attitude that the gyros alone have carried on, without corrections."""

    t_valid_s: float
    error_i: np.ndarray  # (4,) rotation from that to the measured attitude, inertial axes
    R_i: np.ndarray  # (3, 3) rad^2


Evidence = GpsEvidence | RangeEvidence | StarEvidence | GpsRanges  # a fix in the form that `agree` compares


class Health(NamedTuple):
    """Record of one sensor."""

    used: int  # measurements used since the start
    rejected: int  # consecutive rejected fixes which agree with each other
    t_first_s: float  # the first of them
    evidence: Evidence | None  # the last of them
    held: Evidence | None = None  # likewise, the last fix inside the gate, where one alone does not count
    first: Evidence | None = None  # likewise, the first of the rejected
    in_a_row: int = 0  # rejected fixes since the last that was not, whether they agree or not
    far: bool = False  # whether one of those was so far off that it says alone that something is wrong


HEALTHY = Health(0, 0, np.nan, None)


@cache
def chi_square_limit(probability, dof):
    """Value that a chi-square variable exceeds with the given probability."""
    return float(special().chdtri(dof, probability))


class Innovations:
    """The last innovations of one sensor, whitened, changed in place.

    kept, n : (N, d), of which the first n rows are filled, the latest last
    """

    def __init__(self, longest):
        """longest : int, how many are kept at least"""
        self.longest, self.kept, self.n = longest, np.empty((0, 0)), 0

    def forget(self):
        """Begin anew: what came before was judged by another model."""
        self.n = 0

    def last(self, count):
        """A copy of the last innovations, `count` or as many as there are: (n, d).

        (0, 0) before the first, which says what d is.
        """
        return self.kept[max(self.n - count, 0) : self.n].copy()

    def add(self, w):
        """Keep another one: (d,)."""
        if not self.n:
            self.kept = np.empty((2 * self.longest, len(w)))
        elif self.n == len(self.kept):
            self.n = self.longest - 1
            self.kept[: self.n] = self.kept[-self.n :]
        self.kept[self.n] = w
        self.n += 1


class Limits(dict):
    """What a normalised innovation squared may be, by degrees of freedom: chi-square, as far as needed yet.

    limits[dof] is exceeded with the probability of the gate, limits[dof, probability] with another one; None
    is that of the gate, too.
    """

    def __init__(self, probability):
        super().__init__()
        self.probability = probability

    def __missing__(self, key):
        dof, probability = key if isinstance(key, tuple) else (key, None)
        self[key] = chi_square_limit(self.probability if probability is None else probability, dof)
        return self[key]


def judge(health, trial, nis, limit, t_valid_s, alone=True):
    """Fate of a measurement.

    Parameters
    ----------
    health : Health of its sensor
    trial : sensors.Trial, what decides if it contradicts the filter, or if one inside the gate is not enough
    nis, limit : normalised innovation squared and its chi-square limit
    t_valid_s : s
    alone : whether a single fix inside the gate is enough

    Returns
    -------
    fate : Fate
    health : Health
    """
    if nis <= limit and not _still_off(health, trial):
        if alone or (health.held is not None and trial.agree(health.held, trial.evidence)):
            return Fate.USED, Health(health.used + 1, 0, np.nan, None)
        return Fate.HELD, health._replace(held=trial.evidence)
    if insists(health, trial):
        rejected, t_first_s, first = health.rejected + 1, health.t_first_s, health.first
    else:
        rejected, t_first_s, first = 1, t_valid_s, trial.evidence
    rule = trial.rule
    if rejected >= rule.rejections and t_valid_s - t_first_s >= rule.duration - SAME_S:
        return Fate.RESET, Health(health.used + 1, 0, np.nan, None)
    in_a_row = health.in_a_row + 1
    return Fate.REJECTED, Health(
        health.used, rejected, t_first_s, trial.evidence, health.held, first, in_a_row
    )


def _still_off(health, trial):
    """Whether a fix inside a gate that has become wider says what the last rejected one has said."""
    if trial is None or trial.still is None or health.evidence is None:
        return False
    return trial.agree(health.evidence, trial.evidence) and trial.still(health.evidence, trial.evidence)


def insists(health, trial):
    """Whether a rejected fix says what those before it have said. Health, sensors.Trial -> bool"""
    if health.evidence is None or not trial.agree(health.evidence, trial.evidence):
        return False
    return trial.steady is None or trial.steady(health.first, trial.evidence)


def offsets_agree(first, later, limit):
    """Whether two GPS positions are off by the same vector.

    A filter whose position is wrong while its velocity is right is off by a constant; a receiver that runs
    away is not.

    first, later : GpsEvidence or RangeEvidence;  limit : chi-square
    """
    d = later.z - first.z
    S = first.R + later.R + later.P
    return float(d @ np.linalg.solve(S, d)) <= limit


def offset_remains(earlier, later):
    """Whether the offset of a GPS position is nearer to an earlier one than to none. As `offsets_agree`"""
    return bool(np.linalg.norm(later.z - earlier.z) < np.linalg.norm(later.z))


def has_widened(earlier, later):
    """Whether the gate of a GPS position is so much wider than it was that it lets the same offset pass.

    earlier, later : GpsEvidence or RangeEvidence
    """
    before, now = (np.trace(one.P + one.R) for one in (earlier, later))
    return bool(now > WIDER * before)


def same_velocity_offset(earlier, later):
    """Whether two GPS velocities are off by the same vector, to half of it.

    A wrong velocity of the receiver is there at once and stays. What noise of the inertial sensors does
    grows from fix to fix.

    earlier, later : GpsEvidence or None, GpsEvidence
    """
    if earlier is None or np.isnan(earlier.fix.v_ea_e[0]):
        return False
    return bool(np.linalg.norm(later.z - earlier.z) < SAME * np.linalg.norm(earlier.z))


def same_direction(earlier, later):
    """Whether two GPS velocities are off to the same side, within 60 deg. GpsEvidence each"""
    along = float(later.z @ earlier.z)
    return bool(along > 0.5 * np.linalg.norm(later.z) * np.linalg.norm(earlier.z))


def gps_fixes_agree(earlier, later, slack):
    """Whether the change of position between two GpsFix is what their velocities say (trapezoidal rule).

    slack : m per second between them, for the accelerations in between and the swing of the antenna.
    Two fixes with the very same position are one fix repeated, and prove nothing.
    """
    dt_s = later.t_valid_s - earlier.t_valid_s
    gap = later.r_ea_e - earlier.r_ea_e - 0.5 * dt_s * (earlier.v_ea_e + later.v_ea_e)
    return _is_within(gap, earlier, later, slack)


def positions_agree(earlier, later, slack):
    """Whether two positions of a receiver that reports no velocity move as the filter does, GpsEvidence each.

    A filter that is off by a constant is off by the same vector twice; slack, m per second between them, is
    also what its velocity may be wrong by. A fix repeated proves nothing, as in `gps_fixes_agree`.
    """
    return _is_within(later.z - earlier.z, earlier.fix, later.fix, slack)


def _is_within(gap, earlier, later, slack):
    """Whether (3,) m, by which two GpsFix do not agree, is 3 sigma at most, and neither repeats the other."""
    dt_s = later.t_valid_s - earlier.t_valid_s
    if not 0.0 < dt_s <= LONGEST_PAIR_S or np.array_equal(earlier.r_ea_e, later.r_ea_e):
        return False
    variance = np.trace(earlier.R_r_e + later.R_r_e)
    return float(gap @ gap) <= 9.0 * (variance + (slack * dt_s) ** 2)


def star_evidence(state, z, R, turned_i):
    """StarEvidence of a fix with residual z (3,) rad and covariance R (3, 3) rad^2 in body axes.

    turned_i : (4,) what corrections have turned the camera by until then, inertial axes
    """
    measured = rotation.quat_multiply(state.q_ib, rotation.quat_from_rotvec(z))
    C_ib = rotation.dcm_from_quat(measured)
    error_i = rotation.quat_multiply(measured, rotation.quat_conjugate(state.q_ib))
    return StarEvidence(state.t_s, rotation.quat_multiply(error_i, turned_i), C_ib @ R @ C_ib.T)


def star_fixes_agree(earlier, later, P_rate, limit, noise=0.0):
    """Whether two star fixes differ by the rotation that the gyros saw.

    Without corrections the strapdown turns with the gyros, so its attitude error in inertial axes is the same
    at both fixes, but for their noise and for what the gyros are still wrong by. The attitude of the filter
    is no measure: while it knows little of it, other sensors turn it by degrees from one fix to the next.

    earlier, later : StarEvidence
    P_rate : (3, 3) rad^2/s^2, covariance of the corrected rate
    limit : chi-square
    noise : rad^2/s, white noise of the gyros, of the noisiest axis
    """
    dt_s = abs(later.t_valid_s - earlier.t_valid_s)  # they may have arrived in the other order
    if not 0.0 < dt_s <= LONGEST_STAR_PAIR_S:
        return False
    d = rotation.rotvec_from_quat(
        rotation.quat_multiply(later.error_i, rotation.quat_conjugate(earlier.error_i))
    )
    # the largest rate variance stands for every axis, so that no frame has to be chosen for it
    drift = np.max(np.linalg.eigvalsh(P_rate)) * dt_s**2 + noise * dt_s
    S = earlier.R_i + later.R_i + drift * np.eye(3)
    return float(d @ np.linalg.solve(S, d)) <= limit


# ----------------------------------------------------------------------------------------------------------
# Steps by which a sensor was believed against the filter: what of them is still open.
#
# Nothing on board says whether the sensor or the filter was wrong, so each step stays open until it is
# taken back. A receiver that is off by A and steps by B besides is still off by A when B is taken back; so
# the steps are kept one by one, and what takes back all of them together ends them all.


BACK = 0.3  # [E] share of a step, to within which one back ends it


class Steps:
    """Memory, changed in place.

    kept : list of (d,) m or m/s, oldest first
    """

    def __init__(self):
        self.kept = []

    def __bool__(self):
        return bool(self.kept)

    @property
    def largest(self):
        """The most that the sensor or the filter is wrong by, m or m/s; 0 without a step."""
        if not self.kept:
            return 0.0
        return max(float(np.linalg.norm(one)) for one in (*self.kept, self._whole()))

    def is_back(self, z):
        """Whether an innovation (d,) takes a step back, or all of them."""
        return self._without(z) is not None

    def add(self, z):
        """A step (d,) that takes nothing back."""
        self.kept.append(z.copy())

    def take_back(self, z):
        """Forget what an innovation (d,) takes back. -> whether it does"""
        left = self._without(z)
        if left is None:
            return False
        self.kept = left
        return True

    def forget(self):
        """It is known who was wrong."""
        self.kept = []

    def _whole(self):
        """The sum of the steps of as many numbers as the last has."""
        return np.sum([one for one in self.kept if len(one) == len(self.kept[-1])], axis=0)

    def _without(self, z):
        """The steps that an innovation leaves: list, None if it takes none back."""
        if not self.kept:
            return None
        if is_back(self._whole(), z):
            return []
        for k in reversed(range(len(self.kept))):
            if is_back(self.kept[k], z):
                return self.kept[:k] + self.kept[k + 1 :]
        return None


def is_back(step, z):
    """Whether an innovation takes a step back. (d,), (d,) -> bool"""
    return len(step) == len(z) and bool(np.linalg.norm(step + z) < BACK * np.linalg.norm(step))
