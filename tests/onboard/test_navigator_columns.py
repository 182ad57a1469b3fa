"""Solutions and covariances kept as columns: the records that would have been told, however many they are."""

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS, alignment, fly

from shefex_nav.log.run_data import stack
from shefex_nav.onboard import navigator
from shefex_nav.onboard.navigation import covariance, fusion
from shefex_nav.onboard.navigation.state import OPTIONAL, pack
from shefex_nav.records import ImuBlock, NavCovariance, NavSolution

BLOCKS, STATES = fly(25.0)
ARRAYS = ImuBlock(*(np.array(column) for column in zip(*BLOCKS, strict=True)))
FIRST_ROWS = 1024  # of a table, which grows


class Flight:
    """A filter over the blocks, which says what it has to say to one listener."""

    def __init__(self, listener):
        self.software, self.n = navigator.start(PARAMS, alignment(STATES[0]), EARTH, listener), 0

    def until(self, last, longest):
        """On to tick `last`, at most `longest` ticks in a call. -> records that were handed over"""
        records = []
        while self.n < last:
            stop = min(last, self.n + longest)
            done, passed = self.software.advance(ARRAYS, self.n, stop)
            self.n += done
            records += [one for _, said in passed for one in said]
            records += self.software.update([])
        return records


@pytest.fixture(scope="module")
def told():
    """NavSolution and NavCovariance of every tick that has one: {type: list}."""
    records = Flight(navigator.RECORDS).until(len(BLOCKS), 32)
    return {kind: [one for one in records if type(one) is kind] for kind in (NavSolution, NavCovariance)}


def assert_same(found, rows):
    expected = stack(type(found), rows)
    for name, column, wanted in zip(found._fields, found, expected, strict=True):
        assert (column.dtype, column.shape) == (wanted.dtype, wanted.shape), name
        assert column.tobytes() == wanted.tobytes(), name


@pytest.mark.parametrize(("every", "longest"), [(1, 32), (1, 1), (7, 32), (7, 5), (7, 1)])
def test_no_row_is_lost_or_changed_while_a_table_grows(told, every, longest):
    """2500 ticks: more than twice the rows there is room for at first."""
    columns = navigator.Columns(every)
    assert Flight(columns).until(len(BLOCKS), longest) == []
    solution, covariance = columns.read()
    assert len(BLOCKS) > 2 * FIRST_ROWS and len(solution.t_s) == len(BLOCKS) // every
    assert_same(solution, told[NavSolution][every - 1 :: every])
    assert_same(covariance, told[NavCovariance])


def test_what_has_been_read_stays_as_it_was(told):
    columns = navigator.Columns(7)
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
    table, expected = navigator._Table(3), np.random.default_rng(1).standard_normal((sum(counts), 3))
    first = 0
    for count in counts:
        table.more(count)[:] = expected[first : first + count]
        first += count
        assert np.array_equal(table.filled, expected[:first])


LAYOUTS = {
    "none": (),
    "default": ("gyro_roll_column", "mounting"),
    "others": (
        "gyro_scale",
        "gyro_misalignment",
        "accel_scale",
        "gravity",
        "lever_arm",
        "clock",
        "gps_latency",
    ),
}


@pytest.mark.parametrize("names", LAYOUTS.values(), ids=LAYOUTS)
def test_a_covariance_says_what_the_filter_holds(names):
    """Every field in plain words, while a motor burns; the values are random, so none can be another's."""
    rng = np.random.default_rng(3)
    sigmas = {name: rng.uniform(1e-5, 1e-4, OPTIONAL[name]) for name in names}
    clock = {"clock_white": 0.1, "clock_walk": 0.2, "range_bias_sigma": 3.0, "range_bias_time_s": 100.0}
    model = PARAMS.imu._replace(accel_vibration=0.03, gyro_vibration=2e-4, gravity=3e-3)
    params = PARAMS._replace(states=names, sigma_blocks=sigmas, imu=model, **clock)
    nav = fusion.start(params, alignment(STATES[0]), EARTH)
    values = {name: 1e-5 * rng.standard_normal(OPTIONAL[name]) for name in names}
    biases = {"gyro_bias": 1e-6 * rng.standard_normal(3), "accel_bias": 1e-3 * rng.standard_normal(3)}
    nav.history.x[:] = nav.history.xs[0] = pack(nav.history[0].state._replace(**biases, **values))
    for block in BLOCKS[:30]:
        fusion.advance(nav, block)
    told, tick = covariance.covariance(nav), nav.history[-1]
    state, P = tick.state, tick.P.copy()
    P[range(3, 6), range(3, 6)] += 0.03**2
    P[range(6, 9), range(6, 9)] += 2e-4**2
    assert tick.imu.vibration == 1.0
    assert told.t_s == 0.3 and told.states == " ".join(names)
    np.testing.assert_allclose(told.P, P[:9, :9], rtol=1e-14)
    np.testing.assert_array_equal(covariance.reported(nav), P)
    for name in ("gyro_bias", "accel_bias", "gyro_roll_column", "mounting"):
        np.testing.assert_array_equal(getattr(told, name), getattr(state, name))
    sigma = np.sqrt(np.diag(P))
    expected = [sigma[9:12], np.sqrt(sigma[12:15] ** 2 + 3e-3**2)]
    for name in ("gyro_roll_column", "mounting"):
        expected.append(sigma[nav.layout.places[name]] if name in names else np.full(3, np.nan))
    np.testing.assert_allclose(told.sigma, np.concatenate(expected), rtol=1e-14)
    chosen = [np.ravel(getattr(state, name)) for name in names]
    np.testing.assert_array_equal(told.estimates, np.concatenate([*chosen, []]))
    own = [sigma[nav.layout.places[name]] for name in names]
    np.testing.assert_allclose(told.sigmas, np.concatenate([*own, []]), rtol=1e-14)
