"""The spot of a star as a box, which is how the model of the IMPA paper counts (section 4.2).

Equation (26) has a streak of the length l cover r_psf l pixels, with the same light in all of them: that is a
square spot of r_psf pixels. A Gaussian has its third of a streak's light in the middle line too
(`field.PSF_SIGMA_PX`), but soft edges: the streak of a faint star is then narrower and shorter than that of a
bright one, and the threshold cuts it where the noise decides. The edges of a box stand still.
"""

from functools import lru_cache

import numpy as np

from shefex_nav.world.camera import render

PER_PX = 256  # places of the table in a pixel
STEP_PX = 0.5  # of a streak: two spots each, which a box of several pixels makes even


@lru_cache(maxsize=4)
def box(width_px):
    """Square spot of this width whose light is even: render.Psf."""
    reach_px = int(np.ceil(0.5 * width_px)) + 1
    x_px = np.arange(-reach_px * PER_PX, (reach_px + 1) * PER_PX + 1) / PER_PX
    cdf = np.clip(0.5 + x_px / width_px, 0.0, 1.0)
    first = np.arange(PER_PX + 1)[:, None] + PER_PX * np.arange(2 * reach_px)
    return render.Psf(cdf, cdf[first + PER_PX] - cdf[first], PER_PX, reach_px, float(width_px), STEP_PX)
