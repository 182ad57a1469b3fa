"""An instrument that takes the place of another by `--set imu.use=NAME` or `--sweep imu=A,B`.

What a scenario puts on top of its own instrument, such as the range that this very unit was bought with, says
nothing about another one: that comes as its file has it, and what is gone is told. An instrument that the
scenario uses already stays as it is there.
"""

import os
from typing import NamedTuple

from shefex_nav.scenario import instruments, layers, shipped
from shefex_nav.scenario.document import dotted
from shefex_nav.scenario.files import Unreadable
from shefex_nav.scenario.use import USE

MOST = 4  # values that are listed


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
    more = f" and {len(gone) - MOST} more" if len(gone) > MOST else ""
    listed = ", ".join(named[:MOST]) + more
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
