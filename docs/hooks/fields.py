"""Fields of named tuples, with what annotation and comment say of each, as a list below the class."""

import ast
import io
import tokenize
from pathlib import Path

import griffe


class FieldComments(griffe.Extension):
    """Adds a section of attributes to the docstring of each NamedTuple."""

    def on_class_instance(self, *, node, cls, **_):
        """Called with the syntax tree of a class and what griffe makes of it."""
        if not isinstance(node, ast.ClassDef) or "NamedTuple" not in map(ast.unparse, node.bases):
            return
        fields = described(node, comments(Path(cls.filepath)))
        text = cls.docstring.value.rstrip() if cls.docstring else ""
        lines = [f"{name} : {words}" for name, words in fields.items()]
        cls.docstring = griffe.Docstring(
            "\n".join([text, "", "Attributes", "----------", *lines]), parent=cls, lineno=node.lineno
        )


def comments(path):
    """{line: text of the comment on it} of a file."""
    tokens = tokenize.generate_tokens(io.StringIO(path.read_text()).readline)
    return {one.start[0]: one.string.lstrip("# ") for one in tokens if one.type == tokenize.COMMENT}


def described(node, known):
    """{field: annotation, comments and default of it}, a comment behind it or on the lines before it."""
    found, before = {}, node.lineno
    for one in node.body:
        if isinstance(one, ast.AnnAssign):
            above = " ".join(known[k] for k in range(before + 1, one.lineno) if k in known)
            behind = [known[k] for k in range(one.lineno, one.end_lineno + 1) if k in known]
            default = [] if one.value is None else [f"default {ast.unparse(one.value)}"]
            words = "; ".join(filter(None, [annotated(one.annotation), above, *behind, *default]))
            found[one.target.id] = words or ast.unparse(one.annotation)
        before = one.end_lineno
    return found


def annotated(annotation):
    """What an annotation of `shefex_nav.fields` says: of `vector("m", "place")` it is 'place [m]'."""
    if not isinstance(annotation, ast.Call):
        return ""
    texts = [one.value for one in annotation.args if isinstance(getattr(one, "value", None), str)]
    unit = f"[{texts[0]}]" if len(texts) > 1 and texts[0] else ""
    return f"{texts[-1]} {unit}".strip() if texts else ""
