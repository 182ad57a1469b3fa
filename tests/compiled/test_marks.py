"""Kernels are marked by who calls them: `kernel` by Python, `inner` by other kernels alone."""

import ast
import pickle
import re
from pathlib import Path

import numba
import numpy as np
import pytest

import shefex_nav
from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import rotation

PACKAGE = Path(shefex_nav.__file__).parent
MARKS = "kernel", "inner"


def mark_of(node):
    """'kernel' or 'inner', None for what is no kernel."""
    if not isinstance(node, ast.FunctionDef):
        return None
    names = (ast.unparse(one).split("(")[0] for one in node.decorator_list)
    return next((name for name in names if name in MARKS), None)


class File:
    """One file of the package: its kernels, and what the rest of it uses of others."""

    def __init__(self, path, module):
        self.module, tree = module, ast.parse(path.read_text(encoding="utf-8"))
        self.marks = {node.name: mark for node in tree.body if (mark := mark_of(node))}
        self.imported = {
            alias.asname or alias.name: (node.module, alias.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("shefex_nav")
            for alias in node.names
        }
        self.uses = {use for node in tree.body if not mark_of(node) for use in self.uses_in(node)}

    def uses_in(self, node):
        """(module, name) of what a part of the file names; imports alone are no use."""
        for part in ast.walk(node):
            if isinstance(part, ast.Name):
                yield self.imported.get(part.id, (self.module, part.id))
            elif isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name):
                yield ".".join(self.imported.get(part.value.id, ("", ""))), part.attr


def files():
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        yield File(path, ".".join(parts[:-1] if parts[-1] == "__init__" else parts))


@pytest.fixture(scope="module")
def package():
    return {file.module: file for file in files()}


def test_python_calls_no_inner_kernel(package):
    """Each would be compiled twice: alone, and within the kernels that call it."""
    used = set().union(*(file.uses for file in package.values()))
    wrong = [f"{module}: {name}" for module, name in used if package_mark(package, module, name) == "inner"]
    assert not wrong


def test_what_is_marked_kernel_is_called_by_python(package):
    """Or belongs to `geometry`, which people use from Python."""
    used = {resolved(package, *use) for file in package.values() for use in file.uses}
    used |= {resolved(package, *use) for use in documented()}
    alone = [
        f"{module}: {name}"
        for module, file in package.items()
        for name, mark in file.marks.items()
        if mark == "kernel" and (module, name) not in used and not module.startswith("shefex_nav.geometry")
    ]
    assert not alone


def documented():
    """(module, name) of what benchmarks and pages name."""
    root = PACKAGE.parent
    for path in (path for place in ("benchmarks", "docs", "notebooks") for path in (root / place).rglob("*")):
        if path.suffix == ".py":
            yield from File(path, path.stem).uses
        elif path.suffix in (".md", ".ipynb"):
            yield from re.findall(r"\b(\w+)\.(\w+)\(", path.read_text(encoding="utf-8"))


def package_mark(package, module, name):
    module, name = resolved(package, module, name)
    return package[module].marks.get(name) if module in package else None


def resolved(package, module, name):
    """Where a name that is passed on by another file, or written without its folders, is defined."""
    file = package.get(module)
    if file is None:
        short = [one for one in package if one.endswith(f".{module}") and name in package[one].marks]
        return (short[0], name) if short else (module, name)
    origin = file.imported.get(name, (module, name))
    if name in file.marks or origin == (module, name):
        return module, name
    return resolved(package, *origin)


def test_all_kernels_of_the_package_are_marked(package):
    """What numba's own decorators compile would be kept elsewhere, by other rules."""
    marks = [mark for file in package.values() for mark in file.marks.values()]
    assert marks.count("kernel") > 150 and marks.count("inner") > 300
    found = [
        path for path in PACKAGE.rglob("*.py") if re.search(r"\b(njit|import jit)\b", path.read_text("utf-8"))
    ]
    assert [path.relative_to(PACKAGE).as_posix() for path in found] == []


def test_an_inner_kernel_can_be_called_by_a_test():
    @inner
    def half(x):
        return 0.5 * x

    @kernel
    def quarter(x):
        return half(half(x))

    assert (half(3.0), quarter(3.0), half(3)) == (1.5, 0.75, 1.5)


def test_kernels_travel_to_other_processes_by_name():
    assert pickle.loads(pickle.dumps(rotation.quat_multiply)) is rotation.quat_multiply


def test_functions_that_others_compile_call_kernels():
    """Whether the inner kernel has been a part of a kernel before, or not."""

    @inner
    def third(x):
        return max(x, 0.0) / 3.0

    @inner
    def fifth(x):
        return max(x, 0.0) / 5.0

    @kernel
    def both(x):
        return third(x) + fifth(x)

    @numba.njit
    def mine(x):
        return third(x) + np.array([x, 2.0]).sum()

    @numba.njit
    def other(x):
        return fifth(x) + mine(x) + both(x)

    assert mine(3.0) == 6.0
    assert both(15.0) == 8.0
    assert other(15.0) == 3.0 + 22.0 + 8.0
    assert mine.py_func is not third.py_func and third(6.0) == 2.0


def test_errors_and_defaults_pass_through():
    @inner
    def root(x, least=0.0):
        if x < least:
            raise ValueError("negative")
        return x**0.5

    @kernel
    def twice(x):
        return 2.0 * root(x)

    assert twice(9.0) == 6.0
    with pytest.raises(ValueError, match="negative"):
        twice(-1.0)
    with pytest.raises(ValueError, match="negative"):
        root(1.0, 2.0)
