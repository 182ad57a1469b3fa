"""Compiled kernels: how they are marked, for which processor they are compiled, where they are kept.

    kernel, inner    a loop that is compiled: called by Python, or by other kernels alone
    entry            a kernel for arguments whose types are known
    lent             arrays whose references are not counted
    rows             tables whose fields kernels read as attributes
    target           the processor, fixed so that results are the same on another one
    digest           what a kernel and all that it calls really are, as a number
    signature        types of arguments as JSON
    store            the files of compiled kernels
    ahead            compiles what is missing in several processes
    numba_hooks      all that touches the inside of numba, with the next two
    numba_lending    how `lent` is compiled
    machine_code     a compiled kernel as bytes, and back

This file imports numba when the first kernel is marked, not before: `target` has to choose first.
"""

import sys
from functools import cached_property, update_wrapper
from types import ModuleType

from shefex_nav.compiled.lending import lent as lent

GONE = "<dynamic>"  # numba's module of kernels whose own is none of the process, such as beside a plug-in
DEFAULTS = {
    "nopython": True,
    "boundscheck": None,
    "error_model": "python",
    "fastmath": False,
}


def kernel(function=None, **options):
    """Compile a function that Python calls, at its first call with arguments of these types.

    The machine code is kept in a file and loaded by later processes, until the function, or anything that it
    uses, becomes another. Kernels that call this one get a copy inside their own code.

    options : of the compiler: error_model, fastmath, forceinline, inline; else as in DEFAULTS. Without these
        numba would take what the kernel that calls this one has, and of several the first: results must not
        depend on that. (forceinline is inherited so; it changes no result.)
    """
    if function is None:
        return lambda one: kernel(one, **options)
    from numba import config

    if config.DISABLE_JIT:
        return function
    sys.modules.setdefault(GONE, ModuleType(GONE))  # files of such kernels import it
    from shefex_nav.compiled.numba_hooks import Kernel
    from shefex_nav.late_packages import late

    late("scipy.linalg")  # numba's algebra takes its BLAS by the name of a file in it
    return Kernel(function, {**DEFAULTS, **options})


def inner(function=None, **options):
    """Mark a function that other kernels alone call: it is compiled as a part of them.

    A call from Python works, as tests need, but costs a compilation of its own: `tests/compiled` finds calls
    from the package's Python code. Options as for `kernel`.
    """
    if function is None:
        return lambda one: inner(one, **options)
    from numba import config

    return function if config.DISABLE_JIT else _Inner(function, {**DEFAULTS, **options})


class _Inner:
    """An inner kernel: numba's object for it is made when somebody needs it, which in most processes nobody
    does. It has all that that has.
    """

    def __init__(self, function, options):
        update_wrapper(self, function)
        self.py_func, self.targetoptions = function, options

    @cached_property
    def _kernel(self):
        return kernel(self.py_func, **self.targetoptions)

    def __call__(self, *args, **named):
        return self._kernel(*args, **named)

    def __getattr__(self, name):
        if name == "_kernel":
            raise AttributeError(name)
        return getattr(self._kernel, name)

    def __reduce__(self):
        return self._kernel.__reduce__()


def entry(kernel, *args):
    """A kernel for arguments of the types of these, to be called often.

    It does not look at the types of what it gets, which takes longer than a small kernel does: they must be
    these. Of defaults that are not among these arguments it has to be given the value all the same.
    """
    return kernel.entry(*args) if hasattr(kernel, "entry") else kernel


def rows(fields, align=False):
    """NumPy type of the rows of a table whose fields kernels read as attributes, `row.mass`.

    Compiled code can do so with any structured type. NUMBA_DISABLE_JIT=1 runs kernels as Python, for coverage
    and debuggers; there rows have attributes only if they are np.record, whose own (`mean`) are taken.
    ValueError for such a name.
    """
    import numba
    import numpy as np

    plain = np.dtype(fields, align=align)
    if taken := [name for name in plain.names if hasattr(np.record, name)]:
        raise ValueError(f"fields {', '.join(taken)}: NumPy's rows have attributes of these names")
    return np.dtype((np.record, plain)) if numba.config.DISABLE_JIT else plain
