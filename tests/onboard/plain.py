"""Kernels as the Python functions that they are written as, for tests that need no machine code."""

from dis import get_instructions
from types import FunctionType, ModuleType


class _Plain:
    """A module of ours whose kernels are plain."""

    def __init__(self, module):
        self._module = module

    def __getattr__(self, name):
        return plain(getattr(self._module, name))


def plain(kernel):
    """The function of a kernel, with those that it calls; anything else is given back as it is.

    What a test has put in the place of a name of its module is called instead.
    """
    if isinstance(kernel, ModuleType) and kernel.__name__.startswith("shefex_nav."):
        return _Plain(kernel)
    function = getattr(kernel, "py_func", None)
    if function is None:
        return kernel
    known = function.__globals__
    asked = {step.argval for step in get_instructions(function) if step.opname == "LOAD_GLOBAL"}
    called = {name: plain(known[name]) for name in asked & known.keys()}
    return FunctionType(
        function.__code__, {**known, **called}, function.__name__, function.__defaults__, function.__closure__
    )
