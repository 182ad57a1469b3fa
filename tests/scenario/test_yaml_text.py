"""Words and numbers of YAML 1.2, whichever parser of PyYAML reads them."""

from pathlib import Path

import pytest
import yaml

from shefex_nav.scenario import document, load, yaml_text

SHIPPED = sorted((Path(__file__).parents[2] / "scenarios").rglob("*.yaml"))
WORDS = {  # examples of the specification, 10.3.2, and what YAML 1.1 reads otherwise
    "1e-6": 1e-6,
    "1e3": 1e3,
    "12e03": 12e3,
    "-2E+05": -2e5,
    "0.": 0.0,
    "-0.0": -0.0,
    ".5": 0.5,
    "+12.3": 12.3,
    "-.inf": float("-inf"),
    "0": 0,
    "-19": -19,
    "0o7": 7,
    "0x3A": 58,
    "1_000": 1000,
    "true": True,
    "False": False,
    "on": "on",
    "off": "off",
    "yes": "yes",
    "n": "n",
    "12:30:00": "12:30:00",
    "2012-06-22": "2012-06-22",
    "1.2.3": "1.2.3",
    "e3": "e3",
    "=": "=",
    "'1'": "1",
    '"true"': "true",
}


def in_python():
    """The parser of a PyYAML that was built without the one in C."""
    rules = {"yaml_implicit_resolvers": yaml_text.Loader.yaml_implicit_resolvers}
    return type("InPython", (yaml.SafeLoader,), rules)


@pytest.fixture(params=["C", "Python"])
def parser(request, monkeypatch):
    if request.param == "C" and not yaml.__with_libyaml__:
        pytest.skip("this PyYAML was built without its parser in C")
    if request.param == "Python":
        monkeypatch.setattr(yaml_text, "Loader", in_python())
    document._compose.cache_clear()
    yield
    document._compose.cache_clear()


@pytest.mark.parametrize("word", WORDS)
def test_plain_words(parser, word):
    value = document.parse(f"key: {word}\n", "text").tree["key"]
    assert value == WORDS[word] and type(value) is type(WORDS[word])


def test_half_a_surrogate_pair(parser):
    """What Python makes of an argument that is not UTF-8; the parser in C cannot even be given it."""
    with pytest.raises(document.BadText) as refused:
        document.parse("a: 1\nb: \udcff\n", "text")
    mark, words = refused.value.args
    assert mark == ("text", 2, 4) and "unacceptable character #xdcff" in words
    with pytest.raises(load.ScenarioError, match=r"^--set mission.name: not valid YAML: unacceptable"):
        load.load("rexus_like", ["mission.name=\udcff"])


@pytest.mark.parametrize("tagged, value", [("!!float 5", 5.0), ("!!str 5", "5"), ("!!int 0x10", 16)])
def test_tags_that_fit(parser, tagged, value):
    found = document.parse(f"key: {tagged}\n", "text")
    assert not found.errors and repr(found.tree["key"]) == repr(value)


def test_both_parsers_see_the_same_in_every_shipped_file(monkeypatch):
    def read():
        document._compose.cache_clear()
        return [document.parse(path.read_text(encoding="utf-8"), path.name) for path in SHIPPED]

    assert len(SHIPPED) > 20
    in_c = read()
    monkeypatch.setattr(yaml_text, "Loader", in_python())
    assert read() == in_c


@pytest.mark.parametrize(
    "value", [1e-7, 1e22, -0.0, float("inf"), "on", "1e-6", "1", "null", "~", "a: b", "é", ""]
)
def test_what_is_written_is_read_again(value):
    tree = {"first": value, "list": [value, 1], "within": {"on": value}}
    read = document.parse(yaml_text.written(tree), "text").tree
    assert read == tree and repr(read) == repr(tree)


@pytest.mark.parametrize("opened", ["[", "{a: ", "? ", "- - "])
def test_no_nesting_ends_the_process(opened):
    """In C the composer calls itself for each level, until the stack is full."""
    with pytest.raises(document.BadText) as refused:
        document.parse("\n" + opened * 300_000, "text")
    mark, words = refused.value.args
    assert mark.line == 2 and "within each other" in words


def test_a_hundred_levels_are_read():
    value = document.parse("a: " + "[" * 99 + "]" * 99, "text").tree["a"]
    for _ in range(98):
        (value,) = value
    assert value == []


def test_words_are_resolved_as_by_the_rules():
    """The quick way of `Loader` against that of PyYAML itself, also of words in quotes."""
    words = (
        "1 -1 0x1f 1e-6 .5 .inf .nan ~ null true off 12:30:00 2012-06-22 a 1_0 0o7 + - = << x: 'y'".split()
    )
    for word in (*words, ""):
        resolver = yaml_text.yaml.resolver.BaseResolver()
        resolver.yaml_implicit_resolvers = yaml_text.Loader.yaml_implicit_resolvers
        for implicit in ((True, False), (False, True)):
            plain = resolver.resolve(yaml_text.yaml.ScalarNode, word, implicit)
            loader = yaml_text.Loader("")
            assert loader.resolve(yaml_text.yaml.ScalarNode, word, implicit) == plain, word


@pytest.mark.parametrize("text", ["[" * 120, "{a: " * 120, "- " * 120, "? " * 120, "a: [" + "[{b: " * 60])
def test_what_goes_too_deep_is_refused_in_words(text):
    with pytest.raises(yaml_text.yaml.YAMLError):
        yaml_text.compose(text)


def test_lists_in_lines_that_are_indented_less_and_less_far_go_too_deep():
    text = "\n".join(f"{' ' * k}a{k}:" for k in range(120))
    with pytest.raises(yaml_text.yaml.YAMLError, match="more than 100 lists and mappings"):
        yaml_text.compose(text)
