"""Software of a user's own in a scenario: the key `software` of navigation, star_tracker and computer.

    software: my_navigation.py:MyFilter      # a class in a file beside the scenario
    software: {python: my_navigation.py:MyFilter, settings: {gain: 0.2}}
    software: {command: ./my_fsw --fast}     # a program of its own, by standard input and output
    software: {connect: tcp://127.0.0.1:5005}  # one that is running

What a scenario names is run with the user's consent only (`plugins`); it stands in the scenario with its
content (SHA-256) once it has been read, so a log tells which one flew and another one is refused.
"""

import inspect
import os
import re
import shlex
from contextlib import suppress
from difflib import get_close_matches
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from shefex_nav import plugins
from shefex_nav.errors import UserError
from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.quantity import Quantity, quoted, refuse

BUILT_IN = "built_in"
COMPUTER, SOFTWARE = "computer", "software"
PATHS = tuple((section, SOFTWARE) for section in ("navigation", "star_tracker", COMPUTER))
PYTHON, COMMAND, CONNECT, HASH = "python", "command", "connect", "sha256"


class _Given(Block):
    settings: dict[str, Any] = Field(
        default_factory=dict, description="whatever it wants to be told: mission.settings"
    )


class Own(_Given):
    """A class of a user's own."""

    python: str = Field(
        min_length=1, description="class in a file, my_navigation.py:MyFilter, relative to this scenario; or "
        "in an installed package, package.module:Class"
    )  # fmt: skip
    sha256: str | None = Field(
        None, pattern=r"^[0-9a-f]{64}$", description="of the file; another content is refused"
    )


AnswerWithin = Quantity(
    "s", "60 s", "to the answer of a tick; later it has failed", positive=True, at_most="24 h"
)
StartWithin = Quantity("s", "120 s", "to `Ready`, for what it has to load", positive=True, at_most="24 h")


class Program(_Given):
    """A program that is started, and talks by standard input and output."""

    command: str = Field(min_length=1, description="with its arguments; a path is relative to this scenario")
    sha256: str | None = Field(
        None, pattern=r"^[0-9a-f]{64}$", description="of its files; another content is refused"
    )
    answer_within: AnswerWithin = "60 s"
    start_within: StartWithin = "120 s"


ADDRESS = re.compile(r"(tcp|udp)://[^:/]+:([0-9]{1,5})")
LARGEST_PORT = 65535


def _is_address(text):
    """Whether a text is an address that a program may listen at."""
    found = ADDRESS.fullmatch(text)
    return found is not None and 1 <= int(found[2]) <= LARGEST_PORT


def _address(text):
    if not _is_address(text):
        words = f"{quoted(text)} is no address; expected tcp://HOST:PORT or udp://HOST:PORT, PORT from 1 to"
        example = "such as tcp://127.0.0.1:5005; one on this machine needs no consent"
        raise refuse(f"{words} {LARGEST_PORT}, {example}")
    return text


class Reached(_Given):
    """A program that is running, and is talked to over the network."""

    connect: Annotated[str, AfterValidator(_address)] = Field(
        description="where it listens, tcp://127.0.0.1:5005 or udp://",
        json_schema_extra={"pattern": r"^(tcp|udp)://[^:/]+:\d+$"},
    )
    answer_within: AnswerWithin = "60 s"
    start_within: StartWithin = "120 s"


FORMS = {"own": Own, "program": Program, "reached": Reached}


def _form(value):
    for name, key in (("program", COMMAND), ("reached", CONNECT)):
        if isinstance(value, FORMS[name]) or (isinstance(value, dict) and key in value):
            return f"<{name}>"
    if isinstance(value, dict) and PYTHON not in value:  # a misspelt key
        meant = [one for key in value for one in get_close_matches(str(key), (COMMAND, CONNECT), 1)]
        return {COMMAND: "<program>", CONNECT: "<reached>"}[meant[0]] if meant else "<own>"
    if isinstance(value, dict | Own):
        return "<own>"
    return f"<{BUILT_IN}>" if value == BUILT_IN else "<name>"


Software = tagged(_form, {BUILT_IN: Literal[BUILT_IN], "name": str, **FORMS})


def _given(tree):
    """Software of a user's own in a tree. Yields path, section that has it, mapping of what is given."""
    for section, key in PATHS:
        block = tree.get(section)
        value = block.get(key) if isinstance(block, dict) else None
        if isinstance(value, str) and value and value != BUILT_IN:
            value = {PYTHON: value}
        if isinstance(value, dict) and isinstance(words := value.get(COMMAND), list):
            value = value | {COMMAND: shlex.join(map(str, words))}
        if isinstance(value, dict) and isinstance(_name(value), str):
            yield (section, key), block, value


def _name(given):
    """What is to fly, of a mapping."""
    return next((given[key] for key in (PYTHON, COMMAND, CONNECT) if key in given), None)


def relative_to(tree, folder):
    """Let the files of a scenario's own `tree` be looked for in `folder`."""
    for (_, key), block, given in _given(tree):
        if PYTHON in given:
            file, colon, attribute = given[PYTHON].rpartition(":")
            if colon and plugins.is_file(file) and not ADDRESS.fullmatch(given[PYTHON]):
                block[key] = given | {PYTHON: f"{os.path.join(folder, file)}:{attribute}"}
        elif COMMAND in given:
            with suppress(ValueError):  # a quote without its other half: `pin` says so
                beside = (_beside(word, folder) for word in shlex.split(given[COMMAND]))
                block[key] = given | {COMMAND: shlex.join(beside)}


def _beside(word, folder):
    """A word of a command, with the folder if it is a file there."""
    path = os.path.abspath(os.path.join(folder, word))
    return path if os.path.isfile(path) else word


def pin(tree, places, trust=False):
    """Look at the software of a tree; it stands there with its content then.

    What has its content already, as in a log, is looked at when it flies: a log may be read without running
    somebody's code. -> list of (Mark, text) of problems
    """
    found = []
    for path, block, given in _given(tree):
        if given.get(HASH) is not None:
            continue
        try:
            block[path[-1]] = given | _pinned(given, trust)
        except plugins.PluginError as error:
            found.append(places.wrong(path, error))
    return found


def _pinned(given, trust):
    """What is to fly, with its content; PluginError."""
    if len(keys := [key for key in (PYTHON, COMMAND, CONNECT) if key in given]) > 1:
        raise plugins.PluginError(f"names {' and '.join(keys)}; expected one of them")
    if PYTHON in given and ADDRESS.fullmatch(given[PYTHON]):
        raise plugins.PluginError(
            f"{quoted(given[PYTHON])} is an address; write {{connect: {given[PYTHON]}}}"
        )
    if PYTHON in given:
        plugin = _flyable(given[PYTHON], None, trust)
        return {PYTHON: plugin.path, HASH: plugin.sha256}
    if COMMAND in given:
        try:
            words = shlex.split(given[COMMAND])
        except ValueError as error:
            words = f"{given[COMMAND]} cannot be split into words: {error}; expected pairs of quotes"
            raise plugins.PluginError(words) from None
        words, sha256 = plugins.program(words, None, trust)
        return {COMMAND: shlex.join(words), HASH: sha256}
    if _is_address(given[CONNECT]):  # else the field says so: there is nothing to consent to
        plugins.address(given[CONNECT], trust)
    return {}


def _flyable(name, sha256, trust=False):
    """Plugin of a class that can fly; PluginError for another. Arguments as of `plugins.software`"""
    plugin, cls = plugins.software(name, sha256, trust)
    for method in ("start", "step"):
        if not callable(getattr(cls, method, None)):
            raise plugins.PluginError(f"'{name}' has no method {method}")
    try:
        inspect.signature(cls).bind()
    except TypeError as error:
        words = "is made without arguments; give its own a default, or read mission.settings in start"
        raise plugins.PluginError(f"'{name}' {words}: {error}") from None
    except ValueError:  # its signature is not known
        pass
    return plugin


def _owned(scenario):
    """(section, what flies in it) of the sections with software of a user's own."""
    for section, _ in PATHS:  # a replay has no star tracker and no computer
        if section in type(scenario).model_fields and (found := own(getattr(scenario, section))) is not None:
            yield section, found


def own(block):
    """What flies in a section `navigation`, `star_tracker` or `computer`; None: the built-in software."""
    return block.software if isinstance(block.software, tuple(FORMS.values())) else None


def contradictions(scenario):
    """A computer of one's own beside what it stands for: pairs of a field's path and text for people."""
    if own(scenario.computer) is None:
        return
    words = "a computer of your own stands for star tracker and navigation"
    for section in ("navigation", "star_tracker"):
        if own(getattr(scenario, section)) is not None:
            yield (section, SOFTWARE), f"{words}: leave this out, or computer.software"
    for k, fault in enumerate(scenario.faults.star_tracker):
        if fault.fault != "blinded":
            field = "faults", "star_tracker", k, "fault"
            yield field, f"{words}: between them nothing can be {fault.fault}; blinded goes with it"


def with_built_in(scenario):
    """The same Scenario with the built-in software."""
    told = {
        section: getattr(scenario, section).model_copy(update={SOFTWARE: BUILT_IN})
        for section, _ in _owned(scenario)
    }
    return scenario.with_sections(**told) if told else scenario


def name(own):
    """Of software of a user's own, for messages."""
    if isinstance(own, Own):
        return os.path.basename(own.python)
    if isinstance(own, Reached):
        return own.connect
    return " ".join(map(os.path.basename, shlex.split(own.command)))


def words_of(program):
    """Words of the command of a Program."""
    return shlex.split(program.command)


class NotBuiltIn(UserError):
    """Something is about the built-in software, and other software flies."""


def flying(scenario, section="navigation"):
    """The section whose own software does what `section` is about; None: the built-in one does."""
    found = [one for one, _ in _owned(scenario)]
    return next((one for one in (COMPUTER, section) if one in found), None)


def refuse_own(scenario, what, section="navigation"):
    """NotBuiltIn if a scenario flies software of a user's own. what : that is about the built-in one"""
    if (found := flying(scenario, section)) is not None:
        words = f"{what} is about the built-in software, not {name(own(getattr(scenario, found)))}"
        built_in = f"--set {found}.software={BUILT_IN} flies that"
        raise NotBuiltIn(scenario.line_about((found, SOFTWARE), f"{words}; {built_in}"))


def refuse_reached(scenario):
    """NotBuiltIn if a scenario flies a program that is running: it is one, and flights are many."""
    for section, found in _owned(scenario):
        if isinstance(found, Reached):
            words = f"{found.connect} is one program, which flies once; a campaign starts one for each run"
            raise NotBuiltIn(scenario.line_about((section, SOFTWARE), f"{words}: give its command"))


def changed(scenario):
    """Why software of a user's own would not fly: yields (section, PluginError).

    It has another content than the scenario says, it is not there, it cannot fly, or it has no consent.
    """
    for section, one in _owned(scenario):
        try:
            if isinstance(one, Own):
                _flyable(one.python, one.sha256)
            elif isinstance(one, Program):
                plugins.program(words_of(one), one.sha256)
        except plugins.PluginError as error:
            yield section, error


def refuse_changed(scenario):
    """The first PluginError of `changed`, with the section."""
    for section, error in changed(scenario):
        raise type(error)(f"{section}.{SOFTWARE}: {error}") from None


def flown(scenario):
    """Software of a user's own that a scenario flies: tuple of (section, name, SHA-256 or '')."""
    return tuple((section, name(one), getattr(one, HASH, None) or "") for section, one in _owned(scenario))
