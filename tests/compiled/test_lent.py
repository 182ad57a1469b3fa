"""Arrays whose references are not counted, and kernels for arguments whose types are known."""

import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba import config
from numba.core.errors import TypingError

from shefex_nav.compiled import entry, inner, kernel, lent


class Room(NamedTuple):
    """Arrays and a number, one inside the other."""

    a: np.ndarray
    inside: tuple
    factor: float


@inner
def add_up(room):
    """Write into a lent array what is in the others, and read it again."""
    room = lent(room)
    total = 0.0
    for k in range(room.a.shape[0]):
        room.a[k] += room.factor * room.inside[0][k]
        total += room.a[k]
    return total + room.inside[1].shape[0]


@kernel
def with_own_arrays(x, n=3):
    """What a kernel has made is lent to what it calls, again and again."""
    total = 0.0
    for k in range(n):
        total += add_up(Room(np.full(x.shape[0], float(k)), (x, np.empty((k, 2))), 2.0))
    return total


@kernel
def with_the_arrays_of_python(x, y):
    x, y = lent(x), lent(y)
    return add_up(Room(x, (y, np.empty((0, 2))), 0.5)), lent((x[0], 3)), lent(None)


def test_lent_arrays_are_the_same_arrays():
    x, y = np.array([1.0, 2.0]), np.array([10.0, 20.0])
    assert with_the_arrays_of_python(x, y) == (18.0, (6.0, 3), None)
    assert x.tolist() == [6.0, 12.0] and y.tolist() == [10.0, 20.0]
    assert lent(x) is x


def test_the_owner_of_a_lent_array_keeps_its_count():
    """What Python gave has as many references after as before; what was made is made and freed each time."""
    x = np.array([1.0, 2.0, 3.0])
    before = sys.getrefcount(x)
    for _ in range(20_000):
        assert with_own_arrays(x) == 3 * 12.0 + 3.0 + 6.0 + 0.0 + 1.0 + 2.0
    assert sys.getrefcount(x) == before


@kernel
def with_what_may_be_none(x, given):
    room = None
    if given:
        room = x
    return lent(room) is None


@pytest.mark.skipif(config.DISABLE_JIT, reason="Python lends whatever there is")
def test_what_may_be_none_is_not_lent():
    """Nobody knows then whether there is an array whose count is left alone."""
    with pytest.raises(TypingError, match="numbers, None and tuples of these are lent"):
        with_what_may_be_none(np.ones(3), True)


def test_a_kernel_for_known_types_is_that_kernel():
    """Defaults that are not among its arguments are written out."""
    x = np.array([1.0, 2.0, 3.0])
    quick = entry(with_own_arrays, np.empty(1))
    assert quick(x, 3) == with_own_arrays(x)
    assert entry(with_own_arrays, np.empty(1), 3)(x, 2) == with_own_arrays(x, 2)
    with pytest.raises((TypeError, AttributeError)):  # compiled, as Python
        quick("x", 3)
