"""Pieces of an HTML page. Every text that is not written here is escaped here."""

import base64
import re
from html import escape
from importlib.resources import files
from typing import NamedTuple

_IN_KEY = re.compile(r"(?<=[a-zA-Z0-9_])\.(?=[a-zA-Z_])")


class Safe(NamedTuple):
    """HTML that has been made by this module."""

    html: str


def text(value):
    """A text as HTML; what is Safe already stays as it is. -> str"""
    return value.html if isinstance(value, Safe) else escape(str(value), quote=True)


def element(tag, *children, **attributes):
    """An element with children (texts or Safe); `class_` is the attribute class. -> Safe"""
    written = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(str(value), quote=True)}"'
        for name, value in attributes.items()
    )
    return Safe(f"<{tag}{written}>{''.join(text(child) for child in children)}</{tag}>")


def join(parts):
    """Parts (texts or Safe) one after the other."""
    return Safe("\n".join(text(part) for part in parts))


def breakable(value):
    """A text that may be broken after the dots of a key of a scenario, not after those of numbers. -> Safe"""
    return value if isinstance(value, Safe) else Safe(_IN_KEY.sub(".<wbr>", text(value)))


def table(caption, heads, rows, numbers=()):
    """A table; the first cell of a row is its head, `numbers` are the columns set to the right. -> Safe"""

    def cell(tag, k, value, **attributes):
        if k in numbers:
            attributes["class_"] = "number"
        return element(tag, breakable(value), **attributes)

    parts = [element("caption", caption)] if caption else []
    if heads:
        head = element("tr", *(cell("th", k, value, scope="col") for k, value in enumerate(heads)))
        parts.append(element("thead", head))
    lines = []
    for first, *others in rows:
        cells = [cell("td", k, value) for k, value in enumerate(others, start=1)]
        lines.append(element("tr", cell("th", 0, first, scope="row"), *cells))
    parts.append(element("tbody", *lines))
    return element("div", element("table", *parts), class_="scroll")


def picture(data, name, alt, caption, size_inches, kind="svg+xml"):
    """A figure (bytes) within the page, cut off from its styles and names. -> Safe

    size_inches : width, height; None: as large as the picture says
    """
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    size = ""
    if size_inches is not None:
        width, height = (round(96 * inches) for inches in size_inches)
        size = f' width="{width}" height="{height}"'
    image = Safe(f'<img src="{source}" alt="{escape(alt, quote=True)}"{size}>')
    return element("figure", image, element("figcaption", caption), id=f"figure-{name}")


def page(title, *, header, sections, footer):
    """A report: str.

    header : what stands above its table of contents;  sections : of name, heading, list of contents
    """
    links = [element("li", element("a", heading, href=f"#{name}")) for name, heading, _ in sections]
    contents = element("nav", element("ol", *links), aria_label="Contents")
    main = (
        element("section", element("h2", heading), join(content), id=name)
        for name, heading, content in sections
    )
    style = (files("shefex_nav") / "report" / "page.css").read_text()
    return document(title, style, header=join([*header, contents]), main=join(main), footer=footer)


def document(title, style, *, header, main, footer):
    """The whole page: str. `style` is trusted CSS; the policy forbids the page to load anything."""
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{text(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f"<header>{text(header)}</header>\n<main>\n{text(main)}\n</main>\n<footer>{text(footer)}</footer>\n"
        "</body>\n</html>\n"
    )
