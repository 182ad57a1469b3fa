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
from importlib.abc import SourceLoader
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader, ModuleSpec
from importlib.util import spec_from_file_location
from typing import NamedTuple

from shefex_nav.errors import UserError
from shefex_nav.files import opened

SOURCE = ".py"
ENDINGS = (*EXTENSION_SUFFIXES, SOURCE)  # of modules, in the order in which Python looks for them
INSTALLED = (
    *(sysconfig.get_path(kind) for kind in ("stdlib", "purelib", "platlib")),
    os.path.dirname(__file__),
)


class LateImportError(UserError):
    """What lies beside a file is imported when the file has been read already; the text says where."""


class Sources(NamedTuple):
    """A file, and what it imports from its folder, as they were when they were read."""

    path: str  # of the file
    text: bytes
    beside: dict  # path relative to the folder -> content

    @property
    def sha256(self):
        """Of all of it: what consent is about."""
        found = hashlib.sha256(self.text)
        for name, text in self.beside.items():
            found.update(name.encode() + hashlib.sha256(text).digest())
        return found.hexdigest()


def read(path):
    """Sources of a file; OSError, LateImportError."""
    with opened(path) as file:
        text = file.read()
    return Sources(os.path.abspath(path), text, beside(path, text))


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
                    if file.endswith(SOURCE):
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
    """Files in a folder that a module or package of that name has, in the order in which Python looks."""
    package = os.path.join(folder, name)
    inside = () if package.startswith(INSTALLED) else _of_package(package)
    if any(os.path.join(package, f"__init__{ending}") in inside for ending in ENDINGS):
        return inside
    modules = (f"{package}{ending}" for ending in ENDINGS)
    return [one for one in modules if os.path.isfile(one)][:1] or inside


def _of_package(package):
    """Modules that a folder holds, in folders within it, too: list of paths."""
    return [
        os.path.join(root, file)
        for root, _, files in sorted(os.walk(package))
        for file in sorted(files)
        if file.endswith(ENDINGS)
    ]


class _Held(SourceLoader):
    """Loader of a module from the text that was read with the file; its bytecode is never looked for."""

    def __init__(self, path, text):
        self._path, self._text = path, text

    def get_filename(self, fullname):
        return self._path

    def get_data(self, path):
        if path != self._path:
            raise OSError(f"{path} was not read")
        return self._text


class _Finder:
    """Finds what lies beside a file, and nothing else: what was read with it. What is installed comes first.

    Python's own way takes bytecode, and a folder or a compiled file that was put there since, for the file
    that somebody has read.
    """

    def __init__(self, sources):
        self._folder, self._held = os.path.dirname(sources.path), sources.beside

    def find_spec(self, fullname, path=None, target=None):
        """Of a module that is imported; None for others."""
        top, *inner = fullname.split(".")
        if not any(one.partition(os.sep)[0].partition(".")[0] == top for one in self._held):
            return None
        if not inner and self._is_installed(top):
            return None
        if inner and not _lies_in(sys.modules[top], self._folder):
            return None
        place = os.path.join(*fullname.split("."))
        for ending in ENDINGS:
            if (package := os.path.join(place, f"__init__{ending}")) in self._held:
                return self._spec(fullname, package, [os.path.join(self._folder, place)])
        for ending in ENDINGS:
            if f"{place}{ending}" in self._held:
                return self._spec(fullname, f"{place}{ending}", None)
        if any(one.startswith(os.path.join(place, "")) for one in self._held):  # without an __init__
            spec = ModuleSpec(fullname, None, is_package=True)
            spec.submodule_search_locations = [os.path.join(self._folder, place)]
            return spec
        return None

    def _is_installed(self, name):
        """Whether Python finds a module of that name elsewhere."""
        finders = [one for one in sys.meta_path if not isinstance(one, _Finder)]
        specs = (one.find_spec(name, None) for one in finders if hasattr(one, "find_spec"))
        found = next((one for one in specs if one is not None), None)
        return found is not None and found.loader is not None and not _is_in(found.origin, self._folder)

    def _spec(self, fullname, relative, locations):
        path = os.path.join(self._folder, relative)
        loader = _Held(path, self._held[relative])
        if not relative.endswith(SOURCE):
            with opened(path) as file:
                if file.read() != self._held[relative]:
                    raise ImportError(f"{path} has changed since it was read", name=fullname)
            loader = ExtensionFileLoader(fullname, path)
        return spec_from_file_location(fullname, path, loader=loader, submodule_search_locations=locations)


@contextmanager
def importing(sources):
    """A file can import what lies beside it, and nobody after it gets that in the place of his own.

    What is imported is what consent is about: the texts that were read with the file. sources : Sources
    """
    finder, before = _Finder(sources), set(sys.modules)
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        for name in set(sys.modules) - before:
            if _lies_in(sys.modules[name], os.path.dirname(sources.path)):
                del sys.modules[name]


def _lies_in(module, folder):
    """Whether a module or a package is of a folder, and nothing that has been installed there."""
    places = [getattr(module, "__file__", None), *(getattr(module, "__path__", None) or ())]
    inside = (_is_in(place, folder) for place in places if place)
    return any(inside) and not any(place.startswith(INSTALLED) for place in places if place)


def _is_in(place, folder):
    return bool(place) and os.path.abspath(place).startswith(os.path.join(folder, ""))
