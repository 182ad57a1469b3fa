"""From a scenario to software of a user's own that flies."""

import sys
from contextlib import redirect_stdout

from shefex_nav import plugins
from shefex_nav.errors import SoftwareError
from shefex_nav.onboard.own_computer import OwnComputer
from shefex_nav.onboard.own_navigation import OwnNavigation
from shefex_nav.onboard.own_tracker import OwnTracker
from shefex_nav.scenario import params_filter, software
from shefex_nav.software.mission import mission_data


def computer(scenario, params, alignment, earth):
    """OwnComputer of a Scenario at the alignment; None: the built-in computer flies.

    params : onboard.computer.ComputerParams;  earth : EarthRotation
    """
    return _navigating(OwnComputer, scenario.computer, scenario, params, alignment, earth)


def navigation(scenario, params, alignment, earth):
    """OwnNavigation of a Scenario at the alignment, arguments as of `computer`; None: the built-in filter."""
    return _navigating(OwnNavigation, scenario.navigation, scenario, params, alignment, earth)


def _navigating(kind, block, scenario, params, alignment, earth):
    """An OwnNavigation or OwnComputer (kind) of a section, started; None: it has no own software."""
    own = software.own(block)
    if own is None:
        return None
    mission = mission_data(scenario, params, earth, own.settings)
    return started(kind, own, alignment, mission, scenario.requirements)


def started(kind, own, alignment, mission, stated):
    """An OwnNavigation or OwnComputer (kind), started.

    own : scenario.software.Own, Program or Reached;  mission : MissionData
    stated : section `requirements` of the scenario
    """
    return kind(_made(own), software.name(own), alignment, mission, params_filter.required(stated))


def tracker(scenario, params, earth):
    """OwnTracker of a Scenario; None: the built-in chain searches the pictures."""
    own = software.own(scenario.star_tracker)
    if own is None:
        return None
    mission = mission_data(scenario, params, earth, own.settings)
    return OwnTracker(_made(own, searches=True), software.name(own), mission)


def _made(own, searches=False):
    """The object that flies.

    own : scenario.software.Own, Program or Reached
    searches : it is a star tracker, not a navigation or a computer
    """
    if isinstance(own, software.Own):
        _, cls = plugins.software(own.python, own.sha256)
        try:
            with redirect_stdout(sys.stderr):  # standard output is for results
                return cls()
        except KeyboardInterrupt:  # of the user
            raise
        except BaseException as error:
            raise SoftwareError(f"{software.name(own)} cannot be made", error) from error
    from shefex_nav.software import remote

    within = own.answer_within, own.start_within
    kind = remote.RemoteTracker if searches else remote.Remote
    if isinstance(own, software.Program):
        return kind(remote.started(software.words_of(own), own.sha256), *within)
    return kind(remote.reached(own.connect), *within)
