"""Consent is about the texts that are run: what lies beside a file is imported from what was read with it."""

import importlib.machinery
import py_compile
import sys

import pytest

from shefex_nav import plugin_sources, plugins

NAME = "beside_for_this_test"
EVIL = "VALUE = 'evil'\n"


@pytest.fixture
def own(tmp_path):
    """A file of own software that takes a value from beside itself."""
    (tmp_path / f"{NAME}.py").write_text("VALUE = 'read'\n")
    path = tmp_path / "own.py"
    path.write_text(f"from {NAME} import VALUE\n\n\nclass Own:\n    value = VALUE\n")
    return path


def value(path, trust=False):
    """What own software has from beside; NotTrusted if consent is wanted."""
    plugins._MODULES.clear()  # as in a new process
    return plugins.software(f"{path}:Own", trust=trust)[1].value


def test_bytecode_is_not_taken_for_the_text(own, tmp_path):
    assert value(own, trust=True) == "read"
    evil = tmp_path / "evil.txt"
    evil.write_text(EVIL)
    kept = importlib.util.cache_from_source(str(tmp_path / f"{NAME}.py"))
    mode = py_compile.PycInvalidationMode.UNCHECKED_HASH
    py_compile.compile(str(evil), cfile=kept, dfile=f"{NAME}.py", invalidation_mode=mode)
    assert value(own) == "read"


@pytest.mark.parametrize(
    "other", [f"{NAME}/__init__.py", NAME + importlib.machinery.EXTENSION_SUFFIXES[0], f"{NAME}/part.py"]
)
def test_what_python_would_import_instead_is_asked_for_or_left_out(own, tmp_path, other):
    assert value(own, trust=True) == "read"
    path = tmp_path / other
    path.parent.mkdir(exist_ok=True)
    path.write_text(EVIL)
    if other.endswith("part.py"):  # a folder without an __init__ comes last
        assert value(own) == "read"
    else:
        with pytest.raises(plugins.NotTrusted):
            value(own)


def test_what_appears_between_reading_and_running_is_not_run(own, tmp_path):
    sources = plugin_sources.read(own)
    (tmp_path / NAME).mkdir()
    (tmp_path / NAME / "__init__.py").write_text(EVIL)
    (tmp_path / f"{NAME}.py").write_text(EVIL)
    space = {}
    with plugin_sources.importing(sources):
        exec(sources.text, space)
    assert space["VALUE"] == "read" and NAME not in sys.modules


@pytest.mark.parametrize("initial", [True, False])
def test_packages_beside_a_file_import_their_own(tmp_path, initial):
    package = tmp_path / NAME
    (package / "inner").mkdir(parents=True)
    if initial:
        (package / "__init__.py").write_text("")
        (package / "inner" / "__init__.py").write_text("from .deep import VALUE\n")
    (package / "inner" / "deep.py").write_text("from ..data import VALUE\n")
    (package / "data.py").write_text("from pathlib import Path\nVALUE = Path(__file__).parent.name\n")
    path = tmp_path / "own.py"
    path.write_text(f"from {NAME}.inner.deep import VALUE\n\n\nclass Own:\n    value = VALUE\n")
    assert value(path, trust=True) == NAME
    assert not list(tmp_path.rglob("__pycache__"))


def test_what_is_installed_comes_first(tmp_path):
    (tmp_path / "numpy.py").write_text("VALUE = 1\n")
    path = tmp_path / "own.py"
    path.write_text("import numpy\n\n\nclass Own:\n    value = numpy.pi\n")
    assert value(path, trust=True) == pytest.approx(3.14159, abs=1e-4)
