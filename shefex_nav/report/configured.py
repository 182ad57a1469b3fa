"""What the scenario of a log said, as far as this version can still read it."""

from typing import NamedTuple

from shefex_nav.report import local_level


class Configured(NamedTuple):
    """Limits of a run; None where its scenario does not say, or cannot be read."""

    attitude_rad: float | None  # largest error that may be, about each axis
    sun_exclusion_rad: float | None
    limb_exclusion_rad: float | None
    problem: str  # why the scenario cannot be read; empty otherwise


NOTHING = Configured(None, None, None, "")


def configured(data):
    """Configured of a RunData. The scenario of a replay of external data has no such limits."""
    from shefex_nav.scenario import load

    text = data.mission.scenario_text
    if local_level.is_replay(data) or not text.strip():
        return NOTHING
    try:
        scenario = load.load_text(text, "scenario")
    except load.ScenarioError as error:
        return NOTHING._replace(problem=str(error))
    stray = scenario.star_camera.stray_light if scenario.star_camera else None
    return Configured(
        attitude_rad=scenario.navigation.integrity.attitude,
        sun_exclusion_rad=stray and stray.sun_exclusion,
        limb_exclusion_rad=stray and stray.earth_exclusion,
        problem="",
    )
