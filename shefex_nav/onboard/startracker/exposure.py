"""Exposure control of the star camera (SHEFEX-2 star tracker, section 3.1 and figure 2).

In: the mean grey value of a frame and the objects found in it. Out: the two flags of the paper and the
exposure of the next frame. The gain stays where the scenario puts it.
"""

import numpy as np


def flags(settings, mean_dn, detections):
    """(flagSaturated, flagNoStars) of one frame. ExposureControl, float, Detections

    A planet saturates many pixels of one object; shortening the exposure for it would lose the fainter
    stars, so several objects must be saturated. A frame that is bright as a whole is flagged by its mean.
    """
    saturated = np.count_nonzero(detections.n_saturated > settings.saturated_pixels)
    flag_saturated = mean_dn > settings.brightest_mean or saturated >= settings.saturated_objects
    return flag_saturated, len(detections.flux_dn) < settings.fewest_objects


def next_exposure(settings, exposure_s, flag_saturated, flag_no_stars):
    """Exposure of the next frame [s]: one step shorter, longer or the same.

    flagSaturated goes first: a bright frame without stars must not be exposed longer.
    """
    if flag_saturated:
        return max(settings.shortest, exposure_s - settings.step)
    if flag_no_stars:
        return min(settings.longest, exposure_s + settings.step)
    return exposure_s
