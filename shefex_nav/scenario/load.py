"""Scenario file -> `Scenario`: read, extend, override, validate; all errors at once, each with its place."""

import copy
import os
import re
from functools import partial

from pydantic import ValidationError

from shefex_nav.errors import UserError
from shefex_nav.scenario import disperse, document, drawn, expand, fields, kind, messages, moved, shipped
from shefex_nav.scenario.checks import check_what_is_known, cross_check
from shefex_nav.scenario.dispersions import KEYS
from shefex_nav.scenario.document import REMOVED, BadText, Mark, dotted
from shefex_nav.scenario.files import Unreadable, read_text
from shefex_nav.scenario.partial import known
from shefex_nav.scenario.partial import validated as part_of
from shefex_nav.scenario.schema import Scenario

EXTENDS = "extends"
NOT_EXPANDED = (("gps", expand.ALMANAC), ("star_tracker", expand.MODEL))  # what a file gave, or was to give
DISPERSIONS = "dispersions"  # the section whose keys are paths


class ScenarioError(UserError):
    """A scenario that cannot be flown; `messages` are lines for the user, `file:line:col: field: what`."""

    def __init__(self, found):
        self.messages = tuple(found)
        super().__init__("\n".join(self.messages))


def load(path, overrides=()):
    """Scenario of the YAML file at `path`, after its `extends` and the `overrides` (`a.b=value`).

    path : may be the bare name of a scenario that the package brings, see `shipped`

    Raises ScenarioError with every error found: those of the YAML text first, because a tree with holes would
    be blamed for what it lacks; then those of tables in files, of single fields, and between fields that are
    good by themselves; those of dispersions when the fields that they name are.
    """
    files, path = {}, file_of(path)
    tree, places = _extended(path, (), files)
    return _validated(tree, places, files, overrides, path)


def load_as(model, path, overrides=(), *, parts=(), instead=lambda tree, path: ""):
    """The YAML file at `path` as another `model` than a mission by the same rules: `extends`, `--set`, units.

    parts : functions of an instance that yield contradictions in it, (path of the field, text); of a tree
        with mistakes they get what is good of it (`partial`)
    instead : says what a tree is that is of another kind, such as kind.instead_of_replay

    Returns
    -------
    loaded : instance of the model
    places : messages.Places of its keys and values
    source : YAML text with everything in it

    Raises ScenarioError as `load` does.
    """
    path = file_of(path)
    tree, places = _extended(path, (), {})
    if other := instead(tree, path):
        raise ScenarioError([f"{path}: {other}"])
    return _validated_as(model, tree, places, overrides, parts)


def load_text_as(model, text, name, overrides=(), *, parts=()):
    """The same of a text that needs no other file; complaints call it `name`."""
    return _validated_as(model, *_whole(text, name), overrides, parts)


def _validated_as(model, tree, places, overrides, parts):
    """What `load_as` returns, of a merged tree."""
    _override(tree, places, overrides)
    try:
        loaded, found, read = model.model_validate(tree), [], list
    except ValidationError as error:
        loaded, read = part_of(model, tree, messages.paths(error)), known
        found = messages.lines(model, error, places)
    for part in parts:
        found += [(places.value(where), f"{dotted(where)}: {words}") for where, words in read(part(loaded))]
    if found:
        raise _sorted_error(found) from None
    return loaded, places, _normalised(tree)


def load_text(text, name, overrides=()):
    """Scenario of a text that needs no other file, such as a log keeps; complaints call it `name`.

    Raises ScenarioError as `load` does.
    """
    return _validated(*_whole(text, name), {name: text}, overrides, name)


class Pattern:
    """A scenario with dispersions, read once and then made again and again with what was drawn."""

    def __init__(self, text, name):
        self._text, self._name = text, name
        self._tree, self._places = _whole(text, name)
        self.scenario = self._validated(copy.deepcopy(self._tree), self._places.copy())
        self.dispersed, _ = disperse.resolve(Scenario, self._tree, self.scenario.dispersions)
        for one in self.dispersed:
            fields.fill(Scenario, self._tree, one.path)
        self._tree.pop(DISPERSIONS, None)

    def with_draws(self, draws):
        """Scenario of what was drawn, {path as written: value in the unit of its dispersion}.

        The values are checked as those of a file are; raises ScenarioError.
        """
        tree, places = copy.deepcopy(self._tree), self._places.copy()
        for one in self.dispersed:
            fields.put(tree, one.path, drawn.applied(one, draws[one.name]))
            mark = Mark("drawn", 0, 0)
            places.put(one.path, {(): mark}, {(): mark})
        return self._validated(tree, places)

    def _validated(self, tree, places):
        """Scenario of a tree that it may keep."""
        return _validated(tree, places, {self._name: self._text}, (), self._name)


def _whole(text, name):
    """(tree, places) of a text that needs no other file."""
    own = _parsed(text, name)
    places = messages.Places(own.values[()])
    places.put((), own.keys, own.values)
    return own.tree, places


def _validated(tree, places, files, overrides, path):
    """Scenario of a merged tree after the overrides; `path` is the file or text that the user gave."""
    parents = [file for file in files if file != path]
    if other := kind.instead_of_flight(tree, path):
        raise ScenarioError([f"{path}: {other}"])
    _override(tree, places, overrides)
    found, rated = expand.expand(tree, places, files)
    bad = list(NOT_EXPANDED) if found else []
    try:
        scenario = Scenario.model_validate(tree)
    except ValidationError as error:
        found += messages.lines(Scenario, error, places)
        bad += messages.paths(error)
    about = partial(_about, places, path, parents)
    if found:
        others = check_what_is_known(part_of(Scenario, tree, bad), rated)
    else:
        others = [*cross_check(scenario, rated), *disperse.resolve(Scenario, tree, scenario.dispersions)[1]]
    found += [about(where, words) for where, words in others]
    if found:
        raise _sorted_error(found) from None
    scenario.keep_text(partial(_normalised, tree), files)  # which takes longer than all the rest
    scenario.keep_places(partial(_line_about, about), partial(_place, places))
    return scenario


def _line_about(about, where, words):
    """A line of what `_about` says."""
    return _line(*about(where, words))


def _place(places, where):
    """`file:line:col` of the value at a path."""
    return str(places.value(where))


def _about(places, path, parents, where, words):
    """(Mark, text) about the field at the path `where` of the scenario in the file `path`."""
    mark = places.value(where)
    return mark, f"{dotted(where)}: {words}{_whose(mark, path, parents)}"


def _whose(mark, path, parents):
    """Where to put right what stands in a file that the user's own extends: nobody need edit that one."""
    return f" (set in {mark.file}; change it in {path}, which extends it)" if mark.file in parents else ""


def _sorted_error(found):
    """ScenarioError of (Mark, text), in the order of the file."""
    return ScenarioError(_line(mark, text) for mark, text in sorted(found))


def _line(mark, text):
    """Line for the user; `--set a.b` need not name its field twice."""
    return re.sub(r"^(--set )(\S+): \2: ", r"\1\2: ", f"{mark}: {text}")


def file_of(name, beside="", mark=None):
    """Path of the scenario file that is meant by `name` in the folder `beside`; complaints as in `_read`."""
    try:
        return shipped.resolved(os.fspath(name), beside)
    except Unreadable as error:
        raise _unreadable(os.path.join(beside, name), mark, error) from None


def _read(path, mark):
    """Text of the scenario file at `path`; complaints are placed at `mark`, at the file if that is None."""
    try:
        return read_text(path, "a scenario file")
    except Unreadable as error:
        raise _unreadable(path, mark, error) from None


def _unreadable(path, mark, error):
    """ScenarioError of an Unreadable."""
    where = f"{mark}: {EXTENDS}: '{path}'" if mark else f"{path}:"
    return ScenarioError([f"{where} {error}"])


def _parsed(text, name):
    """document.Document of a text that came from the file `name`."""
    try:
        own = document.parse(text, name)
    except BadText as error:
        raise ScenarioError([f"{error.args[0]}: {error.args[1]}"]) from None
    if own.errors:
        raise _sorted_error(own.errors)
    return own


def _extended(path, chain, files, mark=None):
    """(tree, places) of the file at `path` merged over what it extends; texts are added to `files`."""
    text = _read(path, mark)
    real = os.path.realpath(path)
    if real in chain:
        raise ScenarioError([f"{mark}: {EXTENDS}: '{path}' extends itself in a circle; remove one extends"])
    own = _parsed(text, path)
    files[path] = text
    expand.relative_to(own.tree, os.path.dirname(path))
    places = messages.Places(own.values[()])
    if EXTENDS not in own.tree:
        places.put((), own.keys, own.values)
        return own.tree, places
    base = own.tree.pop(EXTENDS)
    here = own.values[EXTENDS,]
    if not isinstance(base, str) or not base:
        raise ScenarioError([f"{here}: {EXTENDS}: expected the name of a scenario file, such as base.yaml"])
    tree, places = _extended(file_of(base, os.path.dirname(path), here), (*chain, real), files, here)
    places.keys[()] = places.values[()] = own.values[()]
    _merge(tree, own, (), own.tree, places)
    found = [(own.keys[removed], text) for removed in own.removed if (text := _remove(tree, removed, places))]
    if found:
        raise _sorted_error(found)
    return tree, places


def _remove(tree, path, places):
    """Take away what a base gives at `path`; the complaint if it gives nothing there, else None."""
    node = tree
    for part in path[:-1]:
        node = node.get(part) if isinstance(node, dict) else None
    if not isinstance(node, dict) or path[-1] not in node:
        if said := moved.words(path):
            return f"{dotted(path)}: {said}"
        return f"{dotted(path)}: null takes away what the extended file gives, which is nothing; leave it out"
    del node[path[-1]]
    places.put(path, {}, {})
    return None


def _merge(tree, own, path, updates, places):
    """Put `updates` into `tree`, section by section; a list or a value replaces what was there."""
    for key, value in updates.items():
        here = (*path, key)
        if isinstance(value, dict) and isinstance(tree.get(key), dict):
            places.keys[here], places.values[here] = own.keys[here], own.values[here]
            _merge(tree[key], own, here, value, places)
            continue
        tree[key] = value
        keys, values = (
            {known[len(here) :]: mark for known, mark in marks.items() if known[: len(here)] == here}
            for marks in (own.keys, own.values)
        )
        places.put(here, keys, values)


def _override(tree, places, overrides):
    """Carry out the `--set` texts in `tree`."""
    found = []
    for text in overrides:
        name, equals, value_text = text.partition("=")
        name = name.strip()
        mark = Mark(f"--set {name}", 0, 0)
        if not equals or not name:
            found.append((mark, "expected path=value, for example --set star_tracker.rate='5 Hz'"))
            continue
        try:
            value, errors = document.parse_value(value_text, mark.file)
        except BadText as error:
            found.append((mark, error.args[1]))
            continue
        found += [(mark, words) for _, words in errors]
        problem = _put(tree, _parts(tree, name), value, mark, places)
        found += [(mark, problem)] if problem else []
    if found:
        raise _sorted_error(found)


def _parts(tree, name):
    """Keys of a path; below `dispersions` the path of a field is one key, as far as there is such a one."""
    parts = name.split(".")
    if parts[0] != DISPERSIONS or len(parts) < 3:
        return parts
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
            node[part] = value
            places.put(path, {(): mark}, {(): mark})
        elif isinstance(node, dict) and part not in node:
            node[part] = {}
            places.put(path, {(): mark}, {(): mark})
        node = node[part]
    return None


def _normalised(tree):
    """YAML text of the merged tree, without comments, that loads to the same scenario."""
    import io

    from ruamel.yaml import YAML

    writer = YAML(typ="safe", pure=True)
    writer.default_flow_style = None  # lists of plain values in one line
    writer.sort_base_mapping_type_on_output = False
    writer.width = 4096
    stream = io.StringIO()
    writer.dump(_given(tree), stream)
    return stream.getvalue()


def _given(tree):
    """A tree without keys that have no value, which is the same as not to give them."""
    if isinstance(tree, dict):
        return {key: _given(value) for key, value in tree.items() if value is not None}
    return [_given(item) for item in tree] if isinstance(tree, list) else tree
