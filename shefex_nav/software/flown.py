"""From a scenario to software of a user's own that flies."""

from shefex_nav import plugins
from shefex_nav.errors import SoftwareError
from shefex_nav.onboard.own_navigation import OwnNavigation
from shefex_nav.onboard.own_tracker import OwnTracker
from shefex_nav.scenario import software
from shefex_nav.software.mission import mission_data


def navigation(scenario, params, alignment, earth):
    """OwnNavigation of a Scenario at the alignment; None: the built-in filter navigates.

    params : onboard.computer.ComputerParams;  earth : EarthRotation
    """
    own = software.own(scenario.navigation)
    if own is None:
        return None
    mission = mission_data(scenario, params, earth, own.settings)
    return OwnNavigation(_made(own), software.name(own), alignment, mission)


def tracker(scenario, params, earth):
    """OwnTracker of a Scenario; None: the built-in chain searches the pictures."""
    own = software.own(scenario.star_tracker)
    if own is None:
        return None
    return OwnTracker(_made(own), software.name(own), mission_data(scenario, params, earth, own.settings))


def _made(own):
    """The object that flies. scenario.software.Own, Program or Reached -> Navigation or StarTracker"""
    if isinstance(own, software.Own):
        _, cls = plugins.software(own.python, own.sha256)
        try:
            return cls()
        except Exception as error:
            raise SoftwareError(f"{software.name(own)} cannot be made", error) from error
    from shefex_nav.software import remote

    if isinstance(own, software.Program):
        return remote.started(software.words_of(own), own.sha256, own.answer_within)
    return remote.reached(own.connect, own.answer_within)
