"""The frames of a log as a screen gets them, by number: which dots each fills, and how bright.

The screen stands in the focal plane of a collimator of focal length F, or at the distance F from the camera.
A pixel of the frame is seen at an angle whose tangent is 1/f, f being the focal length of the simulated
camera in pixels. So it is F/f wide on the screen, and F/(f p) dots of the pitch p: frame and screen are both
planes across the line of sight, and one factor fits all of the field.

The luminance of a dot is taken to be proportional to (code/255)^gamma.
"""

from io import BytesIO
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from shefex_nav.log import pixels
from shefex_nav.log.topics import LogError, epoch_ns, log_time_ns

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


class Player:
    """The frames of a run that can be shown.

    log : path;  data : its RunData
    display : Display

    LogError if there are none.
    """

    def __init__(self, log, data, display):
        self._log, self._display, self._codes = log, display, codes(display)
        epoch = epoch_ns(data.mission.epoch_utc)
        kept = {}  # log time -> whether they are kept as read out alone
        for one in pixels.between(log):
            kept[one.ns] = one.is_full and kept.get(one.ns, True)
        times = zip(
            log_time_ns(epoch, data.frames.t_valid_s).tolist(), data.frames.t_valid_s.tolist(), strict=True
        )
        self._frames = [(ns, t_s) for ns, t_s in times if ns in kept]
        if not self._frames:
            raise LogError(f"{log}: keeps no pixels of frames (log.frames in its scenario)")
        self.noisy = sum(kept.values())  # have the background of the sky

    def times_s(self):
        """Mission times of the frames: list, s."""
        return [t_s for _, t_s in self._frames]

    def png(self, k):
        """Frame k of `times_s` as a PNG picture of the screen's dots: bytes. IndexError"""
        from PIL import Image

        ns = self._frames[k][0]
        # without the background of the sky if it is kept so: the noise of one camera is not for another
        found = min(pixels.between(self._log, ns, ns + 1), key=attrgetter("is_full"))
        stored = BytesIO()
        Image.fromarray(drawn(found.image_dn, self._display, self._codes)).save(
            stored, "PNG", compress_level=1
        )
        return stored.getvalue()
