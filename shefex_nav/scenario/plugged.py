"""The key `plugins` of a scenario: what is loaded before the scenario is read, and from where."""

import os

from pydantic import Field
from pydantic_core import PydanticCustomError

from shefex_nav import plugins
from shefex_nav.environment import models
from shefex_nav.instruments.faults import kinds
from shefex_nav.instruments.instrument import Instrument
from shefex_nav.onboard.navigation.blocks import OwnState
from shefex_nav.onboard.startracker.methods import Method
from shefex_nav.scenario import document
from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.onboard import Navigation
from shefex_nav.scenario.quantity import QuantitySpec
from shefex_nav.settings import declared

KEY, FILE, HASH = "plugins", "file", "sha256"
PLUGINS = (
    "instruments, methods and models of your own: Python files, relative to this one, or names of installed "
    "plug-ins; a file is run with your consent only (--trust)"
)


class Pinned(Block):
    """A plug-in with the content that it had when it was flown, as logs keep it."""

    file: str = Field(min_length=1, description="path, or name of an installed plug-in")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$", description="of its source")


def _form(value):
    return "<pinned>" if isinstance(value, dict | Pinned) else "<name>"


Plugins = list[tagged(_form, {"name": str, "pinned": Pinned})]


def relative_to(tree, folder):
    """Let the files among the plug-ins of a scenario's own `tree` be looked for in `folder`."""
    given = tree.get(KEY)
    for k, one in enumerate(given if isinstance(given, list) else ()):
        if isinstance(one, str) and plugins.is_file(one):
            given[k] = os.path.join(folder, one)


def pinned(scenario):
    """(file or name of a package, SHA-256 of its source) of each plug-in of a scenario: tuple."""
    return tuple((one.file, one.sha256) for one in scenario.plugins)


def pinned_in(text, name):
    """The same of a text that a log or a campaign keeps."""
    given = document.parse(text, name).tree.get(KEY, [])
    return tuple((one[FILE], one[HASH]) for one in given)


def _names(one):
    """Names that something which a plug-in provides takes, each with what it is a name of: set of pairs."""
    if isinstance(one, Instrument | OwnState):
        return {("", name) for name in (one.name, *(block.name for block in getattr(one, "states", ())))}
    return {(one.step if isinstance(one, Method) else type(one).__name__, one.name)}


def _problem(one, taken):
    """What is wrong with something that a plug-in provides; '' if nothing is. taken : names of others"""
    if twice := sorted(_names(one) & taken):
        return f"there is a '{twice[0][1]}' already, of a plug-in of this scenario"
    if isinstance(one, OwnState) and one.name in Navigation.model_fields:
        return f"navigation.{one.name} is a setting of the program; give the block of states another name"
    for cls in _settings_of(one):
        for key, (_, setting) in declared(cls).items() if cls is not None else ():
            try:
                if setting.kind == "quantity":
                    spec = QuantitySpec(setting.unit, setting.example, **dict(setting.limits))
                    given = setting.default if isinstance(setting.default, str) else setting.example
                    spec.read(setting.example)
                    spec.read(given)
            except (PydanticCustomError, TypeError, ValueError) as error:
                words = f"its example or default: {error}{_without_unit(setting)}"
                return f"setting {key} of {cls.__name__}: {words}"
    return ""


def _without_unit(setting):
    """What else a setting may be that has neither unit nor percentage."""
    return "" if setting.unit else "; number() is for what has no unit, such as a factor"


def _settings_of(one):
    """Classes of settings of something that a plug-in provides."""
    if isinstance(one, OwnState | models.Atmosphere | models.Wind):
        return (one.settings,)
    if not isinstance(one, Instrument):
        return ()
    return (one.settings, one.use, *(kind.settings for kind in kinds(one)))


def loaded(tree, places, trust=False):
    """What the plug-ins of a tree provide; each stands in the tree with its content then.

    -> tuple of what it is, list of (Mark, text) about plug-ins that cannot be used
    """
    provided, found, given = [], [], tree.get(KEY)
    for k, one in enumerate(given if isinstance(given, list) else ()):
        name, pinned = (one.get(FILE), one.get(HASH)) if isinstance(one, dict) else (one, None)
        if not isinstance(name, str) or not name:
            continue  # the schema says what is wrong
        try:
            plugin, more = plugins.load(name, pinned, trust)
        except plugins.PluginError as error:
            found.append(places.wrong((KEY, k), error))
            continue
        taken = {name for other in provided for name in _names(other)}
        problem = ""
        for each in more:
            problem = problem or _problem(each, taken)
            taken |= _names(each)
        if problem:
            found.append(places.wrong((KEY, k), f"'{name}': {problem}"))
            continue
        provided += more
        path = plugin.path if plugins.is_file(name) else name
        given[k] = {FILE: path, HASH: plugin.sha256}
    return tuple(provided), found
