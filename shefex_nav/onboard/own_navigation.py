"""Navigation software of somebody's own in the place of the built-in one: a step a tick.

The software gives an `Estimate`, of which the rest of NavSolution follows here, or whole records. What the
star tracker wants to know of a frame follows from the last estimates and from the gyros as they are.
"""

from collections import deque
from typing import Any, NamedTuple, Protocol

import numpy as np

from shefex_nav.clock import SAME_S, TICK_HZ
from shefex_nav.errors import shown
from shefex_nav.geometry import frames, rotation, shutter, wgs84
from shefex_nav.geometry.elementary import arccos
from shefex_nav.geometry.unsteady import STEADY
from shefex_nav.onboard import own_levels, own_records, own_software
from shefex_nav.onboard.navigation.mean_rate import CHANGE, SEEN, SHARE
from shefex_nav.onboard.navigation.solution import ENDS, FIELDS, LEVEL, S_R, derive
from shefex_nav.onboard.navigator import COVARIANCE_TICKS, PREDICTION_FLOOR
from shefex_nav.onboard.own_software import OwnSoftware, covariance_fault, sealed
from shefex_nav.onboard.startracker.tracker import NO_CONTEXT, Context
from shefex_nav.records import QUANTITIES, Doubt, GateResult, NavCovariance, NavHealth, NavSolution, row

KEPT = int(TICK_HZ)  # ticks, for frames that come late
OUTPUTS = NavSolution, NavCovariance, GateResult, NavHealth
ONE_A_TICK = {NavSolution: "solutions", NavCovariance: "covariances"}
LEAST_M = 1.0  # from the centre of the Earth, where no direction is up
LONGEST_S = 0.1  # over which the attitude of a tick is carried on to a picture


class Estimate(NamedTuple):
    """What navigation software knows at the end of a tick: position, velocity, attitude of the IMU."""

    r_i: np.ndarray  # (3,) m, inertial axes
    v_i: np.ndarray  # (3,) m/s, inertial
    q_ib: np.ndarray  # (4,) body to inertial axes, Hamilton, scalar first
    P: np.ndarray | None = None  # (9, 9) covariance: position i [m], velocity i [m/s], attitude b [rad]
    omega_ib_b: np.ndarray | None = None  # (3,) rad/s; None: what the gyros say
    gyro_bias: np.ndarray | None = None  # (3,) rad/s, that has been taken out; for the log
    accel_bias: np.ndarray | None = None  # (3,) m/s^2
    star_aided: bool = False  # a star fix has been used since the start
    usable: tuple[bool, bool, bool] = (True, True, True)  # position, velocity, attitude may be used
    levels_of_P: bool = False  # make protection levels of P, k sigma by requirements.integrity_risk


class Navigation(Protocol):
    """Navigation software, as a user writes it."""

    def start(self, alignment, mission):
        """Begin at the instant of the alignment. records.Alignment, software.MissionData"""

    def step(self, imu, arrived):
        """A tick of 10 ms.

        imu : records.ImuBlock, the samples of the tick
        arrived : list of records that arrive at it: GpsFix, GpsRanges, StarFix, readings of instruments
        -> Estimate; or list of Estimate, NavSolution, NavCovariance, GateResult, NavHealth; None: nothing
        """


class _Kept(NamedTuple):
    """What the star tracker may want to know of a tick later."""

    t_s: float
    imu: Any  # ImuBlock
    r_i: np.ndarray
    v_i: np.ndarray
    q_ib: np.ndarray
    P_theta_b: np.ndarray | None


class OwnNavigation:
    """Navigation software of somebody's own, a `driving.Software`.

    software : Navigation, not started
    name : of it, for messages
    alignment : Alignment
    mission : software.MissionData
    wanted : integrity_protection.Requirement, for software that has its protection levels made of P
    """

    WHAT = "navigation software"
    GIVES = Estimate, *OUTPUTS

    def __init__(self, software, name, alignment, mission, wanted):
        self._own, self._mission = OwnSoftware(software, f"{self.WHAT} {name}"), mission
        self._wanted = wanted
        self.now_s, self._imu, self._ticks = alignment.t_valid_s, None, 0
        self._alignment = alignment  # until the first Estimate has been held against it
        self._kept, self._blocks = deque(maxlen=KEPT), deque(maxlen=KEPT)
        self._P_theta_b = None  # of the Estimate of this tick
        self._ask("start", sealed(alignment), sealed(mission))

    def advance(self, blocks, first, last):
        """As of `driving.Software`: one tick."""
        self._imu, self._ticks = sealed(row(blocks, first)), self._ticks + 1
        self.now_s = self._imu.t_valid_s
        return 1, []

    def update(self, arrived):
        """As of `driving.Software`."""
        self._P_theta_b = None
        given = self._ask("step", self._imu, [sealed(one) for one in arrived])
        given = [] if given is None else [given] if isinstance(given, tuple) else given
        if not isinstance(given, list):
            raise self._error(f"must give an Estimate, a list or None, got {shown(given)}")
        outputs = [record for one in given for record in self._recorded(one)]
        for kind, words in ONE_A_TICK.items():
            if (n := sum(isinstance(one, kind) for one in outputs)) > 1:
                raise self._error(f"gave {n} {words} for one tick")
        self._keep(*(one for one in outputs if isinstance(one, NavSolution)))
        return outputs

    def _recorded(self, given):
        """Records of one thing that the software has given."""
        if isinstance(given, Estimate):
            return self._solution(self._checked(given))
        if isinstance(given, OUTPUTS):
            return [self._checked_record(given)]
        names = ", ".join(kind.__name__ for kind in self.GIVES)
        raise self._error(f"gave {type(given).__name__}; it may give {names}")

    def context(self, frame, sky, predicts=True):
        """What the navigation knows about a frame: `tracker.Context`, of the software if it says so itself.

        sky : navigator.Sky; predicts : as of `Computer`
        """
        if self._own.has("context"):
            return self._checked_context(self._ask("context", sealed(frame), sky, predicts))
        known = [one for one in self._kept if abs(one.t_s - frame.t_valid_s) < LONGEST_S]
        if not known:
            return self._with_rate(NO_CONTEXT, frame) if predicts else NO_CONTEXT
        near = min(known, key=lambda one: abs(one.t_s - frame.t_valid_s))
        omega_b = near.imu.dtheta_b.sum(axis=0) / (near.imu.dt_s * len(near.imu.dtheta_b))
        C_bc = self._mission.C_bc
        turned = rotation.quat_from_rotvec(omega_b * (frame.t_valid_s - near.t_s))
        C_ic = rotation.dcm_from_quat(rotation.quat_multiply(near.q_ib, turned)) @ C_bc
        rate = NO_CONTEXT._replace(rate=float(np.linalg.norm(omega_b)))
        context = self._geometry(rate, near, C_ic, sky)
        if not predicts:
            return context
        if near.P_theta_b is not None:
            floor2 = self._mission.sigma_mounting**2 + PREDICTION_FLOOR**2
            P_c = C_bc.T @ near.P_theta_b @ C_bc + floor2 * np.eye(3)
            context = context._replace(q_ic=rotation.quat_from_dcm(C_ic), P_c=P_c)
        return self._with_rate(context, frame)

    def close(self):
        """There are no more ticks."""
        if self._own.has("close"):
            self._ask("close")

    def _geometry(self, context, near, C_ic, sky):
        """A Context with velocity and angles of the boresight."""
        C_ei = frames.dcm_ie(self._mission.earth, near.t_s).T
        boresight_i = np.ascontiguousarray(C_ic[:, 2])
        return context._replace(
            velocity_i=near.v_i + sky.earth_velocity_i,
            sun_angle=float(arccos(np.clip(boresight_i @ sky.sun_i, -1.0, 1.0))),
            limb_angle=float(wgs84.limb_angle(C_ei @ near.r_i, C_ei @ boresight_i)),
        )

    def _with_rate(self, context, frame):
        """A Context with the mean rate of the gyros over the exposure, as far as samples of it are kept."""
        times = shutter.row_times(frame.exposure_s, frame.line_s, frame.image_dn.shape[0])
        begin_s, end_s = frame.t_start_s, frame.t_start_s + shutter.duration_s(times)
        blocks = [one for one in self._blocks if begin_s < one.t_valid_s < end_s + 1.0 / TICK_HZ]
        if not blocks or not all(block.valid and not block.saturated for block in blocks):
            return context
        C_bc = self._mission.C_bc
        duration_s = sum(block.dt_s * len(block.dtheta_b) for block in blocks)
        omega_b = sum(block.dtheta_b.sum(axis=0) for block in blocks) / duration_s
        gyro = self._mission.sheets["imu"].gyro
        steady2 = gyro.bias**2 + gyro.in_run_bias**2 + gyro.random_walk**2 / duration_s
        scale2 = max(gyro.scale_factor, gyro.scale_factor_roll) ** 2 + 2.0 * gyro.misalignment**2
        of_rate2 = (scale2 + self._mission.sigma_mounting**2) * (omega_b @ omega_b)
        context = context._replace(omega_c=C_bc.T @ omega_b, P_omega_c=(steady2 + of_rate2) * np.eye(3))
        if not covered(blocks, begin_s, end_s):
            return context
        noise = gyro.random_walk**2 * (end_s - begin_s) / 12.0 + gyro.quantum**2 / 12.0
        table_b, variance = besides_mean_rate(blocks, begin_s, end_s, frame.t_valid_s, noise)
        table_c = np.column_stack([table_b[:, :1], table_b[:, 1:] @ C_bc])
        return context._replace(unsteady_c=table_c, unsteady_variance=variance)

    def _keep(self, solution=None):
        """Remember the tick; where it stood if the IMU answered and the software stands by its attitude."""
        self._blocks.append(self._imu)
        if solution is None or not self._imu.valid or solution.do_not_use_attitude:
            return
        P_theta_b = self._P_theta_b
        if P_theta_b is None:  # a whole NavSolution says nothing of correlations
            P_theta_b = np.diag(solution.sigma_theta_b**2)
        known = solution.r_i, solution.v_i, solution.q_ib
        has_P = bool(np.isfinite(P_theta_b).all())
        self._kept.append(_Kept(self.now_s, self._imu, *known, P_theta_b if has_P else None))

    def _solution(self, estimate):
        """NavSolution of an Estimate, and NavCovariance at every tenth tick."""
        omega_b = estimate.omega_ib_b
        if omega_b is None:
            omega_b = self._imu.dtheta_b[-1] / self._imu.dt_s
        told = solution(estimate, self.now_s, omega_b, self._mission.earth)
        if estimate.levels_of_P:
            told = own_levels.added(told, estimate.P, self._wanted, self._mission.earth)
        self._P_theta_b = None if estimate.P is None else estimate.P[6:, 6:].copy()
        outputs = [told]
        if self._ticks % COVARIANCE_TICKS == 0:
            outputs.append(covariance(estimate, self.now_s))
        return outputs

    def _checked(self, estimate):
        """An Estimate with arrays of the right shape; SoftwareError says what is wrong with it."""
        shapes = {"r_i": (3,), "v_i": (3,)}
        shapes |= {"P": (9, 9), "omega_ib_b": (3,), "gyro_bias": (3,), "accel_bias": (3,)}
        arrays = {}
        for field, shape in shapes.items():
            value = getattr(estimate, field)
            if value is not None or field in ("r_i", "v_i"):
                arrays[field] = self._own.numbers(self.now_s, f"{field} of its Estimate", value, *shape)
        self._check_place("r_i of its Estimate", arrays["r_i"])
        arrays["q_ib"] = self._own.quaternion(self.now_s, "q_ib of its Estimate", estimate.q_ib)
        if "P" in arrays and (fault := covariance_fault(arrays["P"])):
            raise self._error(f"P of its Estimate {fault}")
        usable = estimate.usable
        if not isinstance(usable, tuple | list) or len(usable) != len(QUANTITIES):
            raise self._error(f"usable of its Estimate must be of {', '.join(QUANTITIES)}, got {usable!r}")
        asked = estimate.levels_of_P
        if not isinstance(asked, bool | np.bool_):
            raise self._error(f"levels_of_P of its Estimate must be True or False, got {shown(asked)}")
        if asked and "P" not in arrays:
            raise self._error("levels_of_P of its Estimate is set, but there is no P")
        estimate = estimate._replace(**arrays)
        self._check_conventions(estimate, *usable)
        return estimate

    def _check_conventions(self, given, position, _velocity, attitude):
        """SoftwareError if the first solution is right in another convention.

        given : Estimate or NavSolution;  position, attitude : whether the software calls them usable
        """
        if self._alignment is None:
            return
        alignment, self._alignment = self._alignment, None
        if self.now_s - alignment.t_valid_s > own_software.MEANT_S:
            return
        C_ei = frames.dcm_ie(self._mission.earth, self.now_s).T
        words = own_software.of_start_attitude(given.q_ib, alignment) if attitude else ""
        if not words and position:
            words = own_software.of_start_position(given.r_i, alignment, self.now_s, C_ei)
        if words:
            raise self._error(f"its first {words}")

    def _checked_record(self, record):
        """A whole record of the software's own, of this tick."""
        kind = type(record)
        record = own_records.checked(self._own, self.now_s, record)
        if abs(record.t_s - self.now_s) > SAME_S:
            raise self._error(f"gave a {kind.__name__} of T{record.t_s:+.6f} s, of another tick")
        if kind is NavSolution:
            self._own.quaternion(self.now_s, "q_ib of its NavSolution", record.q_ib)
            self._check_place("r_i of its NavSolution", record.r_i)
            usable = (not getattr(record, f"do_not_use_{one}") for one in QUANTITIES)
            self._check_conventions(record, *usable)
        return record

    def _check_place(self, what, r_i):
        """SoftwareError for a position at the centre of the Earth."""
        if np.linalg.norm(r_i) < LEAST_M:
            raise self._error(f"{what} is the centre of the Earth, where no direction is up")

    def _checked_context(self, context):
        """What the software says of a picture itself."""
        if not isinstance(context, Context):
            raise self._error(f"context must give a Context, got {shown(context)}")
        if context.q_ic is not None:
            self._own.quaternion(self.now_s, "q_ic of its Context", context.q_ic)
        for name, shape in (("omega_c", (3,)), ("P_omega_c", (3, 3))):
            if (value := getattr(context, name)) is not None:
                array = self._own.numbers(self.now_s, f"{name} of its Context", value, *shape)
                context = context._replace(**{name: array})
        if context.unsteady_c is None:
            return context
        table = self._own.real(self.now_s, "unsteady_c of its Context", context.unsteady_c)
        table = self._own.numbers(self.now_s, "unsteady_c of its Context", table, len(table), 4)
        if len(table) == 1 or (np.diff(table[:, 0]) <= 0.0).any():
            raise self._error("unsteady_c of its Context must have no rows, or two or more in order of time")
        if not 0.0 <= context.unsteady_variance < np.inf:
            raise self._error(
                f"unsteady_variance of its Context is {context.unsteady_variance}, not 0 or more"
            )
        return context._replace(unsteady_c=table)

    def _ask(self, method, *given):
        return self._own.ask(self.now_s, method, *given)

    def _error(self, words):
        return self._own.error(self.now_s, words)


def solution(estimate, t_s, omega_ib_b, earth):
    """NavSolution of an Estimate; sigmas by linear propagation of its P, NaN without one.

    Without protection levels: how far it can be trusted is the software's own business (`own_levels`).

    Estimate, s, (3,) rad/s, EarthRotation -> NavSolution
    """
    known = estimate.P is not None
    x = np.concatenate([estimate.r_i, estimate.v_i, estimate.q_ib])
    out = derive(x, estimate.P if known else np.zeros((9, 9)), t_s, earth)
    if not known:
        out[S_R:LEVEL] = np.nan
    fields = {"t_s": t_s, "star_aided": bool(estimate.star_aided)}
    for name, size in list(FIELDS.items())[: -len(QUANTITIES)]:
        part = out[ENDS[name] - size : ENDS[name]]
        fields[name] = part if size > 1 else float(part[0])
    fields |= {"omega_ib_b": np.asarray(omega_ib_b, dtype=float), "sigma_omega_b": np.full(3, np.nan)}
    for quantity, usable in zip(QUANTITIES, estimate.usable, strict=True):
        fields[f"do_not_use_{quantity}"] = not usable
        fields[f"doubt_{quantity}"] = int(Doubt.NONE if usable else Doubt.SOFTWARE)
    return NavSolution(**fields)


def covariance(estimate, t_s):
    """NavCovariance of an Estimate: what it does not say is NaN. Estimate, s -> NavCovariance"""
    unknown = np.full(3, np.nan)
    biases = (unknown if bias is None else bias for bias in (estimate.gyro_bias, estimate.accel_bias))
    P = np.full((9, 9), np.nan) if estimate.P is None else estimate.P
    return NavCovariance(t_s, P, *biases, unknown, unknown, np.full(12, np.nan))


def covered(blocks, begin_s, end_s):
    """Whether ImuBlocks follow each other without a gap over an interval."""
    begins = [one.t_valid_s - one.dt_s * len(one.dtheta_b) for one in blocks]
    ends = [one.t_valid_s for one in blocks]
    whole = begins[0] <= begin_s + SAME_S and ends[-1] >= end_s - SAME_S
    return whole and all(abs(b - a) < SAME_S for a, b in zip(ends, begins[1:], strict=False))


def besides_mean_rate(blocks, begin_s, end_s, instant_s, noise):
    """How the gyros say that the body turns besides its mean rate, as `mean_rate` does with estimates.

    blocks : ImuBlocks that cover the interval;  instant_s : from which turns count
    noise : rad^2, of the mean of the turn on each axis
    -> (m, 4) table of `geometry.unsteady` in body axes, variance of its error
    """
    dt_s = np.concatenate([np.full(len(one.dtheta_b), one.dt_s) for one in blocks])
    t_s = blocks[-1].t_valid_s - np.concatenate([np.cumsum(dt_s[::-1])[::-1], [0.0]])
    steps = np.concatenate([np.zeros((1, 3)), *(one.dtheta_b for one in blocks)])
    inside = t_s[(t_s > begin_s + SAME_S) & (t_s < end_s - SAME_S)]
    at_s = np.concatenate([[begin_s], inside, [end_s]])
    angle = np.transpose([np.interp([instant_s, *at_s], t_s, one) for one in np.cumsum(steps, axis=0).T])
    duration_s, since_s = end_s - begin_s, at_s - instant_s
    omega_b = (angle[-1] - angle[1]) / duration_s
    turned = angle[1:] - angle[0] - np.outer(since_s, omega_b)
    largest = (turned**2).sum(axis=1).max()
    if largest > 3.0 * SEEN * noise:
        return np.column_stack([since_s, turned]), noise + SHARE**2 / 9.0 * largest
    return STEADY, min(noise, (omega_b @ omega_b) * (CHANGE * duration_s**2 / 24.0) ** 2)
