"""Software of a user's own in a scenario: `navigation.software` and `star_tracker.software`.

    software: my_navigation.py:MyFilter      # a class in a file beside the scenario
    software: {python: my_navigation.py:MyFilter, settings: {gain: 0.2}}
    software: their_package.navigation:Filter

A file is run with the user's consent only (`plugins`); it stands in the scenario with its content (SHA-256)
once it has been read, so a log tells which one flew and another one is refused.
"""

import os
from typing import Any, Literal

from pydantic import Field

from shefex_nav import plugins
from shefex_nav.errors import UserError
from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.document import dotted

BUILT_IN = "built_in"
PATHS = ("navigation", "software"), ("star_tracker", "software")
PYTHON, HASH = "python", "sha256"


class Own(Block):
    """Software of a user's own."""

    python: str = Field(
        min_length=1, description="class in a file, my_navigation.py:MyFilter, relative to this scenario; or "
        "in an installed package, package.module:Class"
    )  # fmt: skip
    sha256: str | None = Field(
        None, pattern=r"^[0-9a-f]{64}$", description="of the file; another content is refused"
    )
    settings: dict[str, Any] = Field(
        default_factory=dict, description="whatever it wants to be told: mission.settings"
    )


def _form(value):
    if isinstance(value, dict | Own):
        return "<own>"
    return f"<{BUILT_IN}>" if value == BUILT_IN else "<name>"


Software = tagged(_form, {BUILT_IN: Literal[BUILT_IN], "name": str, "own": Own})


def _given(tree):
    """Software of a user's own in a tree. Yields path, section that has it, name of its class."""
    for section, key in PATHS:
        block = tree.get(section)
        value = block.get(key) if isinstance(block, dict) else None
        name = value.get(PYTHON) if isinstance(value, dict) else value
        if isinstance(name, str) and name and name != BUILT_IN:
            yield (section, key), block, name


def relative_to(tree, folder):
    """Let the files of a scenario's own `tree` be looked for in `folder`."""
    for (_, key), block, name in _given(tree):
        file, colon, attribute = name.rpartition(":")
        if colon and plugins.is_file(file):
            _put(block, key, f"{os.path.join(folder, file)}:{attribute}")


def _put(block, key, name):
    if isinstance(block[key], dict):
        block[key][PYTHON] = name
    else:
        block[key] = name


def pin(tree, places, trust=False):
    """Load the software of a tree; it stands there with its content then.

    What has its content already, as in a log, is loaded when it flies: a log may be looked at without running
    somebody's code. -> list of (Mark, text) of problems
    """
    found = []
    for path, block, name in _given(tree):
        given = block[path[-1]] if isinstance(block[path[-1]], dict) else {}
        if given.get(HASH) is not None:
            continue
        try:
            plugin, _ = plugins.software(name, None, trust)
        except plugins.PluginError as error:
            found.append((places.value(path), f"{dotted(path)}: {error}"))
            continue
        block[path[-1]] = given | {PYTHON: plugin.path, HASH: plugin.sha256}
    return found


def own(block):
    """Own of a section `navigation` or `star_tracker`; None: the built-in software flies."""
    return block.software if isinstance(block.software, Own) else None


def made(own):
    """An object of its class, and its name for messages. Own -> object, str"""
    _, cls = plugins.software(own.python, own.sha256)
    return cls(), os.path.basename(own.python)


class NotBuiltIn(UserError):
    """Something is about the built-in software, and other software flies."""


def refuse_own(scenario, what, section="navigation"):
    """NotBuiltIn if a scenario flies software of a user's own. what : that is about the built-in one"""
    if (found := own(getattr(scenario, section))) is not None:
        words = f"{what} is about the built-in software, not {os.path.basename(found.python)}"
        built_in = f"--set {section}.software={BUILT_IN} flies that"
        raise NotBuiltIn(scenario.line_about((section, "software"), f"{words}; {built_in}"))


def flown(scenario):
    """Software of a user's own that a scenario flies: tuple of (section, name, SHA-256)."""
    found = ((section, own(getattr(scenario, section))) for section, _ in PATHS)
    return tuple((section, os.path.basename(one.python), one.sha256) for section, one in found if one)
