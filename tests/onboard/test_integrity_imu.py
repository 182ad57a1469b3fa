"""The watch over the IMU: what it sees, when, and that its noise covers the error that is made."""

import numpy as np
import pytest
from scipy.stats import norm

from shefex_nav.onboard.navigation import integrity_imu as watch_imu
from shefex_nav.onboard.navigation import integrity_readings
from shefex_nav.onboard.navigation.integrity_readings import GOOD, REPEATED, SATURATED, SILENT, STUCK
from shefex_nav.records import ImuBlock
from shefex_nav.world.imu import quantise

DT, N = 1.0 / 400.0, 4
SIGMA, QUANTUM = np.array([4.4e-7, 2.5e-5]), np.array([4.85e-7, 5e-5])  # of the default mission's IMU
RULES = watch_imu.ImuRules(
    repeats=np.array([integrity_readings.repeats(*pair) for pair in zip(SIGMA, QUANTUM, strict=True)]),
    range=np.array([np.radians(1000.0), 400.0]),
    wrong=np.array([1.0, 50.0]),
    change=np.array([0.35, 30.0]),
    missed=np.array([np.radians(1000.0), 50.0]),
)


def readings(seconds, rng, rate=(0.3, -0.02, 0.01), f=(20.0, 0.5, -0.3)):
    """(n, 6) increments of gyros and accelerometers, noisy and rounded."""
    n = round(seconds * 400)
    noise = rng.standard_normal((n, 6)) * np.repeat(SIGMA, 3)
    quantum = np.repeat(QUANTUM, 3)
    return np.rint((np.concatenate([rate, f]) * DT + noise) / quantum) * quantum


def blocks(samples, saturated=(), lost=()):
    for k in range(len(samples) // N):
        rows = samples[N * k : N * k + N]
        t_s = (k + 1) * N * DT
        values = np.full((2, N, 3), np.nan) if k in lost else (rows[:, :3], rows[:, 3:])
        yield ImuBlock(t_s, t_s, DT, *values, k in saturated, k not in lost)


def run(samples, rules=RULES, **options):
    """What `screen` gives for every block: readings (4, 6), densities (n, 3, 3), states (n, 6), health."""
    watch, found = watch_imu.start(rules, N), []
    for block in blocks(samples, **options):
        out, densities = np.empty((N, 6)), np.empty((3, 3))
        health = watch_imu.screen(watch, block, out, densities)
        found.append((out, densities, watch.state.copy(), health))
    out, densities, states, health = zip(*found, strict=True)
    return out, np.array(densities), np.array(states), [record for group in health for record in group]


def test_a_healthy_unit_passes_unchanged():
    """Two minutes: 288 000 readings, of which one in a thousand million might look stuck."""
    watch = watch_imu.start(RULES, N)
    screened, densities = np.empty((N, 6)), np.empty((3, 3))
    for block in blocks(readings(120.0, np.random.default_rng(1))):
        assert not watch_imu.screen(watch, block, screened, densities)
        assert not densities.any()
        assert np.array_equal(screened, np.hstack([block.dtheta_b, block.dv_b]))


def test_repeats_follow_from_noise_and_quantum():
    assert integrity_readings.repeats(4.4e-7, 4.85e-7) == pytest.approx(np.log(1e-9) / np.log(0.418), abs=1.0)
    assert integrity_readings.repeats(0.0, 1e-6) == np.inf  # without noise it may repeat for ever
    assert integrity_readings.repeats(1e-9, 1e-6) == np.inf
    assert integrity_readings.repeats(1e-6, 0.0) == integrity_readings.FEWEST_REPEATS


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("zero", [False, True])
def test_a_stuck_axis_is_found_after_as_many_readings_as_it_takes(axis, zero):
    samples = readings(4.0, np.random.default_rng(axis))
    samples[800:1200, axis] = 0.0 if zero else samples[799, axis]
    out, _, states, health = run(samples)
    needed = int(RULES.repeats[axis // 3])
    bad = np.flatnonzero(states[:, axis])
    assert 800 <= N * bad[0] + N - 1 <= 800 + needed + N
    assert bad[-1] in (299, 300)  # the first new reading may happen to be the same
    assert np.all(states[bad, axis] == STUCK)
    assert not np.delete(states, axis, axis=1).any()
    assert [record.source for record in health] == [watch_imu.NAMES[axis]] * 2
    assert [record.healthy for record in health] == [False, True] and "stuck" in health[0].reason
    # it is given the mean that it had: within 5 sigma of the mean of the 40 samples that count
    good = samples[:, axis].reshape(-1, N).sum(axis=1)
    held = out[250][:, axis].sum()
    rounding = QUANTUM[axis // 3] / np.sqrt(12.0)
    assert held == pytest.approx(
        good[:199].mean(), abs=5 * N * np.hypot(SIGMA[axis // 3], rounding) / np.sqrt(20)
    )


def test_the_noise_covers_a_held_reading_that_the_truth_leaves():
    """Variance given until t is that of the integrated error, whenever the fault was found."""
    samples = readings(30.0, np.random.default_rng(2))
    samples[400:, 1] = samples[399, 1]
    _, densities, _, _ = run(samples)
    given = np.cumsum(densities[:, 0, 1]) * N * DT
    for age in (0.2, 1.0, 5.0, 20.0):
        k = round((1.0 + age) / (N * DT)) - 1
        age_s = age + DT  # counted from the reading that is repeated
        # sigma of the angle: c (tau + t/2) t at first, of a mean that is tau old, then that of a
        # Gauss-Markov rate, by quadrature
        t = np.linspace(0.0, age_s, 20001)
        weight = (age_s - t) * np.exp(-t / watch_imu.SIGN_S)
        markov = 2.0 * RULES.wrong[0] ** 2 * np.trapezoid(weight, t)
        expected = min(markov, (RULES.change[0] * (integrity_readings.MEAN_S + 0.5 * age_s) * age_s) ** 2)
        assert given[k] == pytest.approx(expected, rel=1e-3)


def test_the_noise_covers_what_a_dead_axis_has_lost_until_it_is_seen():
    """An accelerometer under 20 m/s^2 of thrust falls to zero; until then velocity is lost."""
    samples = readings(3.0, np.random.default_rng(5))
    samples[800:, 3] = 0.0
    out, densities, states, _ = run(samples)
    seen = int(np.flatnonzero(states[:, 3] == STUCK)[0])
    lost = sum(samples[N * k, 3] * N - out[seen][:, 3].sum() for k in range(200, seen))  # m/s
    assert lost < -0.4
    sigma = np.sqrt(densities[: seen + 1, 1, 0].sum() * N * DT)
    assert 1.0 < sigma / abs(lost) < 1.3


def test_a_unit_that_is_silent_from_the_start_is_given_nothing_to_hold():
    """Zeros, with the variance of readings that mean nothing: on the pad it would sense 9.8 m/s^2."""
    out, densities, states, _ = run(readings(1.0, np.random.default_rng(6)), lost=range(10))
    assert np.all(states[:10] == SILENT) and not states[10:].any()
    assert not np.any(out[:10])
    age_s = 10 * N * DT
    assert np.allclose(densities[:, :2].sum(axis=0) * N * DT, (RULES.wrong[:, None] * age_s) ** 2, rtol=0.01)


def test_a_silent_unit_is_bridged_with_the_mean():
    samples = readings(3.0, np.random.default_rng(3))
    out, densities, states, health = run(samples, lost=range(100, 120))
    assert np.all(states[100:120] == SILENT) and not np.delete(states, range(100, 120), axis=0).any()
    for k in range(100, 120):
        assert np.allclose(out[k][:, 3:] / DT, [20.0, 0.5, -0.3], atol=0.1)
        assert np.allclose(out[k][:, :3] / DT, [0.3, -0.02, 0.01], atol=1e-3)
    age = 20 * N * DT
    given = densities[:, :2].sum(axis=0) * N * DT
    assert np.allclose(given, (RULES.change[:, None] * (integrity_readings.MEAN_S + 0.5 * age) * age) ** 2)
    assert [(record.source, record.healthy) for record in health] == [("imu", False), ("imu", True)]


def test_a_block_sent_again_is_not_believed():
    samples = readings(3.0, np.random.default_rng(4))
    samples[400:480] = np.tile(samples[396:400], (20, 1))
    _, densities, states, health = run(samples)
    assert np.all(states[100:120] == REPEATED) and not states[120:].any() and not states[:100].any()
    assert densities[100:120, :2].all() and "again" in health[0].reason


@pytest.mark.parametrize("lost", [3, 5, 12])
@pytest.mark.parametrize("again", [False, True])
def test_what_a_despin_takes_off_the_rate_meanwhile_shows_at_the_end(lost, again):
    """2000 deg/s^2: the mean that is held lags by 200 deg/s; the turn is off by more than `change` says."""
    samples = readings(3.0, np.random.default_rng(7))
    t_s = DT * np.arange(1, len(samples) + 1)
    rate = np.radians(np.interp(t_s, [0.9, 1.4], [900.0, -100.0]))
    samples[:, 0] += rate * DT
    true = samples[:, 0].copy()
    first = N * 115
    if again:
        samples[first : first + N * lost] = np.tile(samples[first - N : first], (lost, 1))
    gone = () if again else range(115, 115 + lost)
    out, densities, states, _ = run(samples, lost=gone)
    assert states[115:, 0].tolist() == [REPEATED if again else SILENT] * lost + [GOOD] * (
        len(states) - 115 - lost
    )
    error = sum(block[:, 0].sum() for block in out) - true.sum()
    sigma = np.sqrt(densities[:, 0, 0].sum() * N * DT)
    assert 0.5 < abs(error) / sigma < 1.0 and abs(error) > np.radians(3.0)
    others = densities[:, 0, 1:].sum(axis=0) * N * DT  # of axes that have gone on as they were
    age = lost * N * DT
    assert np.allclose(others, (RULES.change[0] * (integrity_readings.MEAN_S + 0.5 * age) * age) ** 2)


def test_an_axis_at_the_end_of_its_range_is_told_from_the_others():
    samples = readings(6.0, np.random.default_rng(5))
    samples[800:1200, 0] = RULES.range[0] * DT
    out, densities, states, _ = run(samples, saturated=range(200, 300))
    bad = np.flatnonzero(states[:, 0])
    assert bad[0] == 200 and not states[:, 1:].any()
    # it is calm for a second before it is trusted again
    assert bad[-1] == pytest.approx(299 + watch_imu.CALM_S * 100, abs=1.0)
    assert np.all(states[bad, 0] == SATURATED)
    assert densities[200:300, 0, 0].all() and not densities[300:].any()  # what is read again is right
    assert np.array_equal(out[250][:, 0], samples[1000:1004, 0])  # at least as fast as that


def test_only_the_time_at_the_end_of_the_range_counts():
    """Peaks of vibration: a tenth of the blocks is clipped, the variance is that of so much time alone."""
    samples = readings(5.0, np.random.default_rng(15))
    clipped = np.arange(100, 500, 10)
    for block in clipped:
        samples[N * block + 1, 0] = RULES.range[0] * DT
    _, densities, states, _ = run(samples, saturated=set(clipped))
    lost_s = len(clipped) * N * DT
    expected = watch_imu.integrated_variance(RULES.missed[0], 0.0, lost_s, False)
    assert np.all(states[100:500, 0] == SATURATED)
    assert (densities[:, 0, 0] * N * DT).sum() == pytest.approx(expected)


def test_a_fix_ends_what_was_missed_before_it():
    samples = readings(4.0, np.random.default_rng(16))
    samples[400:, 0] = RULES.range[0] * DT
    watch, out, densities = watch_imu.start(RULES, N), np.empty((N, 6)), np.empty((3, 3))
    for k, block in enumerate(blocks(samples, saturated=range(100, 400))):
        watch_imu.screen(watch, block, out, densities)
        if k == 299:
            before = densities[0, 0]
            watch_imu.fixed(watch, 0, block.t_valid_s - 0.05, block.t_valid_s)
        if k == 300:
            age_s = np.array([0.05, 0.06])
            steps = [watch_imu.integrated_variance(RULES.missed[0], 0.0, age, False) for age in age_s]
            assert densities[0, 0] * N * DT == pytest.approx(steps[1] - steps[0])
            assert densities[0, 0] < 0.1 * before
            break


def test_a_flag_without_an_axis_concerns_them_all():
    _, _, states, _ = run(readings(3.0, np.random.default_rng(6)), saturated=[100])
    assert np.all(states[100] == SATURATED) and np.all(states[-1] == GOOD)


def test_a_unit_without_noise_may_repeat_itself():
    """An ideal one at rest: every block is the same, and nothing is wrong."""
    rules = RULES._replace(repeats=np.full(2, np.inf))
    _, densities, states, health = run(np.tile([0.0, 0.0, 0.0, 0.02, 0.0, 0.0], (400, 1)), rules)
    assert not densities.any() and not states.any() and not health


def counted(n, ratio, rng, rate=0.0):
    """(n,) counts of a unit that carries on what rounding leaves; noise and rate in quanta a sample."""
    total = np.cumsum(rate + ratio * rng.standard_normal(n)) + rng.uniform(-0.5, 0.5)
    return np.diff(np.rint(total), prepend=np.rint(rng.uniform(-0.5, 0.5)))


def longest_run(counts):
    """Equal numbers in a row, at most."""
    ends = np.flatnonzero(np.diff(counts, append=np.inf))
    return int(np.diff(ends, prepend=-1).max())


@pytest.mark.parametrize("ratio", [0.1, 0.2, 0.3, 0.5, 0.9])
def test_a_unit_that_carries_on_what_rounding_leaves_repeats_itself_less(ratio):
    """Truth: half a million readings at the rate that repeats most, of which none reaches the limit."""
    rng = np.random.default_rng(11)
    limit, rounded = (
        integrity_readings.repeats(ratio, 1.0, carried=True),
        integrity_readings.repeats(ratio, 1.0),
    )
    found = longest_run(counted(500_000, ratio, rng))
    assert found < limit < 6.0 * max(found, integrity_readings.FEWEST_REPEATS / 6.0)
    assert limit <= rounded
    assert ratio > 0.2 or limit < 0.1 * rounded  # so long a stuck axis of such a unit was not seen


@pytest.mark.parametrize("factor", [2.0, 10.0])
def test_noise_that_is_told_too_large_calls_a_healthy_unit_stuck_a_few_times_at_most(factor):
    """Truth: gyro noise of 0.2 quanta about a rate that repeats most, for five minutes; then one is stuck."""
    rng, ratio, n = np.random.default_rng(12), 0.2, 120_000
    samples = np.column_stack([counted(n, one, rng) for one in 3 * [ratio] + 3 * [3.0]])
    samples[-1600:, 1] = samples[-1601, 1]
    told = integrity_readings.repeats(factor * ratio, 1.0, carried=True)
    rules = RULES._replace(repeats=np.full(2, told), range=np.full(2, np.inf))
    _, _, states, health = run(samples, rules=rules)
    stuck = states == STUCK
    assert stuck[:-410].mean() < 1e-4
    assert sum(not one.healthy for one in health if one.t_s < 10.0) <= 8
    assert not stuck[len(stuck) // 10 : -410].any()
    assert stuck[-150:, 1].all() and not np.delete(stuck[-150:], 1, axis=1).any()


def test_a_long_fault_does_not_allow_longer_ones():
    rng = np.random.default_rng(13)
    samples = readings(12.0, rng)
    for first in (800, 2800):
        samples[first : first + 1000, 0] = samples[first - 1, 0]
    _, _, states, _ = run(samples)
    seen = [int(np.flatnonzero(states[first // N :, 0])[0]) for first in (800, 2800)]
    assert max(seen) * N <= RULES.repeats[0] + 2 * N


@pytest.mark.parametrize("ratio", [0.3, 1.0, 2.0, 2.5, 4.0, 8.0])
def test_equal_readings_say_no_more_than_their_chance_whatever_the_rate(ratio):
    """Counts of a normal distribution about each place within a quantum: n more readings like the first."""
    first, further = integrity_readings.evidence(1.0, ratio)
    edges = (np.arange(-60, 61)[:, None] - 0.5 + np.linspace(0.0, 0.5, 51)) * ratio
    chances = np.diff(norm.cdf(edges), axis=0)
    for n in (1, 2, 5, 40):
        largest = (chances ** (n + 1)).sum(axis=0).max()
        assert largest < np.exp(-first - (n - 1) * further) * (1.0 + 1e-6) or largest > 1.0 - 1e-12
    assert (chances**2).sum(axis=0).max() > 0.9 * np.exp(-first)
    assert (chances**41).sum(axis=0).max() > 0.3 * np.exp(-41.0 * further)


def test_the_same_block_is_no_fault_where_counts_are_coarse():
    """At rest, quanta far above the noise: blocks are the same time and again, and none is called a fault.

    One that is sent again for a second is: after as many blocks as such a unit does not give in 1e9.
    """
    rng, quantum = np.random.default_rng(12), np.array([20.0, 3.0]) * SIGMA
    said = [integrity_readings.evidence(*pair) for pair in zip(SIGMA, quantum, strict=True)]
    again, further = np.transpose(said)
    repeats = [integrity_readings.repeats(*pair, carried=True) for pair in zip(SIGMA, quantum, strict=True)]
    rules = RULES._replace(again=again, further=further, repeats=np.array(repeats))
    samples = np.repeat(SIGMA, 3) * rng.standard_normal((40000, 6))
    for triad in (slice(0, 3), slice(3, 6)):
        counts = np.ascontiguousarray(samples[:, triad])
        quantise(counts, quantum[triad.start // 3])
        samples[:, triad] = counts
    alike = sum(np.array_equal(samples[k : k + N], samples[k + N : k + 2 * N]) for k in range(0, 39990, N))
    assert alike > 5
    _, _, states, _ = run(samples, rules=rules)
    assert not (states == REPEATED).any()
    samples[20000:20400] = np.tile(samples[19996:20000], (100, 1))
    _, _, states, _ = run(samples, rules=rules)
    most = 1 + int(np.ceil((np.log(1e9) / (3.0 * N) - again.sum()) / further.sum()))
    first = int((states[:, 0] == REPEATED).argmax())
    assert 1 < first + 1 - 20000 // N == most and (states[first : 20400 // N] == REPEATED).all()
