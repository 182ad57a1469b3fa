"""By how much the clocks of IMU and GNSS differ, before anything is navigated.

Two things both of them see, whatever the attitude is:

- the length of the mean specific force between two fixes, |dv/dt + Coriolis - g| by the velocities,
- the turn of the course, which the gyros see about the direction of the specific force (for a vehicle that
  goes along the ground).

The lever arm of the antenna counts: in a bend it goes elsewhere than the IMU. Where the axle is that does
not slip is not known; a metre between it and the IMU moves the course by 1 m over the speed, in time. So an
offset by the course is a coarse one, and the filter's own estimate (state gps_latency) is better by far.

The offset is where the squared differences over their noise are least per pair of fixes, while a constant
difference of each kind (biases) is free. Its sigma is from the curvature there, larger by what the
differences are larger than the noise, and from how far away an offset fits nearly as well: between two fixes
the motion may begin anywhere, and one that repeats itself fits a period later, too. Nothing is said where the
motion does not show it.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment import gravity
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.replay import series
from shefex_nav.replay.align_motion import over_ground
from shefex_nav.scenario.data_table import DataError

MOST_S = 20.0  # [E] largest offset that is looked for: more than the leap seconds between GPS and UTC, 18 s
COARSE_S, STEP_S = 0.05, 0.01  # [E] of the search, and around what it finds
INFORMED = 0.25  # [E] of the motion that all pairs show, which those within the IMU's data must have
LIKELY = 3.0  # sigma, up to which an offset fits nearly as well
LONGEST_S = 2.5  # [E] between fixes that are compared
FEWEST = 8  # [E] pairs of fixes
SLOW = 3.0  # [E] m/s over the ground, below which a course means nothing
STEEP = 0.5  # [E] climb over speed from which on there is no course
SMOOTHED_S = 0.05  # [E] over which rates are averaged that swing the antenna
NO_ARM = np.zeros(3)
AXLE_M = 0.5  # [E] 1 sigma, from the IMU to where the vehicle does not slip
MOST_SIGMA_S = 0.15  # [E] of an offset that is worth a word
NOISE = 0.05  # [E] m/s^2 and, in rad/s, a hundredth of it: what both see differently anyway
CLEAR = 5.0  # [E] sigma from which on an offset is told, or another one is out of the question
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
            words = (
                f"within {MOST_S:g} s the motion does not show it; GNSS velocities in one that changes would"
            )
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
    if len(pairs) < FEWEST:
        return None
    seen, kinds = Seen(imu, arm_b), []
    shifts_s = np.arange(-MOST_S, MOST_S + 0.5 * COARSE_S, COARSE_S)
    for kind in (_force(seen, pairs), _course_rate(seen, pairs)):
        cost = _costs(kind, seen, shifts_s)
        fits = np.isfinite(cost)
        count = len(kind.said)
        if fits.any() and cost[fits].max() >= 4.0 * cost[fits].min() + 4.0 * count:
            kinds.append(kind)  # otherwise nothing happens that would show it
    return _least(kinds, seen, shifts_s) if kinds else None


def _costs(kind, seen, shifts_s):
    """Sum of squared differences at each shift, as if all pairs were in it; inf where too few show motion.

    kind : _Kind -> (len(shifts_s),)
    """
    cost, count = np.full(len(shifts_s), np.inf), len(kind.said)
    if count < FEWEST:
        return cost
    motion = _misfit(kind.said, kind.sigma, np.zeros(count)) / count
    for k, shift_s in enumerate(shifts_s):
        inside = _inside(kind, seen, shift_s)
        n = np.count_nonzero(inside)
        if n < max(FEWEST, 0.5 * count):
            continue
        said, sigma = kind.said[inside], kind.sigma[inside]
        if _misfit(said, sigma, np.zeros(n)) >= INFORMED * motion * n:
            cost[k] = _misfit(said, sigma, kind.felt(shift_s)[inside]) * count / n
    return cost


def is_reported(offset):
    """Whether an Offset (or None) is one that the user should be told of."""
    return offset is not None and abs(offset.offset_s) > max(CLEAR * offset.sigma_s, SMALL_S)


def _is_usable(earlier, later):
    return 0.0 < later.t_valid_s - earlier.t_valid_s <= LONGEST_S


class _Kind(NamedTuple):
    """Something that both see, of n pairs of fixes."""

    begin_s: np.ndarray  # (n,) the earlier fix
    end_s: np.ndarray  # (n,)
    said: np.ndarray  # (n,) by GNSS
    sigma: np.ndarray  # (n,) of that
    felt: object  # by the IMU: function of a shift [s] -> (n,)
    own_s: float  # 1 sigma of the offset that comes out, whatever the noise


class Seen:
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
        return series.between(times_s, self.t_s, values)


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
    """Lengths of the specific force [m/s^2]: _Kind."""
    begin_s, end_s, span_s = _times(pairs)
    said, sigma = [], []
    for (earlier, later), dt_s in zip(pairs, span_s, strict=True):
        f = force_between(earlier, later, dt_s)
        u = f / np.linalg.norm(f)
        said.append(np.linalg.norm(f))
        sigma.append(np.sqrt(u @ (earlier.R_v_e + later.R_v_e) @ u) / dt_s)

    def felt(shift_s):
        gained = seen.at(end_s + shift_s, seen.gained) - seen.at(begin_s + shift_s, seen.gained)
        return np.linalg.norm(gained, axis=1) / span_s

    return _Kind(begin_s, end_s, np.array(said), np.hypot(sigma, NOISE), felt, 0.0)


def force_between(earlier, later, dt_s):
    """Mean specific force between two fixes by their velocities, dt_s apart: (3,) m/s^2, frame e."""
    coriolis = 2.0 * np.cross([0.0, 0.0, wgs84.OMEGA], 0.5 * (earlier.v_ea_e + later.v_ea_e))
    return (later.v_ea_e - earlier.v_ea_e) / dt_s + coriolis - gravity.normal_gravity_e(later.r_ea_e)


def _course_rate(seen, pairs):
    """Rates of the course [rad/s] of the pairs that go along the ground: _Kind."""
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
    said = turn / np.maximum(span_s, 1e-9)
    return _Kind(begin_s, end_s, said, np.hypot(sigma, 0.01 * NOISE), felt, own_s)


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


def _least(kinds, seen, shifts_s):
    """Offset at the least cost, from a parabola through it; None if it is at an end or too vague."""
    wide = 3  # steps: the cost is made of straight pieces between the samples of the IMU
    fine_s = _valleys(sum(_costs(kind, seen, shifts_s) for kind in kinds), shifts_s, wide)
    if not len(fine_s):
        return None  # the kinds have motion within the data of the IMU at different shifts
    costs = sum(_costs(kind, seen, fine_s.ravel()) for kind in kinds).reshape(fine_s.shape)
    best, m = np.unravel_index(int(np.argmin(costs)), costs.shape)
    cost, count = costs[best], sum(len(kind.said) for kind in kinds)
    if not wide <= m < len(cost) - wide or not np.isfinite(cost[[m - wide, m, m + wide]]).all():
        return None
    low, middle, high = cost[m - wide], cost[m], cost[m + wide]
    curvature = (low - 2.0 * middle + high) / (wide * STEP_S) ** 2
    if curvature <= 0.0:
        return None
    offset_s = fine_s[best, m] + 0.5 * (low - high) / (low - 2.0 * middle + high) * wide * STEP_S
    scale = max(1.0, middle / max(count - 2, 1))
    likely_s = fine_s[best][cost - middle < LIKELY**2 * scale]
    vague_s = float(np.abs(likely_s - offset_s).max()) / LIKELY
    for lowest_s in np.take_along_axis(fine_s, np.argmin(costs, axis=1)[:, None], 1)[:, 0]:
        if _excess(kinds, seen, lowest_s, fine_s[best, m]) < CLEAR**2 * scale:
            vague_s = max(vague_s, abs(lowest_s - offset_s) - STEP_S)
    own_s = max(kind.own_s for kind in kinds)
    curved_s = np.sqrt(2.0 / curvature * scale)
    sigma_s = float(np.hypot(max(curved_s, vague_s), own_s))
    return Offset(float(-offset_s), sigma_s) if sigma_s < MOST_SIGMA_S else None


def _excess(kinds, seen, shift_s, best_s):
    """By how much the squared differences at a shift exceed those at another, of the pairs that both have.

    Zero of no such pair: nothing tells the two shifts apart.
    """

    def misfit(kind, at_s):
        both = _inside(kind, seen, shift_s) & _inside(kind, seen, best_s)
        return _misfit(kind.said[both], kind.sigma[both], kind.felt(at_s)[both]) if both.any() else 0.0

    return sum(misfit(kind, shift_s) - misfit(kind, best_s) for kind in kinds)


def _inside(kind, seen, shift_s):
    """Which pairs lie within the data of the IMU."""
    return (kind.begin_s + shift_s >= seen.t_s[0]) & (kind.end_s + shift_s <= seen.t_s[-1])


def _valleys(rough, shifts_s, wide):
    """Fine shifts [s] around each shift at which the rough cost is least among its neighbours: (V, W).

    A valley may be narrower than a rough step, so that which is the deepest only the fine ones tell.
    """
    beside = np.pad(rough, 1, constant_values=np.inf)
    is_low = np.isfinite(rough) & (rough <= beside[:-2]) & (rough <= beside[2:])
    reach = round(COARSE_S / STEP_S) + wide
    return shifts_s[is_low, None] + STEP_S * np.arange(-reach, reach + 1)
