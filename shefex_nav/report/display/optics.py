"""Which dots of a screen a frame fills, and how bright they are.

The screen stands in the focal plane of a collimator of focal length F, or at the distance F from the camera.
A pixel of the frame is seen at an angle whose tangent is 1/f, f being the focal length of the simulated
camera in pixels. So it is F/f wide on the screen, and F/(f p) dots of the pitch p: frame and screen are both
planes across the line of sight, and one factor fits all of the field.

The luminance of a dot is taken to be proportional to (code/255)^gamma.
"""

from typing import NamedTuple

import numpy as np

CODES = 256  # of a dot


class Display(NamedTuple):
    """A screen and how it is used."""

    dots: float  # of the screen, a pixel of the frame
    gamma: float
    white_dn: float  # grey value that is shown with all light


def dots_per_pixel(focal_length_px, collimator_m, pitch_m):
    """Dots of the screen a pixel of the frame, along each axis. Focal length of the camera, m, m"""
    return collimator_m / (focal_length_px * pitch_m)


def codes(display):
    """Code of a dot for every grey value: (65536,) uint8. Display"""
    light = np.clip(np.arange(65536) / display.white_dn, 0.0, 1.0)
    return np.rint((CODES - 1) * light ** (1.0 / display.gamma)).astype(np.uint8)


def drawn(image_dn, display, table):
    """A frame as dots of the screen: light is interpolated linearly between the pixels.

    image_dn : (rows, columns) grey values;  table : of `codes`
    -> (rows * dots, columns * dots) uint8
    """
    from PIL import Image

    if display.dots == 1.0:
        return table[image_dn]
    size = tuple(max(1, round(n * display.dots)) for n in image_dn.shape[::-1])
    scaled = Image.fromarray(image_dn.astype(np.float32)).resize(size, Image.Resampling.BILINEAR)
    return table[np.rint(np.asarray(scaled)).clip(0, 65535).astype(np.uint16)]
