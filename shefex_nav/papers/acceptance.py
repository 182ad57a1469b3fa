"""Identifications that are believed as their papers believe them (`identification.acceptance: published`)."""

from shefex_nav.onboard.startracker.identify.verify import nothing
from shefex_nav.records import Reason


def is_published(settings):
    """Whether a method's own acceptance is the last word. Identification settings -> bool"""
    return settings.acceptance == "published"


def believed(settings, found):
    """What a method has found as it is, where there are stars enough for an attitude.

    Parameters
    ----------
    settings : Identification, of it `fewest_stars`
    found : identify.verify.Identification, of the method's `match`

    Returns
    -------
    identify.verify.Identification
    """
    if found.reason == Reason.NONE and (found.star >= 0).sum() < settings.fewest_stars:
        return nothing(len(found.star), Reason.NO_MATCH)
    return found
