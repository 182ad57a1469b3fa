"""What the user says with `--set` on top of a scenario file: values by their paths."""

from typing import NamedTuple

from shefex_nav.scenario import document, instruments, layers, moved, replaced, starlight
from shefex_nav.scenario.dispersions import KEYS, ColumnOfFile
from shefex_nav.scenario.document import REMOVED, BadText, Mark, dotted, no_key
from shefex_nav.scenario.use import USE

DISPERSIONS = "dispersions"  # the section whose keys are paths


class Option(str):
    """`path=value`, given by another option than `--set`."""

    def __new__(cls, text, option):
        one = super().__new__(cls, text)
        one.option = option  # as it is named in messages
        return one


class _Override(NamedTuple):
    """One `--set`."""

    mark: Mark
    parts: list  # keys of the path
    value: object


class _Marks(NamedTuple):
    """As a document.Document has them."""

    keys: dict
    values: dict


def carry_out(overrides, tree, places, texts):
    """Carry out the `--set` texts in `tree`; raises ScenarioError.

    An instrument comes before the values that are set beside it, in whichever order they are given. One that
    the scenario has already is left with what the scenario puts on top of it; another one comes as its file
    has it (`replaced`).

    places : messages.Places of the tree
    texts : layers.Texts, to which those of instruments are added
    """
    told, found = _read(overrides, tree)
    used, others = [], []
    for one in told:
        is_use = tuple(one.parts) in _USES and one.value is not REMOVED
        (used if is_use else others).append(one)
    for one in used:
        section = _USES[tuple(one.parts)]
        if not replaced.is_there(section, one.value, texts):
            replaced.note_dropped(tree, section, one.value, places, texts)
            layers.put_instrument(tree, section, one.value, "", one.mark, places, texts)
            places.put((*section, USE), {(): one.mark}, {(): one.mark})
    found += starlight.set_twice([(one.mark, tuple(one.parts)) for one in others if one.value is not REMOVED])
    for one in others:
        starlight.set_one(tree, tuple(one.parts), one.value)
        problem = _put(tree, one.parts, one.value, one.mark, places)
        found += [(one.mark, problem)] if problem else []
    if found:
        raise layers.sorted_error(found)
    for section, name in layers.taken_uses(tree):  # of whole sections that were set
        _fill(tree, section, name, places, texts)


_USES = {(*section, USE): section for section in instruments.SECTIONS}


def _read(overrides, tree):
    """list of _Told, and of (Mark, text) about what cannot be read."""
    told, found = [], []
    for text in overrides:
        name, equals, value_text = text.partition("=")
        name = name.strip()
        mark = Mark(text.option if isinstance(text, Option) else f"--set {name}", 0, 0)
        if not equals or not name:
            found.append((mark, "expected path=value, for example --set star_tracker.rate='5 Hz'"))
            continue
        try:
            value, errors = document.parse_value(value_text, mark.file)
        except BadText as error:
            found.append((mark, error.args[1]))
            continue
        found += [(mark, words) for _, words in errors]
        told.append(_Override(mark, _parts(tree, name, value), value))
    return told, found


def _fill(tree, section, name, places, texts):
    """Put an instrument under what a section gives itself."""
    given, mark = layers.node(tree, section), places.value(section)
    layers.node(tree, section[:-1])[section[-1]] = {}
    layers.put_instrument(tree, section, name, "", mark, places, texts)
    marks = {path: mark for path in _paths(given, section)}
    whole = given
    for key in reversed(section):
        whole = {key: whole}
    starlight.give_way(tree, whole)
    layers.merge(layers.node(tree, section), _Marks(marks, marks), section, given, places)


def _paths(value, path):
    """Path of a value and of all within it."""
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, one in inner:
        yield from _paths(one, (*path, key))


def _parts(tree, name, value):
    """Keys of a path; below `dispersions` the path of a field is one key, as far as there is such a one.

    A setting may have the name of a key of dispersions, such as sigma: then the value tells which is meant.
    """
    parts = name.split(".")
    if parts[0] != DISPERSIONS or len(parts) < 3:
        return parts
    if isinstance(value, dict) and not ColumnOfFile.keys().keys() & value:  # a whole dispersion
        return [DISPERSIONS, ".".join(parts[1:])]
    given = tree.get(DISPERSIONS)
    for end in range(len(parts), 1, -1):
        key = ".".join(parts[1:end])
        whole = end == len(parts) or parts[end] in KEYS
        if whole and isinstance(given, dict) and key in given:
            return [DISPERSIONS, key, *parts[end:]]
    end = len(parts) - (parts[-1] in KEYS)
    return [DISPERSIONS, ".".join(parts[1:end]), *parts[end:]]


def _put(tree, parts, value, mark, places):
    """Set one value by its path; the complaint if that is impossible, else None."""
    node, path = tree, ()
    for depth, part in enumerate(parts):
        if isinstance(node, list):
            if not part.isdecimal() or int(part) >= len(node):
                return f"{dotted(path)} is a list, its items are 0 to {len(node) - 1}, got '{part}'"
            part = int(part)
        elif not isinstance(node, dict):
            return f"{dotted(path)} is a single value, there is no '{part}' in it"
        elif words := no_key(part):
            return words
        path = (*path, part)
        if depth + 1 == len(parts) and value is REMOVED:
            if isinstance(node, list):
                return f"an item of {dotted(path[:-1])} cannot be taken away; give the whole list"
            if node.pop(part, REMOVED) is REMOVED:
                if said := moved.words(path):
                    return said
                return f"null takes away what the scenario gives; {dotted(path)} is not given"
            places.put(path, {}, {})
            return None
        if depth + 1 == len(parts):
            had = node[part] if isinstance(node, list) else node.get(part)
            node[part] = value
            places.put(path, {(): mark}, {(): mark})
            if isinstance(value, dict) and isinstance(had, dict):
                places.replaced.add(path)
        elif isinstance(node, dict) and part not in node:
            node[part] = {}
            places.put(path, {(): mark}, {(): mark})
            places.made.add(path)
        node = node[part]
    return None
