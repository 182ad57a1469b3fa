"""Which values two scenarios do not have in common, for people."""

from shefex_nav.scenario import layers
from shefex_nav.scenario.document import dotted

NOT_GIVEN = object()


def of_texts(old, new, names=("there", "here")):
    """(path, value, value) of each value that differs between two whole texts, or is NOT_GIVEN in one.

    names : of the two, for the ScenarioError about one that cannot be read
    """
    pairs = zip((old, new), names, strict=True)
    before, after = (dict(_values(layers.parsed(text, name).tree)) for text, name in pairs)
    paths = [*after, *(path for path in before if path not in after)]
    found = [(path, before.get(path, NOT_GIVEN), after.get(path, NOT_GIVEN)) for path in paths]
    return [one for one in found if one[1] != one[2]]


def lines(differences, place=lambda path: "", most=None):
    """`FILE:LINE:COL: launch.elevation: 86.43 deg -> 84 deg` for each.

    place : where the value at a path is written, as text; "" if that is not known
    most : number of them; None for all
    """
    found = []
    for path, old, new in differences[:most]:
        where = place(path)
        found.append(f"{where + ': ' if where else ''}{dotted(path)}: {_text(old)} -> {_text(new)}")
    return found


def _text(value):
    if value is NOT_GIVEN:
        return "(not given)"
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_text(inner)}' for key, inner in value.items())}}}"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _values(tree, path=()):
    """(path, value) of each value of a scenario; a list is one."""
    for key, value in tree.items():
        if isinstance(value, dict) and value:
            yield from _values(value, (*path, key))
        else:
            yield (*path, key), value
