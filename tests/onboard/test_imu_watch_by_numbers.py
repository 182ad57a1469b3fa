"""Watch over the inertial unit, block by block: runs, variances and means against their definitions."""

import numpy as np
import pytest
from plain import plain
from scipy import integrate, stats

from shefex_nav.onboard.navigation import integrity_imu as imu
from shefex_nav.onboard.navigation import integrity_readings
from shefex_nav.onboard.navigation.integrity_readings import GOOD, REPEATED, SATURATED, SILENT, STUCK
from shefex_nav.records import ImuBlock

DT, N = 1.0 / 400.0, 4
RULES = imu.ImuRules(
    np.array([30.0, 40.0]),
    np.array([2.0, 100.0]),
    np.array([0.7, 20.0]),
    np.array([0.3, 5.0]),
    np.array([0.5, 9.0]),
)


@pytest.mark.parametrize("age_s", [1e-3, 0.02, 3.0, 10.0, 200.0])
def test_an_error_with_a_memory_integrates_to_its_variance(age_s):
    """Double integral of s^2 exp(-|t - u|/T) over the time, T = 10 s."""
    wanted, _ = integrate.quad(lambda t: 2.0 * 0.49 * 10.0 * (1.0 - np.exp(-t / 10.0)), 0.0, age_s)
    assert plain(imu.integrated_variance)(0.7, 0.0, age_s, False) == pytest.approx(wanted, rel=2e-3)


def test_a_held_reading_is_right_at_first():
    """The truth runs away at 0.3 per second from a mean 0.1 s old: (c (tau + t/2) t)^2, if that is less."""
    held = plain(imu.integrated_variance)
    for t in (0.01, 0.1, 1.0):
        assert held(0.7, 0.3, t, True) == pytest.approx((0.3 * (0.1 + 0.5 * t) * t) ** 2)
    assert held(0.7, 0.3, 30.0, True) == held(0.7, 0.3, 30.0, False)


@pytest.mark.parametrize("sigma, quantum", [(1.0, 1.0), (0.3, 1.0), (1.0, 0.1)])
def test_equal_readings_in_a_row_have_the_probability_of_one_count(sigma, quantum):
    p = stats.norm.cdf(0.5 * quantum / sigma) - stats.norm.cdf(-0.5 * quantum / sigma)
    n = integrity_readings.repeats(sigma, quantum)
    assert n == max(20.0, np.ceil(np.log(1e-9) / np.log(p)))


def test_bounds_of_repeats():
    assert integrity_readings.repeats(1.0, 0.0) == 20.0  # a driver may send one sample twice
    assert integrity_readings.repeats(1e-3, 1.0) == np.inf and integrity_readings.repeats(0.0, 1.0) == np.inf
    assert integrity_readings.repeats(-1.0, 1.0) == np.inf
    assert (
        integrity_readings.repeats(1e-200, 1.0, carried=True)
        == integrity_readings.repeats(5e-324, 1.0, carried=True)
        == np.inf
    )
    width = 10.0 + 1.165  # quanta of ten sigma: a random walk stays within them for so long
    assert integrity_readings.repeats(0.1, 1.0, carried=True) == np.ceil(
        2.0 * np.log(4e9 / np.pi) * (width / np.pi) ** 2
    )


def block(t_s, values, saturated=False, valid=True):
    values = np.array(values, dtype=float)
    dtheta_b, dv_b = (np.ascontiguousarray(values[:, k : k + 3]) for k in (0, 3))
    return ImuBlock(t_s, t_s, DT, dtheta_b, dv_b, saturated, valid)


RATE = np.array([0.1, -0.2, 0.05, 3.0, -4.0, 9.0])


def through_a_despin(begin, length, samples=40, dt_s=5e-4):
    """A gyro of 2 kHz that repeats one reading `length` times from a sample of a block on, in a despin.

    -> what its angle is off by in the end, and the sigma that the filter is given for it, rad
    """
    rules = RULES._replace(repeats=np.full(2, 20.0), range=np.full(2, np.inf))
    watch, rng = imu.start(rules, samples), np.random.default_rng(1)
    readings, densities, off, variance, sensed = np.empty((samples, 6)), np.empty((3, 3)), 0.0, 0.0, None
    for k in range(140):
        t_s = (samples * k + np.arange(samples) + 0.5) * dt_s
        rate = 9.4 - 11.7 * np.maximum(t_s - 2.5, 0.0)
        values = dt_s * (rate[:, None] + 1e-6 * rng.standard_normal((samples, 6)))
        true = values[:, 0].copy()
        since = samples * (k - 130) - begin + np.arange(samples)
        sensed = values[since == 0, 0] if np.any(since == 0) else sensed
        values[(since >= 0) & (since < length), 0] = sensed
        end_s, dtheta_b, dv_b = samples * (k + 1) * dt_s, values[:, :3].copy(), values[:, 3:].copy()
        imu.screen(watch, ImuBlock(end_s, end_s, dt_s, dtheta_b, dv_b, False, True), readings, densities)
        off, variance = off + (readings[:, 0] - true).sum(), variance + densities[0, 0] * samples * dt_s
    return off, np.sqrt(variance)


@pytest.mark.parametrize("begin, length", [(10, 25), (0, 40), (15, 25), (-5, 25), (-10, 31), (-30, 55)])
def test_an_axis_that_is_read_again_in_the_block_in_which_it_is_stuck_owes_all_of_the_block(begin, length):
    """All of the block is given the mean, a tenth of a second old: 17 mrad off at 11.7 rad/s^2."""
    off, sigma = through_a_despin(begin, length)
    assert abs(off) > 0.015 and abs(off) < 1.2 * sigma


class Unit:
    """Blocks of an unit whose readings change with every sample, one after the other."""

    def __init__(self, rules=RULES):
        self.watch, self.t_s, self.k = imu.start(rules, N), 0.0, 0
        self.readings, self.densities = np.empty((N, 6)), np.empty((3, 3))

    def values(self):
        """Next block: (4, 6), no two samples alike, mean RATE dt."""
        self.k += 1
        ripple = 1e-3 * np.array([1.0, -2.0, 3.0, -2.0])[:, None] * (1.0 + 0.01 * self.k)
        return (RATE * (1.0 + ripple - ripple.mean())) * DT

    def give(self, values=None, **given):
        """What `screen` says to a block. -> NavHealth"""
        self.t_s += N * DT
        values = self.values() if values is None else values
        return imu.screen(self.watch, block(self.t_s, values, **given), self.readings, self.densities)

    def settle(self, number=100):
        for _ in range(number):
            self.give()
        return self


def test_the_mean_of_a_healthy_axis_follows_in_a_tenth_of_a_second():
    unit = Unit()
    unit.give()
    np.testing.assert_allclose(unit.watch.axes["mean_rate"], RATE, rtol=1e-9)
    for _ in range(10):
        unit.give(3.0 * unit.values())
    kept = (1.0 - 0.1) ** 10  # 10 ms blocks, time constant 0.1 s
    np.testing.assert_allclose(unit.watch.axes["mean_rate"], RATE * (kept + 3.0 * (1.0 - kept)), rtol=1e-9)
    assert not unit.densities.any() and np.all(unit.watch.state == GOOD)


@pytest.mark.parametrize("k", range(6))
def test_an_axis_is_stuck_when_it_has_repeated_itself_too_often(k):
    """30 of a gyro, 40 of an accelerometer; it is given its mean, and noise for all that was missed."""
    unit, limit = Unit().settle(), RULES.repeats[k // 3]
    held, blocks, said = unit.readings[-1, k], 0, []
    while not said and blocks < 30:
        values = unit.values()
        values[:, k], blocks = held, blocks + 1
        said = unit.give(values)
    assert 1 + N * blocks >= limit > 1 + N * (blocks - 1)  # the first of them was the last good one
    assert [(one.source, one.healthy, one.t_s) for one in said] == [(imu.NAMES[k], False, unit.t_s)]
    assert unit.watch.state[k] == STUCK and said[0].reason.startswith("stuck")
    np.testing.assert_allclose(unit.readings[:, k], RATE[k] * DT, rtol=1e-6)
    age_s = (1 + N * blocks) * DT
    wrong, change = RULES.wrong[k // 3], RULES.change[k // 3]
    missed = ((held / DT - RATE[k]) * age_s) ** 2
    variance = plain(imu.integrated_variance)(wrong, change, age_s, True) + missed
    assert unit.densities[k // 3, k % 3] * N * DT == pytest.approx(variance, rel=1e-6)
    assert np.count_nonzero(unit.densities) == 1
    before = plain(imu.integrated_variance)(wrong, change, age_s, True)
    values = unit.values()
    values[:, k] = held
    assert not unit.give(values)
    more = plain(imu.integrated_variance)(wrong, change, age_s + N * DT, True) - before
    assert unit.densities[k // 3, k % 3] * N * DT == pytest.approx(more, rel=1e-6)
    said = unit.give()
    assert said[0].healthy and unit.watch.state[k] == GOOD and not unit.densities.any()
    assert np.isnan(unit.watch.axes[k]["since_s"]) and unit.watch.axes[k]["charged"] == 0.0


def test_a_unit_that_is_silent_or_repeats_itself_is_given_its_means():
    unit = Unit().settle()
    last = unit.readings.copy()
    (said,) = unit.give(np.full((N, 6), np.nan), valid=False)
    assert (said.source, said.healthy, said.reason) == ("imu", False, "no samples")
    assert np.all(unit.watch.state == SILENT)
    np.testing.assert_allclose(unit.readings, np.tile(RATE * DT, (N, 1)), rtol=1e-9)
    for triad in (0, 1):
        variance = plain(imu.integrated_variance)(RULES.wrong[triad], RULES.change[triad], N * DT, True)
        np.testing.assert_allclose(unit.densities[triad] * N * DT, variance, rtol=1e-9)
    assert imu.replaced(unit.watch.state)
    (said,) = unit.give(last)
    assert said.reason == "the same block of samples again" and np.all(unit.watch.state == REPEATED)
    one_apart = last.copy()
    one_apart[2, 4] += 1e-12
    assert unit.give(one_apart)[0].healthy
    never = Unit(RULES._replace(repeats=np.array([np.inf, 40.0])))
    never.give(last)
    assert not never.give(last)  # a unit without noise may say the same again
    unit.settle(3)
    values = unit.values()
    values[1, 2] = np.nan
    assert unit.give(values)[0].reason == "no samples"


@pytest.mark.parametrize("k, at_end", [(1, 2.0), (4, -100.0)])
def test_an_axis_at_the_end_of_its_range_keeps_its_reading(k, at_end):
    """Only the time counts that it spends there: V of that time, by what a reading there leaves out."""
    unit = Unit().settle()

    def give(share=1.0):
        values = unit.values()
        values[2, k] = share * at_end * DT
        return unit.give(values), values

    assert not give(0.9985)[0]
    (said,), values = give(0.9991)
    assert (said.source, said.reason) == (imu.NAMES[k], "at the end of its range")
    assert np.array_equal(unit.readings, values) and not imu.replaced(unit.watch.state)
    charged = [unit.densities[k // 3, k % 3] * N * DT]
    for _ in range(3):
        assert not give()[0]
        charged.append(unit.densities[k // 3, k % 3] * N * DT)
    for n in range(1, 5):
        variance = plain(imu.integrated_variance)(RULES.missed[k // 3], 0.0, n * N * DT, False)
        assert sum(charged[:n]) == pytest.approx(variance, rel=1e-9)
    for _ in range(100):  # away from it, for a second
        assert not unit.give() and not unit.densities.any()
    assert unit.watch.state[k] == SATURATED
    assert unit.give()[0].healthy and unit.watch.axes[k]["at_end_s"] == 0.0


def test_a_flag_without_an_axis_is_any_and_with_one_it_is_that():
    unit = Unit().settle()
    (said,) = unit.give(saturated=True)
    assert said.source == "imu" and np.all(unit.watch.state == SATURATED)
    unit = Unit().settle()
    values = unit.values()
    values[0, 5] = 100.0 * DT
    (said,) = unit.give(values, saturated=True)
    assert said.source == "accelerometer z"


def test_longer_runs_are_allowed_where_they_have_ended_by_themselves():
    """A run of 35 that ends: twice as long is allowed of that triad; of the other it is as before."""
    unit = Unit().settle()

    def run(k, number):
        held, found = unit.readings[-1, k], []
        for _ in range(number):
            values = unit.values()
            values[:, k] = held
            found += unit.give(values)
        return found + unit.give()

    assert not run(0, 7) and unit.watch.axes[0]["longest"] == 29.0
    assert not run(1, 14) and unit.watch.axes[1]["longest"] == 57.0  # 2 times 29
    assert len(run(3, 10)) == 2  # stuck, and well again
    assert unit.watch.axes[3]["longest"] == 41.0  # it ended soon: no fault, perhaps
    stuck = run(4, 110)  # 441: longer than a second
    assert len(stuck) == 2 and unit.watch.axes[4]["longest"] < 41.0


def test_a_fix_says_where_the_integral_was():
    """From there the error counts anew, and what is held was right at the beginning, not at the fix."""
    unit = Unit().settle()
    begun_s = unit.t_s
    for _ in range(50):
        unit.give(np.full((N, 6), np.nan), valid=False)
    fixed_s = unit.t_s - 0.2
    imu.fixed(unit.watch, 1, fixed_s, unit.t_s)
    axes = unit.watch.axes
    assert np.isnan(axes["fixed_s"][:3]).all() and np.all(axes["fixed_s"][3:] == fixed_s)
    of = plain(imu.integrated_variance)
    np.testing.assert_allclose(axes["charged"][3:], of(20.0, 5.0, 0.2, False))
    unit.give(np.full((N, 6), np.nan), valid=False)
    more = of(20.0, 5.0, 0.21, False) - of(20.0, 5.0, 0.2, False)
    np.testing.assert_allclose(unit.densities[1] * N * DT, more, rtol=1e-6)
    more = of(0.7, 0.3, 0.51, True) - of(0.7, 0.3, 0.5, True)
    np.testing.assert_allclose(unit.densities[0] * N * DT, more, rtol=1e-6)
    imu.fixed(unit.watch, 0, begun_s - 0.01, unit.t_s)  # of an instant before it began
    assert np.isnan(axes["fixed_s"][:3]).all()
    imu.fixed(unit.watch, 0, unit.t_s + 0.5, unit.t_s)
    assert not axes["charged"][:3].any()


def test_a_fix_leaves_of_a_saturated_axis_the_time_since():
    unit = Unit().settle()
    for _ in range(20):
        values = unit.values()
        values[0, 0] = 2.0 * DT
        unit.give(values)
    assert unit.watch.axes[0]["at_end_s"] == pytest.approx(0.2)
    imu.fixed(unit.watch, 0, unit.t_s - 0.05, unit.t_s)
    assert unit.watch.axes[0]["at_end_s"] == pytest.approx(0.05)
    assert unit.watch.axes[0]["charged"] == pytest.approx((0.5 * 0.05) ** 2, rel=2e-3)
    unit.settle(10)
    imu.fixed(unit.watch, 0, unit.t_s - 0.1, unit.t_s)
    assert unit.watch.axes[0]["at_end_s"] == pytest.approx(0.05)  # no more than it was


def at_range(unit, samples=N):
    """A block whose first samples of accelerometer x are at the end of its range. -> variance, m^2/s^2"""
    values = unit.values()
    values[:samples, 3] = RULES.range[1] * DT
    unit.give(values)
    return unit.densities[1, 0] * N * DT


def test_a_fix_leaves_of_a_reading_that_may_be_all_false_the_time_since():
    """At the end of the range throughout: what a fix leaves is charged by the range, as the rest is."""
    unit, of = Unit().settle(), plain(imu.integrated_variance)
    assert sum(at_range(unit) for _ in range(50)) == pytest.approx(of(100.0, 0.0, 0.5, False))
    for _ in range(3):
        imu.fixed(unit.watch, 1, unit.t_s - 0.1, unit.t_s)
        more = of(100.0, 0.0, 0.15, False) - of(100.0, 0.0, 0.1, False)
        assert sum(at_range(unit) for _ in range(5)) == pytest.approx(more)


def test_each_block_at_the_end_of_the_range_adds_by_its_own_sigma():
    """A second of all readings there, then one of peaks, which miss less; silence before does not pay."""
    unit, of = Unit().settle(), plain(imu.integrated_variance)
    assert sum(at_range(unit) for _ in range(100)) == pytest.approx(of(100.0, 0.0, 1.0, False))
    more = of(9.0, 0.0, 2.0, False) - of(9.0, 0.0, 1.0, False)
    assert sum(at_range(unit, samples=1) for _ in range(100)) == pytest.approx(more)
    more = of(100.0, 0.0, 2.5, False) - of(100.0, 0.0, 2.0, False)
    assert sum(at_range(unit) for _ in range(50)) == pytest.approx(more)
    unit = Unit().settle()
    for _ in range(100):
        unit.give(np.full((N, 6), np.nan), valid=False)
    assert at_range(unit) == pytest.approx(of(100.0, 0.0, N * DT, False))


@pytest.mark.parametrize("blocks", [10, 100])
def test_silence_after_the_end_of_the_range_adds_what_it_adds_alone(blocks):
    """Without what a held reading is right by at first: the mean that is held has been at the end, too."""
    unit, of = Unit().settle(), plain(imu.integrated_variance)
    for _ in range(blocks):
        at_range(unit)
    silent = 0.0
    for _ in range(50):
        unit.give(np.full((N, 6), np.nan), valid=False)
        silent += unit.densities[1, 0] * N * DT
    assert silent == pytest.approx(of(20.0, 5.0, 0.5, False))


def test_changes_are_told_by_axis_or_of_the_unit_as_a_whole():
    state = np.array([GOOD, STUCK, GOOD, GOOD, SATURATED, GOOD])
    assert [(one.source, one.healthy) for one in imu.health(7.0, 0b10010, state)] == [
        ("gyro y", False), ("accelerometer y", False)
    ]  # fmt: skip
    assert len(imu.health(7.0, 0b111111, state)) == 6
    assert [one.source for one in imu.health(7.0, 0b111111, np.full(6, GOOD))] == ["imu"]
