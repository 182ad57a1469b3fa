"""What was learnt from a sensor that has been contradicted: it is doubted together with the sensor.

Scale factors, biases and the mounting of the camera are estimated by their ties to attitude and velocity.
While one sensor is wrong these ties teach falsehoods, and what was learnt stays when the attitude or the
velocity is put right: a roll gyro whose bias is off for a while leaves a scale factor that is off, with a
small sigma, and the next spin shows it. So when stars or GPS have contradicted the filter until they were
believed, and when the stars find a gyro wrong, every learnt block j gets back what it has gained since it was
last known to be right,

    P_jj <- max(P_jj, P_jj(then) + (x_j - x_j(then))^2),

the certainty that it has gained since and all of the correction, which may be the falsehood; to doubt it a
second time adds what it has learnt since the first. Adding independent noise is honest whatever the ties are;
to cut them is not: attitude and mounting, of which the stars see the sum, would seem to be known by sqrt(2)
better after the next fix. What is added to the mounting is added to the attitude with the opposite sign.

**Then** is the start of the filter, unless the stars have confirmed the gyros since (`integrity_gyro`): what
the stars contradict was right at the last comparison that agreed and is `PROVEN_S` old. A GPS receiver is
confirmed by nothing so sharp.

**Stars against the rest.** Star fixes that agree with each other and contradict the filter say that either
the camera or gyros and GPS are wrong by the angle between them, and nothing on board says which. The solution
follows the stars. Up to `LINEAR` the mounting is uncertain by that angle, and the attitude with it: their sum
alone is known. A turn of the vehicle resolves it, which gyros and stars see about axes that differ by the
mounting, or GPS velocity under thrust or drag, which sees the attitude across the force; the filter does that
by itself. A larger angle stays disputed: the solution is not to be used, unless the stars then find a gyro
that turns wrongly by so much that it explains the angle. If GPS has contradicted the inertial unit before,
the attitude was unknown and the stars contradict nothing: two of three agree.

**A first fix that is hardly likely.** The first star fix, or one after a long time without, meets a wide
gate: a wrong gyro may pass it. If its normalised innovation squared is one that chance gives once in a
hundred flights, the variances of attitude and learnt blocks grow by its ratio to what was to be expected,
before the fix is used.

**GPS velocity against the rest.** A velocity is turned by a wrong attitude: what specific force has added to
it since the last velocity fix, dv, is off by 2 |dv| at most. If that can explain the contradiction nothing is
known of the attitude any more, until stars say it again.

**Readings that are none.** While axes of the unit are silent or stuck nothing is learnt at all: the gain of
these blocks is zero (a consider filter, Schmidt 1966), and the covariance is that of such a gain.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.onboard.navigation import eskf
from shefex_nav.onboard.navigation.blocks import STATES
from shefex_nav.onboard.navigation.eskf import MOST_GROWN, grown
from shefex_nav.onboard.navigation.state import (
    ATT,
    NOMINAL,
    X_R,
    X_V,
    initial_covariance,
    right_jacobian,
)
from shefex_nav.onboard.navigation.unknown_attitude import UNKNOWN2

LEARNT = ("gyro_bias", "accel_bias", *(state.name for state in STATES if state.learnt))
PROVEN_S = 10.0  # [E] a wrong gyro is found within so long, or it is too small for the stars to find
LINEAR = np.radians(1.0)  # [E] below, a wrong mounting may be left to the filter, which is linear
SPLIT = "split"  # key of what is doubted of mounting and attitude, but not of their sum
EVERY_S = 5.0  # [E] between two sets of values that are kept


class Kept(NamedTuple):
    """What was known at a time when stars and gyros agreed."""

    t_s: float
    x: np.ndarray  # (93,) packed nominal values
    variances: np.ndarray  # (n,) of the errors


class Learnt:
    """Memory, changed in place."""

    def __init__(self):
        self.kept = deque(maxlen=4)
        self.velocity = None  # t_s, (3,) m, (3,) m/s inertial: at the last velocity fix that was used

    def confirmed(self, t_s, x, P):
        """Stars and gyros agree at t_s; x (93,) packed, P (n, n)."""
        if not self.kept or t_s - self.kept[-1].t_s >= EVERY_S:
            self.kept.append(Kept(t_s, x.copy(), P.diagonal().copy()))

    def moving(self, t_s, x):
        """A velocity fix of t_s has been used; x (93,) packed values."""
        self.velocity = t_s, x[X_R].copy(), x[X_V].copy()

    def then(self, t_s):
        """Kept of the last time before t_s at which all was right for sure, None: that is the start."""
        while self.kept and t_s - self.kept[-1].t_s < PROVEN_S:
            self.kept.pop()  # those are in doubt from here on
        return self.kept[-1] if self.kept else None

    def forget(self):
        """Nothing that was kept is known to be right."""
        self.kept.clear()

    def pushed(self, t_s, x):
        """What specific force has added to the velocity since the last velocity fix, m/s; inf without one."""
        if self.velocity is None:
            return np.inf
        then_s, r_i, v_i = self.velocity
        middle = 0.5 * (r_i + x[X_R])
        gained = x[X_V] - v_i - (t_s - then_s) * (-wgs84.GM / (middle @ middle) ** 1.5 * middle)
        return float(np.sqrt(gained @ gained))


def learnt_blocks(layout):
    """Names and places among the errors of the learnt blocks of a Layout: list."""
    return [(name, layout.places[name]) for name in LEARNT if layout.places[name] is not None]


def doubts(params, layout, then, x, P):
    """What is added to each learnt block: {name: (size,) sigma}.

    NavParams, Layout;  then : Kept, or None: the start;  x, P : (93,), (n, n) of now
    """
    added = {}
    for name, place in learnt_blocks(layout):
        nominal = NOMINAL[name]
        before, value = _at_start(params, name), 0.0
        if then is not None:
            before, value = then.variances[place], then.x[nominal]
        gained = before + (x[nominal] - value) ** 2 - P.diagonal()[place]
        added[name] = np.sqrt(np.maximum(gained, 0.0))
    return added


def _at_start(params, name):
    """Variances of a block at the start."""
    if name == "gyro_bias":
        return params.sigma_gyro_bias**2
    if name == "accel_bias":
        return params.sigma_accel_bias**2
    return initial_covariance(params, name).diagonal()


def widened(nav, P, factor, learnt=MOST_GROWN):
    """What a covariance that was too small all along grows by, learnt errors to so many sigmas of the start.

    Filter, (n, n), float, float -> Grown
    """
    most = np.full(nav.layout.n, np.inf)
    for name, place in learnt_blocks(nav.layout):
        most[place] = learnt * np.sqrt(_at_start(nav.params, name))
    return grown(P, factor, most)


def by_stars(nav, now, z, explained):
    """What is added to the blocks when star fixes have contradicted the filter until they are believed.

    nav : fusion.Filter;  now : Moment;  z : (3,) rad, innovation
    explained : whether it is known what was wrong, or the angle is admitted in attitude and mounting already
    -> {block: (size,) sigma}; `SPLIT`: of the mounting, and of the attitude so that their sum stays known
    """
    memory, angle = nav.watch.learnt, float(np.sqrt(z @ z))
    added = doubts(nav.params, nav.layout, memory.then(now.t_s), now.x, now.P)
    split = added.pop("mounting", None)
    if not explained and (split is None or angle > LINEAR):
        nav.watch.disputed = max(nav.watch.disputed, angle)
    elif not explained:
        split = np.hypot(split, angle)
    if split is not None:
        added[SPLIT] = split
    return added


def add(P, layout, x, sigmas):
    """Noise on blocks of errors, in place; a smoother may lack some of them.

    P : (n, n);  x : (93,) packed values;  sigmas : {block: (size,) sigma}, of `by_stars` and its like
    """
    for name, sigma in sigmas.items():
        place = layout.places["mounting" if name == SPLIT else name]
        if place is None:
            continue
        P[place, place] += np.diag(sigma**2)
        if name == SPLIT:
            # stars see C^T theta + J m: a mounting that is off by m and an attitude by -C J m look right
            mounting = x[NOMINAL["mounting"]]
            tie = -rotation.dcm_from_rotvec(mounting) @ right_jacobian(mounting) * sigma
            P[ATT, ATT] += tie @ tie.T
            P[ATT, place] += tie * sigma
            P[place, ATT] += (tie * sigma).T


def by_velocity(nav, now, z):
    """The same when velocity fixes of GPS have. z : m/s, their innovation -> {block: (size,) sigma}"""
    memory = nav.watch.learnt
    memory.forget()
    added = doubts(nav.params, nav.layout, None, now.x, now.P)
    if 2.0 * memory.pushed(now.t_s, now.x) > np.sqrt(z @ z):
        added["attitude"] = np.full(3, np.sqrt(UNKNOWN2))
    return added


def by_surprise(nav, now, excess):
    """The same of a star fix inside a wide gate that is hardly likely: variances too small by `excess`.

    -> {block: (size,) sigma}
    """
    sigmas = np.sqrt((excess - 1.0) * now.P.diagonal())
    return {name: sigmas[place] for name, place in (("attitude", ATT), *learnt_blocks(nav.layout))}


def places(layout):
    """(n,) bool, errors of learnt blocks. Layout"""
    learnt = np.zeros(layout.n, dtype=bool)
    for _, place in learnt_blocks(layout):
        learnt[place] = True
    return learnt


def update_without(layout, P, measured, x, P_after, share=eskf.take_all, turns=True):
    """`eskf.update_packed` by which nothing is learnt: zero gain of the errors of `places`."""
    dx, updated = _consider(P, *measured, places(layout))
    return dx, eskf.take_in(x, dx, layout.nominal, share(dx, P, updated), P_after, turns)


@kernel
def _consider(P, z, H, R, learnt):
    """Estimated error and covariance with a gain that is zero for some errors, in Joseph's form."""
    H = np.ascontiguousarray(H)
    PH = P @ np.ascontiguousarray(H.T)
    S = H @ PH + R
    K = np.ascontiguousarray(np.linalg.solve(S, np.ascontiguousarray(PH.T)).T)
    for i in range(P.shape[0]):
        if learnt[i]:
            K[i] = 0.0
    A = np.eye(P.shape[0]) - K @ H
    KR = K @ np.ascontiguousarray(R)
    updated = A @ P @ np.ascontiguousarray(A.T) + KR @ np.ascontiguousarray(K.T)
    return K @ z, updated
