"""A frame in a line: whether its pixels are kept, and what the star tracker made of it."""

from types import SimpleNamespace

import numpy as np

from shefex_nav.records import Reason
from shefex_nav.runs.frames import Frames, SeenFrame


def seen(image_dn, is_full, reason):
    fix = None if reason is None else SimpleNamespace(reason=reason)
    return repr(SeenFrame(7, 32.09, 0.18, 0.0, image_dn, is_full, fix, None))


def test_a_frame_in_a_line():
    none = seen(None, False, Reason.TOO_FEW_STARS)
    assert none == (
        "<SeenFrame 7 of T+32.09 s, no pixels, the log keeps none of it (log.frames in the scenario), "
        "star tracker: too few stars>"
    )
    image = np.zeros((3, 4), dtype=np.uint8)
    assert seen(image, True, Reason.NONE) == (
        "<SeenFrame 7 of T+32.09 s, 4 x 3 pixels, star tracker: attitude>"
    )
    assert "4 x 3 pixels, the sky cut off, star tracker: no answer" in seen(image, False, None)


def test_frames_in_a_line():
    def line(t_s):
        frames = SimpleNamespace(t_valid_s=np.array(t_s))
        return repr(Frames(SimpleNamespace(star_fixes=[], frame_truths=[], frames=frames), None))

    assert line([]) == "<Frames: none>"
    assert line([-0.5, 2.25]) == "<Frames: 2, T-0.50 to +2.25 s; [t_s] gives the nearest>"
