"""Watch over the gyros by the stars: a gyro that is wrong in a way that looks alive.

Between two star fixes the strapdown turns with the gyros, so whatever the gyros are wrong by is there as a
rotation between what the stars say and what the strapdown says; corrections of the attitude by the filter in
between, by whatever sensor, are known and taken out. Per star fix k, all in inertial axes, where a rotation
that is past stays what it is::

    E_k = e_k A_k,   A <- q+ q-^-1 A at every update
    D = log(E_l E_f^-1) = integral of C_ib (rate error) from f to l

with e_k the rotation from the estimated to the measured attitude before the update, q- and q+ the attitude
before and after an update. E is the rotation from the attitude of a strapdown that was never corrected to the
measured one, so it stays what it is when a late measurement makes the filter go back and correct again. The
attitude is that of the camera, estimated mounting included, which is what the stars measure: what an update
takes from the body and gives to the mounting is no rotation.

One wrong star fix, or a star camera that has been knocked, is a step in E; a wrong gyro is a slope. So three
fixes are compared, first, middle and last: the rotation from the first to the last must be far more than star
and gyro noise explain, with what the filter thinks of the gyro bias; so must each half of it, and the first
half must be its share of the whole. That several times in a row, and the gyro is called wrong: its bias is
made unknown, to be found again from the stars. Short comparisons find large errors soon, long ones small
ones: after 8 s some 6 arcsec/s with stars good to an arcsecond. Of fewer than two fixes a second none are
compared.

What this cannot see. A wrong scale factor or misalignment while the vehicle does not turn does nothing, and
is found when it turns. Without stars nothing is found. So a gyro that has been wrong once, or contradicted by
stars or GPS, is not trusted without them: `UNCHECKED_S` after the last check the solution is not to be used,
and the log says why. A star
tracker whose fixes all turn away at one steady rate cannot be told from a gyro.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation.history import camera_attitude
from shefex_nav.onboard.navigation.integrity import chi_square_limit
from shefex_nav.onboard.navigation.state import BG, X_Q

BASELINES_S = np.array([0.4, 2.0, 8.0])  # [E] from the first fix to the last
LONGEST_GAP_S = 0.55  # [E] between two fixes, else it starts anew
PROBABILITY = 1e-9  # of calling healthy gyros wrong, in one comparison
HALF_PROBABILITY = 1e-4  # likewise of each half, which guards against steps
SHARE_PROBABILITY = 0.05  # of not seeing a wrong gyro in one comparison, because the middle seems off
CONFORM_PROBABILITY = 1e-3  # of not seeing that a gyro is right
SLACK = 0.12  # [E] of D by which the middle may be off: axes that have turned meanwhile
CONFIRMATIONS = 3  # comparisons that must agree
WITHIN_S = 1.0  # [E] and within how long
SIGNIFICANT = 4.0  # sigma of the rate error of an axis that is blamed
UNCHECKED_S = 1.0  # [E] for how long a gyro that was wrong once is trusted without stars: it may be turning
ROWS = 1024  # fixes that are remembered at most; half of them go when they are full: 8 s at 64 Hz are left
T, Q_E, R_I, PATH, P_BG, Q_IB, PUSH = 0, slice(1, 5), slice(5, 14), 14, slice(15, 24), slice(24, 28), 28
Q_STARS, PATH_STARS = slice(29, 33), 33
WIDTH = 34
UNDECIDED, CONFORM, WRONG = range(3)
AXES = ("gyro x", "gyro y", "gyro z")


class Finding(NamedTuple):
    """A gyro that turns otherwise than the stars."""

    axes: tuple[str, ...]
    rate_b: np.ndarray  # (3,) rad/s, error of the corrected rate, truth minus measured
    sigma_b: np.ndarray  # (3,) rad/s, to which it is known

    @property
    def admitted(self):
        """Standard deviation that the bias gets on top: (3,) rad/s, of the axes that are wrong."""
        wrong = np.array([name in self.axes for name in AXES])
        return np.where(wrong, np.hypot(self.rate_b, self.sigma_b), 0.0)

    @property
    def largest(self):
        """rad/s, of the error."""
        return float(np.sqrt(self.rate_b @ self.rate_b))


def relative_error(params):
    """What angles that the gyros have turned may be wrong by, relative to them. NavParams -> float

    Scale factors, misalignments, and the mounting of the camera, about whose axes the same angle is seen.
    """
    names = ("gyro_roll_column", "gyro_scale", "gyro_misalignment", "mounting")
    known = [np.abs(params.sigma_blocks[name]).max() for name in names if name in params.sigma_blocks]
    return float(np.linalg.norm([params.imu.gyro_cross, *known]))


def sensed_error(params):
    """What rates may be wrong by under specific force, whether that is noise to the filter or a block.

    NavParams -> float, rad/s per m/s^2
    """
    known = params.sigma_blocks.get("gyro_g_sensitivity", np.zeros(1))
    return float(max(params.imu.gyro_g_sensitivity, np.abs(known).max()))


class StarSight(NamedTuple):
    """A star fix and the filter at its instant, before the update."""

    t_s: float
    x: np.ndarray  # (X,) packed values of the filter
    P: np.ndarray  # (n, n)
    z: np.ndarray  # (3,) rad, residual in body axes
    R: np.ndarray  # (3, 3) rad^2
    f_b: np.ndarray  # (3,) m/s^2, specific force, to which gyros answer a little


class GyroWatch:
    """Memory, changed in place.

    model : ImuModel
    relative : error of a turned angle, relative to it: scale factor and misalignment, as known at the start
    sensed : rad/s per m/s^2, of g-sensitivity, likewise
    """

    def __init__(self, model, relative, sensed):
        self.sensed = sensed
        self.noise = np.array(
            [
                model.gyro_random_walk**2,
                relative**2,
                sensed**2,
                0.0,
            ]
        )
        chances = PROBABILITY, SHARE_PROBABILITY, CONFORM_PROBABILITY, HALF_PROBABILITY
        self.limits = np.array([chi_square_limit(p, 3) for p in chances])
        self.rows, self.n = np.empty((ROWS, WIDTH)), 0
        self.found_s = []  # of comparisons that called a gyro wrong
        self.wrong = ()  # axes
        self.failed = ()  # axes that have ever been wrong
        self.checked_s = np.nan  # when the stars last agreed with the gyros

    def forget(self):
        """Start anew: the readings of the gyros have been replaced, or the attitude reset."""
        self.n = 0
        self.found_s.clear()

    def compare(self, seen, A, turned=0.0):
        """Take in a star fix.

        Parameters
        ----------
        seen : StarSight
        A : (4,) of the module's text, `history.Corrected.A`
        turned : rad, by which the camera may be turned: a fix that contradicts the attitude. The axes about
            which the stars turn are then off by as much

        Returns
        -------
        Finding, or None if nothing is wrong as far as that can be said
        """
        t_s = seen.t_s
        if self.n and not 0.0 < t_s - self.rows[self.n - 1, T]:
            return None  # late; those of a later instant have been compared
        if self.n and t_s - self.rows[self.n - 1, T] > LONGEST_GAP_S:
            self.forget()
        if self.n == ROWS:
            self.n = ROWS // 2
            self.rows[: self.n] = self.rows[ROWS - self.n :]
        noise = self.noise
        if turned**2 > noise[3]:
            noise = noise.copy()
            noise[3] = min(turned, 1.0) ** 2
        verdict, rate_b, sigma_b = _take(self.rows, self.n, A, seen, noise, self.limits)
        self.n += 1
        return self._conclude(t_s, verdict, rate_b, sigma_b)

    def _conclude(self, t_s, verdict, rate_b, sigma_b):
        """Finding or None, by the comparison of one fix."""
        if verdict == CONFORM:
            self.checked_s, self.wrong = t_s, ()
        if verdict != WRONG:
            return None
        self.found_s = [one for one in self.found_s if t_s - one <= WITHIN_S] + [t_s]
        if len(self.found_s) < CONFIRMATIONS:
            return None
        far = np.abs(rate_b) / sigma_b
        axes = tuple(
            name for name, one in zip(AXES, far, strict=True) if one > max(SIGNIFICANT, 0.2 * far.max())
        )
        self.wrong = axes
        self.failed = tuple(name for name in AXES if name in self.failed or name in axes)
        self.forget()
        return Finding(axes, rate_b, sigma_b)

    def doubt(self, relative=0.0):
        """Another sensor has contradicted the gyros: from here on they need stars to be trusted.

        relative : error of a turned angle by that of the camera's mounting, if it may be more than was known
        """
        self.noise[3] = max(self.noise[3], min(relative, 1.0) ** 2)
        self.failed = AXES
        self.checked_s = np.nan
        self.forget()

    @property
    def recovered(self):
        """Axes that have been wrong, and are not wrong now as far as the stars say: list of names."""
        return [name for name in self.failed if name not in self.wrong]

    def is_unchecked(self, now_s):
        """Whether the stars have last agreed with the gyros too long ago, if ever."""
        return not now_s - self.checked_s <= UNCHECKED_S

    def trust(self, now_s):
        """Whether gyros that have been wrong before may be relied on now; none of them: always."""
        return not self.failed or not (self.wrong or self.is_unchecked(now_s))


@kernel
def _take(rows, n, A, seen, noise, limits):
    """Remember a fix in row n, and compare it: as `_remember` and `_compare`."""
    _remember(rows, n, A, seen)
    return _compare(rows, n + 1, BASELINES_S, noise, limits)


@inner
def _remember(rows, n, A, seen):
    """Write row n. A : (4,) all corrections of the attitude so far;  seen : StarSight"""
    z, q_ib, camera = seen.z, seen.x[X_Q], camera_attitude(seen.x)
    C_ib, inverse = rotation.dcm_from_quat(q_ib), rotation.quat_conjugate(camera)
    before = rotation.quat_multiply(rotation.quat_multiply(camera, rotation.quat_from_rotvec(z)), inverse)
    R_i, P_i = C_ib @ seen.R @ C_ib.T, C_ib @ np.ascontiguousarray(seen.P[BG, BG]) @ C_ib.T
    row = rows[n]
    row[T] = seen.t_s
    row[Q_E] = rotation.quat_multiply(before, A)
    row[R_I], row[P_BG] = R_i.ravel(), P_i.ravel()
    row[PATH] = row[PUSH] = row[PATH_STARS] = 0.0
    row[Q_STARS] = rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(z))
    if n > 0:
        row[PUSH] = rows[n - 1, PUSH] + (seen.t_s - rows[n - 1, T]) * np.sqrt((seen.f_b**2).sum())
        row[PATH] = rows[n - 1, PATH] + _turned(rows[n - 1, Q_IB], q_ib)
        row[PATH_STARS] = rows[n - 1, PATH_STARS] + _turned(rows[n - 1, Q_STARS], row[Q_STARS])
    row[Q_IB] = q_ib


@inner
def _turned(before, after):
    """Angle from one attitude (4,) to another."""
    v = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(before), after))
    return np.sqrt((v**2).sum())


@inner
def _between(rows, f, l):
    """D from row f to row l, (3,) rad, inertial axes."""
    turned = rotation.quat_multiply(rows[l, Q_E], rotation.quat_conjugate(rows[f, Q_E]))
    return rotation.rotvec_from_quat(turned)


@inner
def _lasting(rows, f, l, noise):
    """Variance on each axis of D by errors that keep their sign: of turned angles, and of specific force."""
    turned, pushed = rows[l, PATH] - rows[f, PATH], rows[l, PUSH] - rows[f, PUSH]
    lasting = noise[1] * turned**2 + noise[2] * pushed**2
    if noise[3] > 0.0:
        lasting += noise[3] * (rows[l, PATH_STARS] - rows[f, PATH_STARS]) ** 2
    return lasting


@inner
def _covariance(rows, f, l, noise):
    """Of D from row f to row l if the gyros are right, (3, 3) rad^2, inertial axes."""
    T_s = rows[l, T] - rows[f, T]
    white = noise[0] * T_s + _lasting(rows, f, l, noise)
    of_fixes = rows[f, R_I] + rows[l, R_I] + T_s**2 * rows[f, P_BG]
    return of_fixes.reshape(3, 3) + white * np.eye(3)


@inner
def _steady(rows, first, middle, last, noise, limits):
    """Whether D grows steadily: both halves are significant, and the first is its share of the whole."""
    D, D_middle = _between(rows, first, last), _between(rows, first, middle)
    for f, l in ((first, middle), (middle, last)):
        half = _between(rows, f, l)
        if half @ np.linalg.solve(_covariance(rows, f, l, noise), half) < limits[3]:
            return False
    T_s = rows[last, T] - rows[first, T]
    share = (rows[middle, T] - rows[first, T]) / T_s
    white = noise[0] * T_s * share * (1.0 - share) + SLACK**2 * (D**2).sum()
    white += _lasting(rows, first, last, noise)
    of_fixes = (1.0 - share) ** 2 * rows[first, R_I] + rows[middle, R_I] + share**2 * rows[last, R_I]
    off = D_middle - share * D
    return off @ np.linalg.solve(of_fixes.reshape(3, 3) + white * np.eye(3), off) < limits[1]


@inner
def _compare(rows, n, baselines_s, noise, limits):
    """Verdict of the last of n rows, rate error and its sigma in body axes, (3,) rad/s.

    noise : white rad^2/s, squares of the relative error of angles, of g-sensitivity, of the angle by which
        the camera may be turned
    limits : chi-square of D, of the middle, of D where it is conform, of each half
    """
    last, verdict, none = n - 1, UNDECIDED, np.zeros(3)
    for k in range(baselines_s.shape[0]):
        first = last
        while first > 0 and rows[last, T] - rows[first, T] < baselines_s[k] - SAME_S:
            first -= 1
        T_all = rows[last, T] - rows[first, T]
        if T_all < baselines_s[k] - SAME_S or T_all > 1.5 * baselines_s[k]:
            continue
        middle = first
        while rows[middle, T] - rows[first, T] < 0.5 * T_all - SAME_S:
            middle += 1
        if (rows[middle, T] - rows[first, T]) / T_all > 0.6:
            continue
        D = _between(rows, first, last)
        S = _covariance(rows, first, last, noise)
        far = D @ np.linalg.solve(S, D)
        if far > limits[0] and _steady(rows, first, middle, last, noise, limits):
            C_ib = rotation.dcm_from_quat(rows[last, Q_IB])
            S_b = C_ib.T @ S @ C_ib
            return WRONG, C_ib.T @ D / T_all, np.sqrt(np.diag(S_b)) / T_all
        if k > 0 and far < limits[2]:
            verdict = CONFORM
    return verdict, none, none
