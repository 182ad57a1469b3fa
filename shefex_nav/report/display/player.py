"""The frames of a log as a screen gets them, by number."""

from io import BytesIO
from operator import attrgetter

from shefex_nav.log import pixels
from shefex_nav.log.topics import LogError, epoch_ns, log_time_ns
from shefex_nav.report.display import optics


class Player:
    """The frames of a run that can be shown.

    log : path;  data : its RunData
    display : optics.Display

    LogError if there are none.
    """

    def __init__(self, log, data, display):
        self._log, self._display, self._codes = log, display, optics.codes(display)
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
        Image.fromarray(optics.drawn(found.image_dn, self._display, self._codes)).save(
            stored, "PNG", compress_level=1
        )
        return stored.getvalue()
