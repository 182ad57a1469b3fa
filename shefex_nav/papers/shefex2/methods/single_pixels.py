"""Sequential scan as section 3.2 prints it: single pixels over a threshold, grown and weighted by intensity.

One pass over the frame; an object begins at a pixel over the threshold and holds all pixels over it that hang
together, by a side or a corner, which is what region growing by recursion from the first of them finds. Its
place is the centre of mass of the intensities above the background. The threshold is in units of the noise
of a pixel (`seed_sigma`); the paper does not give it, and nothing of a second, lower one.

What lies below the threshold is missing in the centre of mass. Each pixel beside an object may hold any light
from none to the threshold t: a variance of t^2/12, which moves the centre by its distance over the object's
light. For faint stars that is two to five times the error by the noise of the pixels.
"""

import numpy as np

from shefex_nav.onboard.startracker.background import BLOCK, N_BLOCK
from shefex_nav.onboard.startracker.scan import (
    BACKGROUND,
    CUT,
    FLUX,
    NOISE,
    PIXELS,
    SATURATED,
    XX,
    XY,
    YY,
    X,
    Y,
)

SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))
CORNERS = np.ones((3, 3), dtype=int)  # neighbours by a corner are neighbours


def single_pixels(image_dn, blocks, background, sigma, rules):
    """Objects of a frame; parameters and result as of `scan.sequential`, `grow_sigma` is not used."""
    from scipy import ndimage  # a fifth of a second, and this way is seldom chosen

    tile_px, seed_sigma, _, fewest, most, largest_peak, saturation_dn, most_objects = rules
    rows, columns = image_dn.shape
    row_tile, column_tile = np.arange(rows) // tile_px, np.arange(columns) // tile_px
    level = (background / N_BLOCK)[row_tile][:, column_tile]
    noise = (sigma / BLOCK)[row_tile][:, column_tile]
    above = image_dn - level
    labels, n = ndimage.label(above > seed_sigma * noise, CORNERS)
    if n == 0:
        return np.empty((0, CUT.stop))
    y, x = np.nonzero(labels)
    label, value = labels[y, x] - 1, above[y, x]

    def total(values):
        return np.bincount(label, values, n)

    light, pixels = total(value), np.bincount(label, minlength=n)
    peak = np.zeros(n)
    np.maximum.at(peak, label, value)
    edge = (x == 0) | (y == 0) | (x == columns - 1) | (y == rows - 1)
    table = np.empty((n, CUT.stop))
    table[:, X], table[:, Y] = total(value * x) / light, total(value * y) / light
    dx, dy = x - table[label, X], y - table[label, Y]
    table[:, FLUX], table[:, PIXELS] = light, pixels
    table[:, SATURATED] = total(image_dn[y, x] >= saturation_dn)
    table[:, BACKGROUND], table[:, NOISE] = total(level[y, x]) / pixels, total(noise[y, x]) / pixels
    table[:, XX], table[:, YY] = total(value * dx * dx) / light, total(value * dy * dy) / light
    table[:, XY] = total(value * dx * dy) / light
    table[:, CUT] = _cut(labels, seed_sigma * noise, table)
    whole = (pixels >= fewest) & (pixels <= most) & (peak <= largest_peak * light) & (total(edge) == 0.0)
    table = table[whole]
    return table[np.argsort(-table[:, FLUX], kind="stable")][:most_objects]


def _cut(labels, threshold, table):
    """Covariance of the centres by the light that their neighbouring pixels may hold: xx, xy, yy (n, 3) px^2.

    labels : (rows, columns) number of the object of each pixel, 0 for none
    threshold : (rows, columns) grey values
    """
    rows, columns = labels.shape
    y, x = np.nonzero(labels)
    down, right = np.array(SIDES).T
    beside_y, beside_x = (y[:, None] + down).ravel(), (x[:, None] + right).ravel()
    label = np.repeat(labels[y, x] - 1, len(down))
    inside = (beside_y >= 0) & (beside_y < rows) & (beside_x >= 0) & (beside_x < columns)
    beside_y, beside_x, label = beside_y[inside], beside_x[inside], label[inside]
    outside = labels[beside_y, beside_x] == 0
    pixel = (label * rows + beside_y) * columns + beside_x
    pixel = np.unique(pixel[outside])  # each once for an object
    label, pixel = np.divmod(pixel, rows * columns)
    beside_y, beside_x = np.divmod(pixel, columns)
    variance = threshold[beside_y, beside_x] ** 2 / 12.0 / table[label, FLUX] ** 2
    dx, dy = beside_x - table[label, X], beside_y - table[label, Y]
    n = len(table)
    return np.column_stack([np.bincount(label, variance * d, n) for d in (dx * dx, dx * dy, dy * dy)])
