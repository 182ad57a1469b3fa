"""How numba compiles `lent`: an array without its owner, whose references need not be counted."""

from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.extending import intrinsic, overload

from shefex_nav.compiled.lending import lent

LENT = (  # types whose memory has one owner at most in each part, which `_uncounted` takes away
    *(types.Array, types.Number, types.Boolean, types.NoneType, types.Omitted),
    *(types.Record, types.BaseTuple),
)


def _uncounted(context, builder, kind, value):
    """LLVM's value of a type without the owners of its arrays."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        parts = cgutils.unpack_tuple(builder, value, len(kind))
        inside = [_uncounted(context, builder, *one) for one in zip(kind.types, parts, strict=True)]
        return context.make_tuple(builder, kind, inside)
    return value


def _is_known(kind):
    """Whether `_uncounted` finds all owners in a type; else one would be freed twice: of what may be None."""
    return isinstance(kind, LENT) and all(map(_is_known, getattr(kind, "types", ())))


@intrinsic
def _lent(typing_context, value):
    if not _is_known(value):
        raise TypingError(f"lent: arrays, numbers, None and tuples of these are lent, not {value}")
    return value(value), lambda context, builder, sig, args: _uncounted(
        context, builder, sig.args[0], args[0]
    )


@overload(lent)
def _lend(value):
    return lambda value: _lent(value)
