"""Our identification and our tracker as the experiments set them; each replaces what its paper has."""

import numpy as np

from shefex_nav.onboard.startracker import tracker
from shefex_nav.onboard.startracker.identify.verify import IdentifyParams

IDENTIFY = IdentifyParams(
    method="bayes",
    camera=None,
    tolerance=0.0,
    max_centroids=15,
    min_stars=4,
    sigma_px=0.2,
    gate_sigma=4.5,
    detection_probability=0.9,
    magnitude_margin=0.3,
    magnitude_sigma=0.3,
    false_alarm=1e-7,
)


def tracker_params(detect, identify, exposure=None):
    """TrackerParams of a camera on a bench: no aberration, no latency, nothing excluded."""
    return tracker.TrackerParams(
        catalogue=None,
        detect=detect,
        identify=identify,
        exposure=exposure,
        earth_velocity_i=np.zeros(3),
        centroid_floor_px=0.03,
        outlier_sigma=4.0,
        latency_s=0.0,
        max_rate=np.inf,
        sun_exclusion=0.0,
        limb_exclusion=-np.inf,
    )
