"""Packages of others of which one file is wanted: what else they import waits until somebody asks for it.

SciPy's and filterpy's packages import all of their files, and with them NumPy's tests, compilers of Fortran
and the texts of all functions: half a second of processor time for a quantile and a measurement update.
"""

import sys
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from threading import RLock
from types import ModuleType

ASKED_FOR = "__all__", "__version__"  # of the names with underscores, that are more than Python's own
_PLACING = RLock()  # two threads that ask for one package get one module


class _Late(ModuleType):
    """A package whose code runs when it is asked for something that its `parts` do not have."""

    def __dir__(self):
        """All names: for help, completion and whoever lists a module."""
        _complete(self)
        return dir(self)

    def __getattr__(self, name):
        if name.startswith("__") and name not in ASKED_FOR:  # Python looks for __warningregistry__ itself
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        state = self.__spec__.loader_state
        with state.lock:  # of another thread that runs it
            if type(self) is _Late:
                if state.begun:
                    raise AttributeError(f"module {self.__name__!r} has no attribute {name!r} yet")
                if name in state.later:
                    return _when_called(self, name)
                for part in (import_module(f"{self.__name__}.{one}") for one in state.parts):
                    if hasattr(part, name):
                        return getattr(part, name)
                _run(self)
        return getattr(self, name)


class _State:
    """What is known of a package that waits: `parts` and `later` as of `late`; begun : its code runs"""

    def __init__(self, parts, later):
        self.parts, self.later = parts, later
        self.lock, self.begun = RLock(), False


def late(package, *parts, later=()):
    """Let a package wait; nothing happens if it has been imported already.

    package : dotted name;  parts : names of files in it, imported when one of their names is asked for
    later : names of functions for which a function is handed out that imports the package when it is called
    """
    with _PLACING:
        if package in sys.modules:
            return
        spec = find_spec(package)
        if spec is None:
            raise ModuleNotFoundError(f"No module named {package!r}", name=package)
        module = module_from_spec(spec)
        module.__class__, spec.loader_state = _Late, _State(parts, later)
        sys.modules[package] = module
        above, _, name = package.rpartition(".")
        if above:
            setattr(sys.modules[above], name, module)


def special():
    """scipy.special, of which only the file with the functions of numbers is imported."""
    late("scipy.special", "_ufuncs")
    return import_module("scipy.special")


def _complete(module):
    """Run the code of a package if it waits."""
    with module.__spec__.loader_state.lock:
        if type(module) is _Late:
            _run(module)


def _run(module):
    """Run the code of a package, as Python's import does; meanwhile it has the names it has so far."""
    state = module.__spec__.loader_state
    state.begun = True
    try:
        module.__spec__.loader.exec_module(module)
        module.__class__ = ModuleType
    finally:
        state.begun = False


def _when_called(module, name):
    """Function that stands for one of a package."""

    def function(*args, **named):
        _complete(module)
        return getattr(module, name)(*args, **named)

    return function
