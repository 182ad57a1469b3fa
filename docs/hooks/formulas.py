"""Formulas as MathML, made while the site is built: browsers draw it themselves, no script, no network."""

import html
import re

from latex2mathml import converter
from mkdocs.exceptions import PluginError

_FOUND = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\(?P<kind>[(\[])(?P<tex>.*?)\\[)\]]</(?P=tag)>', re.S
)


def mathml(tex, block=False):
    """MathML of a formula in LaTeX; ValueError if it has something that was not understood."""
    made = converter.convert(tex, display="block" if block else "inline")
    left = re.search(r"\\[a-zA-Z]+", made)
    if left:
        raise ValueError(f"cannot set {left[0]} in {tex!r}")
    return made


def on_page_content(content, page, **_):
    """The page with its formulas set."""

    def one(found):
        try:
            return mathml(html.unescape(found["tex"]).strip(), found["kind"] == "[")
        except ValueError as error:
            raise PluginError(f"{page.file.src_uri}: {error}") from None

    made = _FOUND.sub(one, content)
    if 'class="arithmatex"' in made:
        raise PluginError(f"{page.file.src_uri}: a formula was not recognised")
    return made
