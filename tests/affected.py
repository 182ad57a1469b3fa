"""Which test files a change since a commit can reach: what `pytest --affected [BASE]` runs.

What a file reaches is read from its imports, those inside functions too, without importing anything: a line
of a compiled kernel, which no tracer of executed lines sees, counts like any other. The command line imports
late: there an import inside a function counts for tests only that have the function's name, the command, as a
text, and in conftest.py for those that take the fixture. Texts that hold code to be run are read, too. A test
that looks through folders for sources is reached by all of them. A changed file of another kind reaches the
sources that name it or its folder, and one that says which packages are installed reaches every test.
"""

import ast
import hashlib
import re
import shlex
import subprocess
import textwrap
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
READER = Path(__file__).read_bytes()  # what was read by another one is read again
PACKAGE, TESTS, FIXTURES = "shefex_nav", "tests", "conftest.py"
LATE = re.compile(rf"(^|/)conftest\.py$|^{PACKAGE}/commands/")
EVERYTHING = {"pyproject.toml", "uv.lock"}
STATEMENT = re.compile(r"(?:from|import) [^;\n]+")
MODULES = re.compile(rf"\b{PACKAGE}(?:\.\w+)+")


def read(text, late):
    """What a source says: {"": [modules, texts and arguments, names]}; functions apart if `late`."""
    body, told = ast.parse(text).body, {}
    own = [node for node in body if late and isinstance(node, ast.FunctionDef)]
    for part in (ast.Module([node for node in body if node not in own], []), *own):
        found = set(), set(), set()
        read_part(part, *found)
        told[getattr(part, "name", "")] = [sorted(one) for one in found]
    return told


def read_part(part, modules, words, names):
    """Add to the sets what a part of a source says."""
    for node in ast.walk(part):
        if isinstance(node, ast.Import):
            modules |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            modules |= {f"{node.module}.{one.name}" for one in node.names}
        elif isinstance(node, ast.Attribute):
            names.add(node.attr)
            modules |= {f"{PACKAGE}.{node.attr}"} if getattr(node.value, "id", "") == PACKAGE else set()
        elif isinstance(node, ast.Name):
            names.add(node.id)
        elif isinstance(node, ast.arg):
            words.add(node.arg)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            modules |= {*MODULES.findall(node.value), f"{node.value}.__main__"}  # python -m shefex_nav
            words |= set(node.value.split("/")) if len(node.value) < 100 else set()
            for code in code_in(node.value):
                read_part(code, modules, words, names)


def code_in(text):
    """Code that a text holds, if it imports anything: list of trees; of a template, its imports alone."""
    found = []
    for one in [textwrap.dedent(text), *STATEMENT.findall(text)] if "import " in text else []:
        try:
            found.append(ast.parse(one))
        except (SyntaxError, ValueError):  # it is no code
            continue
    return found


class Graph:
    """Sources of the project; `known` is what was read of them before, `kept` what is known now."""

    def __init__(self, root, changed, known):
        paths = {*(root / PACKAGE).rglob("*.py"), *(root / TESTS).rglob("*.py")}
        paths |= {root / name for name in changed if name.endswith(".py")}  # it may be gone
        self.told, self.modules, self.kept = {}, {}, {}
        for path in sorted(paths):
            name, data = path.relative_to(root).as_posix(), path.read_bytes() if path.exists() else b""
            key = f"{name} {hashlib.sha1(READER + data).hexdigest()}"
            self.told[name] = self.kept[key] = known.get(key) or read(data, LATE.search(name))
            module = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
            self.modules[module if module.startswith(PACKAGE) else path.stem] = name
        lazy = re.findall(r'"(\w+)": "([\w.]+)"', (root / PACKAGE / "__init__.py").read_text())
        self.public = {f"{PACKAGE}.{name}": f"{PACKAGE}.{module}" for name, module in lazy}

    @cache  # noqa: B019 - a graph lives as long as the process
    def executed(self, file, function):
        """What is executed with a part of a source: the modules that it imports, packages around them."""
        modules, _, names = self.told[file][function]
        found = {(file, one) for one in names if function and one in self.told[file]}
        for module in {*modules, *self.told[file][""][0]} if function else ():  # functions of other commands
            other, _, one = module.rpartition(".")
            if one in names and one in self.told.get(self.modules.get(other), ()):
                found.add((self.modules[other], one))
        for module in self.modules if "walk_packages" in names else modules:
            dotted = self.public.get(module, module) + "."
            around = (dotted[: dot.start()] for dot in re.finditer(r"\.", dotted))
            found |= {(self.modules[one], "") for one in around if one in self.modules}
        return found

    def reached(self, test):
        """Parts of sources, as (file, function), that a test file can execute: a set."""
        around = [f"{folder.as_posix()}/{FIXTURES}" for folder in Path(test).parents]
        todo = [(name, "") for name in (test, *around) if name in self.told]
        seen, late, asked = set(), set(), set()
        while todo:
            node = file, function = todo.pop()
            if node not in seen:
                seen.add(node)
                todo += self.executed(file, function)
                if file.startswith(TESTS) and (function or not file.endswith(FIXTURES)):
                    asked |= set(self.told[file][function][1])
                late |= {(file, one) for one in self.told[file] if one}
                todo += [one for one in late - seen if one[1] in asked]
        return seen


def select(root, changed, known):
    """Test files that changed files reach, and what to give as `known` the next time."""
    graph, chosen = Graph(root, changed, known), []
    sources = any(name.startswith(PACKAGE) and name.endswith(".py") for name in changed)
    others = {part for name in changed if name[-3:] != ".py" for part in name.split("/")} - {PACKAGE, TESTS}
    for test in (name for name in graph.told if Path(name).name.startswith("test_")):
        parts = graph.reached(test)
        said = (graph.told[file][function][1] for file, function in parts if not file.endswith(FIXTURES))
        looks_through = "rglob" in graph.told[test][""][2]
        if (
            any(file in changed for file, _ in parts)
            or any(not others.isdisjoint(words) for words in said)
            or (sources and looks_through)
            or not EVERYTHING.isdisjoint(changed)
        ):
            chosen.append(test)
    return chosen, graph.kept


def changes(root, base):
    """Files that differ from a commit, with those that git does not know yet: set of names."""
    differing = f"git diff --name-only --no-renames {shlex.quote(base)} --"
    command = f"{differing} && git ls-files --others --exclude-standard"
    done = subprocess.run(command, shell=True, cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        raise pytest.UsageError(f"--affected {base}: {done.stderr.strip()}")
    return set(done.stdout.splitlines())
