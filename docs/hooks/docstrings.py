"""Docstrings here say what a parameter is where others put its type; they are shown as they are."""

import re

_EMPTY = re.compile(r'\s*–\s*<div class="doc-md-description">\s*</div>')
_SAID = re.compile(r"\(<code>(.*?)</code>(, default:\s*<code>.*?</code>)?\s*\)(?=\s*</li>)", re.S)
_RETURNED = re.compile(r'(<li class="doc-section-item field-body">\s*)<code>(.*?)</code>(?=\s*</li>)', re.S)


def on_page_content(content, **_):
    """The page with words as words, not as code in brackets."""
    if "doc-section-item" not in content:
        return content
    content = _SAID.sub(lambda found: f": {found[1]}{found[2] or ''}", _EMPTY.sub("", content))
    return _RETURNED.sub(r"\1\2", content)
