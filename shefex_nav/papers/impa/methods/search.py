"""Search of a frame by run lengths: clusters that were in the frame before, at the frame's instant.

Streaks tell their own motion; its direction comes from the frame before, whose exposure must end where this
one begins.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.shutter import row_times
from shefex_nav.onboard.startracker.background import FrameStatistics
from shefex_nav.onboard.startracker.objects import Found
from shefex_nav.papers.impa.methods import chain
from shefex_nav.papers.impa.methods.clusters import Clusters
from shefex_nav.papers.impa.methods.compensate import EXTENT_PX
from shefex_nav.records import Scan

CONTIGUOUS = 1e-3  # of the exposure: gap between two frames that is none


class Memory(NamedTuple):
    """What the next frame needs of this one."""

    t_valid_s: float
    exposure_s: float
    clusters: Clusters


def by_run_length(params, stars, memory, frame, context):
    """As `objects.as_spots`; memory is a Memory.

    The extents of all streaks are too long or too short by much the same, which moves all stars as a wrong
    rate does.
    """
    camera = params.camera
    previous = memory.clusters if follows(memory, frame) else None
    times = row_times(frame.exposure_s, frame.line_s, frame.image_dn.shape[0])
    clusters, found = chain.objects(params.settings.detection, camera, times, previous, frame.image_dn)
    statistics = FrameStatistics(clusters.mean_dn, clusters.background_dn, clusters.noise_dn)
    kept = Memory(frame.t_valid_s, frame.exposure_s, clusters)
    t_s = frame.line_s * (found.xy_px[:, 1] - times.middle_row)
    sigma = EXTENT_PX / (frame.exposure_s * camera.pinhole.focal_length_px)
    yield Found(found, statistics, int(Scan.RUN_LENGTH), True, kept, (t_s, sigma**2 * np.eye(3)))


def follows(memory, frame):
    """Whether a frame's exposure begins where that of the one before ended. Memory or None, Frame -> bool."""
    if memory is None or memory.exposure_s != frame.exposure_s:
        return False
    return abs(frame.t_valid_s - memory.t_valid_s - frame.exposure_s) < CONTIGUOUS * frame.exposure_s
