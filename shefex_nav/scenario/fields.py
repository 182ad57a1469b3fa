"""The field at a path of a scenario: how it reads its value, and what that is."""

from typing import Any, NamedTuple, get_args, get_origin

from pydantic import Discriminator
from pydantic_core import PydanticUndefined

from shefex_nav.scenario import messages, suggest
from shefex_nav.scenario.document import dotted
from shefex_nav.scenario.quantity import NumberSpec, QuantitySpec, describe

NOT_GIVEN = object()
EPOCH = ("mission", "epoch")
SINCE_EPOCH = QuantitySpec("s", "5 min")  # what is added to it


class Target(NamedTuple):
    """A field of a scenario."""

    path: tuple  # keys, and numbers of the items of lists
    spec: Any  # QuantitySpec, NumberSpec, or None: a word, a switch
    nominal: Any  # as written: text, number, or a list of them


class NoField(Exception):
    """There is no such field; the text says why."""


def target(model, tree, name):
    """Target of the field that `name` means in a tree that has been validated by the model; NoField else."""
    parts, path = name.split("."), ()
    annotation, metadata, node = model, (), tree
    for part in parts:
        annotation, metadata = chosen_form(*messages.bare(annotation, metadata), node)
        if get_origin(annotation) in (list, tuple):
            part = _item(part, node, path)
        _check_key(model, annotation, part, path)
        annotation, metadata, node = _step(annotation, node, part, path)
        path = (*path, part)
    annotation, metadata = chosen_form(*messages.bare(annotation, metadata), node)
    if messages.is_model(annotation) or get_origin(annotation) is dict:
        raise NoField(f"{dotted(path)} is a section; name a value in it{_known(annotation, node)}")
    if path == EPOCH:
        return Target(path, SINCE_EPOCH, node)
    return Target(path, _spec(annotation, metadata), list(node) if isinstance(node, tuple) else node)


def put(tree, path, value):
    """Put a value into a tree; the sections and lists around it are there."""
    node = tree
    for part in path[:-1]:
        node = node[part]
    node[path[-1]] = value


def fill(model, tree, path):
    """Write defaults of sections and lists on the way to a path into the tree, where `put` wants them."""
    annotation, metadata, node = model, (), tree
    for depth, part in enumerate(path[:-1], 1):
        annotation, metadata = chosen_form(*messages.bare(annotation, metadata), node)
        annotation, metadata, inner = _step(annotation, node, part, path[: depth - 1])
        if isinstance(inner, tuple):
            inner = list(inner)
        node[part] = inner
        node = inner


def chosen_form(annotation, metadata, node):
    """The form of a section that its value chooses, itself if there is but one."""
    chooser = next((one for one in metadata if isinstance(one, Discriminator)), None)
    if chooser is None:
        return annotation, metadata
    tag = chooser.discriminator(node)
    return messages.bare(*messages.step(annotation, tag))


def _item(part, node, path):
    if not part.isdecimal() or int(part) >= len(node):
        raise NoField(f"{dotted(path)} is a list, its items are 0 to {len(node) - 1}, got '{part}'")
    return int(part)


def _check_key(model, annotation, part, path):
    """NoField unless a section knows the key."""
    if messages.is_model(annotation) and part not in annotation.keys():
        known = list(annotation.keys())
        hint = suggest.meant(model, known, (*path, part)).words or f"known there: {', '.join(known)}"
        raise NoField(f"there is no '{part}' in {dotted(path)}; {hint}")


def _step(annotation, node, part, path):
    """One step down: (annotation, metadata, value), the value being the default if none is given."""
    if messages.is_model(annotation):
        field = annotation.keys()[part]
        value = node.get(part, NOT_GIVEN) if isinstance(node, dict) else NOT_GIVEN
        if value is NOT_GIVEN:
            value = _default(field)
        if value is None:
            raise NoField(f"{dotted((*path, part))} is not given, so there is nothing that could differ")
        return field.annotation, tuple(field.metadata), value
    if get_origin(annotation) is dict:
        if part not in node:
            raise NoField(f"there is no '{part}' in {dotted(path)}{_known(annotation, node)}")
        return get_args(annotation)[1], (), node[part]
    if isinstance(part, int):
        arguments = get_args(annotation)
        is_tuple = get_origin(annotation) is tuple and len(arguments) > part
        return arguments[part if is_tuple else 0], (), node[part]
    raise NoField(f"{dotted(path)} is a single value, there is no '{part}' in it")


def _default(field):
    """Value of a field that is not given, as it would be written; None if it must be given."""
    if field.default_factory is not None:
        made = field.default_factory()
        return {} if messages.is_model(type(made)) else made
    return None if field.default is PydanticUndefined else field.default


def _known(annotation, node):
    names = list(annotation.keys() if messages.is_model(annotation) else node)
    return f"; known there: {', '.join(names)}" if names else ""


def _spec(annotation, metadata):
    """How the numbers at a place are read: QuantitySpec, NumberSpec or None; of a list that of its items."""
    annotation, metadata = messages.bare(annotation, metadata)
    found = next((one for one in metadata if isinstance(one, QuantitySpec | NumberSpec)), None)
    if found is None and get_origin(annotation) in (list, tuple):
        return _spec(get_args(annotation)[0], ())
    return found


def numbers(nominal):
    """All single values of a nominal value, be it a list or one itself: iterator."""
    if isinstance(nominal, list | tuple):
        for item in nominal:
            yield from numbers(item)
    else:
        yield nominal


def in_words(nominal):
    """A nominal value in words."""
    return "a list" if isinstance(nominal, list) else describe(nominal)
