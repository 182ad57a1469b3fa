"""What arrays of a rendered run can be, looked at before a fit is made of those that a folder has.

A file that a power failure cut off is flown again. One that is whole and says what no run gives has been
changed by somebody: fitting it would give statistics of something else.
"""

import numpy as np

from shefex_nav.campaign.characterise.collect import Frames, Searches, Sources
from shefex_nav.records import Reason

MOST = 1e15  # of any number
WIDTHS = {  # of arrays with more than a number a row
    (Frames, "error"): 3, (Frames, "sigma"): 3, (Sources, "features"): 3, (Sources, "along"): 4,
    (Sources, "across"): 4, (Sources, "error"): 2, (Sources, "reported"): 2, (Searches, "error"): 3,
}  # fmt: skip
FLAGS = "first", "clear", "found", "named", "saturated", "matched", "good"
COUNTS = "frame", "hip", "reason", "stars", "objects", "strangers"
UNKNOWN = "error", "sigma", "reported"  # NaN where there is no fix, or nothing was found
NEVER_NEGATIVE = "rate", "exposure_s", "length_px", "sigma", "reported", *COUNTS


def fault(collected, settings, code):
    """Words about what cannot be in a run that is kept, with its array; '' if all can."""
    if not isinstance(settings, dict) or not isinstance(code, str):
        return "about: expected settings and a digest of the program"
    for name, part in zip(collected._fields, collected, strict=True):
        rows = len(part[0]) if part[0].ndim else 0
        for field, values in zip(part._fields, part, strict=True):
            if words := _fault(type(part), field, values, rows):
                return f"{name}.{field}: {words}"
    frames, sources = collected.frames, collected.sources
    if len(sources.frame) and sources.frame.max() >= len(frames.t_s):
        return f"sources.frame: got {sources.frame.max()}, expected a row of {len(frames.t_s)} frames"
    if len(frames.reason) and frames.reason.max() > max(Reason):
        return f"frames.reason: got {frames.reason.max()}, expected 0 to {max(Reason)}"
    if not (np.diff(frames.t_s) > 0.0).all():
        return "frames.t_s: expected times that increase"
    return ""


def _fault(part, field, values, rows):
    """Words about an array."""
    width = WIDTHS.get((part, field))
    shape = (rows,) if width is None else (rows, width)
    if values.shape != shape and not (values.size == 0 and rows == 0):
        return f"got an array of {_size(values.shape)}, expected {_size(shape)}"
    kinds, words = ("b", "flags") if field in FLAGS else ("iu", "whole numbers")
    if field not in FLAGS + COUNTS:
        kinds, words = "f", "numbers"
    if values.size and values.dtype.kind not in kinds:
        return f"got {values.dtype}, expected {words}"
    if kinds == "f":
        bad = ~(np.abs(values) < MOST) & ~(np.isnan(values) & (field in UNKNOWN))
        if bad.any():
            return f"got {values[bad][0]:g}, expected numbers below {MOST:g}"
    if field in NEVER_NEGATIVE and (values < 0).any():
        return f"got {values[values < 0][0]:g}, expected none below 0"
    return ""


def _size(shape):
    return " x ".join(map(str, shape)) or "a single number"
