"""Numbers with a decimal comma, which YAML takes for two values: `{mass: 56,0 kg}`, `[0,3 deg/s]`.

In: nodes of `yaml_text`. Only what can be nothing else is seen as one: a whole number without a unit, a
comma, digits and a unit; in a list the comma must have no space after it.
"""

import re

WHOLE = re.compile(r"[-+]?\d+")
REST = re.compile(r"\d+(?:\s*[A-Za-z%].*)?")
REST_WITH_UNIT = re.compile(r"\d+\s*[A-Za-z%].*")


def in_text(text):
    """`; write 56.0 kg: ...` if a text has a decimal comma, else nothing.

    `1,000 m` may be one metre or a thousand.
    """
    meant = re.sub(r"(?<=\d),(?=\d)", ".", text)
    if meant == text or text.count(",") > 1 or meant.count(".") > 1:
        return ""
    thousands = re.sub(r"(?<![\d.])([1-9]\d{0,2}),(?=\d{3}(?!\d))", r"\1", text)
    either = f"{meant} or, if thousands are meant, {thousands}" if thousands != text else meant
    return f"; write {either}: numbers have a point"


def of_mapping(node, k):
    """(text as written, text as meant) if item k of a mapping is what follows the comma of the one before."""
    key, value = node.value[k]
    if not (k and node.flow_style and value.value == "" and value.tag.endswith(":null")):
        return None
    before = node.value[k - 1][1]
    return _joined(before, key, REST)


def of_list(node, k):
    """The same of item k, from 1 on, of a list in brackets."""
    before, item = node.value[k - 1], node.value[k]
    if not isinstance(item.value, str) or item.start_mark.index != before.end_mark.index + 1:
        return None
    return _joined(before, item, REST_WITH_UNIT)


def _joined(before, after, rest):
    """Texts of two plain scalars that are one number."""
    if before.style or after.style or not isinstance(before.value, str) or not isinstance(after.value, str):
        return None
    if not rest.fullmatch(after.value) or not WHOLE.fullmatch(before.value):
        return None
    return f"{before.value},{after.value}", f"{before.value}.{after.value}"


def words(written, meant, between):
    """For people; between : what a comma is between."""
    return f"'{written}' has a comma, which stands between {between}; write {meant}"
