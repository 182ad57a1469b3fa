"""Ticks in one call: the same as one by one, to the last bit, and an end where something has to be said."""

from functools import cache

import numpy as np
import pytest
from navigation_flight import DT, EARTH, PARAMS, alignment, fly, gps_fix

from shefex_nav.log.run_data import stack
from shefex_nav.onboard import navigator
from shefex_nav.onboard.navigation import fusion, integrity_gyro, integrity_imu, integrity_watch, ticks
from shefex_nav.records import ImuBlock, NavCovariance, NavSolution

CLEAN, STATES = fly(6.0)
NOISE = 1e-7 * np.random.default_rng(2).standard_normal((2, len(CLEAN), 4, 3))  # no reading comes twice
BLOCKS = [
    block._replace(dtheta_b=block.dtheta_b + dtheta, dv_b=block.dv_b + dv)
    for block, dtheta, dv in zip(CLEAN, *NOISE, strict=True)
]
RULES = integrity_imu.ImuRules(
    repeats=np.array([24.0, 24.0]),
    range=np.array([50.0, 500.0]),
    wrong=np.array([1.0, 50.0]),
    change=np.array([0.5, 50.0]),
    missed=np.array([50.0, 50.0]),
)
WATCHED = PARAMS._replace(integrity=integrity_watch.DEFAULT._replace(imu=RULES))


def stacked(blocks):
    return ImuBlock(*(np.array(column) for column in zip(*blocks, strict=True)))


def flown(blocks, together, params=WATCHED, fixes=()):
    """Filter over blocks, which come together or one by one; fixes as they arrive. -> Filter, calls"""
    nav, arrays, n, calls = fusion.start(params, alignment(STATES[0]), EARTH), stacked(blocks), 0, 0
    ends_s = arrays.t_valid_s + 1e-9
    stops = [int(np.searchsorted(ends_s, fix.t_available_s)) + 1 for fix in fixes] + [len(blocks)]
    for stop, fix in zip(stops, [*fixes, None], strict=True):
        while n < stop:
            if together:
                n += ticks.advance(nav, arrays, n, stop)
            else:
                fusion.advance(nav, blocks[n])
                n += 1
            calls += 1
        if fix is not None:
            fusion.fuse(nav, [("gps", fix)])
    return nav, calls


def assert_same(one, two):
    assert list(one.history.ends_s) == list(two.history.ends_s)
    for k in range(len(one.history)):
        a, b = one.history[k], two.history[k]
        np.testing.assert_array_equal(a.x, b.x)
        np.testing.assert_array_equal(a.P, b.P)
        if a.imu is not None:
            np.testing.assert_array_equal(a.imu.increments, b.imu.increments)
            np.testing.assert_array_equal(a.imu.extra, b.imu.extra)
    for name in integrity_imu.AXIS.names:
        np.testing.assert_array_equal(one.watch.imu.axes[name], two.watch.imu.axes[name])
    assert one.watch.changes() == two.watch.changes()


def test_many_ticks_at_once_are_the_same_ticks():
    rng = np.random.default_rng(1)
    fixes = [gps_fix(BLOCKS, STATES, t_s, 0.2, rng) for t_s in (1.0, 2.0, 3.0, 4.0012)]
    one, _ = flown(BLOCKS, False, fixes=fixes)
    many, calls = flown(BLOCKS, True, fixes=fixes)
    assert_same(one, many)
    assert calls < len(BLOCKS) / 8
    assert len(many.history) == round(PARAMS.history_s * 100) + 1  # nothing is kept for longer


def broken(kind):
    """The blocks with a fault from 2 s to 2.6 s."""
    blocks = list(BLOCKS)
    for k in range(200, 260):
        if kind == "silent":
            nothing = np.full((4, 3), np.nan)
            blocks[k] = blocks[k]._replace(dtheta_b=nothing, dv_b=nothing, valid=False)
        elif kind == "stuck":
            dtheta_b = blocks[k].dtheta_b.copy()
            dtheta_b[:, 1] = BLOCKS[200].dtheta_b[0, 1]
            blocks[k] = blocks[k]._replace(dtheta_b=dtheta_b)
    return blocks


def told(fault, longest, listener):
    """Records of a filter over blocks, at most `longest` ticks in a call; four fixes arrive on the way."""
    blocks, rng = broken(fault) if fault else BLOCKS, np.random.default_rng(2)
    waiting = [gps_fix(BLOCKS, STATES, t_s, 0.2, rng) for t_s in (1.0, 2.0, 3.0, 4.0012)]
    arrays, outputs, n = stacked(blocks), [], 0
    software = navigator.start(WATCHED, alignment(STATES[0]), EARTH, listener)
    while n < len(blocks):
        until_s = waiting[0].t_available_s - 1e-9 if waiting else np.inf
        stop = min(int(np.searchsorted(arrays.t_valid_s, until_s)) + 1, len(blocks), n + longest)
        done, passed = software.advance(arrays, n, stop)
        n += done
        outputs += [record for _, said in passed for record in said]
        arrived = [waiting.pop(0)] if waiting and software.nav.history.ends_s[-1] > until_s else []
        outputs += software.update(arrived)
    return outputs


@cache
def records_of(fault, longest):
    """What there is to tell, each as a record."""
    return told(fault, longest, navigator.RECORDS)


@pytest.mark.parametrize("fault", [None, "silent"])
def test_what_is_told_of_ticks_on_the_way_is_what_each_would_have_told(fault):
    """Every NavSolution, and NavCovariance at whole tenths of a second, to the last bit."""
    one, many = records_of(fault, 1), records_of(fault, len(BLOCKS))
    kinds = [type(record) for record in one]
    assert kinds.count(NavSolution) == len(BLOCKS)
    assert kinds.count(NavCovariance) == len(BLOCKS) // 10
    assert kinds == [type(record) for record in many]
    for a, b in zip(one, many, strict=True):
        for x, y in zip(a, b, strict=True):
            np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize(
    ("every", "longest"), [(1, len(BLOCKS)), (4, 1), (7, len(BLOCKS)), (10, len(BLOCKS))]
)
@pytest.mark.parametrize("fault", [None, "silent"])
def test_columns_hold_what_records_tell(fault, every, longest):
    """To the last bit, types and shapes too; what is neither solution nor covariance is handed over."""
    records, columns = records_of(fault, len(BLOCKS)), navigator.Columns(every)
    kinds = [type(one) for one in told(fault, longest, columns)]
    assert kinds == [type(one) for one in records if type(one) not in (NavSolution, NavCovariance)]
    for found, step in zip(columns.read(), (every, 1), strict=True):
        rows = [one for one in records if type(one) is type(found)][step - 1 :: step]
        assert len(found.t_s) == len(rows) == len(BLOCKS) // (every if type(found) is NavSolution else 10)
        for name, column, expected in zip(found._fields, found, stack(type(found), rows), strict=True):
            assert (column.dtype, column.shape) == (expected.dtype, expected.shape), name
            np.testing.assert_array_equal(column, expected)


@pytest.mark.parametrize("kind", ["silent", "stuck"])
def test_what_the_watch_finds_is_said_at_its_tick(kind):
    blocks, arrays = broken(kind), stacked(broken(kind))
    one, _ = flown(blocks, False)
    many, _ = flown(blocks, True)
    assert_same(one, many)
    nav, n, said = fusion.start(WATCHED, alignment(STATES[0]), EARTH), 0, []
    while n < len(blocks):
        n += ticks.advance(nav, arrays, n, len(blocks))
        for change in nav.watch.changes():
            assert change.t_s == nav.history.ends_s[-1]  # the call ended there
            said.append(change.healthy)
    assert said == [False, True]


def test_gyros_that_have_been_wrong_are_watched_tick_by_tick():
    nav, arrays = fusion.start(WATCHED, alignment(STATES[0]), EARTH), stacked(BLOCKS)
    assert ticks.advance(nav, arrays, 0, 100) == 1  # the watch takes its first block by itself
    assert ticks.advance(nav, arrays, 1, 100) == ticks.LONGEST
    nav.watch.gyros.failed = ("gyro x",)
    assert ticks.advance(nav, arrays, 1 + ticks.LONGEST, 100) == 1
    assert nav.watch.distrusted  # no stars have said otherwise


def test_a_gap_in_the_blocks_is_refused():
    arrays = stacked(BLOCKS)
    holed = ImuBlock(*(np.delete(column, 5, axis=0) for column in arrays))
    nav, n = fusion.start(WATCHED, alignment(STATES[0]), EARTH), 0
    with pytest.raises(ValueError, match="does not follow on"):
        while n < 20:
            n += ticks.advance(nav, holed, n, 20)
    assert n == 5 and nav.history.ends_s[-1] == pytest.approx(5 * 4 * DT)


@pytest.mark.parametrize("checked_s", [np.nan, 0.502, 1.0, 2.5])
def test_gyros_that_have_been_wrong_are_spoken_of_at_the_same_ticks(checked_s):
    def doubted(together):
        nav, arrays, n, calls, said = (
            fusion.start(WATCHED, alignment(STATES[0]), EARTH),
            stacked(BLOCKS),
            0,
            0,
            [],
        )
        while n < len(BLOCKS):
            if n == 100:
                nav.watch.gyros.doubt()
                nav.watch.gyros.checked_s = STATES[0].t_s + checked_s
            stop = 100 if n < 100 else len(BLOCKS)
            if together:
                n += ticks.advance(nav, arrays, n, stop)
            else:
                fusion.advance(nav, BLOCKS[n])
                n += 1
            calls += 1
            said += nav.watch.changes()
        return nav, calls, said, nav.watch.imu_blind

    one, _, said, blind = doubted(False)
    many, calls, said_of_many, blind_of_many = doubted(True)
    assert_same(one, many)
    assert said == said_of_many and blind == blind_of_many
    assert {gyro.source for gyro in said} == set(integrity_gyro.AXES) and blind
    assert calls < len(BLOCKS) / 8
