"""Blocks of the inertial unit that are lost now and then: what they have missed, against the truth."""

import numpy as np
import pytest

from shefex_nav.onboard.navigation import integrity_imu as imu
from shefex_nav.onboard.navigation import integrity_unread
from shefex_nav.records import ImuBlock

DT, N, TICK_S = 1.0 / 400.0, 4, 0.01
RULES = imu.ImuRules(
    np.full(2, np.inf), np.full(2, np.inf), np.array([1.0, 50.0]), np.array([0.5, 50.0]), np.full(2, 9.0)
)


def flown(rate, is_lost, until_s=30.0, fixes=()):
    """A gyro whose rate is a function of the time, with numbers of blocks that are lost.

    fixes : numbers of blocks after which a star fix says the angle
    -> (n,) what its angle is off by, (n,) the variance that the filter is given, after each block
    """
    watch, count = imu.start(RULES, N), round(until_s / TICK_S)
    readings, densities, off, given = np.empty((N, 6)), np.empty((3, 3)), np.zeros(count), np.zeros(count)
    for k in range(count):
        t_s = TICK_S * k + DT * (np.arange(N) + 0.5)
        values = np.tile(DT * rate(t_s)[:, None], (1, 6))
        block = ImuBlock(
            TICK_S * (k + 1), TICK_S * (k + 1), DT, values[:, :3].copy(), values[:, 3:].copy(), False,
            not is_lost(k),
        )  # fmt: skip
        imu.screen(watch, block, readings, densities)
        off[k], given[k] = (readings[:, 0] - values[:, 0]).sum(), densities[0, 0] * TICK_S
        if k in fixes:
            integrity_unread.fixed(watch.axes[:3], TICK_S * (k + 1))
    return off, given


def spin_up(t_s):
    return 0.42 * np.maximum(t_s - 2.5, 0.0)


@pytest.mark.parametrize("every, most", [(2, 1.5), (3, 1.5), (10, 1.5), (50, 1.5)])
def test_gaps_in_a_spin_up_add_up(every, most):
    """Charged one by one they were 35, 28, 14 and 6 sigma."""
    off, given = flown(spin_up, lambda k: k > 300 and k % every == 0)
    assert abs(off.sum()) > 0.02
    assert abs(off.sum()) < most * np.sqrt(given.sum())


def test_a_single_gap_and_gaps_of_a_rate_that_swings_are_charged_one_by_one():
    """A swing of 7 Hz errs to both sides: the charge is that of as many axes with a gap each."""

    def swings(t_s):
        return 0.02 * np.sin(2.0 * np.pi * 7.0 * t_s)

    lost = range(400, 1000, 37)
    _, given = flown(swings, lambda k: k in lost, 11.0)
    alone = sum(flown(swings, lambda k, one=one: k == one, 11.0)[1].sum() for one in lost)
    assert given.sum() == pytest.approx(alone, rel=0.02)


def test_after_a_fix_the_gaps_before_it_are_known_but_for_the_last_second():
    axes = imu.start(RULES, N).axes[:3]
    axes["missed"], axes["lately"], axes["given"] = 0.3, 0.02, 0.1
    axes["ended_s"] = 5.0, 6.0, 7.0
    integrity_unread.fixed(axes, 6.5)
    assert axes["missed"].tolist() == [0.02, 0.02, 0.3]
    np.testing.assert_allclose(axes["given"], [4e-4, 4e-4, 0.1])
    off, given = flown(spin_up, lambda k: k > 300 and k % 2 == 0, fixes=range(0, 3000, 10))
    assert abs(off[-100:].sum()) < 1.5 * np.sqrt(given[-100:].sum())  # of a second with ten fixes
    assert given.sum() < 0.2 * flown(spin_up, lambda k: k > 300 and k % 2 == 0)[1].sum()
