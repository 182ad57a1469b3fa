"""What the scenario of a log said, as far as this version can still read it."""

import math
from functools import lru_cache
from typing import NamedTuple

from shefex_nav.records import QUANTITIES
from shefex_nav.report import local_level, requirements


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
    """Configured of a RunData. The scenario of a replay of external data has no such limits."""
    text, mission = data.mission.scenario_text, data.mission
    found = NOTHING if local_level.is_replay(data) or not text.strip() else _read(text)
    return _limits(found, mission)


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


def _of(scenario):
    """Configured of a Scenario."""
    stray = scenario.star_camera.stray_light
    return Configured(
        description=scenario.mission.description,
        requirements=scenario.requirements,
        limits={quantity: getattr(scenario.requirements, quantity).limit for quantity in QUANTITIES},
        sun_exclusion_rad=stray.sun_exclusion,
        limb_exclusion_rad=stray.earth_exclusion,
        problem="",
        scenario=scenario,
        given=frozenset(q for q in QUANTITIES if _gives_limit(scenario.requirements, q)),
    )


def _gives_limit(stated, quantity):
    """Whether the limit of a quantity is not that of the program. stated : section `requirements`"""
    return quantity in stated.model_fields_set and "limit" in getattr(stated, quantity).model_fields_set
