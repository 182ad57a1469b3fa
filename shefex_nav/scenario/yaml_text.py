"""YAML by PyYAML: text -> tree of nodes, each of which knows where it stands; and plain values -> text.

What is a word and what a number is decided by the core schema of YAML 1.2 (section 10.3.2), not by PyYAML's
own rules of YAML 1.1, in which `off` is no word, `1e-6` no number and `12:30:00` no text. Beyond it, whole
numbers may be binary, `0o` and `0x` may have a sign, and all numbers underscores. PyYAML scans the text by
YAML 1.1: U+0085, U+2028 and U+2029 end a line.
"""

import re
from contextlib import suppress
from functools import lru_cache

import yaml

OWN = "tag:yaml.org,2002:"  # of the tags of YAML itself, written !!
STR, INT, FLOAT, BOOL, NULL, SEQ, MAP = (
    f"{OWN}{name}" for name in ("str", "int", "float", "bool", "null", "seq", "map")
)
WHOLE = r"[-+]?(?:0b[01_]+|0o[0-7_]+|0x[0-9a-fA-F_]+|[0-9][0-9_]*)"
DIGITS = r"(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?"
KINDS = (  # of plain words: tag, pattern, how they begin; the first that fits holds
    (NULL, r"~|null|Null|NULL|", "~nN"),
    (BOOL, r"true|True|TRUE|false|False|FALSE", "tTfF"),
    (INT, WHOLE, "-+0123456789"),
    (FLOAT, rf"[-+]?(?:{DIGITS}|\.(?:inf|Inf|INF))|\.(?:nan|NaN|NAN)", "-+.0123456789"),
)
WORDS = {tag: re.compile(pattern) for tag, pattern, _ in KINDS} | {STR: re.compile(".*", re.DOTALL)}
HOLDERS = {SEQ: "sequence", MAP: "mapping"}  # tag -> kind of node
DEEPEST = 100  # lists and mappings within each other
FLAT = DEEPEST // 2  # fewer brackets, and fewer letters before what a line says, go less deep
INDENTED = re.compile(rf"[-?: \t]{{{FLAT}}}")


def _rules():
    """KINDS as PyYAML wants them: {first letter: [(tag, pattern)]}"""
    rules = {"": [(NULL, re.compile(r"\Z"))]}
    for tag, pattern, begins in KINDS:
        for letter in begins:
            rules.setdefault(letter, []).append((tag, re.compile(rf"(?:{pattern})\Z")))
    return rules


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
    """Reads words and numbers by KINDS, in C wherever PyYAML was built with it."""

    yaml_implicit_resolvers = _rules()

    def resolve(self, kind, value, implicit):
        """Tag of a node without one. implicit[0] : whether it is a plain word"""
        is_plain = kind is yaml.ScalarNode and implicit[0]
        return _tag(value) if is_plain else super().resolve(kind, value, implicit)


@lru_cache(4096)  # files of many values have the same ones many times
def _tag(word):
    """Tag of a plain word."""
    rules = Loader.yaml_implicit_resolvers.get(word[:1], ())
    return next((tag for tag, pattern in rules if pattern.match(word)), STR)


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):
    """Writes."""

    yaml_implicit_resolvers = Loader.yaml_implicit_resolvers

    def ignore_aliases(self, data):
        return True


_Dumper.add_representer(float, lambda dumper, value: dumper.represent_scalar(FLOAT, _number(value)))


def _number(value):
    """A number as Python writes it; PyYAML adds a point to 1e-07, which YAML 1.2 does not need."""
    return re.sub(r"^(-?)(inf|nan)", r"\1.\2", repr(value))


def compose(text):
    """Root node of a text, None if there is nothing in it; yaml.YAMLError if it is not YAML."""
    try:
        too_deep = _too_deep(text)
        root = None if too_deep else yaml.compose(text, Loader=Loader)
    except (yaml.YAMLError, UnicodeEncodeError):  # the latter in C, of half a surrogate pair
        with suppress(RecursionError):
            yaml.compose(text, Loader=yaml.SafeLoader)  # its messages say more than those in C
        raise
    if too_deep:
        words = f"more than {DEEPEST} lists and mappings within each other"
        raise yaml.MarkedYAMLError(problem=words, problem_mark=too_deep)
    return root


def fits(node):
    """Whether a node is what its tag says, True of tags that are not known here."""
    if node.tag in WORDS:
        return isinstance(node.value, str) and WORDS[node.tag].fullmatch(node.value) is not None
    return HOLDERS.get(node.tag, node.id) == node.id


def _too_deep(text):
    """Where a text goes deeper than DEEPEST, else None: the composer in C would need all of the stack."""
    if text.count("[") + text.count("{") < FLAT and not INDENTED.search(text):
        return None  # the events of a text of nothing but values take as long as all else
    depth = 0
    for event in yaml.parse(text, Loader=Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            return event.start_mark
    return None


def written(tree):
    """Text of a tree of plain values: lists and mappings of plain values in one line each."""
    return yaml.dump(
        tree, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=4096, allow_unicode=True
    )
