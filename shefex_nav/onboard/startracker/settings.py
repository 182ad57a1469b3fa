"""Settings of the star tracker, for the scenario and for the software that flies."""

from typing import Literal

from shefex_nav.settings import Settings, choice, count, number, quantity, section, switch

MIN_VERIFIED = 4  # stars of an attitude that is found without a prediction


class ExposureControl(Settings):
    """Exposure and gain of the star camera, commanded frame by frame."""

    start: float = quantity("s", "40 ms", "exposure of the first frame", positive=True, at_most="100 s")
    shortest: float = quantity("s", "2 ms", "lower limit", positive=True, at_most="100 s")
    longest: float = quantity("s", "50 ms", "upper limit", positive=True, at_most="100 s")
    step: float = quantity("s", "2 ms", "change from frame to frame", positive=True, at_most="100 s")
    gain: float = quantity("dB", "24 dB", "of the amplifier, constant", at_least="0 dB", at_most="60 dB")
    brightest_mean: float = quantity(
        "DN", "100 DN", "a frame with a higher mean is saturated", positive=True, at_most="65535 DN"
    )
    fewest_objects: int = count("4", "with fewer there are no stars", positive=True)
    saturated_objects: int = count("4", "so many saturated objects shorten the exposure ...", positive=True)
    saturated_pixels: int = count("1", "... that have more than so many saturated pixels", non_negative=True)


class RunLength(Settings):
    """Clusters of pixels and their fusion from frame to frame, as in the literature."""

    threshold: float = quantity(
        "electron", "500 electron", "a pixel of an object is so far above", positive=True
    )
    window: int = count("256", "pixels of the moving average of the sky, a power of two", at_least=16)
    slowest: float = quantity("pix/s", "15 pix/s", "a slower star is a spot and not moved", non_negative=True)
    fusion_distance: float = quantity(
        "pix", "2 pix", "of a star in two frames", positive=True, at_most="100 pix"
    )


class Detection(Settings):
    """Objects in a frame."""

    scan: Literal["sequential", "maximum", "streaks", "run_length", "single_pixels"] = choice(
        "one pass over the frame; search of the brightest pixel again and again; along the "
        "streaks that the gyro rate predicts; clusters of two contiguous frames; or one pass over "
        "single pixels",
        "sequential",
    )
    centroid: Literal["fit", "weighted", "centre_of_mass", "gaussian_interpolation"] = choice(
        "fit of the spot's shape, or one of the literature", "fit"
    )
    tile: int = count(
        "48", "pixels, side of the tiles in which background and noise are measured", at_least=8
    )
    seed_sigma: float = number("6", "an object starts so far above the background", positive=True)
    grow_sigma: float = number("3", "and grows while it is so far above", positive=True)
    fewest_pixels: int = count("2", "smaller objects are noise", positive=True)
    most_pixels: int = count("200", "larger objects are no stars", positive=True)
    largest_peak: float = quantity(
        "", "80 %", "share of the light in one pixel; more is a hot pixel", positive=True, at_most="100 %"
    )
    most_objects: int = count("50", "length of the table", at_least=4, at_most=100_000)
    saturation: float = quantity(
        "DN", "255 DN", "grey value of a saturated pixel; automatic: the largest of the detector",
        "automatic", positive=True, at_most="65535 DN", words=(("automatic", 0.0),)
    )  # fmt: skip
    run_length: RunLength = section("settings of scan: run_length")


class Catalogue(Settings):
    """Stars on board."""

    kind: Literal["magnitude_limited", "asymmetric", "uniform", "combined"] = choice(
        "all stars to a magnitude; to another one in the south; thinned to an even spread; "
        "or the bright ones and an even fill"
    )
    system: Literal["V", "Hp", "silicon"] = choice(
        "of all magnitudes here: Johnson V, Hipparcos Hp or those of a bare silicon detector (Gaia's G)", "V"
    )
    faintest: float = quantity(
        "mag", "5.5 mag", "of the catalogue, or of the pool that is thinned", at_most="8 mag"
    )
    faintest_south: float | None = quantity(
        "mag", "5.4 mag", "asymmetric: south of the equator", None, at_most="8 mag"
    )
    merge_radius: float = quantity(
        "rad", "245 arcsec", "closer stars are one point of light", positive=True, at_most="1 deg"
    )
    keep_to: float = quantity("mag", "4.5 mag", "combined: all stars to here are kept", at_most="8 mag")
    size: int = count("2023", "uniform and combined: number of stars", at_least=100)


class Identification(Settings):
    """Which star is which."""

    method: Literal["bayes", "pyramid", "brightness", "voting", "multipole"] = choice(
        "odds against chance (the project's own), or one of the literature"
    )
    tracking: bool = switch(
        "look near the predicted attitude first, where three stars are enough; bayes only"
    )
    tolerance: float = quantity(
        "rad", "60 arcsec", "of the angle between two detections", positive=True, at_most="1 deg"
    )
    most_centroids: int = count("15", "the brightest, of which triangles are built", at_least=4)
    acceptance: Literal["verified", "published"] = choice(
        "every identification is verified against the whole field, or believed as its paper believes it, "
        "wrong attitudes included; not with bayes",
        "verified",
    )
    fewest_stars: int = count(
        "4", "identified stars without which there is no attitude; 3 with acceptance: published", at_least=3
    )
    centroid_error: float = quantity(
        "pix", "0.2 pix", "per axis, of an ordinary star", positive=True, at_most="100 pix"
    )
    gate_sigma: float = number("4", "a detection further off is not that star", positive=True)
    detection_probability: float = quantity(
        "", "90 %", "of a star brighter than the faintest found", positive=True, at_most="99.99 %"
    )
    magnitude_margin: float = quantity(
        "mag", "0.5 mag", "such a star is brighter by so much", at_least="0 mag"
    )
    magnitude_error: float = quantity("mag", "0.3 mag", "of an identified star, 1 sigma", at_least="0.01 mag")
    magnitude_tolerance: float = quantity(
        "mag", "1 mag", "multipole: of a measured magnitude against the catalogue's", at_least="0.01 mag"
    )
    cosine_error: float | None = number(
        "5.5e-5",
        "pyramid, published: of the cosine of such an angle, in place of tolerance (SHEFEX-2's cosError)",
        None,
        positive=True,
        at_most=0.01,
    )
    reference_magnitude: float | None = quantity(
        "mag",
        "2.4 mag",
        "brightness: a detection that looks brighter is surely brighter than 3 mag, and two others with it "
        "are enough; left out: four stars",
        None,
        at_most="3 mag",
    )
    false_alarm: float = number(
        "1e-6", "accepted probability that an attitude is chance", positive=True, at_most=0.01
    )
    deepest: float | None = quantity(
        "mag",
        "7 mag",
        "deep matching: once identified, fainter objects get their names too, to this magnitude of "
        "catalogue.system; left out: none",
        None,
        at_most="8 mag",
    )


def contradiction(settings):
    """What in settings of the identification contradicts itself: (key, words), or None.

    settings : Identification, as on board or as in a scenario
    """
    if settings.acceptance == "published":
        if settings.method == "bayes":
            return "acceptance", "'bayes' is published nowhere; write verified, or choose another method"
        if settings.method != "pyramid" and settings.cosine_error is not None:
            return "cosine_error", f"method {settings.method!r} has none; leave it out"
    elif settings.fewest_stars < MIN_VERIFIED:
        words = f"{settings.fewest_stars} stars prove nothing; write {MIN_VERIFIED}, or acceptance: published"
        return "fewest_stars", words
    elif settings.cosine_error is not None:
        return "cosine_error", "is of the published pyramid; write acceptance: published, or leave it out"
    if settings.reference_magnitude is not None and settings.method != "brightness":
        return "reference_magnitude", f"method {settings.method!r} has none; leave it out"
    return None


class StarTracker(Settings):
    """Star tracker software."""

    enabled: bool = switch("false: the mission flies without it")
    on: float = quantity("s", "222 s", "first frame")
    off: float = quantity("s", "394 s", "no frame from here on")
    rate: float = quantity(
        "Hz", "10 Hz", "frames a second; must divide 100 Hz", positive=True, at_most="100 Hz"
    )
    latency: float = quantity(
        "s", "30 ms", "processing, from picture in memory to attitude", non_negative=True, at_most="1 s"
    )
    highest_rate: float = quantity(
        "rad/s",
        "2.5 deg/s",
        "frames taken faster give no attitude; the window of reports ends at 2 deg/s, whatever this is",
        positive=True,
    )
    centroid_floor: float = quantity(
        "pix", "0.05 pix", "error of every centroid that no pixel's noise tells", non_negative=True
    )
    outlier_sigma: float = number(
        "4", "a star further from the attitude of the others is left out", positive=True
    )
    exposure: ExposureControl = section("")
    detection: Detection = section("")
    catalogue: Catalogue = section("")
    identification: Identification = section("")
