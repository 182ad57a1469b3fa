"""The section `gps` of a scenario -> the settings of the simulated receiver, and its satellites."""

from shefex_nav.scenario.of_settings import settings


def receiver(scenario):
    """gps_settings.Gps of a scenario."""
    return settings(scenario.gps)


def clock(scenario):
    """gps_settings.Clock of a scenario."""
    return settings(scenario.gps.clock)


def almanac(scenario):
    """yuma.Almanac of the section `gps.almanac`."""
    from shefex_nav.environment import yuma

    return yuma.almanac({name: getattr(scenario.gps.almanac, name) for name in yuma.Almanac._fields})
