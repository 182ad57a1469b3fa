"""Why position, velocity or attitude is not to be used, in words: one for the table and the page."""

import math

from shefex_nav.records import Doubt

WORDS = {
    Doubt.LEVEL: "protection level above {limit}",
    Doubt.CONTRADICTED: "contradicted by a sensor",
    Doubt.IMU: "the IMU does not measure the motion",
    Doubt.SOFTWARE: "the navigation software says so",
}
UNITS = {"position": ("m", 1.0), "velocity": ("m/s", 1.0), "attitude": ("deg", math.degrees(1.0))}  # of SI


def words(doubt, quantity, limit=None, by_default=False):
    """A Doubt about a quantity, for people.

    limit : of its protection level, m, m/s or deg; None: not known
    by_default : whether the scenario says nothing of it
    """
    return WORDS.get(doubt, Doubt(doubt).name.lower()).format(limit=_limit(quantity, limit, by_default))


def _limit(quantity, limit, by_default):
    key = f"requirements.{quantity}.limit"
    if limit is None:
        return key
    return f"{limit:.4g} {UNITS[quantity][0]} ({key}{', by default' if by_default else ''})"
