"""Plug-ins: a file of somebody's own, or an installed package, that adds to the tables of the program.

    plugins: [my_altimeter.py]      # beside the scenario that says so
    plugins: [their-package]        # its entry point in the group `shefex_nav.plugins`

A plug-in says in `PROVIDES` what it adds: instruments (`instruments.instrument.Instrument`), blocks of
states of the filter (`onboard.navigation.blocks.OwnState`), ways to search frames, detect spots, find their
centres and identify stars (`Method`), fields of gravity, atmospheres and winds (`environment.models`). The
methods of the papers are added in the same way (BUNDLED). Nothing is replaced: a name that is taken is an
error. A scenario is a file that is passed around, so one that names a Python file runs it only with consent:
`--trust`, or `Scenario.load(..., trust=True)`, gives it for that file as it is, and it is kept for its
content (SHA-256). A package has been installed on purpose and needs none.
"""

import hashlib
import os
import shutil
import sys
import sysconfig
import traceback
import types
from contextlib import contextmanager, redirect_stdout
from functools import cache
from importlib import import_module, util
from typing import NamedTuple

from shefex_nav import instruments, plugin_checks, plugin_methods, plugin_sources
from shefex_nav.environment import models
from shefex_nav.errors import UserError
from shefex_nav.files import content_of
from shefex_nav.instruments.instrument import Instrument
from shefex_nav.onboard.navigation.blocks import OwnState
from shefex_nav.onboard.startracker import methods
from shefex_nav.onboard.startracker.methods import STEPS, Method

GROUP = "shefex_nav.plugins"
BUNDLED = "shefex2", "bright", "impa"  # papers whose methods come with the program
LOOPBACK = "127.0.0.1", "localhost"
CONSENT = "SHEFEX_NAV_TRUST"  # environment variable of consents given in this process, for those it starts

methods.WAITING += [f"shefex_nav.papers.{paper}.methods" for paper in BUNDLED]


class PluginError(UserError):
    """A plug-in that cannot be used; the message does not name the scenario."""


class NotTrusted(PluginError):
    """A file that nobody has given consent to."""


class Plugin(NamedTuple):
    """Where something comes from that the program did not bring along."""

    name: str  # of the file, or of the package
    version: str  # of a package; '' of a file
    sha256: str  # of the file, or of the source of the package's module
    path: str

    def __str__(self):
        version = f" {self.version}" if self.version else ""
        return f"{self.name}{version} (sha256 {self.sha256[:12]})"


_LOADED = {}  # Plugin -> tuple of what it provides; two places of one content may have other data beside them
_MODULES = {}  # Plugin -> module of software
_INSTALLED = (*(sysconfig.get_path(kind) for kind in ("purelib", "platlib")), os.path.dirname(__file__))
_EVERY = []  # not empty: within `trusting`


def is_file(name):
    """Whether a plug-in is named as a file."""
    return name.endswith(".py") or os.sep in name


def load(name, sha256=None, trust=False):
    """What a plug-in provides: Plugin, tuple of Instrument, OwnState, Method and models of the environment.

    name : path of a file, or name of an entry point
    sha256 : that it must have, with what it imports from its folder; None: any
    trust : whether consent is given for the file as it is now
    """
    path, version = (name, "") if is_file(name) else _installed(name)
    sources, found = _read(name, path, sha256)
    plugin = Plugin(os.path.basename(path) if is_file(name) else name, version, found, os.path.abspath(path))
    if plugin not in _LOADED:
        if is_file(name):
            _ask(name, path, found, trust)
            provided = _module(plugin, sources)
        else:
            provided = _entry(name).load()
        _LOADED[plugin] = tuple(_brought(one, plugin) for one in _provided(provided, name))
    activate(_LOADED[plugin])
    return plugin, _LOADED[plugin]


def software(name, sha256=None, trust=False):
    """Software that somebody wrote to fly on board: Plugin, class.

    name : 'file.py:Class', or 'package.module:Class' of an installed package; sha256, trust : as of `load`
    """
    where, _, attribute = name.rpartition(":")
    if not where or not attribute.isidentifier():
        raise PluginError(f"'{name}' names no class; write such as my_navigation.py:MyFilter")
    path = where if is_file(where) else _module_file(where)
    sources, found = _read(where, path, sha256)
    if is_file(where):
        plugin = Plugin(os.path.basename(path), "", found, os.path.abspath(path))
        if plugin not in _MODULES:
            _ask(where, path, found, trust)
            _MODULES[plugin] = _module(plugin, sources)
        module = _MODULES[plugin]
    else:
        module = import_module(where)
    made = getattr(module, attribute, None)
    if not callable(made):
        known = ", ".join(key for key, value in vars(module).items() if _is_own_class(value, module))
        raise PluginError(f"'{where}' has no class {attribute}; it has: {known or 'none'}")
    return Plugin(name, "", found, f"{os.path.abspath(path)}:{attribute}" if is_file(where) else name), made


def program(words, sha256=None, trust=False):
    """A program that somebody wrote to fly on board: words of its command with whole paths, SHA-256.

    words : of the command; sha256, trust : as of `load`. The SHA-256 is that of the words and of the files
    among them.
    """
    there = shutil.which(words[0])
    if there is None:
        raise PluginError(f"'{words[0]}' cannot be started: there is no such program, or it may not be run")
    words = [os.path.abspath(there), *words[1:]]
    total = hashlib.sha256(repr(words[1:]).encode())
    for word in words:
        if os.path.isfile(word):
            total.update(bytes.fromhex(_digest(word)))
    digest, name = total.hexdigest(), " ".join([os.path.basename(there), *words[1:]])
    if sha256 is not None and digest != sha256:
        raise PluginError(
            f"'{name}' is another program than the one that was flown: its SHA-256 is {digest[:12]}..., "
            f"that was {sha256[:12]}..."
        )
    _ask(name, words[0], digest, trust)
    return words, digest


def address(url, trust=False):
    """NotTrusted unless a program may be talked to at an address; on this machine it may."""
    host = url.partition("://")[2].rpartition(":")[0]
    if host in LOOPBACK:
        return
    try:
        _ask(url, url, hashlib.sha256(url.encode()).hexdigest(), trust)
    except NotTrusted:
        words = "is a program elsewhere, which would be told of the flight and steer it"
        raise NotTrusted(
            f"'{url}' {words}; if you know it, give --trust (kept for this address); one on this machine "
            f"({' or '.join(LOOPBACK)}) needs none"
        ) from None


def _is_own_class(value, module):
    return isinstance(value, type) and value.__module__ == module.__name__


def _module_file(name):
    """File of an installed module; PluginError for one that lies elsewhere, which needs consent as a file."""
    top = name.partition(".")[0]
    spec = util.find_spec(top)  # which runs nothing
    place = os.path.dirname(spec.origin) if spec is not None and spec.origin else ""
    if place and not place.startswith(_INSTALLED):
        raise PluginError(
            f"module '{top}' lies in {place}, it is not installed; name its file, which ends in .py"
        )
    try:
        spec = util.find_spec(name)
    except (ImportError, ValueError):
        spec = None
    if spec is None or spec.origin is None:
        raise PluginError(f"there is no module '{name}' installed; a file of your own ends in .py")
    return spec.origin


def _read(name, path, sha256):
    """Sources of a file, and their SHA-256, which must be `sha256` unless that is None."""
    try:
        sources = plugin_sources.read(path)
    except OSError as error:
        raise PluginError(
            f"'{name}' cannot be read: {error.strerror}; put it there, or name where it is"
        ) from None
    except plugin_sources.LateImportError as error:
        raise PluginError(str(error)) from None
    found = sources.sha256
    if sha256 is not None and found != sha256:
        raise PluginError(
            f"'{name}' is another file than the one that was flown: its SHA-256 is {found[:12]}..., "
            f"that was {sha256[:12]}..."
        )
    return sources, found


def _digest(path):
    """SHA-256 of a file, of one of Python with what it imports from its folder."""
    if path.endswith(plugin_sources.SOURCE):
        return _read(path, path, None)[1]
    return hashlib.sha256(content_of(path)).hexdigest()


def left_out(pins):
    """Why plug-ins of what has been flown cannot be loaded, a text each. pins : of (name, SHA-256)"""
    for name, sha256 in pins:
        try:
            load(name, sha256)
        except PluginError as error:
            yield str(error)


def _brought(one, plugin):
    """What a plug-in provides, as the program keeps it."""
    one = one._replace(plugin=plugin)
    watch = _WATCHED.get(type(one))
    return one if watch is None else watch(one)


def _ask(name, path, sha256, trust):
    """NotTrusted unless there is consent to run a file."""
    if trust or _EVERY:
        consent(sha256, path)
    if not is_trusted(sha256):
        raise NotTrusted(
            f"'{name}' is code that flying this scenario would run; read it, then give --trust "
            f"(kept for this file as it is, SHA-256 {sha256[:12]}...)"
        )


def _installed(name):
    """Path of the module of an installed plug-in, and the version of its package."""
    entry = _entry(name)
    spec = util.find_spec(entry.value.partition(":")[0])
    if spec is None or spec.origin is None:
        raise PluginError(f"plug-in '{name}': its module {entry.value} cannot be found; install it again")
    return spec.origin, entry.dist.version if entry.dist else ""


def _entry(name):
    """Entry point of a plug-in."""
    from importlib import metadata  # which takes a while

    found = list(metadata.entry_points(group=GROUP, name=name))
    if not found:
        known = sorted({one.name for one in metadata.entry_points(group=GROUP)})
        there = f"installed are: {', '.join(known)}" if known else "none is installed"
        raise PluginError(f"there is no plug-in '{name}'; {there}; a file of your own ends in .py")
    return found[0]


def _module(plugin, sources):
    """The module that the bytes of a file make, under a name of its own. They are what consent is about."""
    place = hashlib.sha256(os.fsencode(plugin.path)).hexdigest()
    name = f"shefex_nav_plugin_{plugin.sha256[:16]}_{place[:8]}"
    module = types.ModuleType(name)
    module.__file__ = plugin.path
    sys.modules[name] = module  # where its records are found again in other processes
    try:
        # standard output is for results
        with plugin_sources.importing(sources), redirect_stdout(sys.stderr):
            exec(compile(sources.text, plugin.path, "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        frames = [one for one in traceback.extract_tb(error.__traceback__) if one.filename == plugin.path]
        line = frames[-1].lineno if frames else getattr(error, "lineno", None)
        raise PluginError(f"{plugin.path}:{line or 1}: {type(error).__name__}: {error}") from error
    return module


def _provided(module, name):
    """What a module provides, checked."""
    provided = getattr(module, "PROVIDES", None)
    if not isinstance(provided, list | tuple) or not provided:
        raise PluginError(
            f"'{name}' provides nothing; end it with PROVIDES = [...], a list of what it brings"
        )
    for one in provided:
        if type(one) not in _PROBLEM:
            kinds = ", ".join(kind.__name__ for kind in _PROBLEM)
            raise PluginError(f"'{name}': {one!r} in PROVIDES is none of {kinds}")
        if problem := _PROBLEM[type(one)](one):
            raise PluginError(f"'{name}': '{one.name}': {problem}")
    return provided


def _problem_of_method(one):
    """What is wrong with a Method; '' if nothing is."""
    if one.step not in STEPS:
        return f"there is no step '{one.step}'; choose from: {', '.join(STEPS)}"
    if one.name in _built_in()[STEPS[one.step].path]:
        return f"there is a way of {one.step} of that name already, of the program"
    return "" if callable(one.function) else f"its function must be one, got {one.function!r}"


_PROBLEM = {
    Instrument: plugin_checks.problem,
    OwnState: plugin_checks.problem_of_state,
    Method: _problem_of_method,
    **dict.fromkeys(models.BUILT_IN, plugin_checks.problem_of_model),
}
_WATCHED = {
    Instrument: plugin_checks.checked,
    OwnState: plugin_checks.checked_state,
    Method: plugin_methods.checked,
    models.Gravity: plugin_checks.checked_gravity,
    models.Atmosphere: plugin_checks.checked_atmosphere,
    models.Wind: plugin_checks.checked_wind,
}


@cache
def _built_in():
    """Names at the keys of a scenario that come with the program: called before plug-ins add to them."""
    return {step.path: frozenset(methods.ways(step.path)) for step in STEPS.values()}


def activate(provided):
    """Put what plug-ins provide into the tables of this process, in the place of what others had there.

    Models of the environment are in no such table: a scenario has those of its own.
    """
    for one in provided:
        if isinstance(one, Method):
            methods.add(one)
        elif isinstance(one, OwnState):
            instruments.OWN_STATES[one.name] = one
        elif isinstance(one, Instrument):
            instruments.TABLE[one.name] = one


@contextmanager
def trusting():
    """Consent for every file that is loaded within: `--trust`."""
    _EVERY.append(True)
    try:
        yield
    finally:
        _EVERY.pop()


def consent_here(sha256):
    """Take the user's consent to run a file, for this process and those it starts."""
    if sha256 not in os.environ.get(CONSENT, "").split(","):
        os.environ[CONSENT] = ",".join(filter(None, (os.environ.get(CONSENT, ""), sha256)))


def consent(sha256, path):
    """Keep the user's consent to run a file, for this process and those it starts, and for later ones."""
    consent_here(sha256)
    kept = _kept_in()
    if sha256 in _kept():
        return
    try:
        os.makedirs(os.path.dirname(kept), exist_ok=True)
        with open(kept, "a", encoding="utf-8") as file:
            file.write(f"{sha256} {os.path.abspath(path)!a}\n")
    except OSError:  # it is asked for again next time
        pass


def is_trusted(sha256):
    """Whether the user has given consent to a file with this content."""
    if sha256 in os.environ.get(CONSENT, "").split(","):
        return True
    return sha256 in _kept()


def _kept():
    """SHA-256 of the files with a consent that was kept: set."""
    try:
        text = content_of(_kept_in()).decode("ascii", "replace")
    except OSError:
        return set()
    return {line.split(" ", 1)[0] for line in text.splitlines()}


def _kept_in():
    """File of the consents."""
    base = os.environ.get("XDG_CONFIG_HOME") or os.path.join(os.path.expanduser("~"), ".config")
    return os.path.join(base, "shefex_nav", "trusted")
