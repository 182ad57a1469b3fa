"""Instruments in a scenario: their sections, what contradicts them, and what world and filter get of them.

`navigation.<name>` says how the filter uses an instrument; `navigation.told.<name>` what the computer is told
of it in the place of the truth. Of a block of states that a plug-in brings by itself `navigation.<name>` has
what is known.
"""

from functools import cache, partial
from typing import Literal

from pydantic import Field, create_model

from shefex_nav.clock import TICK_HZ
from shefex_nav.environment import models
from shefex_nav.instruments import BUILT_IN, OWN_STATES, TABLE, faults
from shefex_nav.instruments.instrument import Instrument, Known
from shefex_nav.onboard.navigation.blocks import OPTIONAL, OwnState
from shefex_nav.onboard.startracker.methods import STEPS, Method
from shefex_nav.scenario import surroundings
from shefex_nav.scenario.block import AUTOMATIC, kinds, with_word
from shefex_nav.scenario.of_settings import section, settings
from shefex_nav.scenario.partial import of_each
from shefex_nav.scenario.told import part_of

FAULT = "fault"  # key that tells kinds of faults apart
LEFT_OUT = "left out: there is none"
_MADE = {}  # models by module and qualified name


def complete(provided, base, navigation, told=None, core=tuple(OPTIONAL)):
    """Model of a kind of scenario with a section for each instrument.

    provided : what plug-ins provide (`plugins`), beside what comes with the program
    base : Block of the scenario, with a field `navigation`; its module has `made` for what it lacks
    navigation : Block of that section, whose field `states` is given the names of all blocks
    told : Block of navigation.told, if there is one
    core : names of the blocks that are no instrument's
    """
    own = [one for one in provided if isinstance(one, Instrument)]
    states = tuple(one for one in provided if isinstance(one, OwnState))
    whole = _complete((*BUILT_IN.values(), *own), states, base, navigation, told, core)
    for one in provided:
        if isinstance(one, Method) and STEPS[one.step].path[0] in whole.model_fields:
            whole = with_word(whole, STEPS[one.step].path, one.name)
    brought = tuple(one for one in provided if type(one) in models.BUILT_IN)
    return surroundings.complete(whole, brought) if brought and "earth" in whole.model_fields else whole


@cache
def _complete(instruments, own_states, base, navigation, told, core):
    words = {one.name: one.name.replace("_", " ") for one in instruments}
    own = {
        one.name: (
            section(one.use),
            Field(
                default_factory=section(one.use),
                description=f"how the filter uses the {words[one.name]}, if there is one",
            ),
        )
        for one in instruments
        if one.use
    }
    for one in own_states:
        own[one.name] = (section(one.settings) | None, Field(default=None, description=one.label))
    of_instruments = (block.name for one in instruments for block in one.states)
    states = Literal[(*core, *of_instruments, *(one.name for one in own_states))]
    own["states"] = navigation.states_field(states)
    if told is not None:
        parts = {
            one.name: (
                part_of(section(one.settings), dict.fromkeys(one.told)) | None,
                Field(default=None, description=f"of the {words[one.name]}"),
            )
            for one in instruments
            if one.told
        }
        whole = _model(told, parts, instruments, own_states, base.__module__)
        own["told"] = (whole, Field(default_factory=whole, description=told.HELP))
    sections = {
        one.name: (section(one.settings) | None, Field(default=None, description=LEFT_OUT))
        for one in instruments
    }
    given = base.model_fields["navigation"]
    whole = _model(navigation, own, instruments, own_states, base.__module__)
    how = {} if given.is_required() else {"default_factory": whole}
    fields = {"navigation": (whole, Field(description=given.description, **how)), **sections}
    if (wrong := base.model_fields.get("faults")) is not None:
        lists = {one.name: _list_of_faults(one, words[one.name]) for one in instruments}
        whole = _model(wrong.annotation, lists, instruments, own_states, base.__module__)
        fields["faults"] = (whole, Field(default_factory=whole, description=wrong.description))
    return _model(base, fields, instruments, own_states, base.__module__)


def _list_of_faults(one, words):
    """Type and FieldInfo of a list of faults of an Instrument."""
    models = [section(kind.settings) for kind in faults.kinds(one)]
    return list[kinds(FAULT, *models)], Field(default=[], description=f"faults of the {words}")


def _model(base, fields, instruments, own_states, module):
    """A model with more fields, which `module` has for pickle."""
    model = create_model(base.NAME, __base__=base, __module__=module, __doc__=base.__doc__, **fields)
    model.INSTRUMENTS, model.OWN_STATES = instruments, own_states
    model.__qualname__ = f"{base.NAME}:{','.join(one.name for one in (*instruments, *own_states))}"
    _MADE[module, model.__qualname__] = model
    return model


def made(module, name):
    """A model of a module that has completed it, by its qualified name; AttributeError if there is none."""
    if (module, name) not in _MADE:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    return _MADE[module, name]


def table_of(scenario):
    """Instruments that a scenario may have: its own, whatever other plug-ins this process has loaded."""
    return getattr(type(scenario), "INSTRUMENTS", None) or tuple(TABLE.values())


def activate(scenario):
    """Let this process know the instruments and states of a scenario, in the place of others so named."""
    TABLE.update({one.name: one for one in table_of(scenario)})
    OWN_STATES.update({state.name: state for state, _ in own_states(scenario)})


def own_states(scenario):
    """Blocks of states that plug-ins of a scenario bring by themselves.

    Iterator of (blocks.OwnState, its settings; None if they are not given)
    """
    for state in getattr(type(scenario), "OWN_STATES", ()):
        given = getattr(scenario.navigation, state.name)
        yield state, None if given is None else settings(given)


def check_own_blocks(scenario):
    """Ask every block of states of a plug-in what is known of it; CodeError if that goes wrong."""
    for state, known in own_states(scenario):
        if known is not None:
            state.block(known)


def unused_blocks(scenario):
    """Blocks of states of plug-ins whose section is given, and which no filter estimates: (path, words)."""
    states = scenario.navigation.states
    for state, known in own_states(scenario):
        if known is not None and states != AUTOMATIC and state.name not in states:
            words = f"is of no effect: navigation.states does not name {state.name}"
            yield ("navigation", state.name), f"{words}; write [{', '.join([*states, state.name])}]"


def own_blocks(scenario):
    """Those that the filter of a scenario estimates: tuple of blocks.Block."""
    states = scenario.navigation.states
    return tuple(state.block(known) for state, known in own_states(scenario) if state.name in states)


def instruments(scenario):
    """What is aboard: iterator of (Instrument, its Section)."""
    for one in table_of(scenario):
        if (given := getattr(scenario, one.name, None)) is not None:
            yield one, given


def wrong(scenario):
    """Faults of what is aboard: {name: tuple of their settings}."""
    return {
        one.name: tuple(settings(fault) for fault in getattr(scenario.faults, one.name))
        for one, _ in instruments(scenario)
    }


def used(scenario):
    """What the filter uses: iterator of (Instrument, its settings, those of its use)."""
    for one, given in instruments(scenario):
        if one.aid is None:
            continue
        use = settings(getattr(scenario.navigation, one.name))
        if use.used:
            yield one, settings(given), use


def aids(scenario):
    """Aids of the filter: tuple of aid.Aid."""
    found = list(used(scenario))
    if not found:
        return ()
    from shefex_nav.environment import ephemeris

    bodies = ephemeris.sky_bodies(scenario.mission.epoch)
    known = Known(year(scenario), ephemeris.apparent_sun(bodies))
    return tuple(one.aid(given, use, known) for one, given, use in found)


def estimated(scenario):
    """Names of the blocks that the filter estimates: those of the scenario, without those of instruments that
    it does not use."""
    unused = {block.name for one in table_of(scenario) for block in one.states}
    unused -= {block.name for one, _, _ in used(scenario) for block in one.states}
    return tuple(name for name in scenario.navigation.states if name not in unused)


def year(scenario):
    """Of the mission, decimal."""
    from shefex_nav.environment import magnetic_field

    return magnetic_field.decimal_year(scenario.mission.epoch)


def longest_latency(scenario):
    """Of readings, s."""
    return max((given.latency for _, given in instruments(scenario)), default=0.0)


def contradictions(scenario):
    """(path, words) of contradictions in the sections of the instruments of a mission."""
    yield from of_sensors(scenario)
    told = scenario.navigation.told
    for name in (one.name for one in table_of(scenario)):
        if getattr(scenario, name, None) is None and getattr(told, name, None) is not None:
            yield ("navigation", "told", name), "there is none that it could be told of"
    for one, given in instruments(scenario):
        ticks = TICK_HZ / given.rate
        if round(ticks) < 1 or abs(ticks - round(ticks)) > 1e-6:
            words = f"{given.rate:g} Hz does not divide the on-board clock, {TICK_HZ:g} Hz"
            yield (one.name, "rate"), f"{words}; take such as 1, 10, 20 or 50 Hz"
    yield from _faults(scenario)


def _faults(scenario):
    """(path, words) of faults of instruments that are not aboard, or of no field."""
    for one in table_of(scenario):
        several = getattr(scenario.faults, one.name, ())
        if several and getattr(scenario, one.name, None) is None:
            yield ("faults", one.name), f"there is none aboard; give section {one.name}, or leave it out"
        yield from of_each(several, partial(_fieldless, one.name))


def _fieldless(name, k, fault):
    fields = faults.fields_of(fault.SETTINGS)
    if fields and all(getattr(fault, field) is None for field in fields):
        words = f"a {fault.fault} of what? Give one of: {', '.join(fields)}"
        yield ("faults", name, k), words


def of_sensors(scenario):
    """(path, words) of what missions and replays have in common."""
    states = scenario.navigation.states
    for one in table_of(scenario):
        if getattr(scenario, one.name, None) is None:
            yield from _of_none(one, states)
    for one, given, use in used(scenario):
        missing = [block for block in one.states if block.needed and block.name not in states]
        if missing and states != AUTOMATIC:
            names = ", ".join([*states, *(block.name for block in missing)])
            yield ("navigation", "states"), f"{missing[0].why}; write [{names}]"
        if one.check is not None:
            yield from one.check(given, use, year(scenario))
    for state, known in own_states(scenario):
        if states != AUTOMATIC and state.name in states and known is None:
            words = f"what is known of '{state.name}' at the start? Give section navigation.{state.name}"
            yield ("navigation", "states", states.index(state.name)), words


def _of_none(one, states):
    """Blocks of states of an instrument that is not aboard."""
    for block in one.states:
        if states != AUTOMATIC and block.name in states:
            words = f"'{block.name}' is of a {one.name}: give section {one.name}, or leave it out"
            yield ("navigation", "states", states.index(block.name)), words
