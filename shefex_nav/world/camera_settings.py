"""Settings of the star camera as it really is: optics, detector, errors, what disturbs it.

Charges are in electrons, grey values in DN.
"""

from typing import Literal

import numpy as np

from shefex_nav.settings import Settings, choice, count, number, quantity, section


class Mounting(Settings):
    """How the camera sits in the vehicle: two directions in body axes (x to the nose)."""

    boresight: tuple[float, float, float] = number(("0", "1", "0"), "direction of the boresight")
    image_right: tuple[float, float, float] = number(("1", "0", "0"), "direction of image right")
    error: float = quantity(
        "rad", "0.02 deg", "unknown rotation about each axis, 1 sigma", non_negative=True, at_most="180 deg"
    )

    @property
    def C_bc(self):
        """Nominal rotation (3, 3): its columns are image right, image down and boresight in body axes."""
        boresight_b = np.array(self.boresight)
        boresight_b /= np.linalg.norm(boresight_b)
        right_b = np.array(self.image_right)
        right_b -= (right_b @ boresight_b) * boresight_b  # a scenario holds the angle to 90 deg, nearly
        right_b /= np.linalg.norm(right_b)
        return np.column_stack([right_b, np.cross(boresight_b, right_b), boresight_b])


class Optics(Settings):
    """Lens."""

    focal_length: float = quantity(
        "m", "25 mm", "calibrated, as the flight software knows it", positive=True, at_most="100 m"
    )
    focal_length_error: float = quantity(
        "", "0.02 %", "what the calibration left, 1 sigma", non_negative=True
    )
    principal_point: tuple[float, float] | None = quantity(
        "pix",
        ("328.7 pix", "246.2 pix"),
        (
            "where the optical axis meets the detector, column, the first is 0; left out: the middle",
            "row, the first is 0",
        ),
        None,
    )
    principal_point_error: float = quantity("pix", "0.3 pix", "each axis, 1 sigma", non_negative=True)
    distortion: tuple[float, float, float, float, float] | None = number(
        ("-0.3", "0.1", "0.0002", "-0.0001", "0"),
        (
            "k1 of Brown and Conrady, in OpenCV's order, from the ideal to the distorted picture; left out: "
            "a lens without distortion",
            "k2",
            "p1",
            "p2",
            "k3; 0 where a calibration has four coefficients",
        ),
        None,
    )
    psf_sigma: float = quantity(
        "pix", "0.8 pix", "Gaussian image of a star", at_least="0.3 pix", at_most="5 pix"
    )
    zero_magnitude_flux: float | None = quantity(
        "electron/s",
        "2.5e6 electron/s",
        "from a star of magnitude 0; left out: follows from lens and detector",
        None,
        positive=True,
    )
    f_number: float | None = number(
        "1.4", "focal length over aperture; in place of the flux", None, at_least=0.5
    )
    aperture: float | None = quantity(
        "m", "18 mm", "diameter of the pupil, in the place of f_number", None, positive=True, at_most="100 m"
    )
    transmission: float | None = quantity(
        "", "80 %", "of lens, filters and windows, mean over the band", None, positive=True, at_most="100 %"
    )


class Detector(Settings):
    """Image sensor."""

    columns: int = count("659", "pixels in a row", at_least=64, at_most=4096)
    rows: int = count("493", "rows", at_least=64, at_most=4096)
    pixel_size: float = quantity("m", "9.9 um", "square pixels", positive=True, at_most="10 mm")
    background: float = quantity(
        "electron/s", "400 electron/s", "dark current and sky, per pixel", non_negative=True
    )
    read_noise: float = quantity("electron", "16 electron", "1 sigma", positive=True)
    full_well: float = quantity("electron", "30000 electron", "charge that a pixel can hold", positive=True)
    conversion: float = quantity("electron/DN", "118 electron/DN", "at a gain of 0 dB", positive=True)
    black_level: float = quantity(
        "DN", "8 DN", "grey value without charge", non_negative=True, at_most="30000 DN"
    )
    readout: float = quantity(
        "s", "10 ms", "end of exposure to picture in memory", non_negative=True, at_most="100 s"
    )
    bits: int = count("8", "of a grey value, which is at most 2^bits - 1", at_least=8, at_most=16)
    shutter: Literal["global", "rolling"] = choice("all rows are exposed at once, or one after the other")
    line_time: float | None = quantity(
        "s",
        "60 us",
        "rolling: from the start of one row to that of the next",
        None,
        positive=True,
        at_most="1 s",
    )
    quantum_efficiency: float | None = quantity(
        "", "60 %", "at 550 nm, of a pixel as a whole; in place of the flux", None, positive=True,
        at_most="100 %",
    )  # fmt: skip

    @property
    def line_s(self):
        """From the start of one row to that of the next; 0 with a global shutter."""
        return self.line_time if self.shutter == "rolling" and self.line_time else 0.0


class Stars(Settings):
    """Which stars shine, and how well their brightness is known."""

    faintest: float = quantity("mag", "7.5 mag", "V of the faintest star drawn", at_most="8 mag")
    brightness_error: float = quantity("mag", "0.15 mag", "of each star, 1 sigma", at_least="0 mag")
    band: Literal["silicon", "V"] = choice(
        "of a bare silicon detector, for which red stars are brighter; or the catalogue's own"
    )


class Artefacts(Settings):
    """What the pictures show besides stars."""

    hot_pixels: int = count("30", "found before flight", non_negative=True)
    hot_pixel_weakest: float = quantity(
        "electron/s", "2000 electron/s", "their extra dark current, from", positive=True
    )
    hot_pixel_strongest: float = quantity("electron/s", "100000 electron/s", "to", positive=True)
    dead_pixels: int = count("10", "found before flight", non_negative=True)
    unknown_bad_pixels: int = count("5", "hot pixels that appeared since", non_negative=True)
    false_objects: int = count(
        "200", "point sources in no catalogue, on the whole sky", non_negative=True, at_most=1_000_000
    )
    spikes_per_frame: float = number(
        "0.2", "spots in a single frame, mean number", non_negative=True, at_most=10_000
    )
    false_brightest: float = quantity("mag", "3 mag", "brightness of both, from")
    false_faintest: float = quantity("mag", "6 mag", "to")
    hot_pixel_smear: float = quantity(
        "", "10 %", "of a hot pixel's charge, left in its column", "0 %", non_negative=True, at_most="90 %"
    )
    upsets_per_frame: float = number(
        "2", "particles that hit a pixel or a few, mean number", 0.0, non_negative=True, at_most=1_000_000
    )
    trails_per_frame: float = number(
        "0.5", "particles along the detector, mean number", 0.0, non_negative=True, at_most=10_000
    )
    particle_weakest: float = quantity(
        "electron",
        "500 electron",
        "charge of an upset, or of a trail in each pixel, from",
        "500 electron",
        positive=True,
    )  # [E]
    particle_strongest: float = quantity(
        "electron", "20000 electron", "to", "20000 electron", positive=True
    )  # [E]
    trail_longest: float = quantity("pix", "100 pix", "from one pixel to", "100 pix", at_least="1 pix")  # [E]
    moving_objects: int = count(
        "300", "satellites and debris, on the whole sky", 0, non_negative=True, at_most=1_000_000
    )
    moving_slowest: float = quantity(
        "rad/s", "0.1 deg/s", "their rate, from", "0.1 deg/s", positive=True
    )  # [E]
    moving_fastest: float = quantity("rad/s", "2 deg/s", "to", "2 deg/s", positive=True)  # [E]


class StrayLight(Settings):
    """Sun and Earth: the angles within which they spoil a picture, and how."""

    sun_exclusion: float = quantity("rad", "90 deg", "boresight to the Sun", positive=True, at_most="180 deg")
    earth_exclusion: float = quantity(
        "rad", "45 deg", "boresight to the limb", positive=True, at_most="180 deg"
    )
    baffle: float = quantity(
        "rad", "50 deg", "half angle within which light reaches the lens", positive=True, at_most="90 deg"
    )
    rate_at_exclusion: float = quantity("electron/s", "200 electron/s", "per pixel", non_negative=True)
    tenfold_angle: float = quantity(
        "rad", "10 deg", "further in, stray light is ten times as bright", positive=True, at_most="180 deg"
    )
    direct_rate: float = quantity(
        "electron/s", "1e7 electron/s", "per pixel with the lens lit", positive=True
    )
    gradient: float = quantity(
        "",
        "20 %",
        "more in the corner on the Sun's side than in the middle",
        "0 %",
        non_negative=True,
        at_most="100 %",
    )


class StarCamera(Settings):
    """Star camera, in the world."""

    mounting: Mounting = section()
    optics: Optics = section()
    detector: Detector = section()
    stars: Stars = section()
    artefacts: Artefacts = section()
    stray_light: StrayLight = section()
