"""The code blocks of a Markdown page, and what its comments say about running them.

A comment on a line of its own above a block, which readers do not see, is about that block:

    <!-- not run: needs a cluster -->             the reason is required
    <!-- short: --runs 300 => --runs 2 -->        other text is run in place of the printed one
    <!-- flight: 303 s -->                        flights of this block end here, not at END_S
    <!-- base: scenarios/night_sky.yaml -->       what a fragment of a scenario is added to

A block whose first line is a comment with a path (`# my_rocket/wind.csv`) is that file.
"""

import re
from typing import NamedTuple

END_S = 3.0  # flights are cut here: what is tested is that commands work as printed
BASE = "scenarios/shefex2_andoya.yaml"
_COMMENT = re.compile(r"<!-- (not run|short|flight|base): (.+?) -->")
_FENCE = re.compile(r"^( *)```(\w*)[^\n]*$")
_FILE = re.compile(r"[#;] ([\w./-]+\.\w+)$")
_PROGRAMS = ("uv ", "pip ", "mkdir ", "dask ", "kubectl ", "cp ", "shefex-nav ")


class Block(NamedTuple):
    """A code block."""

    line: int  # of its fence in the file, from 1
    kind: str  # sh, python, yaml, json, text, file
    text: str
    file: str  # path that it is the content of
    reason: str  # why it is not run
    end_s: float
    base: str


class BadPage(Exception):
    """A block that says nothing a reader, or this program, could go by."""


def blocks(text, name):
    """list of Block of a page. `name` is for messages."""
    found, lines, notes, k = [], text.splitlines(), [], 0
    while k < len(lines):
        fence = _FENCE.match(lines[k])
        if fence:
            indent, end = fence[1], k + 1
            while lines[end].strip() != "```":
                end += 1
            body = [line.removeprefix(indent) for line in lines[k + 1 : end]]
            found.append(_block(k + 1, fence[2], body, notes, f"{name}:{k + 1}"))
            notes, k = [], end
        elif lines[k].strip().startswith("<!--"):
            if _COMMENT.sub("", lines[k]).strip():
                raise BadPage(f"{name}:{k + 1}: a comment that means nothing: {lines[k]}")
            notes += _COMMENT.findall(lines[k])
        elif lines[k].strip() and notes:
            raise BadPage(f"{name}:{k}: this comment stands above no block")
        k += 1
    return found


def _block(line, language, body, notes, where):
    text = "\n".join(body) + "\n"
    told = {kind: words for kind, words in notes if kind != "short"}
    for kind, words in notes:
        if kind == "short":
            old, arrow, new = words.partition(" => ")
            if not arrow or old not in text:
                raise BadPage(f"{where}: there is no {old!r} to be replaced")
            text = text.replace(old, new)
    named = _FILE.match(body[0]) if body else None
    kind = "file" if named else _kind(language, body, where)
    return Block(
        line,
        kind,
        text,
        named[1] if named else "",
        told.get("not run", ""),
        float(told.get("flight", f"{END_S} s").removesuffix(" s")),
        told.get("base", BASE),
    )


def _kind(language, body, where):
    if language:
        known = {"sh": "sh", "bash": "sh", "python": "python", "yaml": "yaml", "json": "json", "text": "text"}
        if language not in known:
            raise BadPage(f"{where}: what to do with {language!r}?")
        return known[language]
    written = [line for line in body if line.strip()]
    return "sh" if any(line.startswith(_PROGRAMS) for line in written) else "text"
