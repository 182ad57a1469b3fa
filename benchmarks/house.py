"""How big the package is, room by room: lines that are code, nodes of its syntax trees, what is too long.

uv run python benchmarks/house.py [--json]

A line counts if something but a comment or a docstring stands on it. A room is a folder or a file of the
package. Named below: files over 400 lines, functions over 50, functions with more than eight parameters.
"""

import argparse
import ast
import io
import json
import tokenize
from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "shefex_nav"
FILE, FUNCTION, PARAMETERS = 400, 50, 8
BLANK = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
)
NAMED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def code_lines(text, tree):
    """Numbers of the lines with code: set."""
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in BLANK:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        if isinstance(node, NAMED) and ast.get_docstring(node, clean=False) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return lines


def measured():
    """Rooms: {name: Counter of files, lines, nodes}; what is too long: list of words."""
    rooms, long = {}, []
    for path in sorted(PACKAGE.rglob("*.py")):
        text, where = path.read_text(encoding="utf-8"), path.relative_to(PACKAGE.parent)
        tree = ast.parse(text)
        nodes = list(ast.walk(tree))
        size = {"files": 1, "lines": len(code_lines(text, tree)), "nodes": len(nodes)}
        rooms.setdefault(where.parts[1], Counter()).update(size)
        if len(text.splitlines()) > FILE:
            long.append(f"{where}: {len(text.splitlines())} lines")
        for node in nodes:
            if not isinstance(node, ast.FunctionDef):
                continue
            length = node.end_lineno - node.lineno + 1
            given = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            if length > FUNCTION:
                long.append(f"{where}: {node.name}, {length} lines")
            if len(given) > PARAMETERS:
                long.append(f"{where}: {node.name}, {len(given)} parameters")
    return rooms, long


def main():
    """Print the table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rooms, long = measured()
    total = sum(rooms.values(), Counter())
    if options.json:
        print(json.dumps({"rooms": rooms, "total": total, "too_long": long}, indent=1))
        return
    for name, size in [*rooms.items(), ("total", total)]:
        print(f"{name:16} {size['files']:4} files {size['lines']:6} lines {size['nodes']:7} nodes")
    print("\n".join(long))


if __name__ == "__main__":
    main()
