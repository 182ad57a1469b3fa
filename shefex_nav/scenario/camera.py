"""Section of a scenario about the star camera as it really is: optics, detector, errors, what disturbs it.

Values are floats in SI and radians once loaded; charges in electrons, grey values in DN.
"""

from typing import Literal

from pydantic import Field

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Count, Number, Quantity

Axis = tuple[Number("0"), Number("1"), Number("0")]


class Mounting(Block):
    """How the camera sits in the vehicle: two directions in body axes (x to the nose)."""

    boresight: Axis
    image_right: Axis
    error: Quantity("rad", "0.02 deg", "unknown rotation about each axis, 1 sigma", non_negative=True)


class Optics(Block):
    """Lens."""

    focal_length: Quantity("m", "25 mm", "calibrated, as the flight software knows it", positive=True)
    focal_length_error: Quantity("", "0.02 %", "what the calibration left, 1 sigma", non_negative=True)
    principal_point_error: Quantity("pix", "0.3 pix", "each axis, 1 sigma", non_negative=True)
    psf_sigma: Quantity("pix", "0.8 pix", "Gaussian image of a star", at_least="0.3 pix", at_most="5 pix")
    zero_magnitude_flux: Quantity(
        "electron/s", "2.5e6 electron/s", "from a star of magnitude 0", positive=True
    )


class Detector(Block):
    """Image sensor."""

    columns: Count("659", "pixels in a row", at_least=64, at_most=4096)
    rows: Count("493", "rows", at_least=64, at_most=4096)
    pixel_size: Quantity("m", "9.9 um", "square pixels", positive=True)
    background: Quantity("electron/s", "400 electron/s", "dark current and sky, per pixel", non_negative=True)
    read_noise: Quantity("electron", "16 electron", "1 sigma", positive=True)
    full_well: Quantity("electron", "30000 electron", "charge that a pixel can hold", positive=True)
    conversion: Quantity("electron/DN", "118 electron/DN", "at a gain of 0 dB", positive=True)
    black_level: Quantity("DN", "8 DN", "grey value without charge", non_negative=True, at_most="30000 DN")
    readout: Quantity("s", "10 ms", "end of exposure to picture in memory", non_negative=True)
    bits: Count("8", "of a grey value, which is at most 2^bits - 1", at_least=8, at_most=16)
    shutter: Literal["global", "rolling"] = Field(
        description="all rows are exposed at once, or one after the other"
    )
    line_time: (
        Quantity("s", "60 us", "rolling: from the start of one row to that of the next", positive=True) | None
    ) = None

    @property
    def line_s(self):
        """From the start of one row to that of the next; 0 with a global shutter."""
        return self.line_time if self.shutter == "rolling" and self.line_time else 0.0


class Stars(Block):
    """Which stars shine, and how well their brightness is known."""

    faintest: Quantity("mag", "7.5 mag", "V of the faintest star drawn", at_most="8 mag")
    brightness_error: Quantity("mag", "0.15 mag", "of each star, 1 sigma", at_least="0 mag")
    band: Literal["silicon", "V"] = Field(
        description="of a bare silicon detector, for which red stars are brighter; or the catalogue's own"
    )


class Artefacts(Block):
    """What the pictures show besides stars."""

    hot_pixels: Count("30", "found before flight", non_negative=True)
    hot_pixel_weakest: Quantity(
        "electron/s", "2000 electron/s", "their extra dark current, from", positive=True
    )
    hot_pixel_strongest: Quantity("electron/s", "100000 electron/s", "to", positive=True)
    dead_pixels: Count("10", "found before flight", non_negative=True)
    unknown_bad_pixels: Count("5", "hot pixels that appeared since", non_negative=True)
    false_objects: Count("200", "point sources in no catalogue, on the whole sky", non_negative=True)
    spikes_per_frame: Number("0.2", "spots in a single frame, mean number", non_negative=True)
    false_brightest: Quantity("mag", "3 mag", "brightness of both, from")
    false_faintest: Quantity("mag", "6 mag", "to")
    hot_pixel_smear: Quantity(
        "", "10 %", "of a hot pixel's charge, left in its column", non_negative=True, at_most="90 %"
    ) = "0 %"
    upsets_per_frame: Number("2", "particles that hit a pixel or a few, mean number", non_negative=True) = 0.0
    trails_per_frame: Number("0.5", "particles along the detector, mean number", non_negative=True) = 0.0
    particle_weakest: Quantity(
        "electron", "500 electron", "charge of an upset, or of a trail in each pixel, from", positive=True
    ) = "500 electron"  # [E]
    particle_strongest: Quantity("electron", "20000 electron", "to", positive=True) = "20000 electron"  # [E]
    trail_longest: Quantity("pix", "100 pix", "from one pixel to", at_least="1 pix") = "100 pix"  # [E]
    moving_objects: Count("300", "satellites and debris, on the whole sky", non_negative=True) = 0
    moving_slowest: Quantity("rad/s", "0.1 deg/s", "their rate, from", positive=True) = "0.1 deg/s"  # [E]
    moving_fastest: Quantity("rad/s", "2 deg/s", "to", positive=True) = "2 deg/s"  # [E]


class StrayLight(Block):
    """Sun and Earth: the angles within which they spoil a picture, and how."""

    sun_exclusion: Quantity("rad", "90 deg", "boresight to the Sun", positive=True, at_most="180 deg")
    earth_exclusion: Quantity("rad", "45 deg", "boresight to the limb", positive=True, at_most="180 deg")
    baffle: Quantity(
        "rad", "50 deg", "half angle within which light reaches the lens", positive=True, at_most="90 deg"
    )
    rate_at_exclusion: Quantity("electron/s", "200 electron/s", "per pixel", non_negative=True)
    tenfold_angle: Quantity("rad", "10 deg", "further in, stray light is ten times as bright", positive=True)
    direct_rate: Quantity("electron/s", "1e7 electron/s", "per pixel with the lens lit", positive=True)
    gradient: Quantity(
        "",
        "20 %",
        "more in the corner on the Sun's side than in the middle",
        non_negative=True,
        at_most="100 %",
    ) = "0 %"


class StarCamera(Block):
    """Star camera, in the world."""

    mounting: Mounting
    optics: Optics
    detector: Detector
    stars: Stars
    artefacts: Artefacts
    stray_light: StrayLight
