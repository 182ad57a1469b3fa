"""Files of the user are opened by `files.opened` alone: a pipe would be waited for, a device never end."""

import ast
from pathlib import Path

import shefex_nav

PACKAGE = Path(shefex_nav.__file__).parent
READS = {"read_text", "read_bytes"}
OF_THE_PACKAGE = {  # what these read is the package's own, or of the operating system
    "campaign/flight.py", "commands/new.py", "commands/scenarios.py", "compiled/ahead.py",
    "compiled/algebra.py", "compiled/store.py", "compiled/target.py", "environment/atmosphere.py",
    "environment/gravity.py", "environment/magnetic_field.py", "environment/stars.py", "papers/impa/kept.py",
    "report/coast.py", "report/display/server.py", "report/html.py", "report/viewer/program.py",
    "scenario/instruments.py", "scenario/shipped.py", "solve/names.py", "verify/robustness/design.py",
}  # fmt: skip
BY_ITSELF = {  # what these read has been looked at before
    "files.py", "log/tail.py", "scenario/files.py", "solve/deep.py", "solve/picture.py",
}  # fmt: skip


def reads(path):
    """(line, call) of each call in a file that opens another one for reading."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        given = [*node.args, *(one.value for one in node.keywords)]
        modes = [one.value for one in given if isinstance(one, ast.Constant) and isinstance(one.value, str)]
        writes = any(set(mode) <= set("rwxabt+") and set(mode) & set("wxa+") for mode in modes)
        is_method = isinstance(node.func, ast.Attribute)
        opens = name == "open" and not writes and not (is_method and _of_a_library(node.func))
        if opens or (name in READS and is_method):
            yield node.lineno, ast.unparse(node)[:60]


def _of_a_library(function):
    return isinstance(function.value, ast.Name) and function.value.id in ("Image", "fits", "client", "os")


def test_files_of_the_user_are_opened_with_care():
    found = [
        f"{name}:{line}: {call}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if (name := path.relative_to(PACKAGE).as_posix()) not in OF_THE_PACKAGE | BY_ITSELF
        for line, call in reads(path)
    ]
    assert found == []
