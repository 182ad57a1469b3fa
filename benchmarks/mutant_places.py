"""Where a Python source can be made wrong by one small change, and how."""

import ast
import re

ARITHMETIC = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "/"), ast.Mod: ("%", "*"), ast.Pow: ("**", "*"),
    ast.BitOr: ("|", "&"), ast.BitAnd: ("&", "|"),
}  # fmt: skip
COMPARISON = {
    ast.Lt: ("<", ">="), ast.LtE: ("<=", ">"), ast.Gt: (">", "<="), ast.GtE: (">=", "<"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"),
}  # fmt: skip
CALLED = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "all": "any", "any": "all"}


def of(text):
    """Mutants of a source.

    Returns
    -------
    list of (line, lines, begin, end, new, what): bytes begin to end are replaced by new; lines : first and
        last of the statement, of the whole file where it is run with the import alone
    """
    finder = _Finder(text)
    finder.visit(ast.parse(text))
    return sorted(set(finder.found))


def kernels(text):
    """Kernels of a source: what is compiled. -> list of (first line, last line, names that they use)"""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and any(map(_marks, node.decorator_list)):
            names = {getattr(one, "id", getattr(one, "attr", None)) for one in ast.walk(node)}
            found.append((node.lineno, node.end_lineno, names))
    return found


def _marks(decorator):
    """Whether a decorator is `kernel` or `inner` of `shefex_nav.compiled`, with options or without."""
    name = decorator.func if isinstance(decorator, ast.Call) else decorator
    return isinstance(name, ast.Name) and name.id in ("kernel", "inner")


def constant(text, line):
    """Name that a line outside functions gives to a constant, '' if it gives none."""
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign) and node.lineno <= line <= node.end_lineno:
            return getattr(node.targets[0], "id", "")
    return ""


class _Finder(ast.NodeVisitor):
    """Collects mutants. What is not run is left alone: annotations, docstrings, decorators."""

    def __init__(self, text):
        self.found, self._data, self._lines = [], text.encode(), None
        self._starts = [0]
        for line in text.encode().splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def visit(self, node):
        """Knows the lines of the statement in hand; of one with a body, those of its head."""
        before = self._lines
        if isinstance(node, ast.stmt) and before is not None:
            body = getattr(node, "body", None)
            self._lines = node.lineno, max(node.lineno, body[0].lineno - 1) if body else node.end_lineno
        elif isinstance(node, ast.Module):
            self._lines = None
        super().visit(node)
        self._lines = before

    def _begin(self, node):
        return self._starts[node.lineno - 1] + node.col_offset

    def _end(self, node):
        return self._starts[node.end_lineno - 1] + node.end_col_offset

    def _add(self, node, begin, end, new):
        old = self._data[begin:end].decode()
        shown = " ".join(old.split())
        lines = self._lines or (1, len(self._starts))
        self.found.append((node.lineno, lines, begin, end, new, f"{shown[:60]} -> {new[:60]}"))

    def _operator(self, node, left, right, old, new):
        begin, end = self._end(left), self._begin(right)
        gap = self._data[begin:end].decode()
        words = r"\s+".join(map(re.escape, old.split()))
        if place := re.search(words, re.sub(r"#[^\n]*", lambda m: " " * len(m[0]), gap)):
            self._add(node, begin + place.start(), begin + place.end(), new)

    def visit_BinOp(self, node):
        if type(node.op) in ARITHMETIC:
            self._operator(node, node.left, node.right, *ARITHMETIC[type(node.op)])
        self.generic_visit(node)

    def visit_Compare(self, node):
        for left, op, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            self._operator(node, left, right, *COMPARISON[type(op)])
        self.generic_visit(node)

    def visit_BoolOp(self, node):
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._operator(node, left, right, old, new)
        self.generic_visit(node)

    def visit_UnaryOp(self, node):
        if isinstance(node.op, (ast.USub, ast.Not)):
            sign = self._begin(node)
            self._add(node, sign, sign + (1 if isinstance(node.op, ast.USub) else 3), "")
        self.generic_visit(node)

    def visit_Constant(self, node):
        begin, end, value = self._begin(node), self._end(node), node.value
        if isinstance(value, bool):
            self._add(node, begin, end, str(not value))
        elif isinstance(value, (int, float)):
            text = self._data[begin:end].decode()
            self._add(node, begin, end, "1" if value == 0 else f"(2 * {text})")

    def visit_Call(self, node):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", None)
        if name in CALLED:
            end = self._end(node.func)
            self._add(node.func, end - len(name), end, CALLED[name])
        self.generic_visit(node)

    def visit_If(self, node):
        self._negated(node.test)
        self.generic_visit(node)

    def visit_IfExp(self, node):
        self._negated(node.test)
        self.generic_visit(node)

    def _negated(self, test):
        if isinstance(test, (ast.Name, ast.Attribute, ast.Call)):
            text = self._data[self._begin(test) : self._end(test)].decode()
            self._add(test, self._begin(test), self._end(test), f"(not {text})")

    def visit_AugAssign(self, node):
        if type(node.op) in ARITHMETIC:
            old, new = (f"{sign}=" for sign in ARITHMETIC[type(node.op)])
            self._operator(node, node.target, node.value, old, new)
        self._left_out(node)
        self.generic_visit(node)

    def visit_Expr(self, node):
        if isinstance(node.value, ast.Call):
            self._left_out(node)
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_Assign(self, node):
        target = node.targets[0]
        if isinstance(target, (ast.Subscript, ast.Attribute)):  # a name would be missing later
            self._left_out(node)
        self.generic_visit(node)

    def visit_AnnAssign(self, node):
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node):
        for default in [*node.args.defaults, *filter(None, node.args.kw_defaults)]:
            self.visit(default)
        before, self._lines = self._lines, (node.lineno, node.end_lineno)
        for statement in node.body:
            self.visit(statement)
        self._lines = before

    def _left_out(self, node):
        self._add(node, self._begin(node), self._end(node), "pass")
