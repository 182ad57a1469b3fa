"""What a lens does at the edges of a picture: whether it is one there, and how far it sees. Compiled.

In: focal length [px], distortion (5,) of `distortion`, (width, height) of the picture as floats. The axis is
in the middle of the picture. Of one elsewhere, the picture is told that is as wide to either side as to the
farther one: the detector and its mirror image about the axis.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.distortion import BEHIND, bent_one, slopes_one, straight_one

ALONG = 20  # points from the axis to a corner
SAME_PX = 1.0  # of a corner, there and back


@inner
def corner(focal_px, k, size_px, n):
    """Corner number n (0 to 3): x, y as the lens shows it, and of the ideal pinhole, all over f."""
    u, v = (n % 2 - 0.5) * size_px[0] / focal_px, (n // 2 - 0.5) * size_px[1] / focal_px
    return u, v, *straight_one(k, u, v)


@kernel
def is_lens(focal_px, k, size_px):
    """Whether each corner is the image of one direction: a polynomial may fold, where few stars hold it."""
    for n in range(4):
        u, v, x, y = corner(focal_px, k, size_px, n)
        if not 1.0 / np.sqrt(1.0 + x * x + y * y) > BEHIND:
            return False
        again_u, again_v = bent_one(k, x, y)
        if not max(abs(again_u - u), abs(again_v - v)) * focal_px < SAME_PX:
            return False
        for m in range(1, ALONG + 1):
            xx, xy, yy = slopes_one(k, x * m / ALONG, y * m / ALONG)
            if not xx * yy - xy * xy > 0.0:
                return False
    return True


@kernel
def corner_angle(focal_px, k, size_px):
    """Angle from the axis to the farthest corner [rad]."""
    farthest = 0.0
    for n in range(4):
        _, _, x, y = corner(focal_px, k, size_px, n)
        farthest = max(farthest, np.arctan(np.sqrt(x * x + y * y)))
    return farthest


@kernel
def across(focal_px, k, size_px):
    """Angle between the middles of the left and the right edge [rad]."""
    x, y = straight_one(k, -0.5 * size_px[0] / focal_px, 0.0)
    far_x, far_y = straight_one(k, 0.5 * size_px[0] / focal_px, 0.0)
    lengths = np.sqrt((1.0 + x * x + y * y) * (1.0 + far_x * far_x + far_y * far_y))
    cross_x, cross_y, cross_z = y - far_y, far_x - x, x * far_y - y * far_x
    sine = np.sqrt(cross_x * cross_x + cross_y * cross_y + cross_z * cross_z)
    return np.arctan2(sine / lengths, (x * far_x + y * far_y + 1.0) / lengths)
