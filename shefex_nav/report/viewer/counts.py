"""How many objects of a frame the star tracker keeps, and how often that was too few."""

from typing import NamedTuple

from shefex_nav.report.configured import configured


class Limit(NamedTuple):
    """The length of the table of detections, against the frames of a run."""

    most: int  # objects of a frame, star_tracker.detection.most_objects
    reached: int  # frames that have so many: there may have been more
    frames: int  # that were searched


def limit(data):
    """Limit of a RunData; None where its scenario does not say, or cannot be read."""
    scenario = configured(data).scenario
    if scenario is None:
        return None
    most = scenario.star_tracker.detection.most_objects
    reached = sum(len(fix.hip) >= most for fix in data.star_fixes)
    return Limit(most, reached, len(data.star_fixes))
