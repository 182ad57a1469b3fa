"""What the package imports is declared: nothing comes by way of another package alone."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]
OLD_TYPER = {"click"}  # where typer does not carry its own, it requires this


def imported():
    """{name of a module of others: file that imports it}."""
    found = {}
    for path in sorted((ROOT / "shefex_nav").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [node.module]
            else:
                continue
            found |= {name.split(".")[0]: path for name in names}
    return {
        name: path for name, path in found.items() if name not in {*sys.stdlib_module_names, "shefex_nav"}
    }


def normalised(requirement):
    """Name of a distribution as indices compare them."""
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower()


def test_what_is_imported_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    declared = {normalised(one) for one in [*project["dependencies"], *extras["msis"], *extras["cluster"]]}
    found, known = imported(), packages_distributions()
    assert {"numpy", "erfa", "zstandard", "pydantic_core"} <= set(found)
    undeclared = {
        f"{name}, imported by {path.relative_to(ROOT)}"
        for name, path in found.items()
        if not declared & {normalised(one) for one in known.get(name, [name])} and name not in OLD_TYPER
    }
    assert not undeclared


def test_each_dependency_has_its_reason():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    reasons = (ROOT / "docs" / "decisions" / "0002-dependencies.md").read_text(encoding="utf-8")
    named = {
        normalised(one)
        for line in reasons.splitlines()
        if line.startswith("|")
        for one in re.findall(r"[\w.-]+", line.split("|")[1])
    }
    assert {normalised(one) for one in project["dependencies"]} <= named


def is_for_checkers(node):
    """Whether a statement is there for type checkers alone, and never runs."""
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


def own_imports():
    """{module of the package: modules of it that are imported anywhere in it}."""
    paths = {}
    for path in sorted((ROOT / "shefex_nav").rglob("*.py")):
        paths[".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")] = path
    found = {}
    for module, path in paths.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        tree.body = [node for node in tree.body if not is_for_checkers(node)]
        froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level == 0]
        named = [(node.module, f"{node.module}.{alias.name}") for node in froms for alias in node.names]
        found[module] = {inner if inner in paths else outer for outer, inner in named} & set(paths)
    return found


def circle(imports):
    """Modules that import each other in a circle, the first one at both ends; [] if there are none."""
    done = set()

    def below(module, way):
        if module in way:
            return [*way[way.index(module) :], module]
        if module not in done:
            for one in sorted(imports[module]):
                if found := below(one, [*way, module]):
                    return found
            done.add(module)
        return []

    return next((found for module in imports if (found := below(module, []))), [])


def test_no_modules_import_each_other_in_a_circle():
    """Not in functions either: what is put off there is a circle all the same."""
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert circle(own_imports()) == []
