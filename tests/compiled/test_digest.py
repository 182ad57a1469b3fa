"""What a kernel is made from tells it from others, wherever that stands; a name is of what is compiled."""

import sys
import types as python

import numpy as np
import pytest
from numba.core import config, types

from shefex_nav.compiled import digest, kernel, machine_code, numba_hooks, signature
from shefex_nav.compiled.store import Store
from shefex_nav.geometry import rotation

LOWER = """
from shefex_nav.compiled import inner
TABLE = (1.0, 2.0)
@inner
def scale(x):
    return 2.0 * x
"""
UPPER = """
import enum
import low_folder
import low
import numpy as np
from shefex_nav.compiled import inner, kernel
class Mode(enum.Enum):
    SLOW = 1
KIND = np.dtype([("a", np.float64)])
GRID = np.ones((2, 2), order="C")
def make(n):
    @inner
    def times(x):
        return n * x
    return times
first, second = make(1), make(2)
@inner
def deepest(x):
    return x + 1.0
@inner
def deeper(x):
    return deepest(x)
@kernel
def total(x):
    row = np.zeros(1, KIND)[0]
    row.a = low.TABLE[0] * deeper(x) + low_folder.low.scale(x) + GRID[0, 1]
    return row.a + first(x) - second(row.a) + (1.0 if x == Mode.SLOW.value else 0.0)
"""
SMALL = """
from shefex_nav.compiled import inner, kernel
FACTOR = (2.0,)
@inner
def scaled(x):
    return FACTOR[0] * x
@kernel
def total(x):
    return FACTOR[0] * x
@kernel
def one(x):
    return scaled(x)
@kernel
def other(x):
    return scaled(x) + 0.0
"""
FLOATS = (types.float64,)


def module(name, text, **names):
    """A module of this text."""
    made = python.ModuleType(name)
    vars(made).update(names)
    exec(text, vars(made))
    return made


@pytest.fixture
def own_store(tmp_path, monkeypatch):
    """The kernels of this process are kept in an empty folder."""
    monkeypatch.setattr(numba_hooks, "_STORE", Store("kind", tmp_path))


def of_total(monkeypatch, lower, upper):
    low = module("low", lower)
    folder = module("low_folder", "", low=low)
    monkeypatch.setitem(sys.modules, "low", low)
    monkeypatch.setitem(sys.modules, "low_folder", folder)
    return digest.of_kernel(module("up", upper).total)


@pytest.mark.parametrize(
    "old, new",
    [
        ("(1.0, 2.0)", "(1.5, 2.0)"),
        ("2.0 * x", "3.0 * x"),
        ("x + 1.0", "x + 1.5"),
        ("SLOW = 1", "SLOW = 2"),
        ("np.float64)", "np.float32)"),
        ('order="C"', 'order="F"'),
        ("make(1), make(2)", "make(2), make(1)"),
    ],
    ids=["attribute", "module in a module", "second level", "enum", "dtype", "order", "swapped factories"],
)
def test_what_a_kernel_uses_is_part_of_it(monkeypatch, old, new):
    assert (LOWER + UPPER).count(old) == 1
    texts = LOWER.replace(old, new), UPPER.replace(old, new)
    first = of_total(monkeypatch, LOWER, UPPER)
    assert of_total(monkeypatch, LOWER, UPPER) == first != of_total(monkeypatch, *texts)


def test_the_order_of_a_set_is_no_part_of_it():
    code = (lambda x: x in {0, 8}).__code__

    def with_set(*members):
        return code.replace(
            co_consts=tuple(frozenset(members) if one == {0, 8} else one for one in code.co_consts)
        )

    one, other = with_set(0, 8), with_set(8, 0)
    assert repr(one.co_consts) != repr(other.co_consts)
    assert digest.of_code(one) == digest.of_code(other) != digest.of_code(with_set(0, 9))


def test_a_global_that_becomes_another_gives_other_names(own_store):
    """Compiled for a second type, the kernel takes the new one: a fresh process must not be given that."""
    changed = module("small", SMALL)
    assert changed.total(1.0) == 2.0
    changed.FACTOR = (5.0,)
    assert changed.total(1) == 5.0
    assert module("small", SMALL).total(1) == 2.0
    assert module("small", SMALL.replace("(2.0,)", "(5.0,)")).total(1) == 5.0


def test_a_callee_from_before_is_not_kept_under_a_new_name(own_store):
    changed = module("small", SMALL)
    assert changed.one(1.0) == 2.0
    changed.FACTOR = (5.0,)
    changed.other(1.0)  # may take `scaled` as it was
    assert changed.other.file_of(FLOATS) is None
    assert module("small", SMALL.replace("(2.0,)", "(5.0,)")).other(1.0) == 5.0


def test_a_global_that_becomes_another_while_it_is_compiled(own_store, monkeypatch):
    changed = module("small", SMALL)
    reduced = numba_hooks._Files._is_as_named

    def late(self, args):
        changed.FACTOR = (5.0,)
        return reduced(self, args)

    monkeypatch.setattr(numba_hooks._Files, "_is_as_named", late)
    changed.total(1.0)
    changed.FACTOR = (2.0,)
    assert changed.total.file_of(FLOATS) is None


@pytest.mark.parametrize(
    "name, value",
    [
        ("NUMBA_DEBUGINFO", "1"),
        ("NUMBA_ENABLE_PROFILING", "1"),
        ("NUMBA_EXTEND_VARIABLE_LIFETIMES", "1"),
        ("NUMBA_LLVM_REFPRUNE_PASS", "0"),
        ("NUMBA_LLVM_REFPRUNE_FLAGS", "per_bb"),
        ("NUMBA_DEBUG_NRT", "1"),
        ("NUMBA_OPT", "1"),
    ],
)
def test_settings_that_change_meanwhile_give_other_names(monkeypatch, name, value):
    """numba reads the environment at each compilation."""
    before = rotation.quat_conjugate._cache.name(FLOATS)
    with monkeypatch.context() as patch:
        patch.setenv(name, value)
        assert rotation.quat_conjugate._cache.name(FLOATS) != before
    assert rotation.quat_conjugate._cache.name(FLOATS) == before


def test_functions_of_intel_give_other_names(monkeypatch):
    before = rotation.quat_conjugate._cache.name(FLOATS)
    monkeypatch.setattr(config, "USING_SVML", not config.USING_SVML)
    assert rotation.quat_conjugate._cache.name(FLOATS) != before


@pytest.mark.parametrize("maker", [numba_hooks, machine_code, digest, signature])
def test_other_makers_of_files_make_another_kind(maker, monkeypatch):
    first, loader = numba_hooks._kind(), maker.__spec__.loader
    monkeypatch.setattr(loader, "get_source", lambda name: "# another text")
    assert numba_hooks._kind() != first


def test_makers_without_sources_are_told_apart_by_their_instructions(monkeypatch):
    for maker in (numba_hooks, machine_code, digest, signature):
        monkeypatch.setattr(maker.__spec__.loader, "get_source", lambda name: None)
    first = numba_hooks._kind()
    assert numba_hooks._kind() == first
    monkeypatch.setattr(digest.__spec__.loader, "get_code", lambda name: compile("x = 3", "", "exec"))
    assert numba_hooks._kind() != first


def test_names_of_files_are_names_on_every_system():
    half = kernel(lambda x: 0.5 * x)
    name = half._cache.name(FLOATS)
    assert "test_digest" in name and not set('<>:"/\\|?*') & set(name)


@pytest.mark.parametrize(
    "kind",
    [types.Omitted(np.int64(3)), types.Omitted(print), types.Omitted((1, 2)), rotation.quat_conjugate._type],
    ids=["number of NumPy", "function", "tuple", "kernel"],
)
def test_types_that_json_cannot_hold_have_no_name(kind):
    with pytest.raises(signature.UnknownType):
        signature.encode(kind)
    assert rotation.quat_conjugate._cache.name((kind,)) is None


def test_a_type_that_is_none_is_unknown():
    for text in ("nonsense", ["array"], 3, ["named", "os:path", [], []]):
        with pytest.raises(signature.UnknownType):
            signature.decode(text)


def test_records_in_records_keep_their_layout():
    def outer(*fields, **more):
        inside = np.dtype(list(fields), **more)
        return numpy_type([("n", np.int32), ("inside", inside), ("several", inside, (2,))])

    def numpy_type(fields):
        from numba.np import numpy_support

        return numpy_support.from_dtype(np.dtype(fields))

    one = outer(("a", np.float64), ("b", np.float64))
    other = outer(("b", np.float64), ("a", np.float64))
    assert signature.encode(one) != signature.encode(other)
    for kind in (one, other, outer(("a", np.int8), ("b", np.float64), align=True)):
        assert signature.decode(signature.encode(kind)) == kind
