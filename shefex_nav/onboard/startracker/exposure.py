"""Exposure control of the star camera (SHEFEX-2 star tracker, section 3.1 and figure 2).

In: the mean grey value of a frame and the objects found in it. Out: the two flags of the paper and the
exposure of the next frame. The gain stays where the scenario puts it.
"""

from typing import NamedTuple

import numpy as np


class ExposureParams(NamedTuple):
    """Settings of the control."""

    start_s: float  # exposure of the first frame
    min_s: float
    max_s: float
    step_s: float
    gain_db: float  # constant
    max_mean_dn: float  # mean grey value above which a frame does not show a star sky
    min_objects: int  # fewer than this: flagNoStars
    saturated_objects: int  # flagSaturated needs this many saturated objects ...
    saturated_pixels: int  # ... with more than this many saturated pixels each


def flags(params, mean_dn, detections):
    """(flagSaturated, flagNoStars) of one frame.

    A planet saturates many pixels of one object; shortening the exposure for it would lose the fainter
    stars, so several objects must be saturated. A frame that is bright as a whole is flagged by its mean.
    """
    saturated = np.count_nonzero(detections.n_saturated > params.saturated_pixels)
    flag_saturated = mean_dn > params.max_mean_dn or saturated >= params.saturated_objects
    return flag_saturated, len(detections.flux_dn) < params.min_objects


def next_exposure(params, exposure_s, flag_saturated, flag_no_stars):
    """Exposure of the next frame [s]: one step shorter, longer or the same.

    flagSaturated goes first: a bright frame without stars must not be exposed longer.
    """
    if flag_saturated:
        return max(params.min_s, exposure_s - params.step_s)
    if flag_no_stars:
        return min(params.max_s, exposure_s + params.step_s)
    return exposure_s
