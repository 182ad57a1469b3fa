"""Whether the frames of late deny what the star tracker is told of its camera.

A lens that is not as it is told has its stars elsewhere in every frame. Nearly all such frames are refused
for their residuals, a right one is once in a thousand; but now and then a few stars fit each other, and make
an attitude whose covariance knows nothing of the rest. While most frames are refused, it is not given out.

The memory is of frames, not of time: a lens does not get better while none are taken. After a disturbance
that made residuals and is over, up to 14 good frames are withheld.
"""

from shefex_nav.records import Reason

RECENT = 20  # frames, over which the share is averaged
MOST = 0.5  # share of them that may be refused for residuals


def is_denied(share):
    """Whether an attitude is not to be given out. share : of `after` the frame before"""
    return share > MOST


def after(share, reason):
    """Share of late frames refused for residuals, of those that had an attitude or residuals.

    share : before this frame, 0 at the start;  reason : Reason of this frame by itself
    """
    if reason not in (Reason.NONE, Reason.RESIDUALS):
        return share
    return share + ((reason == Reason.RESIDUALS) - share) / RECENT
