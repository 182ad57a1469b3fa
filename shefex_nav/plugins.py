"""Plug-ins: a file of somebody's own, or an installed package, that adds to the tables of the program.

    plugins: [my_altimeter.py]      # beside the scenario that says so
    plugins: [their-package]        # its entry point in the group `shefex_nav.plugins`

A plug-in says in `PROVIDES` what it adds: instruments (`instruments.instrument.Instrument`), and ways to
detect spots, find their centres and identify stars (`Method`). Nothing is replaced: a name that is taken is
an error. A scenario is a file that is passed around, so one that names a Python file runs it only with
consent: `--trust`, or `Scenario.load(..., trust=True)`, gives it for that file as it is, and it is kept for
its content (SHA-256). A package has been installed on purpose and needs none.
"""

import hashlib
import os
import sys
import traceback
from contextlib import contextmanager
from importlib import import_module, util
from typing import Any, NamedTuple

from shefex_nav import instruments
from shefex_nav.errors import UserError
from shefex_nav.instruments.instrument import Instrument
from shefex_nav.settings import Settings, declared

GROUP = "shefex_nav.plugins"
CONSENT = "SHEFEX_NAV_TRUST"  # environment variable of consents given in this process, for those it starts
TIMES = ("t_valid_s", "t_available_s")


class PluginError(UserError):
    """A plug-in that cannot be used; the message does not name the scenario."""


class NotTrusted(PluginError):
    """A file that nobody has given consent to."""


class Method(NamedTuple):
    """A way to do one step of the star tracker chain, chosen by its name in the scenario."""

    step: str  # of STEPS
    name: str
    function: Any  # with the signature of those beside it
    plugin: Any = None  # Plugin that brought it


STEPS = {  # step -> where in a scenario it is chosen, module and table of those that come with the program
    "identification": (
        ("star_tracker", "identification", "method"),
        "shefex_nav.onboard.startracker.identify:IDENTIFIERS",
    ),
    "scan": (
        ("star_tracker", "detection", "scan"),
        "shefex_nav.onboard.startracker.detect:SCANS",
    ),
    "centroid": (
        ("star_tracker", "detection", "centroid"),
        "shefex_nav.onboard.startracker.detect:CENTROIDS",
    ),
}


class Plugin(NamedTuple):
    """Where something comes from that the program did not bring along."""

    name: str  # of the file, or of the package
    version: str  # of a package; '' of a file
    sha256: str  # of the file, or of the source of the package's module
    path: str

    def __str__(self):
        version = f" {self.version}" if self.version else ""
        return f"{self.name}{version} (sha256 {self.sha256[:12]})"


_LOADED = {}  # sha256 -> (Plugin, tuple of what it provides)
_OWNERS = {}  # (kind, name) of what plug-ins have added -> path of the plug-in
_EVERY = []  # not empty: within `trusting`


def is_file(name):
    """Whether a plug-in is named as a file."""
    return name.endswith(".py") or os.sep in name


def load(name, sha256=None, trust=False):
    """What a plug-in provides: Plugin, tuple of Instrument and Method.

    name : path of a file, or name of an entry point
    sha256 : that its source must have; None: any
    trust : whether consent is given for the file as it is now
    """
    path, version = (name, "") if is_file(name) else _installed(name)
    try:
        with open(path, "rb") as file:
            source = file.read()
    except OSError as error:
        raise PluginError(f"'{name}' cannot be read: {error.strerror}; it is part of the scenario") from None
    found = hashlib.sha256(source).hexdigest()
    if sha256 is not None and found != sha256:
        raise PluginError(
            f"'{name}' is another file than the one that was flown: its SHA-256 is {found[:12]}..., "
            f"that was {sha256[:12]}..."
        )
    if found in _LOADED:
        return _LOADED[found]
    plugin = Plugin(os.path.basename(path) if is_file(name) else name, version, found, os.path.abspath(path))
    if is_file(name):
        if trust or _EVERY:
            consent(found, path)
        if not is_trusted(found):
            raise NotTrusted(
                f"'{name}' is code that flying this scenario would run; read it, then give --trust "
                f"(kept for this file as it is, SHA-256 {found[:12]}...)"
            )
    provided = tuple(one._replace(plugin=plugin) for one in _provided(_module(plugin), name))
    for one in provided:
        _add(one)
    _LOADED[found] = plugin, provided
    return plugin, provided


def _installed(name):
    """Path of the module of an installed plug-in, and the version of its package."""
    from importlib import metadata  # which takes a while

    found = list(metadata.entry_points(group=GROUP, name=name))
    if not found:
        known = sorted({one.name for one in metadata.entry_points(group=GROUP)})
        there = f"installed are: {', '.join(known)}" if known else "none is installed"
        raise PluginError(f"there is no plug-in '{name}'; {there}; a file of your own ends in .py")
    spec = util.find_spec(found[0].value.partition(":")[0])
    return spec.origin, found[0].dist.version if found[0].dist else ""


def _module(plugin):
    """The module of a plug-in, imported under a name of its own."""
    name = f"shefex_nav_plugin_{plugin.sha256[:16]}"
    spec = util.spec_from_file_location(name, plugin.path)
    module = util.module_from_spec(spec)
    sys.modules[name] = module  # where its records are found again in other processes
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        frames = [one for one in traceback.extract_tb(error.__traceback__) if one.filename == plugin.path]
        line = frames[-1].lineno if frames else getattr(error, "lineno", None)
        raise PluginError(f"{plugin.path}:{line or 1}: {type(error).__name__}: {error}") from error
    return module


def _provided(module, name):
    """What a module provides, checked."""
    provided = getattr(module, "PROVIDES", None)
    if not isinstance(provided, list | tuple) or not provided:
        raise PluginError(f"'{name}' provides nothing; end it with PROVIDES = [YOUR_INSTRUMENT]")
    for one in provided:
        if not isinstance(one, Instrument | Method):
            raise PluginError(f"'{name}': {one!r} in PROVIDES is neither an Instrument nor a Method")
        if problem := _problem(one) if isinstance(one, Instrument) else _problem_of_method(one):
            raise PluginError(f"'{name}': '{one.name}': {problem}")
    return provided


def _problem_of_method(one):
    """What is wrong with a Method; '' if nothing is."""
    if one.step not in STEPS:
        return f"there is no step '{one.step}'; choose from: {', '.join(STEPS)}"
    return "" if callable(one.function) else f"its function must be one, got {one.function!r}"


def _problem(one):
    """What is wrong with the description of an instrument; '' if nothing is."""
    if not one.name.isidentifier() or not one.name.islower():
        return "its name must be lower case with underscores, such as 'radar_altimeter'"
    if not (isinstance(one.settings, type) and issubclass(one.settings, Settings)):
        return f"settings must be a class of Settings, got {one.settings!r}"
    missing = [key for key in ("rate", "latency") if key not in declared(one.settings)]
    if missing:
        return f"its settings need {' and '.join(missing)}"
    if getattr(one.record, "_fields", ())[:2] != TIMES:
        return f"its record must be a NamedTuple that begins with {' and '.join(TIMES)}"
    if one.aid is not None and one.use is None:
        return "one with an aid needs a class of settings in `use` (instrument.Use, for example)"
    return ""


def _add(one):
    """Put something into its table; one of the same file, edited since, takes the place of the older."""
    kind, table, value = "an instrument", instruments.TABLE, one
    if isinstance(one, Method):
        module, _, name = STEPS[one.step][1].partition(":")
        kind, value = f"a way of {one.step}", one.function
        table = getattr(import_module(module), name)
    owner = _OWNERS.get((kind, one.name))
    if one.name in table and owner != one.plugin.path:
        whose = owner or "the program"
        raise PluginError(f"{one.plugin.path}: there is {kind} '{one.name}' already, of {whose}")
    _OWNERS[kind, one.name] = one.plugin.path
    table[one.name] = value


@contextmanager
def trusting():
    """Consent for every file that is loaded within: `--trust`."""
    _EVERY.append(True)
    try:
        yield
    finally:
        _EVERY.pop()


def consent(sha256, path):
    """Keep the user's consent to run a file, for this process and those it starts, and for later ones."""
    os.environ[CONSENT] = ",".join(filter(None, (os.environ.get(CONSENT, ""), sha256)))
    kept = _kept_in()
    try:
        os.makedirs(os.path.dirname(kept), exist_ok=True)
        with open(kept, "a", encoding="utf-8") as file:
            file.write(f"{sha256} {os.path.abspath(path)}\n")
    except OSError:  # it is asked for again next time
        pass


def is_trusted(sha256):
    """Whether the user has given consent to a file with this content."""
    if sha256 in os.environ.get(CONSENT, "").split(","):
        return True
    try:
        with open(_kept_in(), encoding="utf-8") as file:
            return any(line.split(" ", 1)[0] == sha256 for line in file)
    except OSError:
        return False


def _kept_in():
    """File of the consents."""
    base = os.environ.get("XDG_CONFIG_HOME") or os.path.join(os.path.expanduser("~"), ".config")
    return os.path.join(base, "shefex_nav", "trusted")
