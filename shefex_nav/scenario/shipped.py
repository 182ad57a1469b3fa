"""The scenarios that come with the package, and which file a name means.

A name of a file that is there means that file. Otherwise a bare name (without a folder, with or without
`.yaml`) means the file `NAME.yaml` there, or else the scenario of that name that the package brings.
"""

import os
import re
from typing import NamedTuple

from shefex_nav.scenario.files import Unreadable
from shefex_nav.scenario.files import alike as name_alike

ENDING = ".yaml"
PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
COMMANDS = {"run": "", "replay": "replay"}  # which takes a scenario: folder of such scenarios
MOST = 3  # names that are alike
_SENTENCE = re.compile(r"(?<=[a-z0-9)])\.(?:\s|$)")  # its end; not that of an initial


class Shipped(NamedTuple):
    """A scenario of the package."""

    name: str
    file: str
    command: str  # run, replay
    description: str


def folder():
    """Where they are: inside an installed package, in a checkout beside it."""
    inside = os.path.join(PACKAGE, "scenarios")
    return inside if os.path.isdir(inside) else os.path.join(os.path.dirname(PACKAGE), "scenarios")


def files():
    """{name: path} of all of them, flights first."""
    found = {}
    for below in COMMANDS.values():
        place = os.path.join(folder(), below) if below else folder()
        names = sorted(os.listdir(place)) if os.path.isdir(place) else ()
        found |= {n.removesuffix(ENDING): os.path.join(place, n) for n in names if n.endswith(ENDING)}
    return found


def listed():
    """list of Shipped."""
    return [Shipped(name, path, _command(path), _description(path)) for name, path in files().items()]


def resolved(name, beside=""):
    """Path of the scenario file that `name` means in the folder `beside`, '' for the current one.

    Raises Unreadable where a bare name means none.
    """
    if (path := found(name, beside, files())) is not None:
        return path
    where = "" if beside else f" in {os.getcwd()}"
    stem = name.removesuffix(ENDING)
    raise Unreadable(f"there is no such file{where}{alike_file(beside, stem)}, and {unknown(stem)}")


def alike_file(beside, stem):
    """`; did you mean 'mine.yaml'?` of a scenario file with a name like it in the folder `beside`."""
    return name_alike(os.path.join(beside, stem + ENDING))


def found(name, beside, known):
    """Path of the file that `name` means in the folder `beside`; None where a bare name means none.

    known : {name: path} of those of the package
    """
    local = os.path.join(beside, name)
    if os.path.basename(name) != name or os.path.isfile(local):
        return local
    stem = name.removesuffix(ENDING)
    if os.path.isfile(os.path.join(beside, stem + ENDING)):
        return os.path.join(beside, stem + ENDING)
    if stem in known:
        return known[stem].removeprefix(os.getcwd() + os.sep)  # what messages name is short in a checkout
    return None if _is_missing(local) else local  # whoever reads it says what it is, or why it cannot be read


def _is_missing(path):
    try:
        os.stat(path)
    except FileNotFoundError:
        return True
    except (OSError, ValueError):  # not to be entered; a null character
        pass
    return False


def unknown(name):
    """Words about a name that none of them has."""
    known = list(files())
    if like := alike(name, known):
        more = f"did you mean {' or '.join(like)}? `shefex-nav scenarios` lists all"
    else:
        more = f"there are {', '.join(known)}" if known else "there are none"
    return f"no scenario '{name}' comes with the program (in {folder()}); {more}"


def alike(name, known):
    """Those of the names known that are like one that is not."""
    import difflib

    return difflib.get_close_matches(name.lower(), known, n=MOST)


def with_what_it_names(path):
    """Paths of a scenario of the package and of every file that it needs, the scenario first."""
    found, left = [], [path]
    while left:
        one = left.pop(0)
        if one not in found:
            found.append(one)
            left += _named(one) if one.endswith(ENDING) else ()
    return found


def _named(path):
    """Paths of files that the values of a scenario name, and of those in folders that they name."""
    from shefex_nav.scenario import document

    place = os.path.dirname(path)
    with open(path, encoding="utf-8") as stream:
        tree = document.parse(stream.read(), path).tree
    for value in _texts(tree):
        there = os.path.normpath(os.path.join(place, value))
        if os.path.isfile(there):
            yield there
        elif os.path.isdir(there) and there.startswith(place + os.sep):  # not the scenario's own, or above
            inside = (os.path.join(there, name) for name in sorted(os.listdir(there)))
            yield from (one for one in inside if os.path.isfile(one) and not one.endswith(".py"))


def _texts(node):
    """All texts of a tree that are values."""
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict | list):
        for one in node.values() if isinstance(node, dict) else node:
            yield from _texts(one)


def _command(path):
    place = os.path.basename(os.path.dirname(path))
    return next((command for command, below in COMMANDS.items() if below == place), "run")


def _description(path):
    """The first sentence of the comment at the beginning of a file."""
    words = []
    with open(path, encoding="utf-8") as stream:
        for line in stream:
            text = line.removeprefix("#").strip()
            if not line.startswith("#") or not text:
                break
            words.append(text)
    return _SENTENCE.split(" ".join(words), maxsplit=1)[0].rstrip(".:")
