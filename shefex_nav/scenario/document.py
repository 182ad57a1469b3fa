"""YAML text -> plain dict and list with the place of every key and value.

The tree is built here from the nodes of `yaml_text`, so that each value knows its file, line and column, and
all duplicate keys are found in one pass.
"""

import re
from functools import lru_cache
from typing import NamedTuple

from shefex_nav.scenario import decimal_comma, yaml_text
from shefex_nav.scenario.block import BAD_KEY, is_tag
from shefex_nav.scenario.quantity import quoted

MOST_REPEATED = 50_000  # values of a file that aliases repeat: they may make a short one endless
MERGE = "<<"
REMOVED = object()  # the value `null`, written out


class Mark(NamedTuple):
    """A place in a file; line and column count from 1, 0 where there are none (command line)."""

    file: str
    line: int
    column: int

    def __str__(self):
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


def placed(mark, text):
    """Line for the user; `--set a.b` and `--sweep a.b=value` need not name their field twice."""
    return re.sub(r"^(--(?:set|sweep) ([^\s=]+)(?:=.*?)?): \2: ", r"\1: ", f"{mark}: {text}")


class Document(NamedTuple):
    """A parsed file: plain tree, and the marks of keys and values by their path from the root."""

    tree: dict
    keys: dict  # path (tuple) -> Mark of the key, or of the list item
    values: dict  # path -> Mark of the value
    errors: list  # (Mark, text)
    removed: list  # paths of keys with the value `null`, which are not in the tree
    repeated: int = 0  # values that are in the tree because aliases repeat others

    def wrong(self, mark, path, words):
        """Note what is wrong at a place about what has a path."""
        self.errors.append((mark, f"{dotted(path)}: {words}"))


class BadText(Exception):
    """Text that is not YAML: (Mark, text)."""


def parse(text, file):
    """Document of the YAML `text`, which came from `file`; BadText if it is not YAML."""
    found = _parsed(text, file)
    return Document(
        _copied(found.tree),
        dict(found.keys),
        dict(found.values),
        list(found.errors),
        list(found.removed),
        found.repeated,
    )


def _copied(value):
    """A tree of dicts and lists in which nothing but single values is the same object."""
    if isinstance(value, dict):
        return {key: _copied(one) for key, one in value.items()}
    return [_copied(one) for one in value] if isinstance(value, list) else value


@lru_cache(maxsize=32)  # a study reads its scenario and its instruments for every flight
def _parsed(text, file):
    """As `parse`, of which all get the same object."""
    node = _compose(text, file)
    document = Document({}, {}, {}, [], [])
    if node is None:
        raise BadText(
            Mark(file, 1, 1), "the file is empty; a scenario is a mapping that starts with 'mission:'"
        )
    mark = _mark(node, file)
    if node.id != "mapping":
        kind = "list" if node.id == "sequence" else "single value"
        raise BadText(mark, f"the file holds a {kind}; expected a mapping that starts with 'mission:'")
    if node.tag != yaml_text.MAP:
        raise BadText(mark, _wrong_tag(node))
    document.keys[()] = document.values[()] = mark
    repeated = _repeated(node, file) if "*" in text else 0
    return document._replace(tree=_build(node, (), file, document, ()), repeated=repeated)


def parse_value(text, label):
    """Plain value of a `--set` text, placed at `label`; REMOVED for `null`."""
    node = _compose(text, label)
    document = Document({}, {}, {}, [], [])
    if _is_null(node):
        return REMOVED, []
    value = None if node is None else _build(node, (), label, document, ())
    return value, document.errors


@lru_cache(maxsize=128)  # values of settings, mostly
def _compose(text, file):
    """Root node of the YAML `text`, None if there is nothing in it."""
    from yaml import MarkedYAMLError, YAMLError

    try:
        return yaml_text.compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        if error.context == "while scanning a simple key":  # the problem is where its colon was looked for
            mark = error.context_mark
            said = text.splitlines()[mark.line].strip()
            raise BadText(Mark(file, mark.line + 1, mark.column + 1), _no_colon(said)) from None
        words = ", ".join(str(part) for part in (error.context, error.problem) if part)
        raise BadText(
            Mark(file, mark.line + 1, mark.column + 1), f"not valid YAML: {words}{_hint(words)}"
        ) from None
    except YAMLError as error:  # a character that YAML forbids
        words = str(error).splitlines()[0]
        position = getattr(error, "position", 0)
        before = text[:position]
        line, column = before.count("\n") + 1, position - (before.rfind("\n") + 1) + 1
        raise BadText(Mark(file, line, column), f"not valid YAML: {words}") from None


def _hint(words):
    """What to do about an error of the parser, as far as it does not say so itself."""
    if "'\\t'" in words:
        return "; indent with spaces, not tabs"
    if "incompatible YAML document" in words:
        return "; files of YAML 1.1 and 1.2 are read: leave the line with %YAML out"
    return ""


def _no_colon(line):
    """Words about a line that should be a key and its value."""
    shown = line if len(line) <= 40 else f"{line[:40]}..."
    return f"not valid YAML: '{shown}' has no colon; a key is followed by one, as in 'height: 300 m'"


def _mark(node, file):
    return Mark(file, node.start_mark.line + 1, node.start_mark.column + 1)


def _build(node, path, file, document, parents):
    """Plain value of `node`; its marks and errors go into `document`."""
    document.values[path] = _mark(node, file)
    if not yaml_text.fits(node):
        document.wrong(_mark(node, file), path, _wrong_tag(node))
        return None
    if node.id == "scalar":
        return _scalar(node, path, file, document)
    if any(node is parent for parent in parents):
        document.wrong(_mark(node, file), path, "an alias must not contain itself")
        return None
    parents = (*parents, node)
    if node.tag == yaml_text.SEQ:
        for index, item in enumerate(node.value):
            document.keys[(*path, index)] = _mark(item, file)
            if index and node.flow_style and (halves := decimal_comma.of_list(node, index)):
                words = decimal_comma.words(*halves, "values")
                document.wrong(_mark(node.value[index - 1], file), path, words)
        return [
            _build(item, (*path, index), file, document, parents) for index, item in enumerate(node.value)
        ]
    if node.tag == yaml_text.MAP:
        return _mapping(node, path, file, document, parents)
    document.wrong(_mark(node, file), path, _wrong_tag(node))
    return None


def _wrong_tag(node):
    """Words about a tag that has no meaning here, or that says of a node what it is not."""
    tag = node.tag.replace(yaml_text.OWN, "!!")
    if yaml_text.fits(node):
        return f"tag {tag} is not used in scenarios"
    kinds = {"sequence": "a list", "mapping": "a mapping"}
    return f"tag {tag} does not fit {kinds.get(node.id) or repr(node.value[:40])}"


def _repeated(root, file):
    """How many values aliases repeat; BadText where they are too many."""
    sizes = {}  # id of a node -> values in it, those of aliases each time

    def size(node):
        if id(node) not in sizes:
            sizes[id(node)] = 1  # of one that contains itself, which is an error of its own
            inside = node.value if isinstance(node.value, list) else ()
            parts = (part for one in inside for part in (one if isinstance(one, tuple) else (one,)))
            sizes[id(node)] = 1 + sum(map(size, parts))
        if sizes[id(node)] > MOST_REPEATED + len(sizes):
            raise BadText(_mark(node, file), f"aliases repeat more than {MOST_REPEATED} values")
        return sizes[id(node)]

    size(root)
    return sizes[id(root)] - len(sizes)


def _is_null(node):
    """Whether a node is `null` or `~`, written out; nothing after the colon is not."""
    return node is not None and node.tag == yaml_text.NULL and bool(node.value) and yaml_text.fits(node)


def _mapping(node, path, file, document, parents):
    tree, taken = {}, set()
    for k, (key_node, value_node) in enumerate(node.value):
        mark = _mark(key_node, file)
        if halves := decimal_comma.of_mapping(node, k):
            key, value = node.value[k - 1]
            words = decimal_comma.words(*halves, "keys")
            document.wrong(_mark(value, file), (*path, key.value), words)
            continue
        if words := no_key(key_node.value):
            document.wrong(mark, path, words)
            continue
        key_path = (*path, key_node.value)
        if key_node.value in taken:
            first = document.keys[key_path].line
            words = f"duplicate key, already given in line {first}; keep one of them"
            document.wrong(mark, key_path, words)
            continue
        document.keys[key_path] = mark
        taken.add(key_node.value)
        if _is_null(value_node):
            document.removed.append(key_path)
            continue
        tree[key_node.value] = _build(value_node, key_path, file, document, parents)
    return tree


def no_key(key):
    """Words about a key that is none, also about one in the spelling of what messages.plain leaves out."""
    if key == MERGE:
        return (
            f"the merge key {MERGE} of YAML 1.1 is not read; write the values out, repeat a whole value by "
            "an alias ('gps: *name'), or put what is common into a file that this one extends, 'extends: "
            "base.yaml'"
        )
    is_word = isinstance(key, str) and not is_tag(key) and key != BAD_KEY
    return "" if is_word else f"a key must be a word{f', got {quoted(key)}' if isinstance(key, str) else ''}"


def _scalar(node, path, file, document):
    text = node.value
    if node.tag == yaml_text.STR:
        return text
    if node.tag == yaml_text.NULL:
        if not text:  # nothing after the colon: its place is the key
            document.values[path] = document.keys.get(path, document.values[path])
        return None
    if node.tag == yaml_text.BOOL:
        return text.lower() == "true"
    if node.tag == yaml_text.INT:
        digits = text.replace("_", "")
        try:
            return int(digits, 0) if re.fullmatch(r"[+-]?0[xob].+", digits) else int(digits)
        except ValueError:  # thousands of digits
            return text
    if node.tag == yaml_text.FLOAT:
        return float(re.sub(r"\.(?=[in])", "", text.replace("_", "").lower()))
    document.wrong(_mark(node, file), path, _wrong_tag(node))
    return None


def dotted(path):
    """`('vehicle', 'stages', 0)` as `vehicle.stages.0`."""
    return ".".join(map(str, path)) or "scenario"
