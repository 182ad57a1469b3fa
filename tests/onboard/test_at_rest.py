"""Noise of the IMU at rest: known from readings in ten seconds, not mistaken for shaking or motion."""

from types import SimpleNamespace

import numpy as np
import pytest
from navigation_flight import MODEL, PARAMS

from shefex_nav.onboard.navigation.noise_evidence import FIXES, Still
from shefex_nav.onboard.navigation.strapdown import BEFORE
from shefex_nav.world.imu import quantise

DT, N = 1.0 / 400.0, 4
WALK = MODEL.gyro_random_walk, MODEL.accel_random_walk
RATE = np.array([0.0, 3e-5, 6e-5, 0.1, 9.7, 0.3])  # Earth and weight, in axes of the vehicle


class Memory:
    """As much of a History as is asked for: 0.6 s of ticks."""

    def __init__(self, now_s, increments):
        ticks = len(increments) // N
        self.ends_s = now_s - 0.01 * np.arange(ticks + 1)[::-1]
        self.numbers = np.tile([0.0, DT, N, 0.0], (ticks + 1, 1))
        self.numbers[0, 2] = 0
        self.increments = np.zeros((ticks + 1, BEFORE + N, 6))
        self.increments[1:, BEFORE:] = increments.reshape(ticks, N, 6)

    def __len__(self):
        return len(self.ends_s)

    def place(self, k):
        return k % len(self.ends_s)


ACCEL, GYRO = 1, 0


def told_at_rest(
    factors, seed, *, quantum=0.0, swing=0.0, swings=ACCEL, seconds=12, speed=0.0, turn=None, swing_told=0.0
):
    """Factors found of an IMU with so many times the noise that is told, and when. swings : which triad"""
    rng, still = np.random.default_rng(seed), Still()
    noise = np.repeat(np.array(factors) * WALK, 3) * np.sqrt(DT)
    told = PARAMS._replace(
        imu=MODEL._replace(gyro_quantum=quantum, accel_quantum=quantum),
        sigma_gyro_bias=1e-4,
        swing_at_rest=swing_told * np.eye(2)[swings],
    )
    for second in range(seconds):
        t = second + DT * np.arange(1, 241)
        increments = RATE * DT + noise * rng.standard_normal((240, 6))
        triad = slice(3 * swings, 3 * swings + 3)
        increments[:, triad] += swing * np.diff(np.sin(2 * np.pi * 31.0 * np.append(0.0, t)))[:, None]
        if turn is not None:
            increments[:, :3] += turn(t)[:, None] * DT
        if quantum:
            for triad in (increments[:, :3], increments[:, 3:]):
                left = np.ascontiguousarray(triad)
                quantise(left, quantum)
                triad[:] = left
        fix = SimpleNamespace(
            t_valid_s=float(second), v_ea_e=np.array([speed, 0.0, 0.0]), R_v_e=0.01 * np.eye(3),
            r_ea_e=np.array([6e6 + speed * second, 0.0, 0.0]), R_r_e=4.0 * np.eye(3),
        )  # fmt: skip
        found = still.look(Memory(second + 0.2, increments), told, fix)
        if found is not None:
            return found, second
    return None, None


@pytest.mark.parametrize("times", [3.3, 5.0, 10.0])
def test_noise_told_too_small_is_told_within_two(times):
    found = [told_at_rest((times, times), seed) for seed in range(20)]
    assert {second for _, second in found} == {FIXES}
    factors = np.array([one for one, _ in found])
    known = factors[factors > 1.0]
    assert len(known) > 0.9 * factors.size
    assert np.all((known > times / 2.0) & (known < 2.0 * times))


def test_only_the_triad_that_is_noisy_is_named():
    for seed in range(10):
        (gyro, accel), _ = told_at_rest((8.0, 1.0), seed)
        assert gyro > 4.0
        assert accel == 1.0


def test_the_right_noise_and_less_are_left_alone():
    for seed in range(100):
        assert told_at_rest((1.0, 0.3), seed)[0] == (1.0, 1.0)


def test_rounding_is_no_noise():
    """Quanta six times the noise of a sample, whose remainder is carried on."""
    for seed in range(20):
        assert told_at_rest((1.0, 1.0), seed, quantum=1.5e-4)[0][1] == 1.0


def test_coarse_counts_do_not_hide_noise():
    """Of the accelerometers, eight times what was told: found within a factor of two."""
    found = np.array([told_at_rest((1.0, 8.0), seed, quantum=1.5e-4)[0][1] for seed in range(20)])
    known = found[found > 1.0]
    assert len(known) > 17 and np.all((known > 4.0) & (known < 16.0))


def test_a_swing_of_the_size_of_the_noise_is_no_noise():
    for seed in range(20):
        assert told_at_rest((1.0, 1.0), seed, swing=1.5e-4)[0] == (1.0, 1.0)


@pytest.mark.parametrize("times", [6.0, 60.0])
@pytest.mark.parametrize("triad", [GYRO, ACCEL])
def test_a_swing_that_was_told_is_no_noise_whatever_its_size(triad, times):
    """Of 31 Hz, by its amplitude over the noise of a span; told by half, it is not all of the scatter."""
    swing = times * WALK[triad] * np.sqrt(0.1)
    told = [
        told_at_rest((1.0, 1.0), seed, swing=swing, swings=triad, swing_told=swing / np.sqrt(2.0))
        for seed in range(20)
    ]
    assert {one for one, _ in told} == {(1.0, 1.0)}
    assert told_at_rest((1.0, 1.0), 1, swing=swing, swings=triad, swing_told=0.25 * swing)[0][triad] > 2.0
    (gyro, accel), _ = told_at_rest((1.0, 8.0), 1, swing=1e-3, swing_told=1e-3 / np.sqrt(2.0))
    assert gyro == 1.0 and 4.0 < accel < 16.0


def test_a_vehicle_that_moves_is_not_at_rest():
    assert told_at_rest((10.0, 10.0), 1, speed=3.0) == (None, None)


def test_a_vehicle_that_turns_where_it_stands_is_not_at_rest():
    """Fast, as on a turntable; slowly to and fro; once by a little."""
    for seed in range(10):
        assert told_at_rest((1.0, 1.0), seed, turn=lambda t: 0.3 + 0.0 * t) == (None, None)
        for turn in (lambda t: 1e-3 * np.sin(0.6 * t), lambda t: 5e-3 * (np.abs(t - 4.0) < 0.1)):
            assert told_at_rest((1.0, 1.0), seed, turn=turn)[0] == (1.0, 1.0)
