"""The documentation site: it builds without a warning, needs no network, and has every key and command."""

import ast
import importlib.util
import pkgutil
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import shefex_nav

ROOT = Path(__file__).parents[2]
LOADING = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src"}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("mkdocs", reason="the documentation tools are not installed: uv sync")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


def hook(name):
    """A module of docs/hooks."""
    pytest.importorskip("mkdocs", reason="the documentation tools are not installed: uv sync")
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "hooks" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Loads(HTMLParser):
    """What a page loads by itself."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        value = attributes.get(LOADING.get(tag, ""), "") or ""
        if value and not (tag == "link" and attributes.get("rel") in ("canonical", "prev", "next")):
            self.found.append(value)


def test_pages_load_nothing_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        parser = Loads()
        parser.feed(page.read_text())
        assert parser.found
        assert not [one for one in parser.found if re.match(r"(https?:)?//", one)], page
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\(['\"]?(https?:)?//", sheet.read_text()), sheet


def test_formulas_are_set(site):
    text = (site / "theory" / "filter.html").read_text()
    assert text.count("<math") > 10
    assert not re.search(r'class="arithmatex"|<math[^>]*>[^<]*\\', text)


def test_links_to_scenarios_are_in_the_site(site):
    assert 'href="scenarios/rexus_like.yaml"' in (site / "describe-your-rocket.html").read_text()
    assert (site / "scenarios" / "rexus_like.yaml").is_file()


def test_reference_of_python_has_every_public_name(site):
    """What `import shefex_nav` offers is on the page, by the module that it comes from."""
    text = (site / "reference" / "python.html").read_text()
    assert len(shefex_nav._PUBLIC) > 5
    missing = [
        name for name, module in shefex_nav._PUBLIC.items() if f'id="shefex_nav.{module}.{name}"' not in text
    ]
    assert not missing


def test_reference_of_replay_has_every_key():
    from shefex_nav.replay.schema import ReplayScenario
    from shefex_nav.scenario.json_schema import json_schema

    pages = hook("scenario_keys")
    text, blocks = pages.text(pages.REPLAY), json_schema(ReplayScenario)["$defs"]
    keys = {key for n, b in blocks.items() if not n.endswith(".partial") for key in b.get("properties", {})}
    assert len(keys) > 150
    assert {key for key in keys if f"| `{key}` |" not in text} == {"extends"}
    assert "| `gate_probability` | of rejecting a good measurement | number | `0.0001` | > 0, ≤ 0.1 |" in text
    headings = re.findall(r"^#+ .*$", text, re.M)
    assert len(headings) == len(set(headings)), "two sections of one name"


def test_reference_of_scenarios_has_every_key():
    """Every section of the JSON schema that editors use, with its keys and examples."""
    from shefex_nav.scenario.json_schema import json_schema

    pages = hook("scenario_keys")
    text = pages.text(pages.SCENARIO)
    blocks = {n: b for n, b in json_schema()["$defs"].items() if not n.endswith(".partial")}
    keys = {key for name, block in blocks.items() if name != "Unknown" for key in block.get("properties", {})}
    assert len(keys) > 200
    assert {key for key in keys if f"| `{key}` |" not in text} == {"extends"}
    assert "| `elevation` | of the rail | rad | *required* | ≥ 45 deg, ≤ 90 deg | `88 deg` |" in text
    assert "| `gravity_degree` | degree and order of egm96 | whole number | `12` | ≥ 2, ≤ 36 | `12` |" in text
    headings = re.findall(r"^#+ .*$", text, re.M)
    assert len(headings) == len(set(headings)), "two sections of one name"


def test_what_the_reference_of_python_names_is_there():
    """Functions and classes of modules, or modules with their members; every public name among them."""
    text = (ROOT / "docs" / "reference" / "python.md").read_text()
    named = re.findall(r"^::: ([\w.]+)$(?:\n    options:((?:\n      .+)+))?", text, re.M)
    public = {f"shefex_nav.{module}.{name}" for name, module in shefex_nav._PUBLIC.items()}
    assert public <= {place for place, _ in named}
    assert len(named) == text.count("\n:::") > 15
    for place, options in named:
        found = pkgutil.resolve_name(place)
        members = re.search(r"members: \[(.*)\]", options)
        for member in members[1].split(", ") if members and members[1] else ():
            assert hasattr(found, member), f"{place}.{member}"


def test_reference_of_commands_has_every_option(monkeypatch):
    from shefex_nav.commands.app import app

    monkeypatch.setenv("COLUMNS", "200")
    text = hook("commands").text()
    names = re.findall(r"^## (.+)$", text, re.M)
    assert {"run", "verify nesc", "campaign", "view"} <= set(names)
    for name in names:
        shown = set(re.findall(r"--[a-z][\w-]*", helped(app, name).split("Options")[-1]))
        part = text.split(f"\n## {name}\n")[1].split("\n## ")[0]
        assert {option for option in shown - {"--help"} if f"`{option}" not in part} <= {"--set"}, name


def helped(app, name):
    """What --help says of a command."""
    from typer.testing import CliRunner

    return CliRunner().invoke(app, [*name.split(), "--help"]).output


def test_a_formula_that_is_wrong_is_noticed():
    formulas = hook("formulas")
    assert "<mfrac>" in formulas.mathml(r"\frac{1}{2}")
    with pytest.raises(ValueError, match="nonsense"):
        formulas.mathml(r"\nonsense{1}")


def test_reference_of_messages_has_every_field():
    """Every message of the .proto file, with its fields."""
    from shefex_nav.software.messages import proto

    text = hook("messages").text()
    for name, body in re.findall(r"^message (\w+) \{\n(.*?)^\}", proto(), re.M | re.S):
        section = text.partition(f"\n### {name}\n")[2].partition("\n### ")[0]
        fields = re.findall(r"^  (?:optional |repeated )?\w+ (\w+) = \d+;", body, re.M)
        assert fields.pop(0) == "timestamp_ns" and section, name
        assert all(f"| `{one}` |" in section for one in fields), name
    assert "| `dv_b_m_s` | double (n, 3) | integrated specific force, body axes, likewise [m/s] |" in text


def test_fields_of_records_are_described_by_their_comments(site, tmp_path):
    page = (site / "reference" / "python.html").read_text()
    assert "covariance as the receiver reports it" in page and "why there is no fix; empty when valid" in page
    code = 'from typing import NamedTuple\n\n\nclass A(NamedTuple):\n    """Words."""\n\n'
    code += "    # of the two\n    # first\n    x: float  # m\n    y: int\n    z: float = 0.5\n"
    path = tmp_path / "a.py"
    path.write_text(code)
    fields = hook("fields")
    node = ast.parse(code).body[1]
    found = fields.described(node, fields.comments(path))
    assert found == {"x": "of the two first; m", "y": "int", "z": "default 0.5"}
