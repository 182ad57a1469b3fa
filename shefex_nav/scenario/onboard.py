"""Sections of a scenario about the software that flies: star tracker and navigation filter.

Values are floats in SI and radians once loaded. What the filter assumes of the sensors is taken from their
sections unless it is told otherwise in `navigation`.
"""

from typing import Any, ClassVar, Literal

from pydantic import Field

from shefex_nav.onboard.navigation import settings
from shefex_nav.onboard.startracker import settings as startracker
from shefex_nav.scenario.block import AUTOMATIC, Block, tagged
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.quantity import Count, Number, Quantity
from shefex_nav.scenario.software import BUILT_IN, Software
from shefex_nav.scenario.star_statistics import Model
from shefex_nav.scenario.told import Told


class StarTracker(section(startracker.StarTracker)):
    """Star tracker software."""

    frames: Literal["rendered", "statistical"] = Field(
        "rendered",
        description="pictures are drawn and searched; or what would be found follows from statistics, "
        "which takes a tenth of the time",
    )
    model: Model | None = Field(
        None, description="file of `shefex-nav characterise` with the statistics, relative to this one"
    )
    software: Software = Field(
        BUILT_IN, description="what searches the pictures: built_in, or software of your own"
    )


class Computer(Block):
    """The computer on board, with star tracker and navigation."""

    software: Software = Field(
        BUILT_IN, description="built_in, which runs star_tracker and navigation; or a computer of your own"
    )


def _states_form(value):
    return f"<{AUTOMATIC}>" if isinstance(value, str) else "<names>"


class Navigation(section(settings.Navigation)):
    __doc__ = settings.Navigation.__doc__
    NAME: ClassVar[str] = "Navigation"

    states: Any = AUTOMATIC  # `states_field`
    told: Told = Field(default_factory=Told, description=Told.HELP)
    software: Software = Field(
        BUILT_IN, description="what navigates: the built_in filter, or software of your own"
    )

    @classmethod
    def states_field(cls, block):
        """Type and FieldInfo of `states`. block : Literal of the names of all blocks"""
        return tagged(_states_form, {AUTOMATIC: Literal["automatic"], "names": list[block]}), Field(
            default=AUTOMATIC,
            description="what is estimated besides: errors of the sensors, each a block of states; "
            "automatic: those that swamp the noise of the sensors in the planned flight",
        )


class FrameLog(Block):
    """Which pictures of the star camera are kept."""

    full_every: Count("100", "every n-th frame in full; 0 = never", non_negative=True)
    otherwise: Literal["thresholded", "none"] = Field(
        description="the other frames: with the sky background set to zero, or not at all"
    )
    threshold_sigma: Number("4", "what counts as sky background", positive=True)


class Log(Block):
    """What is logged."""

    rate: Quantity("Hz", "100 Hz", "of truth, IMU and solution: 10, 20, 50 or 100 Hz", positive=True) = (
        "100 Hz"
    )
    frames: FrameLog
