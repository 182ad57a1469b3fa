"""Benchmarks keep up with the package: they answer --help, and what they call takes what they give it."""

import ast
import importlib
import inspect
import runpy
import sys
from pathlib import Path

import pytest

FILES = sorted((Path(__file__).parent.parent / "benchmarks").rglob("*.py"))
TEXTS = {path: path.read_text(encoding="utf-8") for path in FILES}
HELPFUL = [path for path, text in TEXTS.items() if "argparse" in text and "__main__" in text]
HELPFUL = [path for path in HELPFUL if "import calisto" not in TEXTS[path]]  # needs rocketpy
PAIRING = "from shefex_nav.report import pairing\n"


def imported(node, one):
    """What an import of the package brings; ImportError."""
    module = importlib.import_module(node.module)
    if not hasattr(module, one.name):
        importlib.import_module(f"{node.module}.{one.name}")
    return getattr(module, one.name)


def meant(node, names):
    """Object of a name, or of an attribute of a module or class (AttributeError); None: not known."""
    if isinstance(node, ast.Attribute):
        owner = meant(node.value, names)
        return getattr(owner, node.attr) if inspect.ismodule(owner) or inspect.isclass(owner) else None
    return names.get(node.id) if isinstance(node, ast.Name) else None


def bind(call, called):
    """TypeError if the arguments are not those of what is called; with * and ** some may be left out."""
    if inspect.isclass(called) and issubclass(called, BaseException):
        return
    signature = inspect.signature(called)
    given = [None for one in call.args if not isinstance(one, ast.Starred)]
    named = {one.arg: None for one in call.keywords if one.arg}
    is_all = len(given) + len(named) == len(call.args) + len(call.keywords)
    (signature.bind if is_all else signature.bind_partial)(*given, **named)


def complaints(text):
    """What a source imports, reads or calls of the package that is not there, or not so: list of words.

    A name that the source gives another meaning, too, such as an argument, is left alone.
    """
    nodes, names, said = list(ast.walk(ast.parse(text))), {}, []
    other = {node.arg for node in nodes if isinstance(node, ast.arg)}
    other |= {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "shefex_nav":
            for one in node.names:
                try:
                    name, thing = one.asname or one.name, imported(node, one)
                    other |= {name} if names.setdefault(name, thing) is not thing else set()
                except ImportError as error:
                    said.append(f"{node.lineno}: {error}")
    names = {name: thing for name, thing in names.items() if name not in other}
    for node in nodes:
        try:
            if isinstance(node, ast.Call) and (called := meant(node.func, names)) is not None:
                bind(node, called)
            elif isinstance(node, ast.Attribute):
                meant(node, names)
        except (AttributeError, TypeError) as error:
            said.append(f"{node.lineno}: {ast.unparse(node)}: {error}")
    return said


@pytest.mark.parametrize(
    "text, words",
    [
        ("from shefex_nav.prepare import nothing", "nothing"),
        (PAIRING + "pairing.nothing", "nothing"),
        (PAIRING + "pairing.same_times([0.0])", "t_b"),
        (PAIRING + "pairing.same_times(1, 2, t_c=3)", "t_c"),
        (PAIRING + "pairing.same_times(*a)\npairing.same_times(1, 2)", None),
        (PAIRING + "def f(pairing): pairing.nothing", None),
    ],
)
def test_complaints(text, words):
    assert [words in one for one in complaints(text)] == ([True] if words else [])


def test_calls_suit_what_they_call():
    found = {path.name: complaints(text) for path, text in TEXTS.items()}
    assert {name: said for name, said in found.items() if said} == {}


@pytest.mark.parametrize("path", HELPFUL, ids=lambda path: path.stem)
def test_help_is_answered(path, monkeypatch, capsys):
    """In this process; files beside a benchmark, or of tests that it uses, are read anew for each."""
    beside = {one.stem for one in FILES}
    kept = {name: sys.modules.pop(name) for name in beside & set(sys.modules)}
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.setattr(sys, "argv", [str(path), "--help"])
    try:
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(path), run_name="__main__")
    finally:
        for name in beside & set(sys.modules):
            del sys.modules[name]
        sys.modules.update(kept)
    assert not ended.value.code
    assert capsys.readouterr().out.startswith(f"usage: {path.name}")
