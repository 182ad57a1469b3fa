"""Sections of a scenario about the software that flies: star tracker and navigation filter.

Values are floats in SI and radians once loaded. What the filter assumes of the sensors is taken from their
sections unless it is told otherwise in `navigation`.
"""

from typing import Any, ClassVar, Literal

from pydantic import Field, StrictBool

from shefex_nav.onboard.navigation import settings
from shefex_nav.scenario.block import AUTOMATIC, Block, tagged
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.quantity import Count, Number, Quantity, Time
from shefex_nav.scenario.star_statistics import Model
from shefex_nav.scenario.told import Told


class ExposureControl(Block):
    """Exposure and gain of the star camera, commanded frame by frame."""

    start: Quantity("s", "40 ms", "exposure of the first frame", positive=True)
    shortest: Quantity("s", "2 ms", "lower limit", positive=True)
    longest: Quantity("s", "50 ms", "upper limit", positive=True)
    step: Quantity("s", "2 ms", "change from frame to frame", positive=True)
    gain: Quantity("dB", "24 dB", "of the amplifier, constant", at_least="0 dB", at_most="60 dB")
    brightest_mean: Quantity(
        "DN", "100 DN", "a frame with a higher mean is saturated", positive=True, at_most="65535 DN"
    )
    fewest_objects: Count("4", "with fewer there are no stars", positive=True)
    saturated_objects: Count("4", "so many saturated objects shorten the exposure ...", positive=True)
    saturated_pixels: Count("1", "... that have more than so many saturated pixels", non_negative=True)


class RunLength(Block):
    """Clusters of pixels and their fusion from frame to frame, as in the literature."""

    threshold: Quantity("electron", "500 electron", "a pixel of an object is so far above", positive=True)
    window: Count("256", "pixels of the moving average of the sky, a power of two", at_least=16)
    slowest: Quantity("pix/s", "15 pix/s", "a slower star is a spot and not moved", non_negative=True)
    fusion_distance: Quantity("pix", "2 pix", "of a star in two frames", positive=True, at_most="100 pix")


class Detection(Block):
    """Objects in a frame."""

    scan: Literal["sequential", "maximum", "streaks", "run_length"] = Field(
        "sequential",
        description="one pass over the frame; search of the brightest pixel again and again; along the "
        "streaks that the gyro rate predicts; or clusters of two contiguous frames",
    )
    centroid: Literal["fit", "weighted", "centre_of_mass", "gaussian_interpolation"] = Field(
        "fit", description="fit of the spot's shape, or one of the literature"
    )
    tile: Count("48", "pixels, side of the tiles in which background and noise are measured", at_least=8)
    seed_sigma: Number("6", "an object starts so far above the background", positive=True)
    grow_sigma: Number("3", "and grows while it is so far above", positive=True)
    fewest_pixels: Count("2", "smaller objects are noise", positive=True)
    most_pixels: Count("200", "larger objects are no stars", positive=True)
    largest_peak: Quantity(
        "", "80 %", "share of the light in one pixel; more is a hot pixel", positive=True, at_most="100 %"
    )
    most_objects: Count("50", "length of the table", at_least=4)
    saturation: Quantity("DN", "255 DN", "grey value of a saturated pixel", positive=True, at_most="65535 DN")
    run_length: RunLength = Field(description="settings of scan: run_length")


class Catalogue(Block):
    """Stars on board."""

    kind: Literal["magnitude_limited", "asymmetric", "uniform", "combined"] = Field(
        description="all stars to a magnitude; to another one in the south; thinned to an even spread; "
        "or the bright ones and an even fill"
    )
    system: Literal["V", "Hp"] = Field("V", description="of all magnitudes here: Johnson V or Hipparcos Hp")
    faintest: Quantity("mag", "5.5 mag", "of the catalogue, or of the pool that is thinned", at_most="8 mag")
    faintest_south: Quantity("mag", "5.4 mag", "asymmetric: south of the equator", at_most="8 mag") | None = (
        None
    )
    merge_radius: Quantity(
        "rad", "245 arcsec", "closer stars are one point of light", positive=True, at_most="1 deg"
    )
    keep_to: Quantity("mag", "4.5 mag", "combined: all stars to here are kept", at_most="8 mag")
    size: Count("2023", "uniform and combined: number of stars", at_least=100)


class Identification(Block):
    """Which star is which."""

    method: Literal["bayes", "pyramid", "brightness", "voting", "multipole"] = Field(
        description="odds against chance (the project's own), or one of the literature"
    )
    tracking: StrictBool = Field(
        description="look near the predicted attitude first, where three stars are enough; bayes only"
    )
    tolerance: Quantity(
        "rad", "60 arcsec", "of the angle between two detections", positive=True, at_most="1 deg"
    )
    most_centroids: Count("15", "the brightest, of which triangles are built", at_least=4)
    fewest_stars: Count("4", "identified stars without which there is no attitude", at_least=4)
    centroid_error: Quantity("pix", "0.2 pix", "per axis, of an ordinary star", positive=True)
    gate_sigma: Number("4", "a detection further off is not that star", positive=True)
    detection_probability: Quantity(
        "", "90 %", "of a star brighter than the faintest found", positive=True, at_most="99.99 %"
    )
    magnitude_margin: Quantity("mag", "0.5 mag", "such a star is brighter by so much", at_least="0 mag")
    magnitude_error: Quantity("mag", "0.3 mag", "of an identified star, 1 sigma", at_least="0.01 mag")
    magnitude_tolerance: Quantity(
        "mag", "1 mag", "multipole: of a measured magnitude against the catalogue's", at_least="0.01 mag"
    )
    false_alarm: Number(
        "1e-6", "accepted probability that an attitude is chance", positive=True, at_most=0.01
    )


class StarTracker(Block):
    """Star tracker software."""

    enabled: StrictBool = Field(description="false: the mission flies without it")
    on: Time("222 s", "first frame")
    off: Time("394 s", "no frame from here on")
    rate: Quantity("Hz", "10 Hz", "frames a second; must divide 100 Hz", positive=True, at_most="100 Hz")
    latency: Quantity(
        "s", "30 ms", "processing, from picture in memory to attitude", non_negative=True, at_most="1 s"
    )
    highest_rate: Quantity(
        "rad/s", "2.5 deg/s", "frames taken faster are smeared and give no attitude", positive=True
    )
    centroid_floor: Quantity(
        "pix", "0.05 pix", "error of every centroid that no pixel's noise tells", non_negative=True
    )
    outlier_sigma: Number("4", "a star further from the attitude of the others is left out", positive=True)
    exposure: ExposureControl
    detection: Detection
    catalogue: Catalogue
    identification: Identification
    frames: Literal["rendered", "statistical"] = Field(
        "rendered",
        description="pictures are drawn and searched; or what would be found follows from statistics, "
        "which takes a tenth of the time",
    )
    model: Model | None = Field(
        None, description="file of `shefex-nav characterise` with the statistics, relative to this one"
    )


def _states_form(value):
    return f"<{AUTOMATIC}>" if isinstance(value, str) else "<names>"


class Navigation(section(settings.Navigation)):
    __doc__ = settings.Navigation.__doc__
    NAME: ClassVar[str] = "Navigation"

    states: Any = AUTOMATIC  # `states_field`
    told: Told = Field(default_factory=Told, description=Told.HELP)

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
