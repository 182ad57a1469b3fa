"""Gravity, air and wind of a scenario: the models that it may name, and what the flight gets of them."""

import math
from functools import cache
from typing import Literal

import numpy as np
from pydantic import Field, create_model

from shefex_nav.environment.models import BUILT_IN, Atmosphere, Gravity, Site, Wind
from shefex_nav.scenario import mission
from shefex_nav.scenario.block import with_field, with_word
from shefex_nav.scenario.of_settings import section, settings
from shefex_nav.settings import REQUIRED, declared


@cache
def complete(model, brought):
    """Model of a scenario in which the models of plug-ins can be named. brought : tuple of them"""
    kept = {kind: {**known} for kind, known in BUILT_IN.items()}
    for one in brought:
        kept[type(one)][one.name] = one
        if isinstance(one, Gravity):
            model = with_word(model, ("earth", "gravity"), one.name)
        elif isinstance(one, Atmosphere):
            model = _with_atmosphere(model, one)
    if any(isinstance(one, Wind) for one in brought):
        model = with_field(model, ("wind",), lambda field: _wind(kept[Wind].values()))
    model.MODELS = kept
    return model


def _with_atmosphere(model, one):
    model = with_word(model, ("atmosphere", "model"), one.name)
    if one.settings is None:
        return model
    own, words = section(one.settings), f"needed by {one.name}"
    return with_field(model, ("atmosphere", one.name), lambda field: own | None, description=words)


def _wind(winds):
    """Type of the section of the wind, with a form for each wind that has settings."""
    named = [
        create_model(
            one.settings.__name__,
            __base__=section(one.settings),
            __doc__=one.settings.__doc__,
            model=(Literal[one.name], Field(description="name of the wind")),
        )
        for one in winds
        if one.settings
    ]
    return mission.wind_type(tuple(one.name for one in winds), *named)


def _needed(one):
    """Settings that a model cannot do without, with their examples, as a text."""
    given = declared(one.settings) if one.settings else {}
    must = (key for key, (_, setting) in given.items() if setting.default is REQUIRED)
    return ", ".join(f"{key}: {given[key][1].example}" for key in must)


def _of(scenario, kind, name):
    return type(scenario).MODELS[kind][name]


def contradictions(scenario):
    """(path, words) about settings that the models of a scenario cannot do without."""
    given, one = scenario.atmosphere, _of(scenario, Atmosphere, scenario.atmosphere.model)
    if (keys := _needed(one)) and getattr(given, one.name) is None:
        words = f"is missing; {one.name} needs it, for example '{one.name}: {{{keys}}}'"
        yield ("atmosphere", one.name), words
    if isinstance(scenario.wind, str) and (keys := _needed(_of(scenario, Wind, scenario.wind))):
        yield ("wind",), f"{scenario.wind} needs settings: write {{model: {scenario.wind}, {keys}}}"


def gravity(scenario):
    """environment.gravity.GravityModel of a scenario."""
    from shefex_nav.environment import gravity

    return gravity.load(scenario.earth.gravity, scenario.earth.gravity_degree, type(scenario).MODELS[Gravity])


def air(scenario, at=None):
    """Air above the place of the start, (n, 4) as `environment.sampling.air_table`; (0, 4) for US76.

    at : latitude and longitude of that place, rad; None: as the scenario says
    """
    from shefex_nav.environment import sampling

    one = _of(scenario, Atmosphere, scenario.atmosphere.model)
    return sampling.air_table(one, _site(scenario, one, getattr(scenario.atmosphere, one.name, None), at))


def wind(scenario):
    """Wind above the place of the start: rows (m, 1 + 2 k) and times (k,) as of `world.flight.params`.

    Of a table, speed and direction are given at the heights; between them the components are linear.
    """
    given = scenario.wind
    if isinstance(given, mission.WindTable):
        speed, whence = np.array(given.speed), np.array(given.direction)
        rows = np.column_stack([given.height, -speed * np.cos(whence), -speed * np.sin(whence)])
        return rows, np.zeros(1)
    from shefex_nav.environment import sampling

    named = isinstance(given, str)
    one = _of(scenario, Wind, given if named else given.model)
    span = scenario.mission.start, scenario.mission.time_limit
    return sampling.wind_table(one, _site(scenario, one, None if named else given), span)


def check(scenario):
    """Ask the models of plug-ins that a scenario names; CodeError if that goes wrong."""
    for ask in (gravity, air, wind):
        ask(scenario)


def _site(scenario, one, given, at=None):
    """models.Site of a model. given : section of its settings; None: their defaults; at : as of `air`"""
    own = None if one.settings is None else settings(given or section(one.settings)())
    return Site(scenario.mission.epoch, *(at or place(scenario)), own)


def place(scenario):
    """Latitude and longitude at the start, rad; for an orbit those below, latitude to a fifth of a degree."""
    site = scenario.launch or scenario.ground or getattr(scenario.trajectory, "origin", None)
    if site is not None:
        return site.latitude, site.longitude
    if scenario.trajectory is not None:
        return 0.0, 0.0  # its file says: `air` is told
    from shefex_nav.environment import ephemeris
    from shefex_nav.geometry import frames

    orbit, earth = scenario.orbit, scenario.earth
    along = orbit.perigee + orbit.anomaly  # from the ascending node
    x, y = np.cos(along), np.sin(along) * np.cos(orbit.inclination)
    cosine, sine = np.cos(orbit.node), np.sin(orbit.node)
    u_i = np.array([cosine * x - sine * y, sine * x + cosine * y, np.sin(along) * np.sin(orbit.inclination)])
    rotation = ephemeris.earth_rotation(
        scenario.mission.epoch, earth.ut1_minus_utc, earth.pole_x, earth.pole_y
    )
    u_e = frames.dcm_ie(rotation, scenario.mission.start).T @ u_i
    return math.asin(min(max(u_e[2], -1.0), 1.0)), math.atan2(u_e[1], u_e[0])
