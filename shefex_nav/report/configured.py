"""What the scenario of a log said, as far as this version can still read it."""

import math
from functools import lru_cache
from typing import NamedTuple

from pydantic import ValidationError

from shefex_nav.records import QUANTITIES
from shefex_nav.report import local_level, requirements
from shefex_nav.scenario import document


class Configured(NamedTuple):
    """Of the scenario of a run; None where it does not say, or cannot be read."""

    description: str  # may be empty
    requirements: object  # scenario.requirements.Requirements
    limits: dict  # quantity of records.QUANTITIES: its limit in SI; empty where the scenario does not say
    sun_exclusion_rad: float | None
    limb_exclusion_rad: float | None
    problem: str  # why the scenario cannot be read; empty otherwise
    scenario: object = None  # Scenario
    given: frozenset = frozenset()  # quantities of which the scenario itself gives the limit


NOTHING = Configured("", None, {}, None, None, "")


def configured(data):
    """Configured of a RunData. Of a replay of external data it has the limits of protection levels alone."""
    text, mission = data.mission.scenario_text, data.mission
    read = _read_replay if local_level.is_replay(data) else _read
    return _limits(read(text) if text.strip() else NOTHING, mission)


def _limits(found, mission):
    """Configured with the exclusion angles of a Mission, where it has them."""
    if math.isnan(mission.sun_exclusion) or math.isnan(mission.limb_exclusion):  # a log that does not say
        return found
    return found._replace(sun_exclusion_rad=mission.sun_exclusion, limb_exclusion_rad=mission.limb_exclusion)


def of_run(data, scenario=None):
    """The same; scenario : that of the run, where it is at hand and its text need not be read."""
    return configured(data) if scenario is None else _limits(_of(scenario), data.mission)


def judged(data, summary, scenario=None):
    """requirements.Judged of a RunData with this summary; () where its scenario requires nothing.

    scenario : Scenario of the run, where it is at hand; otherwise the one in the log is read
    """
    stated = configured(data).requirements if scenario is None else scenario.requirements
    return () if stated is None else requirements.judge(stated, summary)


@lru_cache(maxsize=4)
def _read(text):
    """Configured of the text of a scenario, which takes half a second."""
    from shefex_nav.scenario import load

    try:
        scenario = load.load_text(text, "scenario.yaml")
    except load.ScenarioError as error:
        return NOTHING._replace(problem=str(error))
    return _of(scenario)


@lru_cache(maxsize=4)
def _read_replay(text):
    """Configured of the text of a replay scenario; nothing where it cannot be read."""
    from shefex_nav.scenario.requirements import ReplayRequirements

    try:
        tree = document.parse(text, "scenario.yaml").tree
        stated = ReplayRequirements.model_validate(tree.get("requirements") or {})
    except (document.BadText, ValidationError):
        return NOTHING
    description = str(tree.get("mission", {}).get("description", ""))
    return NOTHING._replace(description=description, limits=_limits_of(stated), given=_given(stated))


def _of(scenario):
    """Configured of a Scenario."""
    stray = scenario.star_camera.stray_light
    return Configured(
        description=scenario.mission.description,
        requirements=scenario.requirements,
        limits=_limits_of(scenario.requirements),
        sun_exclusion_rad=stray.sun_exclusion,
        limb_exclusion_rad=stray.earth_exclusion,
        problem="",
        scenario=scenario,
        given=_given(scenario.requirements),
    )


def _limits_of(stated):
    """Limit of each quantity. stated : section `requirements`"""
    return {quantity: getattr(stated, quantity).limit for quantity in QUANTITIES}


def _given(stated):
    """Quantities of which the section gives the limit itself."""
    return frozenset(quantity for quantity in QUANTITIES if _gives_limit(stated, quantity))


def _gives_limit(stated, quantity):
    """Whether the limit of a quantity is not that of the program. stated : section `requirements`"""
    return quantity in stated.model_fields_set and "limit" in getattr(stated, quantity).model_fields_set
