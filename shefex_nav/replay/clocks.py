"""By how much the clocks of IMU and GNSS differ, before anything is navigated.

Two things both of them see, whatever the attitude is:

- the length of the mean specific force between two fixes, |dv/dt + Coriolis - g| by the velocities,
- the turn of the course, which the gyros see about the direction of the specific force (for a vehicle that
  goes along the ground).

The lever arm of the antenna counts: in a bend it goes elsewhere than the IMU. Where the axle is that does
not slip is not known; a metre between it and the IMU moves the course by 1 m over the speed, in time. So an
offset by the course is a coarse one, and the filter's own estimate (state gps_latency) is better by far.

The offset is where the squared differences over their noise are least, while a constant difference of each
kind (biases) is free. Its sigma is from the curvature there, larger by what the differences are larger than
the noise. Nothing is said where the motion does not show it.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment import gravity
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.replay.align_motion import over_ground
from shefex_nav.scenario.data_table import DataError

MOST_S = 3.0  # [E] largest offset that is looked for
STEP_S = 0.01  # [E] of the search
LONGEST_S = 2.5  # [E] between fixes that are compared
FEWEST = 8  # [E] pairs of fixes
SLOW = 3.0  # [E] m/s over the ground, below which a course means nothing
STEEP = 0.5  # [E] climb over speed from which on there is no course
SMOOTHED_S = 0.05  # [E] over which rates are averaged that swing the antenna
NO_ARM = np.zeros(3)
AXLE_M = 0.5  # [E] 1 sigma, from the IMU to where the vehicle does not slip
MOST_SIGMA_S = 0.15  # [E] of an offset that is worth a word
NOISE = 0.05  # [E] m/s^2 and, in rad/s, a hundredth of it: what both see differently anyway
CLEAR = 5.0  # [E] sigma from which on an offset is told
SMALL_S = 0.02  # [E] offset that is not worth a word


class Offset(NamedTuple):
    """By how much fixes are stamped later than the clock of the IMU has them."""

    offset_s: float
    sigma_s: float


class Clocks(NamedTuple):
    """What is known of the clocks, and what was done."""

    found: Offset | None  # by the motion, before anything was done
    applied_s: float  # that was taken from the times of GNSS


def made_one(scenario, data):
    """Dataset with the times of GNSS on the clock of the IMU, and Clocks.

    DataError where the scenario wants the offset to be found and the motion does not show it.
    """
    found = find(data.imu, data.fixes, np.array(scenario.gnss.lever_arm))
    wanted_s = scenario.gnss.clock_offset
    if np.isinf(wanted_s):
        if found is None:
            words = "the motion does not show it; GNSS velocities in a motion that changes would"
            raise DataError(f"gnss.clock_offset: 'find': {words}; give a time")
        wanted_s = found.offset_s
    if not wanted_s:
        return data, Clocks(found, 0.0)
    moved = [
        fix._replace(t_valid_s=fix.t_valid_s - wanted_s, t_available_s=fix.t_available_s - wanted_s)
        for fix in data.fixes
    ]
    return data._replace(fixes=moved), Clocks(found, float(wanted_s))


def oddities(common):
    """What is to be warned of: (field, text)."""
    found = common.found
    if found is None:
        return
    left = Offset(found.offset_s - common.applied_s, found.sigma_s)
    if is_reported(left):
        seen = f"{found.offset_s:+.3f} s, 1 sigma {found.sigma_s:.3f} s"
        yield (
            "gnss.clock_offset",
            f"by the motion, fixes are stamped {seen}, later than the IMU's clock has them; write "
            "'find' or the value, and let the filter estimate the rest (navigation.states: [gps_latency])",
        )


def find(imu, fixes, arm_b=NO_ARM):
    """Offset of the clocks, or None if the motion does not show it.

    imu : Increments;  fixes : GpsFix;  arm_b : (3,) m, IMU to antenna
    """
    fixes = [fix for fix in fixes if fix.valid and np.isfinite(fix.v_ea_e[0])]
    pairs = [(a, b) for a, b in pairwise(fixes) if _is_usable(a, b)]
    inside = [
        pair for pair in pairs
        if imu.t_s[0] + MOST_S < pair[0].t_valid_s and pair[1].t_valid_s < imu.t_s[-1] - MOST_S
    ]  # fmt: skip
    if len(inside) < FEWEST:
        return None
    shifts_s = np.arange(-MOST_S, MOST_S + 0.5 * STEP_S, STEP_S)
    seen = _Seen(imu, arm_b)
    cost, count, coarse_s = np.zeros(len(shifts_s)), 0, 0.0
    for said, sigma, felt, own_s in (_force(seen, inside), _course_rate(seen, inside)):
        if len(said) < FEWEST:
            continue
        misfit = np.array([_misfit(said, sigma, felt(shift_s)) for shift_s in shifts_s])
        if misfit.max() < 4.0 * misfit.min() + 4.0 * len(said):
            continue  # nothing happens that would show it
        cost, count = cost + misfit, count + len(said)
        coarse_s = max(coarse_s, own_s)
    return _least(shifts_s, cost, count, coarse_s) if count else None


def is_reported(offset):
    """Whether an Offset (or None) is one that the user should be told of."""
    return offset is not None and abs(offset.offset_s) > max(CLEAR * offset.sigma_s, SMALL_S)


def _is_usable(earlier, later):
    return 0.0 < later.t_valid_s - earlier.t_valid_s <= LONGEST_S


class _Seen:
    """Integrals of the IMU in axes that do not turn, at the times of its samples."""

    def __init__(self, imu, arm_b):
        self.t_s = imu.t_s
        step_s = float(np.median(np.diff(imu.t_s)))
        wide = max(1, round(SMOOTHED_S / step_s))
        omega_b = np.column_stack(
            [np.convolve(one, np.full(wide, 1.0 / wide), "same") for one in imu.dtheta_b.T / step_s]
        )
        self.swing = np.cross(omega_b, arm_b)  # velocity of the antenna about the IMU, body axes
        self.gained = _gained(imu.dtheta_b, imu.dv_b, self.swing)
        up = imu.dv_b.sum(axis=0)  # of a vehicle that goes along the ground
        self.turned = -np.cumsum(imu.dtheta_b @ up) / max(float(np.linalg.norm(up)), 1e-9)

    def at(self, times_s, values):
        """Values at other times, (m,) or (m, 3)."""
        if values.ndim == 1:
            return np.interp(times_s, self.t_s, values)
        return np.column_stack([np.interp(times_s, self.t_s, column) for column in values.T])


@kernel
def _gained(dtheta_b, dv_b, swing_b):
    """Velocity that the antenna has gained, in the axes of the first sample: (N, 3) rad, m/s, m/s -> m/s."""
    C, gained, arm = np.eye(3), np.zeros_like(dv_b), np.zeros_like(dv_b)
    for k in range(1, len(dv_b)):
        half = rotation.dcm_from_rotvec(0.5 * dtheta_b[k])
        C = C @ half
        gained[k] = gained[k - 1] + C @ dv_b[k]
        C = C @ half
        arm[k] = C @ swing_b[k]
    return gained + arm


def _times(pairs):
    begin_s, end_s = (np.array([pair[k].t_valid_s for pair in pairs]) for k in (0, 1))
    return begin_s, end_s, end_s - begin_s


def _force(seen, pairs):
    """Lengths of the specific force [m/s^2]: by GNSS, their sigma, by the IMU at a shift, and 1 sigma [s] of
    the offset that comes out, whatever the noise."""
    begin_s, end_s, span_s = _times(pairs)
    said, sigma = [], []
    for (earlier, later), dt_s in zip(pairs, span_s, strict=True):
        coriolis = 2.0 * np.cross([0.0, 0.0, wgs84.OMEGA], 0.5 * (earlier.v_ea_e + later.v_ea_e))
        f = (later.v_ea_e - earlier.v_ea_e) / dt_s + coriolis - gravity.normal_gravity_e(later.r_ea_e)
        u = f / np.linalg.norm(f)
        said.append(np.linalg.norm(f))
        sigma.append(np.sqrt(u @ (earlier.R_v_e + later.R_v_e) @ u) / dt_s)

    def felt(shift_s):
        gained = seen.at(end_s + shift_s, seen.gained) - seen.at(begin_s + shift_s, seen.gained)
        return np.linalg.norm(gained, axis=1) / span_s

    return np.array(said), np.hypot(sigma, NOISE), felt, 0.0


def _course_rate(seen, pairs):
    """Rates of the course [rad/s], likewise; of the pairs that go along the ground."""
    courses = [[_course(fix) for fix in pair] for pair in pairs]
    used = [k for k, both in enumerate(courses) if None not in both]
    begin_s, end_s, span_s = _times([pairs[k] for k in used])
    first, last = (np.array([courses[k][i] for k in used]).reshape(-1, 2) for i in (0, 1))
    turn = (last[:, 0] - first[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
    sigma = np.hypot(first[:, 1], last[:, 1]) / np.maximum(span_s, 1e-9)

    speed = np.array([[_speed(fix) for fix in pairs[k]] for k in used]).reshape(-1, 2)

    def lead(at_s, fast):  # of the antenna's course, by its motion about the IMU
        swing = seen.at(at_s, seen.swing)
        return np.arctan2(swing[:, 1], np.maximum(fast, SLOW))

    def felt(shift_s):
        turned = seen.at(end_s + shift_s, seen.turned) - seen.at(begin_s + shift_s, seen.turned)
        led = lead(end_s + shift_s, speed[:, 1]) - lead(begin_s + shift_s, speed[:, 0])
        return (turned + led) / span_s

    own_s = AXLE_M / float(np.median(speed)) if used else 0.0
    return turn / np.maximum(span_s, 1e-9), np.hypot(sigma, 0.01 * NOISE), felt, own_s


def _speed(fix):
    return float(np.linalg.norm(fix.v_ea_e))


def _course(fix):
    """Course over the ground [rad] and its sigma; None if there is none."""
    v_n, speed, sigma = over_ground(fix)
    if speed < SLOW or abs(v_n[2]) > STEEP * speed:
        return None
    return float(np.arctan2(v_n[1], v_n[0])), sigma


def _misfit(said, sigma, felt):
    """Sum of squared differences over their sigmas, a constant difference taken out."""
    weight, d = sigma**-2, felt - said
    return float(np.sum(weight * (d - np.sum(weight * d) / np.sum(weight)) ** 2))


def _least(shifts_s, cost, count, coarse_s):
    """Offset at the least cost, from a parabola through it; None if it is at an end or too vague."""
    k = int(np.argmin(cost))
    wide = 3  # steps: the cost is made of straight pieces between the samples of the IMU
    if not wide <= k < len(cost) - wide:
        return None
    low, middle, high = cost[k - wide], cost[k], cost[k + wide]
    curvature = (low - 2.0 * middle + high) / (wide * STEP_S) ** 2
    if curvature <= 0.0:
        return None
    offset_s = shifts_s[k] + 0.5 * (low - high) / (low - 2.0 * middle + high) * wide * STEP_S
    sigma_s = float(np.hypot(np.sqrt(2.0 / curvature * max(1.0, middle / max(count - 2, 1))), coarse_s))
    return Offset(float(-offset_s), sigma_s) if sigma_s < MOST_SIGMA_S else None
