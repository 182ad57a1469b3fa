"""What a kernel and all that it calls really are, as a number.

Compiled code is good as long as this number stays. It follows from the instructions of the kernel and of
every function that it calls, and from the constants, tables and types that they use, in whichever file they
stand. Comments, docstrings, line numbers and folders do not count.
"""

import dis
import enum
import hashlib
import sys
import types as python
from functools import cache

import numpy as np

FIXED = sys.stdlib_module_names | {"numpy", "scipy", "numba", "llvmlite"}  # packages that do not change
PLAIN = {type(None), type(...), bool, int, float, complex, str, bytes, slice, range}
LOADS_CONSTANT = frozenset(dis.hasconst)


def closure(kernel, known=None):
    """All functions that are compiled together with a kernel, itself first: {function: own(function)}.

    Always in the same order, whatever they are called.

    known : what has been found out for other kernels at this moment, likewise; it grows. Not to be kept:
        globals may become others
    """
    known = {} if known is None else known
    found, waiting = {}, [kernel.py_func]
    while waiting:
        function = waiting.pop()
        if function not in found:
            if function not in known:
                known[function] = own(function)
            found[function] = known[function]
            waiting += found[function][1]
    return found


def of_kernel(kernel, known=None):
    """Digest of a kernel and all that it calls, as they are now: str. known : as for `closure`"""
    found = closure(kernel, known)
    numbers = {function: k for k, function in enumerate(found)}
    parts = [f"{text} calls {[numbers[one] for one in called]}" for text, called in found.values()]
    return hashlib.sha256("\n".join([_options(kernel), *parts]).encode()).hexdigest()


def weight(function):
    """How much there is to compile in a function alone: int, bytes of Python's instructions."""
    return len(function.__code__.co_code)


def own(function):
    """Text that tells a function from others, and the functions that it calls: (str, list)."""
    called = []
    text, names = _code(function.__code__)
    parts = [_name(function), text]
    for name, value in _used(function, names):
        parts.append(f"{name} = {_value(value, called)}")
    parts.append(_value((function.__defaults__, function.__kwdefaults__), called))
    return "\n".join(parts), called


def _used(function, names):
    """Names of other files or of the module that a function uses, with what they mean: (name, value)."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    found = [(name, cell.cell_contents) for name, cell in cells]
    space = function.__globals__  # what is not in it is Python's own, or an attribute
    found += [(name, space[name]) for name in names if name in space]
    for name, value in found:
        yield name, value
        if isinstance(value, python.ModuleType):
            yield from _attributes(name, value, names, ())


def _attributes(path, module, names, around):
    """What a module has under names that a function uses, and modules in it: (name, value)."""
    if _is_fixed(module.__name__) or module in around:
        return
    for name in names:
        if hasattr(module, name):
            value = getattr(module, name)
            yield f"{path}.{name}", value
            if isinstance(value, python.ModuleType):
                yield from _attributes(f"{path}.{name}", value, names, (*around, module))


def _is_fixed(module):
    return str(module).split(".")[0] in FIXED


def _names(code):
    """Names of globals and attributes in a code object and those inside it: set."""
    inside = (one for one in code.co_consts if isinstance(one, python.CodeType))
    return set(code.co_names).union(*map(_names, inside))


@cache
def _code(code):
    """Digest of the instructions, and the names of globals and attributes in them, sorted: (str, list)."""
    return hashlib.sha256(of_code(code).encode()).hexdigest(), sorted(_names(code))


def of_code(code):
    """Text of the instructions: constants in the order of their use, so that a docstring is none of them."""
    raw, constants, wide = bytearray(code.co_code), [], 0
    for k in range(0, len(raw), 2):
        operation, argument = raw[k], raw[k + 1] | wide
        wide = argument << 8 if operation == dis.EXTENDED_ARG else 0
        if operation in LOADS_CONSTANT:
            one = code.co_consts[argument]
            constants.append(of_code(one) if isinstance(one, python.CodeType) else _value(one, []))
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
    if type(value) in PLAIN:
        return f"{type(value).__name__} {value!r}"
    if hasattr(value, "py_func"):
        called.append(value.py_func)
        return f"kernel {_name(value.py_func)} {_options(value)}"
    if isinstance(value, enum.Enum):
        return f"{_name(type(value))}.{value.name} {value.value!r}"
    if isinstance(value, (tuple, list)):
        inside = ", ".join(_value(one, called) for one in value)
        return f"{_value(type(value), called)} ({inside})"
    if isinstance(value, (set, frozenset)):
        return f"set {sorted(_value(one, called) for one in value)}"
    if isinstance(value, dict):
        return f"dict {sorted((_value(k, called), _value(v, called)) for k, v in value.items())}"
    if isinstance(value, python.FunctionType) and not _is_fixed(value.__module__):
        called.append(value)
        return f"function {_name(value)}"
    return _description(value)


def _description(value):
    """Text of what is neither a plain value nor a function of ours."""
    if isinstance(value, python.ModuleType):
        return f"module {value.__name__}"
    if isinstance(value, (np.ndarray, np.generic)):
        bits = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        order = value.flags.c_contiguous, value.flags.f_contiguous
        return f"array {_description(value.dtype)} {np.shape(value)} {order} {bits}"
    if isinstance(value, np.dtype):
        return f"dtype {value.descr} {value.itemsize} {value.alignment}"
    if isinstance(value, type):
        members = [(one.name, one.value) for one in value] if issubclass(value, enum.Enum) else ()
        fields, defaults = getattr(value, "_fields", ()), getattr(value, "_field_defaults", {})
        return f"class {_name(value)} {fields} {_value(defaults, [])} {members}"
    if isinstance(value, (int, float, str)):  # of a class of its own
        return f"{_name(type(value))} {value!r}"
    if callable(value) and hasattr(value, "__name__"):  # of Python, NumPy or numba
        return f"callable {getattr(value, '__module__', '')} {value.__name__}"
    if type(value).__module__.split(".")[0] == "numba":
        return f"type {value}"
    raise TypeError(f"a kernel uses {value!r}: no rule tells when that becomes another")


def _name(thing):
    return f"{thing.__module__}:{thing.__qualname__}"
