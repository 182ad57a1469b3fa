"""The files of a plug-in or of software: the one that is named, and those beside it that it imports.

What lies beside a file is found by the import statements, without running anything. It is part of what
consent is asked for and of what a log names; and nobody else gets it in the place of his own of that name.
"""

import ast
import hashlib
import os
import sys
import sysconfig
from contextlib import contextmanager

from shefex_nav.errors import UserError
from shefex_nav.files import opened

INSTALLED = (
    *(sysconfig.get_path(kind) for kind in ("stdlib", "purelib", "platlib")),
    os.path.dirname(__file__),
)


class LateImportError(UserError):
    """What lies beside a file is imported when the file has been read already; the text says where."""


def digest(path, source):
    """SHA-256 of a file's source (bytes), and of what lies beside it and is imported."""
    found = hashlib.sha256(source)
    for name, text in beside(path, source).items():
        found.update(name.encode() + hashlib.sha256(text).digest())
    return found.hexdigest()


def beside(path, source):
    """{path relative to the folder: source} of what a file imports from its folder, in order of the names.

    LateImportError if an import stands in a function: it would look for the file when the flight goes on.
    """
    folder = os.path.dirname(os.path.abspath(path))
    found, waiting = {}, [(path, source)]
    while waiting:
        here, text = waiting.pop()
        for name in _imported(here, text, folder):
            for file in _files(folder, name):
                relative = os.path.relpath(file, folder)
                if relative not in found and os.path.abspath(file) != os.path.abspath(path):
                    with opened(file) as stream:
                        found[relative] = stream.read()
                    waiting.append((file, found[relative]))
    return dict(sorted(found.items()))


def _imported(path, source, folder):
    """First parts of the names of what a source imports."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return []  # told when it is run
    top = set(ast.walk(tree))
    for function in (one for one in ast.walk(tree) if isinstance(one, _FUNCTIONS)):
        for one in ast.walk(function):
            top.discard(one)
            for name in _names(one):
                if _files(folder, name):
                    words = f"imports '{name}', which lies beside it, in a function"
                    raise LateImportError(f"{path}:{one.lineno}: {words}; import it at the top of the file")
    return sorted({name for one in top for name in _names(one)})


_FUNCTIONS = ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda


def _names(node):
    """First parts of the names that an import statement has."""
    if isinstance(node, ast.Import):
        return [one.name.partition(".")[0] for one in node.names]
    if isinstance(node, ast.ImportFrom) and not node.level and node.module:
        return [node.module.partition(".")[0]]
    return []


def _files(folder, name):
    """Files in a folder that a module or package of that name has."""
    if os.path.isfile(module := os.path.join(folder, f"{name}.py")):
        return [module]
    package = os.path.join(folder, name)
    if not os.path.isdir(package) or package.startswith(INSTALLED):
        return []
    return [
        os.path.join(root, file)
        for root, _, files in sorted(os.walk(package))
        for file in sorted(files)
        if file.endswith(".py")
    ]


@contextmanager
def importing(path):
    """A file can import what lies beside it, and nobody after it gets that in the place of his own.

    No bytecode of it is kept: Python would take that for the file itself when the file is changed within a
    second, and consent is about the file.
    """
    folder, before = os.path.dirname(os.path.abspath(path)), set(sys.modules)
    sys.path.append(folder)  # what is installed comes first
    kept, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = kept
        sys.path.remove(folder)
        for name in set(sys.modules) - before:
            if _lies_in(sys.modules[name], folder):
                del sys.modules[name]


def _lies_in(module, folder):
    """Whether a module or a package is of a folder, and nothing that has been installed there."""
    places = [getattr(module, "__file__", None), *(getattr(module, "__path__", None) or ())]
    inside = (os.path.abspath(place).startswith(os.path.join(folder, "")) for place in places if place)
    return any(inside) and not any(place.startswith(INSTALLED) for place in places if place)
