"""Constants of the receiver that were told wrongly: the instant that its fixes belong to, and its lever arm.

A wrong constant c shows in every fix alike. Its time shows as the motion of the vehicle meanwhile, its lever
arm as the motion of another point: z = s c + noise, with the columns

    of position  s = H_r [-v, C_ib],    of velocity  s = H_v [-a, C_ib (omega x)]

for a fix measured c_1 seconds before the instant that it names, and an arm that is longer by c_2...4. What
the filter has learnt of it already shows no more. That is its response B to a unit of c, which goes through
the filter as an error of the state does (separate bias: Friedland, IEEE TAC 14, 1969)::

    B <- Phi B,    h = s - H B,    B <- B + K h

Innovations of a filter whose constants are right are white with covariance S, so that over all fixes

    J = sum h^T S^-1 h,    y = sum h^T S^-1 z,    y^T J^-1 y ~ chi-square

for any h. B is followed through position, velocity and attitude only; that makes h less sharp, not the chance
of a false alarm larger. Whoever else is at fault leaves innovations of another form: a constant is found only
where it explains most of what is more than chance in all innovations since the start. Constants are wrong
from the start: once a sensor was believed against the filter, something else may be, and no more is taken in.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.state import ATT, POS, VEL, X_Q, X_R, X_V

PROBABILITY = 1e-10  # of finding a right constant wrong, per fix
FEWEST = 5  # [E] innovations of GPS
LEAST = 2e-3, 0.2  # [E] s, m: an error below is no matter
EXPLAINED = 0.7  # [E] share of the squares beyond chance
OVER = 0.25  # of the limit, below which a constant is right after all
CONDITION = 1e8  # of J, beyond which nothing is said
TIME, ARM = slice(0, 1), slice(1, 4)
LIMITS = {}


class Constants:
    """Memory, changed in place.

    found : '' or what is wrong
    """

    def __init__(self):
        self.B, self.seen = None, None  # (n, 4); (t_s, v_i, C_ib) at the last measurement
        self.a_i = np.zeros(3)  # m/s^2, mean since the one before
        self.J, self.y, self.beyond, self.count = np.zeros((4, 4)), np.zeros(4), 0.0, 0
        self.found, self.wrong = "", None  # words, and which constants
        self.closed = False  # whether something else may have been wrong since

    def take(self, nav, now, name, z, H, S, fate):
        """Take a measurement in, before it corrects the state.

        nav : Filter;  now : Moment;  z, H, S : (m,), (m, n), (m, m);  fate : what becomes of it
        """
        if self.closed:
            return
        self._carry(now, H.shape[1])
        gps, h = name in ("gps_position", "gps_velocity"), -(H @ self.B)
        if name == "gps_position":
            h += _of_position(H, now.x, nav.earth.rate)
        elif name == "gps_velocity":
            h += _of_velocity(H, now.x, self.a_i, now.felt_packed[:3])
        weighed = np.linalg.solve(S, np.column_stack([h, z]))
        if gps and fate != Fate.HELD and not nav.watch.imu_blind:
            self.J += h.T @ weighed[:, :4]
            self.y += h.T @ weighed[:, 4]
            self.beyond += float(z @ weighed[:, 4]) - len(z)
            self.count += 1
            self._judge()
        self.closed = fate == Fate.RESET
        if fate == Fate.USED:
            self.B += now.P @ H.T @ weighed[:, :4]

    def _carry(self, now, n):
        """The response on to this instant: attitude errors turn the force that was felt since the last."""
        t_s, v_i, C_ib = now.t_s, now.x[X_V].copy(), rotation.dcm_from_quat(now.x[X_Q])
        if self.seen is None:
            self.B = np.zeros((n, 4))
        elif t_s > self.seen[0]:
            before_s, before_v_i, before_C_ib = self.seen
            self.a_i = _carried(self.B, before_v_i, before_C_ib, now.x[X_R], v_i, C_ib, t_s - before_s)
        self.seen = (t_s, v_i, C_ib)

    def _judge(self):
        """Whether a constant is wrong; one that was stays so while anything speaks for it."""
        best, words = 0.0, ""
        for part, least, say in ((TIME, LEAST[0], _time), (ARM, LEAST[1], _arm)):
            value, explained = self._estimate(part)
            if self.wrong == part and explained > OVER * _limit(part):
                self.found = say(value)
                return
            enough = explained > _limit(part) and explained > EXPLAINED * self.beyond
            if enough and np.sqrt(value @ value) > least and explained - _limit(part) > best:
                best, words, self.wrong = explained - _limit(part), say(value), part
        self.found = words if self.count >= FEWEST else ""
        self.wrong = self.wrong if self.found else None

    def _estimate(self, part):
        """Values of some constants, and by how much they make the squares of the innovations less."""
        return _best(np.ascontiguousarray(self.J[part, part]), self.y[part])


@kernel
def _best(J, y):
    """The value that explains most, and how much; nothing where J (k, k) does not tell. y : (k,)"""
    tells = np.isfinite(J).all() and np.isfinite(y).all() and (np.diag(J) > 0.0).all()
    if not tells or (len(y) > 1 and np.linalg.cond(J) > CONDITION):
        return np.zeros(len(y)), 0.0
    value = np.linalg.solve(J, y)
    return value, y @ value


@kernel
def _carried(B, before_v_i, before_C_ib, r_i, v_i, C_ib, dt_s):
    """The response on by dt_s, in place. -> (3,) m/s^2, mean acceleration

    B : (n, 4);  before_v_i, before_C_ib : at the last measurement;  r_i, v_i, C_ib : now
    """
    gravity = -wgs84.GM / (r_i @ r_i) ** 1.5 * r_i
    felt = v_i - before_v_i - gravity * dt_s  # vibration, which is noise, has no part in the mean
    turn_i = before_C_ib @ B[ATT]
    gained = -rotation.skew(felt) @ turn_i
    B[POS] += dt_s * (B[VEL] + 0.5 * gained)
    B[VEL] += gained
    B[ATT] = C_ib.T @ turn_i
    return (v_i - before_v_i) / dt_s


@kernel
def _of_position(H, x, rate):
    """(m, 4) of the position of a GPS fix, what a unit of each constant shows in it.

    H : (m, n);  x : (X,) packed values;  rate : rad/s, of the Earth
    """
    r_i, shown = x[X_R], np.empty((3, 4))
    shown[:, 0] = -(x[X_V] - np.array([-rate * r_i[1], rate * r_i[0], 0.0]))
    shown[:, 1:] = rotation.dcm_from_quat(x[X_Q])
    return np.ascontiguousarray(H[:, POS]) @ shown


@kernel
def _of_velocity(H, x, a_i, omega_b):
    """Likewise of its velocity. a_i : (3,) m/s^2;  omega_b : (3,) rad/s"""
    shown = np.empty((3, 4))
    shown[:, 0] = -a_i
    shown[:, 1:] = rotation.dcm_from_quat(x[X_Q]) @ rotation.skew(omega_b)
    return np.ascontiguousarray(H[:, VEL]) @ shown


def _limit(part):
    """Of chi-square."""
    dof = part.stop - part.start
    if dof not in LIMITS:
        from scipy.special import chdtri

        LIMITS[dof] = float(chdtri(dof, PROBABILITY))
    return LIMITS[dof]


def _time(value):
    side = "before" if value[0] > 0.0 else "after"
    return f"time of its fixes wrong: measured about {1e3 * abs(value[0]):.0f} ms {side} it"


def _arm(value):
    return f"lever arm wrong: by about {np.sqrt(value @ value):.2g} m"
