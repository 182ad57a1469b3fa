"""The star tracker for the pictures of a camera whose file says nothing of a star tracker.

It is that of the default mission, with what follows from the camera: saturation by the bits of a grey value,
the way to look for objects by the shutter, how far stars are merged by the pixels, how deep its catalogue
goes by the field of view. There is no amplifier: `conversion` is that of the pictures.
"""

import numpy as np

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import solid_angle
from shefex_nav.scenario import lens, load
from shefex_nav.scenario.of_settings import settings

MISSION = "shefex2_andoya"
STARS = 30  # of the catalogue, in the field on average
DEEPEST = 8.0  # V
MERGED_PX = 3.0  # closer stars are one point of light
BRIGHT = 0.4  # mean of a picture that is too bright, as a share of the largest grey value
RATE = 1.0  # Hz: leaves time to read out all rows of any shutter; nothing else follows from it


def of_camera(sensor):
    """Section star_tracker for a section star_camera with optics and detector."""
    detector, hole = sensor.detector, lens.pinhole_of(sensor)
    usual = load.load(MISSION).star_tracker
    largest = 2**detector.bits - 1
    return usual.with_sections(
        rate=RATE,
        exposure=usual.exposure.with_sections(brightest_mean=BRIGHT * largest, gain=0.0),
        detection=usual.detection.with_sections(
            saturation=float(largest), scan="streaks" if detector.shutter == "rolling" else "sequential"
        ),
        catalogue=usual.catalogue.with_sections(
            faintest=faintest(hole), merge_radius=MERGED_PX / hole.focal_length_px
        ),
    )


def faintest(hole):
    """V of the faintest star, so that the field of a Pinhole holds STARS of them on average."""
    share = solid_angle(hole.width_px, hole.height_px, hole.focal_length_px) / (4.0 * np.pi)  # of the sky
    vmag = np.sort(load_catalogue(DEEPEST).vmag)
    return float(vmag[min(int(STARS / share), len(vmag) - 1)])


def checked(check):
    """A check of a camera file that has its star tracker, or this one. check : of checks_tracker"""

    def of_file(given):
        own = given.star_tracker
        yield from check(given if own else given.with_sections(star_tracker=of_camera(given.star_camera)))

    return of_file


def told(given):
    """Settings of the star tracker of a camera file, of its own or of this one; and its gain [dB]."""
    section = given.star_tracker or of_camera(given.star_camera)
    return settings(section), section.exposure.gain
