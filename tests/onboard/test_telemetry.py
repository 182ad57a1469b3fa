"""Solutions and covariances kept as columns: the records that would have been told, however many they are."""

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS, alignment, fly

from shefex_nav.log.run_data import stack
from shefex_nav.onboard import computer, telemetry
from shefex_nav.onboard.navigation import fusion
from shefex_nav.records import ImuBlock, NavCovariance, NavSolution

BLOCKS, STATES = fly(25.0)
ARRAYS = ImuBlock(*(np.array(column) for column in zip(*BLOCKS, strict=True)))
FIRST_ROWS = 1024  # of a table, which grows


class Flight:
    """A filter over the blocks, which says what it has to say to one listener."""

    def __init__(self, listener):
        self.nav, self.n, self.listener = fusion.start(PARAMS, alignment(STATES[0]), EARTH), 0, listener

    def until(self, last, longest):
        """On to tick `last`, at most `longest` ticks in a call. -> records that were handed over"""
        records = []
        while self.n < last:
            stop = min(last, self.n + longest)
            done, passed = computer.glide(self.nav, self.n, ARRAYS, self.n, stop, self.listener)
            self.n += done
            records += [one for _, said in passed for one in said]
            records += computer.conclude(self.nav, self.n, [], (), self.listener)
        return records


@pytest.fixture(scope="module")
def told():
    """NavSolution and NavCovariance of every tick that has one: {type: list}."""
    records = Flight(telemetry.RECORDS).until(len(BLOCKS), 32)
    return {kind: [one for one in records if type(one) is kind] for kind in (NavSolution, NavCovariance)}


def assert_same(found, rows):
    expected = stack(type(found), rows)
    for name, column, wanted in zip(found._fields, found, expected, strict=True):
        assert (column.dtype, column.shape) == (wanted.dtype, wanted.shape), name
        assert column.tobytes() == wanted.tobytes(), name


@pytest.mark.parametrize(("every", "longest"), [(1, 32), (1, 1), (7, 32), (7, 5), (7, 1)])
def test_no_row_is_lost_or_changed_while_a_table_grows(told, every, longest):
    """2500 ticks: more than twice the rows there is room for at first."""
    columns = telemetry.Columns(every)
    assert Flight(columns).until(len(BLOCKS), longest) == []
    solution, covariance = columns.read()
    assert len(BLOCKS) > 2 * FIRST_ROWS and len(solution.t_s) == len(BLOCKS) // every
    assert_same(solution, told[NavSolution][every - 1 :: every])
    assert_same(covariance, told[NavCovariance])


def test_what_has_been_read_stays_as_it_was(told):
    columns = telemetry.Columns(7)
    assert [len(one.t_s) for one in columns.read()] == [0]  # of covariances not even the width is known
    flight = Flight(columns)
    flight.until(19, 32)
    early = columns.read()
    flight.until(len(BLOCKS), 32)
    assert [len(one.t_s) for one in early] == [2, 1]
    assert_same(early[0], told[NavSolution][6:19:7])
    assert_same(early[1], told[NavCovariance][:1])


@pytest.mark.parametrize("counts", [[1024, 1], [1000, 24, 1], [1025], [3000, 1, 1], [1] * 1030])
def test_a_table_takes_any_number_of_rows(counts):
    table, expected = telemetry._Table(3), np.random.default_rng(1).standard_normal((sum(counts), 3))
    first = 0
    for count in counts:
        table.more(count)[:] = expected[first : first + count]
        first += count
        assert np.array_equal(table.filled, expected[:first])
