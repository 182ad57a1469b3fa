"""Elementary functions against Python's `math`, to the last bit, in all shapes."""

import ast
import math
from pathlib import Path

import numba
import numpy as np
import pytest

from shefex_nav.geometry import elementary

RNG = np.random.default_rng(1)  # anew in each test: conftest.own_numbers
ONE = {
    "exp": (math.exp, -700.0, 700.0),
    "log": (math.log, 1e-6, 1e6),
    "log10": (math.log10, 1e-6, 1e6),
    "arcsin": (math.asin, -1.0, 1.0),
    "arccos": (math.acos, -1.0, 1.0),
}
TWO = {"power": (math.pow, 0.1, 20.0), "arctan2": (math.atan2, -5.0, 5.0)}


@pytest.mark.parametrize("name", ONE)
def test_as_the_c_library(name):
    function, least, most = ONE[name]
    x = RNG.uniform(least, most, 1000)
    assert np.array_equal(getattr(elementary, name)(x), [function(value) for value in x])
    assert np.allclose(getattr(elementary, name)(x), getattr(np, name)(x), rtol=1e-14)


@pytest.mark.parametrize("name", TWO)
def test_of_two_as_the_c_library(name):
    function, least, most = TWO[name]
    x, y = RNG.uniform(least, most, (2, 1000))
    expected = [function(a, b) for a, b in zip(x, y, strict=True)]
    assert np.array_equal(getattr(elementary, name)(x, y), expected)
    assert np.allclose(getattr(elementary, name)(x, y), getattr(np, name)(x, y), rtol=1e-14)


def test_shapes_and_single_numbers():
    x = RNG.uniform(0.5, 2.0, (4, 6))
    assert np.array_equal(elementary.exp(x[:, ::2].T), elementary.exp(x)[:, ::2].T)
    assert elementary.power(10.0, x[0]).shape == (6,)
    assert elementary.arctan2(x[:, :1], x[0]).shape == (4, 6)
    assert elementary.exp(np.empty((0, 3))).shape == (0, 3)
    assert elementary.log10([10, 1000]).tolist() == [1.0, 3.0]
    assert elementary.exp(1) == math.e and np.ndim(elementary.exp(1)) == 0


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="as Python the functions of `math` raise there")
def test_outside_the_domain_is_no_number():
    assert elementary.log(0.0) == -math.inf and elementary.exp(1e4) == math.inf
    assert math.isnan(elementary.arccos(1.5)) and math.isnan(elementary.log(-1.0))


def _is_kernel(node):
    decorators = getattr(node, "decorator_list", ())
    return any(ast.unparse(one).startswith(("kernel", "inner")) for one in decorators)


def _outside_kernels(tree):
    """Nodes of a module that run as Python: those of functions that are not compiled."""
    nodes = [tree]
    while nodes:
        node = nodes.pop()
        yield node
        nodes += [child for child in ast.iter_child_nodes(node) if not _is_kernel(child)]


@pytest.mark.parametrize("room", ["environment", "instruments", "onboard", "world"])
def test_records_use_no_function_that_numpy_has_for_one_processor(room):
    chosen = {
        f"np.{name}" for name in (*ONE, *TWO, "expm1", "log1p", "log2", "arctan", "tan", "tanh", "cbrt")
    }
    for path in sorted((Path(elementary.__file__).parent.parent / room).rglob("*.py")):
        found = {
            ast.unparse(node)
            for node in _outside_kernels(ast.parse(path.read_text()))
            if isinstance(node, ast.Attribute)
        }
        assert not chosen & found, path  # `elementary` has them, or Python's `math`
