"""What blocks from outside do to the increments of the IMU in a tick: coefficients for kernels.

In: the blocks that a filter has (`blocks.Block`), and what the IMU has measured. Out: `drive` (6, m) of an
ImuWindow, rad/s and m/s^2 for each of the last m errors, those from outside; they are constant in a tick.
"""

import numpy as np

from shefex_nav.onboard.navigation.blocks import ImuMean


def coefficients(nav, readings, end_s, dt_s):
    """`drive` of a tick that ends at end_s.

    nav : fusion.Filter;  readings : (n, 6) increments over dt_s each -> (6, m)
    """
    n = len(readings)
    mean = readings.sum(axis=0) / (n * dt_s)
    sensed = ImuMean(end_s - 0.5 * n * dt_s, mean[:3], mean[3:])
    columns = [
        np.zeros((6, block.size)) if block.drives is None else block.drives(sensed)
        for block in nav.params.blocks
        if block.name in nav.layout.names
    ]
    return np.hstack(columns)
