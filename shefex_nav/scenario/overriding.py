"""What the user says with `--set` on top of a scenario file: values by their paths.

An instrument that takes the place of another (`--set imu.use=NAME`, `--sweep imu=A,B`) comes as its file has
it: what a scenario puts on top of its own instrument, such as the range that this very unit was bought with,
says nothing about another one, and what is gone is told. One that the scenario uses already stays as it is.
"""

import os
from typing import NamedTuple

from shefex_nav.scenario import document, instruments, layers, shipped, starlight, suggest
from shefex_nav.scenario.dispersions import KEYS, ColumnOfFile
from shefex_nav.scenario.document import REMOVED, BadText, Mark, dotted, no_key
from shefex_nav.scenario.files import Unreadable
from shefex_nav.scenario.sensors import USE

MOST_LISTED = 4  # values that are listed
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

    An instrument comes before the values that are set beside it, in whichever order they are given.

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
        if not is_there(section, one.value, texts):
            note_dropped(tree, section, one.value, places, texts)
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
                if said := suggest.moved(path):
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


class Gone(NamedTuple):
    """What another instrument has taken away."""

    field: tuple  # path of the key `use`
    text: str


def is_there(section, name, texts):
    """Whether a section uses the instrument already. path, name as given, layers.Texts"""
    if section not in texts.used or not isinstance(name, str) or not name:
        return False
    try:
        return os.path.realpath(instruments.resolved(section, name, "")) == texts.used[section]
    except Unreadable:
        return False  # which is told when it is read


def note_dropped(tree, section, name, places, texts):
    """Add to `texts.dropped` what an instrument is going to take away from a section of a tree."""
    gone = _on_top(tree, section, places, texts)
    if not gone:
        return
    old = f"of {_stem(texts.used[section])}" if section in texts.used else "of the unit that it extends"
    named = [f"{dotted(path[len(section) :])} {value}" for path, value in gone]
    more = f" and {len(gone) - MOST_LISTED} more" if len(gone) > MOST_LISTED else ""
    listed = ", ".join(named[:MOST_LISTED]) + more
    first, value = gone[0]
    words = (
        f"{name} comes as its file has it, without what the scenario puts on top {old}: {listed}; it keeps "
        f"what is set beside it, such as --set '{dotted(first)}={value}'"
    )
    texts.dropped.append(Gone((*section, USE), words))


def _on_top(tree, section, places, texts):
    """(path, value) of what a scenario puts on top of the instrument of a section: list.

    Without `use` the instrument is what the file says of it that the others extend.
    """
    found = [
        (path, value, places.value(path).file)
        for key in instruments.values_of(section)
        for path, value in _leaves(layers.node(tree, (*section, key)), (*section, key))
    ]
    own = texts.instruments
    if section not in texts.used:
        written = {file for _, _, file in found}
        own = [file for file in texts if file in written][-1:]  # each file is read before those it extends
    return [(path, value) for path, value, file in found if file not in own]


def _leaves(value, path):
    """(path, value) of each single value and each list, at and below a path."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, (*path, key))
    elif value is not None:
        yield path, value


def _stem(path):
    return os.path.basename(path).removesuffix(shipped.ENDING)
