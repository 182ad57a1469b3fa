"""The sigma of the rate that is told: readings that cannot be trusted, and noise that is no state."""

import numpy as np
import pytest
from navigation_flight import DEG, DT, EARTH, PARAMS, alignment, fly
from test_nav_ticks import WATCHED

from shefex_nav.onboard.navigation import adaptation, fusion, measurements, solution

BLOCKS, STATES = fly(1.0)
RANGE = 100.0 * DEG
LIMITED = WATCHED.integrity.imu._replace(
    range=np.array([RANGE, 500.0]), missed=np.array([RANGE, 50.0]), repeats=np.full(2, 3.0)
)
NAN = np.full((4, 3), np.nan)


def spun_up(block, k):
    """The rate about x leaves the range of its gyro, those about y and z change: rad/s in the tick."""
    rate = np.array([np.interp(k, [40, 60, 100], [0.5, 1.4, 2.4]) * RANGE, 0.1 + 0.01 * (k - 50), 0.2])
    noise = 1e-7 * np.random.default_rng(k).standard_normal((4, 3))
    return block._replace(dtheta_b=np.tile(rate * DT, (4, 1)) + noise), rate


def clipped(block):
    """As a gyro reads it: never beyond its range."""
    dtheta_b = np.clip(block.dtheta_b, -RANGE * DT, RANGE * DT)
    return block._replace(dtheta_b=dtheta_b, saturated=bool((np.abs(dtheta_b) == RANGE * DT).any()))


def silent(block):
    return clipped(block)._replace(dtheta_b=NAN, dv_b=NAN, valid=False)


@pytest.mark.parametrize(("read", "axes"), [(clipped, [0]), (silent, [0, 1, 2])])
def test_a_rate_that_is_not_read_is_not_known(read, axes):
    """Healthy until 0.6 s: the error was up to 13 000 of the sigma that was told."""
    integrity = WATCHED.integrity._replace(imu=LIMITED)
    nav = fusion.start(WATCHED._replace(integrity=integrity), alignment(STATES[0]), EARTH)
    for k, block in enumerate(BLOCKS, 1):
        block, rate = spun_up(block, k)
        fusion.advance(nav, clipped(block) if k <= 60 else read(block))
    told, good = solution.solution(nav), [k for k in range(3) if k not in axes]
    error = np.abs(told.omega_ib_b - rate)
    assert error[0] > 50.0 * DEG
    assert np.all(error < 3.0 * told.sigma_omega_b)
    assert np.all(told.sigma_omega_b[good] < 0.1 * DEG)
    bias = nav.history.P[9:12, 9:12].diagonal()  # as the lever arm has it, but for what is known of the gyros
    more = measurements._unread(nav.history.imu(-1), LIMITED)
    np.testing.assert_allclose(told.sigma_omega_b[axes] ** 2, (more + bias)[axes], rtol=1e-3)


def flown(blocks=BLOCKS[:20], **of_imu):
    model = PARAMS.imu._replace(**dict.fromkeys(("gyro_cross", "gyro_g_sensitivity"), 0.0) | of_imu)
    nav = fusion.start(PARAMS._replace(imu=model), alignment(STATES[0]), EARTH)
    for block in blocks:
        fusion.advance(nav, block)
    return nav


def test_noise_that_was_found_larger_is_told():
    """White noise of a sample, N^2/T, five times as large from 0.1 s on."""
    nav = flown()
    before = solution.solution(nav).sigma_omega_b ** 2
    adaptation.scheduled(nav.constants.model, nav.params.imu, [(0.1, 5.0, (1.0, 1.0))])
    white = PARAMS.imu.gyro_random_walk**2 / DT
    np.testing.assert_allclose(solution.solution(nav).sigma_omega_b ** 2 - before, 24.0 * white, rtol=1e-6)
    first = solution.solutions(nav, range(5, 6))[0]  # of a tick before that
    np.testing.assert_allclose(first.sigma_omega_b**2, before, rtol=1e-2)


@pytest.mark.parametrize("name", ["gyro_cross", "gyro_g_sensitivity"])
def test_errors_that_noise_stands_for_are_errors_of_the_rate(name):
    """Scale factors times the rate across the roll axis; g-sensitivity times the specific force."""
    last = BLOCKS[19]
    met = last.dtheta_b[-1, 1:] if name == "gyro_cross" else last.dv_b[-1]
    nothing, found = (solution.solution(flown(**{name: size})).sigma_omega_b ** 2 for size in (0.0, 2e-3))
    np.testing.assert_allclose(found - nothing, (2e-3 / DT) ** 2 * (met @ met), rtol=1e-3)


def told_of(rates, rng, n=400):
    """Errors over sigmas of the rate about x at the end of n ticks whose samples are means of `rates`(t)."""
    t_s = DT * np.arange(4 * n + 1)
    true, turned = (
        rates(t_s),
        np.concatenate([[0.0], np.cumsum(0.5 * (rates(t_s)[1:] + rates(t_s)[:-1]) * DT)]),
    )
    nav, ratios = fusion.start(PARAMS, alignment(STATES[0]), EARTH), np.empty(n)
    noise = PARAMS.imu.gyro_random_walk * np.sqrt(DT) * rng.standard_normal((4 * n, 3))
    for k in range(n):
        own = slice(4 * k, 4 * k + 4)
        dtheta_b = noise[own].copy()
        dtheta_b[:, 0] += np.diff(turned)[own]
        end_s = 0.01 * (k + 1)
        block = BLOCKS[0]._replace(
            t_valid_s=end_s, t_available_s=end_s, dtheta_b=dtheta_b, dv_b=1e-6 * noise[own]
        )
        fusion.advance(nav, block)
        told = solution.solution(nav)
        ratios[k] = (told.omega_ib_b[0] - true[4 * k + 4]) / told.sigma_omega_b[0]
    return ratios


def test_a_rate_that_changes_is_half_a_sample_late():
    """A despin of 2000 deg/s^2: the rate at the instant was 2.5 deg/s off, with a sigma of 0.01 deg/s."""
    ratios = told_of(lambda t: 9.0 - 35.0 * np.clip(t - 1.0, 0.0, 0.25), np.random.default_rng(4))
    assert np.abs(ratios[100:125]).max() < 1.5  # about 1 while the rate changes
    assert np.abs(ratios).max() < 4.5


def test_a_steady_rate_is_as_sure_as_its_noise():
    """What noise changes from sample to sample is not counted twice: errors of 0.75 to 1 sigma."""
    ratios = told_of(lambda t: np.full(len(t), 2.0), np.random.default_rng(5))
    assert 0.75 < np.sqrt(np.mean(ratios**2)) < 1.0
