"""Types of arguments as JSON, and back: a kernel is compiled once for each list of them."""

from importlib import import_module

import numpy as np
from numba.core import types
from numba.np import numpy_support

SCALARS = types.Number, types.Boolean, types.NoneType, types.UnicodeType
DEFAULTS = type(None), bool, int, float, str  # of values: exactly these, which JSON gives back as they were
FAULTS = AttributeError, IndexError, KeyError, TypeError, ValueError  # of what does not mean a type


class UnknownType(ValueError):
    """A type that cannot be written or read."""


def encode(kind):
    """Type of numba -> str or list. UnknownType."""
    if isinstance(kind, types.Omitted) and type(kind.value) in DEFAULTS:
        return ["default", kind.value]
    if type(kind) is types.Array:
        flags = "" if kind.mutable else "readonly", "" if kind.aligned else "unaligned"
        return ["array", encode(kind.dtype), kind.ndim, kind.layout, *filter(None, flags)]
    if isinstance(kind, types.Record):
        return _encode_record(numpy_support.as_dtype(kind))
    if isinstance(kind, types.BaseNamedTuple):
        of = kind.instance_class
        return [
            "named",
            f"{of.__module__}:{of.__qualname__}",
            list(of._fields),
            [encode(one) for one in kind],
        ]
    if isinstance(kind, types.BaseTuple):
        return ["tuple", *(encode(one) for one in kind)]
    if isinstance(kind, SCALARS) and not isinstance(kind, types.Literal):
        return str(kind)
    raise UnknownType(f"no rule for {kind}")


def decode(text):
    """What `encode` gave -> type of numba. UnknownType for what the program no longer has."""
    try:
        return _decode(text)
    except UnknownType:
        raise
    except FAULTS as error:
        raise UnknownType(f"no type is {text}: {error}") from error


def _decode(text):
    if isinstance(text, str):
        return types.none if text == "none" else getattr(types, text)
    word, *rest = text
    if word == "default":
        return types.Omitted(rest[0])
    if word == "array":
        of, ndim, layout, *flags = rest
        return types.Array(decode(of), ndim, layout, "readonly" in flags, aligned="unaligned" not in flags)
    if word == "record":
        return _decode_record(*rest)
    if word == "named":
        return _decode_named(*rest)
    if word == "tuple":
        return types.BaseTuple.from_types(tuple(decode(one) for one in rest))
    raise UnknownType(f"no rule for {text}")


def name(kernel):
    """Name of a kernel by which `find` finds it: str."""
    return f"{kernel.py_func.__module__}:{kernel.py_func.__qualname__}"


def find(text):
    """The kernel, or class, of a name. UnknownType where there is none."""
    module, _, attribute = text.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise UnknownType(f"no {text}") from error


def _encode_record(dtype):
    fields = [(one, *dtype.fields[one][:2]) for one in dtype.names]
    return ["record", dtype.itemsize, dtype.isalignedstruct, [[n, _format(of), at] for n, of, at in fields]]


def _format(dtype):
    of, shape = dtype.subdtype or (dtype, ())
    text = of.str if of.names is None else _encode_record(of)
    return [text, list(shape)] if shape else text


def _decode_record(size, aligned, fields):
    return numpy_support.from_dtype(_dtype(size, aligned, fields))


def _dtype(size, aligned, fields):
    formats = [_decode_format(one) for _, one, _ in fields]
    layout = {"names": [one[0] for one in fields], "formats": formats, "offsets": [one[2] for one in fields]}
    return np.dtype({**layout, "itemsize": size}, align=aligned)


def _decode_format(text):
    if isinstance(text, str):
        return text
    if text[0] == "record":
        return _dtype(*text[1:])
    of, shape = text
    return _decode_format(of), tuple(shape)


def _decode_named(of, names, kinds):
    named = find(of)
    if list(named._fields) != names:
        raise UnknownType(f"{of} has the fields {', '.join(named._fields)}")
    return types.BaseTuple.from_types(tuple(decode(one) for one in kinds), named)
