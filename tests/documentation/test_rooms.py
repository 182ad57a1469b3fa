"""The docstring of a folder of the package names files that there are."""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "shefex_nav"
FOLDERS = sorted(path.parent for path in PACKAGE.rglob("__init__.py"))
LINE = re.compile(
    r"^ {0,2}((?:[a-z_0-9]+(?:\*|/)?, )*[a-z_0-9]+(?:\*|/)?)(?: {2,}\S|$)"
)  # "one, two   words"


def named(text):
    """Names of files and folders in the lists of a docstring."""
    for line in text.splitlines()[1:]:
        if found := LINE.match(line):
            yield from found[1].split(", ")


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: str(folder.relative_to(PACKAGE.parent)))
def test_what_a_folder_names_is_there(folder):
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    missing = [
        name
        for name in named(text)
        if not any(folder.glob(name.rstrip("/") if name.endswith("/") else f"{name}.py"))
    ]
    assert not missing


def test_lists_are_found():
    rooms = {folder.name: list(named(ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))))
             for folder in FOLDERS if folder.name in ("navigation", "camera")}  # fmt: skip
    assert "measure_*" in rooms["navigation"] and "shutter" in rooms["camera"]
