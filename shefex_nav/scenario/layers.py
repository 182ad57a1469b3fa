"""Files that build on each other -> one tree of values, each with the place where it was written.

A scenario `extends` another, whose values hold where it gives none. A section that says `use: NAME` takes the
values of an instrument (`instruments`), in the place of what the extended file says of that; what stands
beside `use` comes on top, and so does what a file that extends this one gives.
"""

import os
from typing import NamedTuple

from pydantic import ValidationError

from shefex_nav.errors import UserError
from shefex_nav.scenario import (
    document,
    expand,
    instruments,
    messages,
    plugged,
    shipped,
    software,
    starlight,
    suggest,
    trajectory,
)
from shefex_nav.scenario.document import BadText, Mark, dotted, placed
from shefex_nav.scenario.files import LARGEST, Unreadable, read_text
from shefex_nav.scenario.sensors import USE

MOST, LONGEST = 2 * messages.MOST_TOLD, 4000  # errors, and letters of one: what a person reads
EXTENDS, ENDINGS = "extends", (".yaml", ".yml")
DEEPEST = 50  # files that extend each other


class ScenarioError(UserError):
    """A scenario that cannot be flown; `messages` are lines for the user, `file:line:col: field: what`."""

    def __init__(self, found):
        self.messages = tuple(dict.fromkeys(found))  # a table that two stages have is wrong once
        super().__init__("\n".join(self.messages))


class Texts(dict):
    """Text of each file that a scenario is made of, by its path."""

    def __init__(self, texts=()):
        super().__init__(texts)
        self.instruments = set()  # paths of those that are instruments
        self.used = {}  # real path of the instrument of each section that has one
        self.dropped = []  # of overriding.Gone
        self.size = self.repeated = 0  # bytes of all, values that aliases repeat in them
        self.mistakes = {}  # (Mark, text) of what is wrong in them, as keys: each once

    def add(self, path, text, said):
        """Keep the text of a file, before it is parsed; ScenarioError where all are too large."""
        self[path] = text
        self.size += len(text.encode())
        if self.size > LARGEST:
            words = (
                f"is too much: with it the files of the scenario have more than {LARGEST / 1e6:.3g} MB in all"
            )
            raise _complaint(path, said, words)

    def repeat(self, path, own, said):
        """Count what aliases repeat in a document.Document; ScenarioError where it is too much in all."""
        self.repeated += own.repeated
        if self.repeated > document.MOST_REPEATED:
            words = (
                f"is too much: with it aliases repeat more than {document.MOST_REPEATED} values in all files"
            )
            raise _complaint(path, said, words)

    def with_mistakes(self, found):
        """(Mark, text) of these and of `found`, which may say of a value what is said of its file already."""
        told = {mark for mark, _ in self.mistakes}
        return [*self.mistakes, *(one for one in found if one[0] not in told)]


def sorted_error(found):
    """ScenarioError of (Mark, text) in the order of the file; in one place a section before what is in it."""
    ordered = sorted(found, key=lambda one: (one[0], one[1].partition(": ")[0].split("."), one[1]))
    told = [
        placed(mark, text if len(text) <= LONGEST else f"{text[:LONGEST]}...")
        for mark, text in ordered[:MOST]
    ]
    if len(ordered) > MOST:
        told.append(placed(ordered[MOST][0], "more errors are told when these are mended"))
    return ScenarioError(told)


class Named(NamedTuple):
    """What names a file: the field, and where it stands."""

    mark: Mark
    field: str

    def line(self, words):
        """Line for the user about it."""
        return placed(self.mark, f"{self.field}: {words}")


def file_of(name, beside="", mark=None):
    """Path of the scenario file that is meant by `name` in the folder `beside`.

    mark : where `extends` says so; None: the user does
    """
    try:
        return shipped.resolved(os.fspath(name), beside)
    except Unreadable as error:
        raise _complaint(os.path.join(beside, name), mark and Named(mark, EXTENDS), error) from None


def parsed(text, name):
    """document.Document of a text that came from the file `name`."""
    try:
        own = document.parse(text, name)
    except BadText as error:
        raise ScenarioError([f"{error.args[0]}: {error.args[1]}"]) from None
    if own.errors:
        raise sorted_error(own.errors)
    return own


def _check_chain(path, real, chain, said):
    """ScenarioError of a file that extends itself, or of one file too many. Arguments as in `extended`"""
    if real in chain:
        raise ScenarioError([said.line(f"'{path}' extends itself in a circle; remove one extends")])
    if len(chain) >= DEEPEST:
        raise ScenarioError([said.line(f"'{path}': a chain of `extends` has {DEEPEST} files at most")])


def extended(path, texts, chain=(), said=None, find=None):
    """(tree, places) of the file at `path` merged over what it extends and uses.

    Parameters
    ----------
    path : of the file
    texts : Texts, to which those of the files are added
    chain : real paths of the files that led here
    said : Named, for complaints about the file; None: the user names it
    find : as `file_of`, which it is by default: which file the name behind `extends` means
    """
    find = find or file_of
    text = _read(path, said)
    real = os.path.realpath(path)
    _check_chain(path, real, chain, said)
    texts.add(path, text, said)
    own = parsed(text, path)
    texts.repeat(path, own, said)
    folder = os.path.dirname(path)
    expand.relative_to(own.tree, folder)
    plugged.relative_to(own.tree, folder)
    software.relative_to(own.tree, folder)
    trajectory.relative_to(own.tree, folder)
    places, tree = messages.Places(own.values[()]), {}
    has_base, used = EXTENDS in own.tree, taken_uses(own.tree)
    if not has_base and not used:
        places.put((), own.keys, own.values)
        return own.tree, places
    if has_base:
        base, here = own.tree.pop(EXTENDS), own.values[EXTENDS,]
        if not isinstance(base, str) or not base:
            raise ScenarioError(
                [f"{here}: {EXTENDS}: expected the name of a scenario file, such as base.yaml"]
            )
        chain = (*chain, real)
        tree, places = extended(find(base, folder, here), texts, chain, Named(here, EXTENDS), find)
        places.keys[()] = places.values[()] = own.values[()]
    for section, name in used:
        put_instrument(tree, section, name, folder, own.values[*section, USE], places, texts)
    starlight.give_way(tree, own.tree, own.removed)
    merge(tree, own, (), own.tree, places)
    in_reach = {path for path in own.removed if has_base or any(_is_below(path, one) for one, _ in used)}
    found = [
        (own.keys[path], words) for path in own.removed if path in in_reach and (words := _remove(tree, path))
    ]
    if in_reach:
        places.take(in_reach, {}, {})
    if found:
        raise sorted_error(found)
    return tree, places


def taken_uses(tree):
    """Take the keys `use` out of a tree: list of (path of the section, name)."""
    found = []
    for section in instruments.SECTIONS:
        given = node(tree, section)
        if isinstance(given, dict) and USE in given:
            found.append((section, given.pop(USE)))
    return found


def node(tree, path):
    """What stands at a path of a tree, None if there is nothing."""
    for part in path:
        tree = tree.get(part) if isinstance(tree, dict) else None
    return tree


def _is_below(path, section):
    return len(path) > len(section) and path[: len(section)] == section


def put_instrument(tree, section, name, folder, mark, places, texts):
    """Put the values of an instrument into a section of a tree, in the place of what it says of them.

    Parameters
    ----------
    tree : of the scenario; sections that are missing are made
    section : path of the section
    name : as given behind `use`
    folder : in which a file of that name is looked for
    mark : where that stands
    places : messages.Places of the tree
    texts : Texts, to which that of the instrument is added
    """
    said = Named(mark, dotted((*section, USE)))
    values, inner, path = _instrument(section, name, folder, said, texts)
    texts.used[section] = os.path.realpath(path)
    for depth in range(1, len(section) + 1):
        path = section[:depth]
        outer = node(tree, path[:-1])
        if not isinstance(outer.get(path[-1]), dict):
            outer[path[-1]] = {}
            places.put(path, {(): mark}, {(): mark})
    into = node(tree, section)
    for key in instruments.values_of(section):  # of the unit that was there nothing is left
        into.pop(key, None)
    for key, value in values.items():
        into[key] = value
        keys, marks = (_below(one, (key,)) for one in (inner.keys, inner.values))
        places.put((*section, key), keys, marks)


def _instrument(section, name, folder, said, texts):
    """Values of an instrument for a section, the messages.Places of its file, and its path.

    Raises ScenarioError if it is none; what is wrong in one is kept in `texts`, and the rest is checked, too.

    said : Named
    """
    if not isinstance(name, str) or not name:
        known = instruments.listing(section)
        raise ScenarioError([said.line(f"expected the name of an instrument or of its file; {known}")])

    def find(other, beside, mark):
        named = said if mark is None else Named(mark, EXTENDS)
        try:
            return instruments.resolved(section, other, beside)
        except Unreadable as error:
            raise ScenarioError([named.line(error)]) from None

    path = find(name, folder, None)
    tree, places = extended(path, texts, (), said, find)
    texts.instruments.add(path)
    if words := instruments.instead(section, tree):
        raise ScenarioError([said.line(f"'{path}' {words}")])
    model = instruments.SECTIONS[section]
    try:
        model.model_validate(tree)
    except ValidationError as error:
        texts.mistakes |= dict.fromkeys(messages.lines(model, error, places))
    values = {key: value for key, value in tree.items() if key in instruments.values_of(section)}
    return values, places, path


def _read(path, said):
    """Text of the scenario file at `path`; complaints as of `_complaint`."""
    # somebody else's scenario may name any file, and messages quote what is in it
    if said is not None and not path.lower().endswith(ENDINGS):
        raise ScenarioError([said.line(f"'{path}' is no scenario file; expected {' or '.join(ENDINGS)}")])
    try:
        return read_text(path, "a scenario file")
    except Unreadable as error:
        raise _complaint(path, said, error) from None


def _complaint(path, said, words):
    """ScenarioError about a file. said : Named; None: the user names the file"""
    return ScenarioError([said.line(f"'{path}' {words}") if said else f"{path}: {words}"])


def _remove(tree, path):
    """Take away what a base gives at `path`; the complaint if it gives nothing there, else None."""
    given = node(tree, path[:-1])
    if not isinstance(given, dict) or path[-1] not in given:
        if said := suggest.moved(path):
            return f"{dotted(path)}: {said}"
        return f"{dotted(path)}: null takes away what the extended file gives, which is nothing; leave it out"
    del given[path[-1]]
    return None


def merge(tree, own, path, updates, places):
    """Put `updates` into `tree`, section by section; a list or a value replaces what was there.

    tree : section at `path` of the scenario
    own : document.Document, or what has its marks, of the updates
    places : messages.Places of the scenario
    """
    places.take(_merged(tree, own, path, updates, places), own.keys, own.values)


def _merged(tree, own, path, updates, places):
    """Merge, but for the marks of what is replaced; the set of the paths of that."""
    replaced = set()
    for key, value in updates.items():
        here = (*path, key)
        if isinstance(value, dict) and isinstance(tree.get(key), dict):
            places.keys[here], places.values[here] = own.keys[here], own.values[here]
            replaced |= _merged(tree[key], own, here, value, places)
            continue
        tree[key] = value
        replaced.add(here)
    return replaced


def _below(marks, path):
    """Marks at and below a path, by their paths from there."""
    return {known[len(path) :]: mark for known, mark in marks.items() if known[: len(path)] == path}
