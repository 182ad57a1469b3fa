"""Scenario file -> `Scenario`: read, extend, override, validate; all errors at once, each with its place."""

import copy
import json
from functools import partial
from os import PathLike
from pathlib import PurePath
from typing import Self

from pydantic import ValidationError

from shefex_nav.scenario import (
    aboard,
    checks,
    disperse,
    drawn,
    expand,
    fields,
    kind,
    layers,
    messages,
    overriding,
    plugged,
    schema,
    software,
    starlight,
    trajectory,
    yaml_text,
)
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.checks import check_what_is_known, cross_check
from shefex_nav.scenario.document import BadText, Mark, dotted, parse, placed
from shefex_nav.scenario.files import Unreadable, read_text
from shefex_nav.scenario.layers import EXTENDS, ScenarioError, Texts, file_of
from shefex_nav.scenario.onboard import Navigation
from shefex_nav.scenario.partial import known
from shefex_nav.scenario.partial import validated as part_of
from shefex_nav.scenario.star_statistics import MODEL, StarStatistics
from shefex_nav.scenario.told import Told
from shefex_nav.settings import declared
from shefex_nav.world.camera_settings import Detector

DETECTION, DETECTOR = ("star_tracker", "detection"), ("star_camera", "detector")
__all__ = [
    "EXTENDS",
    "Pattern",
    "Scenario",
    "ScenarioError",
    "file_of",
    "load",
    "load_as",
    "load_text",
    "load_text_as",
]
DISPERSIONS = "dispersions"
DRAWN = Mark("drawn", 0, 0)  # place of what a run has drawn


class ScenarioBase(schema.Sections):
    __doc__ = schema.Sections.__doc__

    @classmethod
    def load(cls, path: str | PathLike, overrides=(), *, trust: bool = False) -> Self:
        """Scenario of a YAML file, with overrides ["gps.rate=5 Hz"] or {"gps.rate": "5 Hz"}.

        The name of one that comes with the package is enough: Scenario.load("shefex2_andoya").
        In a dict, what is no text may be a number, also of NumPy, True, None, or a list or dict of such.
        trust : consent to run the Python files that it names in `plugins`, as they are now; it is kept
        Raises ScenarioError, which lists every error with its place.
        """
        if isinstance(overrides, str):
            overrides = [overrides]
        if isinstance(overrides, dict):
            told = [(key, *_yaml(value)) for key, value in overrides.items()]
            bad = [f"{key}: {problem}" for key, _, problem in told if problem]
            if bad:
                raise ScenarioError(bad)
            overrides = [f"{key}={text}" for key, text, _ in told]
        return load(path, overrides, trust=trust)

    def __reduce__(self):
        """One with plug-ins is read again in another process: it has models of its own."""
        return (load_text, (self.source, self.mission.name)) if self.plugins else super().__reduce__()


def model_of(provided=()):
    """Scenario with a section for each instrument. provided : by its plug-ins, Instrument and Method"""
    return aboard.complete(provided, ScenarioBase, Navigation, Told)


def __getattr__(name):
    """A model by its qualified name, as pickle asks for it in another process."""
    return aboard.made(__name__, name)


def load(path, overrides=(), *, trust=False):
    """Scenario of the YAML file at `path`, after its `extends` and the `overrides` (`a.b=value`).

    path : may be the bare name of a scenario that the package brings, see `shipped`
    trust : consent to run the files of its plug-ins as they are now, `plugins`

    Raises ScenarioError with every error found: those of the YAML text first, because a tree with holes would
    be blamed for what it lacks; then those of tables in files, of single fields, and between fields that are
    good by themselves; those of dispersions when the fields that they name are.
    """
    files, path = Texts(), file_of(path)
    tree, places = layers.extended(path, files)
    return _validated(tree, places, files, overrides, path, trust)


def _provided(tree, places, trust):
    """What the plug-ins of a tree provide; ScenarioError where one cannot be used."""
    provided, found = plugged.loaded(tree, places, trust)
    found += software.pin(tree, places, trust)
    found += trajectory.pin(tree, places)
    if found:
        raise layers.sorted_error(found)
    return provided


def load_as(model, path, overrides=(), *, parts=(), instead=lambda tree, path: "", trust=False):
    """The YAML file at `path` as another kind than a mission by the same rules: `extends`, `--set`, units.

    model : function of what plug-ins provide that gives the model of the kind
    parts : functions of an instance that yield contradictions in it, (path of the field, text); of a tree
        with mistakes they get what is good of it (`partial`)
    instead : says what a tree is that is of another kind, such as kind.instead_of_replay

    Returns
    -------
    loaded : instance of the model
    places : messages.Places of its keys and values
    source : YAML text with everything in it

    Raises ScenarioError as `load` does.
    """
    files, path = Texts(), file_of(path)
    tree, places = layers.extended(path, files)
    if other := instead(tree, path):
        raise ScenarioError([f"{path}: {other}"])
    return _validated_as(model, tree, places, files, overrides, parts, trust)


def load_text_as(model, text, name, overrides=(), *, parts=()):
    """The same of a text that needs no other file; complaints call it `name`."""
    return _validated_as(model, *_whole(text, name), Texts(), overrides, parts)


def _validated_as(model, tree, places, files, overrides, parts, trust=False):
    """What `load_as` returns, of a merged tree."""
    overriding.carry_out(overrides, tree, places, files)
    model = model(_provided(tree, places, trust))
    whole, dark = starlight.filled(with_saturation(tree), places)
    try:
        loaded, found, read = model.model_validate(whole), dark, list
    except ValidationError as error:
        loaded, read = part_of(model, whole, messages.paths(error)), known
        found = dark + messages.lines(model, error, places)
    found = files.with_mistakes(found)
    for part in parts:
        found += [places.wrong(where, words) for where, words in read(part(loaded))]
    if found:
        raise layers.sorted_error(found) from None
    return loaded, places, normalised(tree)


def load_text(text, name, overrides=()):
    """Scenario of a text that needs no other file, such as a log keeps; complaints call it `name`.

    Raises ScenarioError as `load` does.
    """
    return _validated(*_whole(text, name), Texts({name: text}), overrides, name)


class Pattern:
    """A scenario with dispersions, read once and then made again and again with what was drawn."""

    def __init__(self, text, name):
        self._text, self._name = text, name
        self._tree, self._places = _whole(text, name)
        self.scenario = self._validated(copy.deepcopy(self._tree), self._places.copy())
        self.dispersed, _ = disperse.resolve(type(self.scenario), self._tree, self.scenario.dispersions)
        for one in self.dispersed:
            fields.fill(type(self.scenario), self._tree, one.path)
        self._tree.pop(DISPERSIONS, None)

    def with_draws(self, draws):
        """Scenario of what was drawn, {path as written: value in the unit of its dispersion}.

        The values are checked as those of a file are; raises ScenarioError.
        """
        tree, places = copy.deepcopy(self._tree), self._places.copy()
        for one in self.dispersed:
            fields.put(tree, one.path, drawn.applied(one, draws[one.name]))
        marks = {one.path: DRAWN for one in self.dispersed}
        places.take(marks, marks, marks)
        return self._validated(tree, places)

    def _validated(self, tree, places):
        """Scenario of a tree that it may keep."""
        return _validated(tree, places, Texts({self._name: self._text}), (), self._name)


def _whole(text, name):
    """(tree, places) of a text that needs no other file."""
    own = layers.parsed(text, name)
    places = messages.Places(own.values[()])
    places.put((), own.keys, own.values)
    return own.tree, places


def _validated(tree, places, files, overrides, path, trust=False):
    """Scenario of a merged tree after the overrides; `path` is the file or text that the user gave."""
    if other := kind.instead_of_flight(tree, path):
        raise ScenarioError([f"{path}: {other}"])
    overriding.carry_out(overrides, tree, places, files)
    model = model_of(_provided(tree, places, trust))
    others = {file: "uses" if file in files.instruments else "extends" for file in files if file != path}
    found, rated = expand.expand(tree, places, files)
    bad = expand.not_expanded(tree) if found else []
    whole, dark = starlight.filled(with_saturation(tree), places)
    found += dark
    try:
        scenario = model.model_validate(whole)
    except ValidationError as error:
        found += messages.lines(model, error, places)
        bad += messages.paths(error)
    found = files.with_mistakes(found)
    about = partial(_about, places, path, others)
    if found:
        more = check_what_is_known(part_of(model, whole, bad), rated)
    else:
        more = list(cross_check(scenario, rated))
        more += _dispersions(tree, scenario, try_them=not more)
    stages = layers.node(tree, checks.STAGES)
    more = checks.noted(more, stages if isinstance(stages, dict) else (), places, others)
    found += [about(where, words) for where, words in more]
    if found:
        raise layers.sorted_error(found) from None
    scenario.keep_text(partial(normalised, tree), files)  # which takes longer than all the rest
    scenario.keep_dropped(files.dropped)
    scenario.keep_places(partial(_line_about, about), partial(_place, places))
    return scenario


def _dispersions(tree, scenario, try_them):
    """(path, text) of what is wrong with the dispersions of a scenario that was read from a tree."""
    model, section = type(scenario), scenario.dispersions
    dispersed, found = disperse.resolve(model, tree, section)
    return found if found or not try_them else drawn.refused(model, tree, section, dispersed, _complaint)


def _complaint(tree):
    """What is said first of a tree in which something is drawn; '' if it is good."""
    tree.pop(DISPERSIONS, None)
    try:
        _validated(tree, messages.Places(DRAWN), Texts(), (), DRAWN.file)
    except ScenarioError as error:
        return error.messages[0].removeprefix(f"{DRAWN}: ")
    return ""


def _line_about(about, where, words):
    """A line of what `_about` says."""
    return placed(*about(where, words))


def _place(places, where):
    """`file:line:col` of the value at a path."""
    return str(places.value(where))


def _about(places, path, others, where, words):
    """(Mark, text) about the field at the path `where` of the scenario in the file `path`.

    others : {path of another file: 'extends', 'uses', what the scenario does with it}
    """
    mark = places.value(where)
    return mark, f"{dotted(where)}: {words}{_whose(mark, path, others)}"


def _whose(mark, path, others):
    """Where to put right what stands in a file that the user's own builds on: nobody need edit that one."""
    verb = others.get(mark.file)
    return f" (set in {mark.file}; change it in {path}, which {verb} it)" if verb else ""


def star_statistics_of(path, overrides=()):
    """StarStatistics of the file that star_tracker.model of a scenario names, None without one.

    A scenario of rendered frames is loaded without them (`expand`): its camera may be another one. Whoever
    predicts what the star tracker would do asks here.

    path, overrides : as of `load`. ScenarioError if the file cannot be read
    """
    read, path = Texts(), file_of(path)
    tree, places = layers.extended(path, read)
    overriding.carry_out(overrides, tree, places, read)
    name = layers.node(tree, MODEL)
    if not isinstance(name, str):
        return None
    where = f"{places.value(MODEL)}: {dotted(MODEL)}: '{name}'"
    try:
        found = parse(read_text(name, "a file of `shefex-nav characterise`"), name)
        return StarStatistics.model_validate(found.tree)
    except (Unreadable, BadText) as error:
        raise ScenarioError([f"{where} {error.args[-1]}"]) from None
    except ValidationError as error:
        lines = [words for _, words in messages.lines(StarStatistics, error, places)]
        raise ScenarioError([f"{where}: {lines[0]}"]) from None


def with_saturation(tree):
    """A tree with the largest grey value of the camera's detector for `star_tracker.detection.saturation`.

    So a scenario takes a camera of 8 bits or of 12, whichever it is given; a value is for a detector that
    saturates below its largest grey value. The same tree if one is given or the detector is not known.
    """
    detection, detector = (layers.node(tree, path) for path in (DETECTION, DETECTOR))
    if not isinstance(detection, dict) or not isinstance(detector, dict):
        return tree
    if detection.get("saturation", AUTOMATIC) != AUTOMATIC:
        return tree
    setting = declared(Detector)["bits"][1]
    bits, limits = str(detector.get("bits", setting.default)), dict(setting.limits)
    if not bits.isdecimal() or not limits["at_least"] <= int(bits) <= limits["at_most"]:
        return tree  # what is wrong with it is told elsewhere
    filled = {**detection, "saturation": f"{2 ** int(bits) - 1} DN"}
    return {**tree, "star_tracker": {**tree["star_tracker"], "detection": filled}}


def with_states(scenario, names):
    """A Scenario whose filter has the named blocks of states, in its text as well."""
    navigation = scenario.navigation.model_copy(update={"states": list(names)})
    settled = scenario.with_sections(navigation=navigation)
    settled.keep_text(partial(_source_with_states, scenario, list(names)), dict(scenario.files))
    return settled


def _source_with_states(scenario, names):
    tree = layers.parsed(scenario.source, scenario.mission.name).tree
    tree["navigation"]["states"] = names
    return normalised(tree)


def normalised(tree):
    """YAML text of the merged tree, without comments, that loads to the same scenario."""
    return yaml_text.written(_given(tree))


def _given(tree):
    """A tree without keys that have no value, which is the same as not to give them."""
    if isinstance(tree, dict):
        return {key: _given(value) for key, value in tree.items() if value is not None}
    return [_given(item) for item in tree] if isinstance(tree, list) else tree


def _yaml(value):
    """Text that YAML reads as the value: a text as it is, anything else as JSON, which is YAML too.

    -> text, what is wrong with the value (one of them is empty)
    """
    if isinstance(value, str):
        return value, ""
    try:
        return json.dumps(value, allow_nan=False, default=_plain), ""
    except (TypeError, ValueError) as error:
        wanted = "a text with a unit, a finite number, True, None, or a list or dict of such"
        return "", f"{value!r} cannot stand in a scenario ({error}); give {wanted}"


def _plain(value):
    """Numbers and arrays of NumPy as Python's own, paths as texts; TypeError for anything else."""
    if isinstance(value, PurePath):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"of type {type(value).__name__}")


Scenario = model_of()  # of the instruments that come with the program
