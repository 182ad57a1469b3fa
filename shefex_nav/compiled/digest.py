"""What a kernel and all that it calls really are, as a number.

Compiled code is good as long as this number stays. It follows from the instructions of the kernel and of
every function that it calls, and from the constants, tables and types that they use, in whichever file they
stand. Comments, docstrings, line numbers and folders do not count.
"""

import dis
import enum
import hashlib
import types as python
from functools import cache

import numpy as np

OURS = "shefex_nav"
LOADS_CONSTANT = frozenset(dis.hasconst)
CACHE_ENTRY = dis.opmap.get("CACHE", 0)


def closure(kernel):
    """All functions that are compiled together with a kernel, itself included: list."""
    found, waiting = {}, [kernel.py_func]
    while waiting:
        function = waiting.pop()
        if function not in found:
            found[function] = None
            waiting += _own(function)[1]
    return list(found)


def of_kernel(kernel):
    """Digest of a kernel and all that it calls: str."""
    parts = sorted(_own(function)[0] for function in closure(kernel))
    return hashlib.sha256("\n".join([_options(kernel), *parts]).encode()).hexdigest()


def weight(function):
    """How much there is to compile in a function alone: int, bytes of Python's instructions."""
    return len(function.__code__.co_code)


@cache
def _own(function):
    """Text that tells a function from others, and the functions that it calls: (str, list)."""
    called = []
    parts = [_name(function), _code(function.__code__)]
    for name, value in _used(function):
        parts.append(f"{name} = {_value(value, called)}")
    parts.append(_value((function.__defaults__, function.__kwdefaults__), called))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest() + " " + _name(function), called


def _used(function):
    """Names of other files or of the module that a function uses, with what they mean: (name, value)."""
    names = sorted(_names(function.__code__))
    space = function.__globals__
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    yield from ((name, cell.cell_contents) for name, cell in cells)
    for name in names:
        if name not in space:
            continue  # Python's own, or an attribute
        value = space[name]
        yield name, value
        if isinstance(value, python.ModuleType) and value.__name__.split(".")[0] == OURS:
            yield from ((f"{name}.{one}", getattr(value, one)) for one in names if hasattr(value, one))


def _names(code):
    """Names of globals and attributes in a code object and those inside it: set."""
    inside = (one for one in code.co_consts if isinstance(one, python.CodeType))
    return set(code.co_names).union(*map(_names, inside))


def _code(code):
    """Text of the instructions: constants in the order of their use, so that a docstring is none of them."""
    raw, constants, wide = bytearray(code.co_code), [], 0
    for k in range(0, len(raw), 2):
        operation, argument = raw[k], raw[k + 1] | wide
        wide = argument << 8 if operation == dis.EXTENDED_ARG else 0
        if operation in LOADS_CONSTANT:
            one = code.co_consts[argument]
            constants.append(_code(one) if isinstance(one, python.CodeType) else repr(one))
            raw[k + 1] = 0
    layout = code.co_argcount, code.co_varnames, code.co_names, code.co_freevars, code.co_cellvars
    return f"{raw.hex()} {constants} {layout} {code.co_exceptiontable.hex()}"


def _options(kernel):
    """How a kernel is compiled, apart from the processor."""
    options = {
        name: sorted(one) if isinstance(one, set) else one for name, one in kernel.targetoptions.items()
    }
    return repr(sorted(options.items()))


def _value(value, called):
    """Text of a constant, the same in every process; functions are added to `called`.

    TypeError for a kind of constant for which there is no rule.
    """
    if isinstance(value, enum.Enum):
        return f"{_name(type(value))}.{value.name} {value.value!r}"
    if value is None or isinstance(value, (bool, int, float, complex, str, bytes, slice, range)):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, (tuple, list)):
        inside = ", ".join(_value(one, called) for one in value)
        return f"{_value(type(value), called)} ({inside})"
    if isinstance(value, (set, frozenset)):
        return f"set {sorted(_value(one, called) for one in value)}"
    if isinstance(value, dict):
        return f"dict {sorted((_value(k, called), _value(v, called)) for k, v in value.items())}"
    if hasattr(value, "py_func"):
        called.append(value.py_func)
        return f"kernel {_name(value.py_func)} {_options(value)}"
    if isinstance(value, python.FunctionType):
        called.append(value)
        return f"function {_name(value)}"
    return _description(value)


def _description(value):
    """Text of what is neither a plain value nor a function of ours."""
    if isinstance(value, (np.ndarray, np.generic)):
        bits = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"array {_description(value.dtype)} {np.shape(value)} {bits}"
    if isinstance(value, np.dtype):
        return f"dtype {value.descr} {value.itemsize} {value.alignment}"
    if isinstance(value, type):
        members = [(one.name, one.value) for one in value] if issubclass(value, enum.Enum) else ()
        return f"class {_name(value)} {getattr(value, '_fields', ())} {members}"
    if isinstance(value, python.ModuleType):
        return f"module {value.__name__}"
    if callable(value) and hasattr(value, "__name__"):  # of Python, NumPy or numba
        return f"callable {getattr(value, '__module__', '')} {value.__name__}"
    if type(value).__module__.split(".")[0] == "numba":
        return f"type {value}"
    raise TypeError(f"a kernel uses {value!r}: no rule tells when that becomes another")


def _name(thing):
    return f"{thing.__module__}:{thing.__qualname__}"
